/* SPDX-License-Identifier: Apache-2.0 */
/*
 * round_walk.h - one ray through one structure of spheres or linear swept spheres with AVX2 (round_avx2.c): its data,
 * and the walks from a node on. Internal: packet_avx2.c uses them where few rays of a packet are left.
 */
#ifndef BVHD_ROUND_WALK_H
#define BVHD_ROUND_WALK_H

#include "builder/traverse/avx2_walk.h"
#include "builder/traverse/round_lanes.h"

#ifdef BOXTEST_AVX2

/* One ray through round kinds. */
struct round_walk {
    struct avx2_walk nodes; /* without its triangles */
    const float *shapes; /* of an unpacked structure */
    bool is_prepared; /* the state's round_ray and `lanes` are prepared, which they are at the first leaf */
    struct round_lanes_ray lanes;
};

/*
 * Prepares a plain ray in world space, of which the state is settled, for an unpacked structure. Returns false if boxes
 * have to be tested in another way.
 */
bool round_walk_begin(struct round_walk *walk, struct traverse_state *state, const struct portable_view *view,
                      const struct unpacked_node *unpacked);

/* Walks an unpacked structure from a node on, for the closest hit. */
void round_walk_closest(struct round_walk *walk, uint32_t node);

#endif
#endif
