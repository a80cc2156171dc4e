/* SPDX-License-Identifier: Apache-2.0 */
/*
 * cpu_scene.h - the inside of struct bvhd_cpu_scene (bvhd_cpu.h), and what differs between targets. Internal.
 *
 * A new target needs a file cpu_TARGET.c with its struct cpu_target, members in the unions below, and its place in
 * cpu_scene.c (which recognises blobs) and cpu_trace.c (which calls the traversal directly).
 */
#ifndef BVHD_CPU_SCENE_H
#define BVHD_CPU_SCENE_H

#include <bvhd/bvhd_cpu.h>

#include "builder/format/positions.h"
#include "builder/traverse/lavapipe_traverse.h"
#include "builder/traverse/traverse.h"
#include "proto/base/bytes.h"

/* One blob of a scene, opened. */
struct cpu_structure {
    struct bytes blob; /* data is NULL if there is none */
    union {
        struct portable_view portable;
        struct lavapipe_view lavapipe;
    } view; /* by target; empty if there is no blob */
    struct unpacked_node *unpacked; /* the nodes of portable triangles or instances, if the machine uses them */
    struct unpacked_triangles *triangles; /* what the view of indexed triangles has become, if the machine uses it */
    struct positions *positions; /* NULL: a portable structure without ALLOW_DATA_ACCESS */
    bool is_shared; /* the view and what it needs belong to another structure with the same data */
};

struct cpu_target;

/* The levels of a scene. An empty structure of a native target does not tell its level. */
enum cpu_level { CPU_BOTTOM, CPU_TOP, CPU_EITHER };

struct bvhd_cpu_scene {
    const struct cpu_target *target;
    struct cpu_structure *structures; /* by index of the caller's blobs */
    uint32_t structure_count;
    uint32_t bottom_count; /* the first structures; the last one is the top level if there are fewer of these */
    uint32_t *rows; /* the bottom level of each handle, if the caller has said which; else NULL */
    void *views; /* pointers to the views of the bottom levels, NULL where there is none */
    const struct unpacked_node **unpacked; /* portable: those of the bottom levels, or NULL */
    union {
        struct scene portable;
        struct lavapipe_scene lavapipe;
    } walk; /* by target: what the traversal runs over */
};

/* The functions of one target. A hit that is passed to them names a bottom level that is there. */
struct cpu_target {
    enum target target;
    /* Opens a hostile blob, of which structure->blob is set, and prepares it for rays. */
    enum bvhd_status (*open)(struct cpu_structure *structure, struct bvhd_error *error);
    enum cpu_level (*level)(const struct cpu_structure *structure);
    /* Makes scene->views and scene->walk. Returns false if there is no memory. */
    bool (*make_walk)(struct bvhd_cpu_scene *scene);
    /* Return the number of instances in a top level, and of its serialized handles, and one of these. */
    uint32_t (*instance_count)(const struct cpu_structure *top);
    uint64_t (*handle_count)(const struct cpu_structure *top);
    uint64_t (*handle)(const struct cpu_structure *top, uint64_t index);
    /* Returns the bottom level of an instance, as the traversal finds it, and its place in the request. */
    uint64_t (*bottom)(const struct bvhd_cpu_scene *scene, uint32_t record, uint32_t *ret_instance);
    void (*bounds)(const struct cpu_structure *structure, float ret_bounds[6]);
    /* Returns false if there is no such triangle, or if it moves and `time` is NULL. */
    bool (*corners)(const struct bvhd_cpu_scene *scene, const struct ray_hit *hit, const float *time,
                    float ret_corners[3][3]);
    /* Returns false if there is no such sphere or linear swept sphere. NULL: the target has none. */
    bool (*ends)(const struct bvhd_cpu_scene *scene, const struct ray_hit *hit, float ret_ends[2][4]);
    /*
     * Gives the transform of an instance, by a record below instance_count. Returns false if it moves and `time` is
     * NULL, or has none at that time.
     */
    bool (*object_to_world)(const struct cpu_structure *top, uint32_t record, const float *time, float ret_matrix[12]);
};

extern const struct cpu_target cpu_portable, cpu_lavapipe;

/* Returns the top level, or NULL if there is none. */
static inline const struct cpu_structure *cpu_scene_top(const struct bvhd_cpu_scene *scene)
{
    return scene->bottom_count < scene->structure_count ? &scene->structures[scene->bottom_count] : NULL;
}

#endif
