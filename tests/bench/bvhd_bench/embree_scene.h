/* SPDX-License-Identifier: Apache-2.0 */
/* embree_scene.h - rtcCommitScene over one mesh, and rtcIntersect1 through the result. */
#ifndef BVHD_BENCH_EMBREE_SCENE_H
#define BVHD_BENCH_EMBREE_SCENE_H

#include "tests/bench/bvhd_bench/method.h"
#include "tests/support/scene/ply.h"
#include "builder/traverse/traverse.h"

struct embree_scene;

/*
 * NULL when Embree fails. Each has a device of its own, which decides on the number of threads of every device of the
 * process.
 */
struct embree_scene *embree_scene_build(const struct method *method, const struct ply *mesh, unsigned threads);
void embree_scene_destroy(struct embree_scene *scene);

/* Of rtcCommitScene alone. */
double embree_scene_ms(const struct embree_scene *scene);
/*
 * What the commit left behind in the device. Vertices and indices, which COMPACT scenes need to be traced, are the
 * caller's.
 */
uint64_t embree_scene_bytes(const struct embree_scene *scene);

/* As traverse(): closest hit, or any with RAY_TERMINATE_ON_FIRST_HIT, of which then only that there is one is told. */
bool embree_scene_trace(const struct embree_scene *scene, const struct ray *ray, struct ray_hit *ret_hit);

#endif
