/* SPDX-License-Identifier: Apache-2.0 */
/*
 * srt_bounds.h - bounds of what an SRT moves. While the quaternions of both ends are interpolated, the structure turns
 * about one axis at a speed that varies, so that its corners move on curves, and a box between those of both ends may
 * not hold it.
 */
#ifndef BVHD_SRT_BOUNDS_H
#define BVHD_SRT_BOUNDS_H

#include "builder/format/srt.h"
#include "proto/base/box.h"

/*
 * Finds the boxes at t = 0 and t = 1 of what is in `box` and is moved by the SRT whose numbers are interpolated in
 * float, each rounded by less than 2^-22 of the greater magnitude at both ends: the box that is interpolated between
 * them holds it at each time. Each holds all rotations with the scales and the translation of its end. The numbers are
 * finite, and the result is too.
 *
 * The turn is divided into parts of at most 15 degrees. A point moves on an arc from one end of a part to the other,
 * which leaves the line between them by at most r (1 - cos(angle / 2)), where r bounds its distance from the axis. A
 * quaternion that comes near zero may turn anywhere; then the box holds the whole ball around the pivot.
 */
void srt_bounds(const float start[SRT_NUMBERS], const float end[SRT_NUMBERS], const struct box *box,
                struct box ret_boxes[2]);

#endif
