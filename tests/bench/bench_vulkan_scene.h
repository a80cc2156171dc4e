/* SPDX-License-Identifier: Apache-2.0 */
/*
 * bench_vulkan_scene.h - recovers the input of a scene that `bvhctl build` wrote for the portable target, so that the
 * driver can build from what our structures were built from.
 */
#ifndef BVHD_BENCH_VULKAN_SCENE_H
#define BVHD_BENCH_VULKAN_SCENE_H

#include "bvhd/bvhd.h"
#include "builder/format/canonical.h"
#include "builder/context.h"
#include "tests/support/driver/driver_structure.h"
#include "client/bvhctl/scene/structures.h"

/* The triangles of one bottom level, as in a build request. */
struct bench_mesh {
    float *positions;
    uint32_t *indices;
    uint32_t vertex_count, triangle_count;
};

struct bench_scene {
    struct structures given; /* the structures as read */
    struct canonical *bottoms; /* in the order of the top level's table of references */
    struct canonical top; /* if given.has_top */
    struct bench_mesh *meshes;
    uint64_t triangle_count; /* over distinct bottom levels */
    struct memory *memory;
};

struct bench_scene_options {
    const char *directory;
    bool is_bottom; /* leave out a top level of one instance */
    bool is_shuffled; /* shuffle the triangles of each geometry, with `seed` */
    uint64_t seed;
};

/*
 * Opens triangles and instances only: returns BVHD_UNSUPPORTED for AABBs and for other targets. The caller ends the
 * scene with bench_scene_close.
 */
enum bvhd_status bench_scene_open(const struct bench_scene_options *options, struct memory *memory,
                                  const struct parallel *parallel, struct bench_scene *ret_scene,
                                  struct bvhd_error *error);
void bench_scene_close(struct bench_scene *scene);

/* Return a structure as read. */
static inline const struct portable_view *bench_scene_bottom(const struct bench_scene *scene, uint32_t row)
{
    return &scene->given.files[row].structure.view.portable;
}

static inline const struct portable_view *bench_scene_top(const struct bench_scene *scene)
{
    return &structures_top(&scene->given)->view.portable;
}

/* Builds the scene again in this process. The caller closes the result with structures_close. */
enum bvhd_status bench_scene_build(const struct bench_scene *scene, const struct build_options *options,
                                   const struct build_context *context, struct structures *ret_structures,
                                   struct bvhd_error *error);

/* The driver's own structures: built with PREFER_FAST_TRACE, bottom levels compacted. */
struct bench_driver {
    struct driver_structure *bottoms;
    struct driver_structure top;
    uint32_t bottom_count;
    uint64_t bytes; /* after compaction */
    double build_ms; /* wall time, including compaction */
    struct gpu *gpu;
    struct memory *memory;
};

enum bvhd_status bench_driver_build(struct gpu *gpu, const struct bench_scene *scene, struct memory *memory,
                                    struct bench_driver *ret_driver, struct bvhd_error *error);
void bench_driver_destroy(struct bench_driver *driver);

#endif
