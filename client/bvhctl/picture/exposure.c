/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/picture/exposure.h"

#include <math.h>

/* The logarithms to base 2 of the limits of the histogram. */
static const double darkest = -16, brightest = 12;

void histogram_add(struct histogram *histogram, double luminance)
{
    double at = luminance > 0 ? (log2(luminance) - darkest) / (brightest - darkest) * EXPOSURE_BINS : 0;
    int bin = at < 0 ? 0 : at >= EXPOSURE_BINS ? EXPOSURE_BINS - 1 : (int)at;
    histogram->bins[bin]++;
    histogram->count++;
}

double histogram_percentile(const struct histogram *histogram, double fraction)
{
    double wanted = fraction * (double)histogram->count;
    uint64_t seen = 0;
    for (int i = 0; i < EXPOSURE_BINS; i++) {
        seen += histogram->bins[i];
        if (seen > 0 && (double)seen >= wanted)
            return exp2(darkest + (i + 0.5) / EXPOSURE_BINS * (brightest - darkest));
    }
    return 0;
}

double exposure_choose(const struct histogram *histogram, bool is_inside)
{
    /* luminances after the exposure, in the unit of light_display */
    static const double bright = 1.15, bright_inside = 1.6, middle_inside = 0.3;
    double high = histogram_percentile(histogram, is_inside ? 0.95 : 0.98);
    double middle = histogram_percentile(histogram, 0.5);
    if (!(high > 0) || !(middle > 0))
        return 1;
    if (is_inside)
        return fmin(fmax(fmin(middle_inside / middle, bright_inside / high), 0.3), 8);
    return fmin(fmax(bright / high, 0.4), 1.8);
}
