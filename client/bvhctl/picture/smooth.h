/* SPDX-License-Identifier: Apache-2.0 */
/*
 * smooth.h - removes the noise from a picture's ambient light and preserves edges (edge-avoiding a-trous filter,
 * Dammertz 2010).
 */
#ifndef BVHCTL_SMOOTH_H
#define BVHCTL_SMOOTH_H

#include <stdbool.h>

#include "proto/base/memory.h"
#include "proto/base/parallel.h"

struct pixel {
    float backdrop[3], albedo[3], direct[3]; /* light.h */
    float ambient[3]; /* the mean of its samples with a surface */
    float normal[3]; /* unit, or 0 without a surface */
    float position[3]; /* relative to the camera, divided by the distance from it: its length is about 1 */
    float depth; /* that distance, divided by the size of the stage */
};

/* Smooths `ambient` of all pixels. Returns false when there is no memory. */
bool smooth_ambient(struct pixel *pixels, uint32_t width, uint32_t height, const struct parallel *parallel,
                    struct memory *memory);

#endif
