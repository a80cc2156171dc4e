/* SPDX-License-Identifier: Apache-2.0 */
/*
 * triangle_bake.h - the states of all micro-triangles of one triangle in a texture.
 *
 * It goes down from the whole triangle along the curve of micro_triangle.h: what is decided for a micro-triangle is
 * decided for all that it consists of, so only the surroundings of outlines are looked at closely.
 */
#ifndef BVHD_TRIANGLE_BAKE_H
#define BVHD_TRIANGLE_BAKE_H

#include <stdatomic.h>

#include "builder/micromap/micro_scan.h"

/* What all triangles have in common. */
struct triangle_baker {
    const struct alpha_cells *cells;
    const atomic_bool *cancel; /* may be NULL */
};

/*
 * Returns the set of what the test decides in the whole triangle, as micro_scan does, for any triangle that
 * texture_triangle_init has placed.
 */
unsigned triangle_bake_whole(const struct triangle_baker *baker, const struct texture_triangle *triangle);

/*
 * Writes the states at a level to micro_triangle_bytes(format, level) bytes, and adds to counts[s] the number of
 * micro-triangles that have state s. A state that is not unknown is right at each point of the micro-triangle in the
 * 4-state format. In the 2-state format states without certainty are those of the middles. Returns false if it was
 * cancelled; then the states are unfinished.
 */
bool triangle_bake_states(const struct triangle_baker *baker, const struct texture_triangle *triangle,
                          enum micro_format format, unsigned level, unsigned char *states,
                          uint32_t counts[MICRO_STATES]);

/*
 * Computes how much is decided for certain at each level from 0 to `last`: ret_decided[level] of MICRO_COUNT_MAX equal
 * parts of the triangle. It ends before `last` as soon as no further level could decide `worth` parts or more for each
 * byte that its states take more than those of the level before; the levels that follow then have the last number.
 * Returns false if it was cancelled.
 */
bool triangle_bake_explore(const struct triangle_baker *baker, const struct texture_triangle *triangle,
                           enum micro_format format, unsigned last, double worth,
                           uint32_t ret_decided[MICRO_LEVEL_MAX + 1]);

#endif
