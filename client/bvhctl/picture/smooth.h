/* SPDX-License-Identifier: Apache-2.0 */
/*
 * smooth.h - removes the noise from a picture's ambient light and from the soft edges of its shadows, and preserves
 * other edges (edge-avoiding a-trous filter, Dammertz 2010).
 */
#ifndef BVHCTL_SMOOTH_H
#define BVHCTL_SMOOTH_H

#include <stdbool.h>

#include "proto/base/memory.h"
#include "proto/base/parallel.h"

struct pixel {
    float backdrop[3], albedo[3]; /* light.h */
    float sun[3]; /* the light of the sun that it would reflect without shadows */
    float lit; /* the part of it that is not in a shadow, 0 to 1 */
    float ambient[3]; /* the mean of its samples with a surface */
    float normal[3]; /* unit, or 0 without a surface */
    float position[3]; /* relative to the camera, divided by the distance from it: its length is about 1 */
    bool is_subject; /* it shows something of the scene, and not the floor or the sky */
    float depth; /* that distance, divided by the size of the stage */
};

/*
 * Smooths `ambient` of all pixels, and `lit` of those in the soft edge of a shadow, which are means of that many
 * `samples`: of many less, and of 64 not at all. Returns false when there is no memory.
 */
bool smooth_light(struct pixel *pixels, uint32_t width, uint32_t height, uint32_t samples,
                  const struct parallel *parallel, struct memory *memory);

#endif
