/* SPDX-License-Identifier: Apache-2.0 */
/* exposure.h - how bright a picture is made, by a histogram of the light in it. */
#ifndef BVHCTL_EXPOSURE_H
#define BVHCTL_EXPOSURE_H

#include <stdbool.h>
#include <stdint.h>

enum { EXPOSURE_BINS = 512 };

/* Numbers of pixels by the logarithm of their luminance. All zero: no pixels. */
struct histogram {
    uint64_t bins[EXPOSURE_BINS];
    uint64_t count;
};

/* Adds a pixel. Its luminance is linear; one that is not a number counts as black. */
void histogram_add(struct histogram *histogram, double luminance);

/* Returns the luminance that a fraction of the pixels does not exceed, within 4 %; 0 for no pixels. */
double histogram_percentile(const struct histogram *histogram, double fraction);

/*
 * Returns the factor for all light. The brightest parts of the subject, except for a few small ones, become as bright
 * as light_display still shows with contrast, so that a white body keeps its form. Outdoors a dark subject becomes a
 * little brighter; inside, where the light depends on the windows, the middle of the histogram becomes a middle grey as
 * far as the bright parts allow.
 */
double exposure_choose(const struct histogram *histogram, bool is_inside);

#endif
