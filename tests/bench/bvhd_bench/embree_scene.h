/* SPDX-License-Identifier: Apache-2.0 */
/* embree_scene.h - times rtcCommitScene over one mesh, and traces the result with rtcIntersect1. */
#ifndef BVHD_BENCH_EMBREE_SCENE_H
#define BVHD_BENCH_EMBREE_SCENE_H

#include "tests/bench/bvhd_bench/method.h"
#include "tests/support/scene/ply.h"
#include "builder/traverse/traverse.h"

struct embree_scene;

/*
 * Returns NULL when Embree fails. Each scene has its own device. While it lives, its number of threads applies to every
 * Embree device of the process.
 */
struct embree_scene *embree_scene_build(const struct method *method, const struct ply *mesh, unsigned threads);
void embree_scene_destroy(struct embree_scene *scene);

/* Milliseconds of rtcCommitScene alone. */
double embree_scene_ms(const struct embree_scene *scene);
/*
 * Bytes that the commit left allocated in the device. They exclude vertices and indices, which belong to the caller,
 * although tracing a COMPACT scene needs them.
 */
uint64_t embree_scene_bytes(const struct embree_scene *scene);

/*
 * Works like traverse(): finds the closest hit, or any hit with RAY_TERMINATE_ON_FIRST_HIT. In the latter case only the
 * return value says whether there is a hit; *ret_hit is not set.
 */
bool embree_scene_trace(const struct embree_scene *scene, const struct ray *ray, struct ray_hit *ret_hit);

#endif
