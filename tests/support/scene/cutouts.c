/* SPDX-License-Identifier: Apache-2.0 */
/* cutouts.c - draws a leaf and a fence from distances to their outlines. */
#include "tests/support/scene/cutouts.h"

#include <math.h>

/* Of the leaf, in units of the picture: where blade and stalk end, and half their widths. */
static const double leaf_tip = 0.04, leaf_base = 0.90, leaf_half = 0.24, stalk_half = 0.012, stalk_end = 0.985;

/*
 * Of the fence: half the width of a wire, as of one of 2.5 mm around meshes of 50 mm; and where the wires are. Beside
 * the corners of the picture, and of its parts down to a sixteenth, they touch fewer parts than if they went through
 * them.
 */
static const double wire_half = 0.0177, wire_place = 1. / 32;

/* Half the width of the blade at height y: it is widest near its base, pointed at the tip, and smooth. */
static double blade_half(double y)
{
    const double t = (y - leaf_tip) / (leaf_base - leaf_tip);
    return t <= 0 || t >= 1 ? 0 : leaf_half * sin(acos(-1.0) * pow(t, 1.25));
}

/* Returns the distance of a point from the leaf's outline, above 0 inside; it is about right near the outline. */
static double leaf_distance(double x, double y)
{
    const double step = 1e-4, half = blade_half(y), side = fabs(x - 0.5);
    const double slope = (blade_half(y + step) - blade_half(y - step)) / (2 * step);
    const double blade = y > leaf_tip && y < leaf_base ? (half - side) / sqrt(1 + slope * slope)
                                                       : -fmax(side, fmax(leaf_tip - y, y - leaf_base));
    const double stalk = fmin(stalk_half - side, fmin(stalk_end - y, y - (leaf_base + leaf_tip) / 2));
    return fmax(blade, stalk);
}

static double fence_distance(double x, double y)
{
    const double down = x - y - wire_place, up = x + y - wire_place;
    return wire_half - fmin(fabs(down - rint(down)), fabs(up - rint(up))) / sqrt(2);
}

/* Returns a texel's alpha, of the picture with so many texels a side; x and y are its middle. */
static unsigned char texel(enum cutout cutout, double size, double x, double y)
{
    const double distance = cutout == CUTOUT_LEAF ? leaf_distance(x, y) : fence_distance(x, y);
    const double share = distance * size + 0.5;
    return (unsigned char)lrint(255 * (share < 0 ? 0 : share > 1 ? 1 : share));
}

void cutout_draw(enum cutout cutout, uint32_t size, unsigned char *ret_alpha)
{
    cutout_draw_atlas(cutout, size, 1, ret_alpha);
}

void cutout_draw_atlas(enum cutout cutout, uint32_t size, uint32_t count, unsigned char *ret_alpha)
{
    const uint32_t part = size / count;
    for (uint32_t row = 0; row < size; row++)
        for (uint32_t column = 0; column < size; column++) {
            const uint32_t number = row / part * count + column / part;
            double x = (column % part + 0.5) / part, y = (row % part + 0.5) / part;
            if (cutout == CUTOUT_LEAF && number & 1)
                x = 1 - x;
            if (cutout == CUTOUT_LEAF && number & 2)
                y = 1 - y;
            if (cutout == CUTOUT_LEAF && number % 3 == 1) {
                const double kept = x;
                x = y;
                y = kept;
            }
            ret_alpha[(size_t)row * size + column] = texel(cutout, part, x, y);
        }
}
