/* SPDX-License-Identifier: Apache-2.0 */
/*
 * smooth.h - taking the noise out of a picture's ambient light without touching edges (edge-avoiding a-trous filter,
 * Dammertz 2010).
 */
#ifndef BVHCTL_SMOOTH_H
#define BVHCTL_SMOOTH_H

#include <stdbool.h>

#include "proto/base/memory.h"
#include "proto/base/parallel.h"

struct pixel {
    float backdrop[3], albedo[3], direct[3]; /* light.h */
    float ambient[3]; /* of its surface samples */
    float normal[3]; /* unit, or 0 without a surface */
    float position[3]; /* from the camera, in units of the distance there: of about 1 */
    float depth; /* that distance, in units of the stage's size */
};

/* Smooths `ambient` of all pixels. false: no memory. */
bool smooth_ambient(struct pixel *pixels, uint32_t width, uint32_t height, const struct parallel *parallel,
                    struct memory *memory);

#endif
