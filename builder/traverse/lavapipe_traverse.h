/* SPDX-License-Identifier: Apache-2.0 */
/*
 * lavapipe_traverse.h - traces rays through structures of the lavapipe layout on the CPU, to check what was written
 * without the driver.
 *
 * It has the semantics, options and answers of traverse.h and uses the same exact triangle test, not the driver's
 * arithmetic. Instances' rays are transformed in double with the inverse of object_to_world; the driver's float inverse
 * in the structure is ignored. `record` of a hit is the leaf's place, `handle` the row of the scene's bottoms, so that
 * both targets give the same answers.
 */
#ifndef BVHD_LAVAPIPE_TRAVERSE_H
#define BVHD_LAVAPIPE_TRAVERSE_H

#include "builder/format/lavapipe.h"
#include "builder/traverse/traverse.h"

/*
 * The scene to trace: one bottom level, or a top level with the bottom levels of its handles. An instance whose handle
 * is row + 1, as written, uses bottoms[row], unless `rows` says otherwise. If there is no such row, or its view is
 * NULL, the instance counts as inactive.
 */
struct lavapipe_scene {
    const struct lavapipe_view *top; /* NULL: the scene is bottoms[0] alone */
    const struct lavapipe_view *const *bottoms;
    uint32_t bottom_count;
    const uint32_t *rows; /* the row of bottoms for each leaf of the top level; NULL: the row is the handle - 1 */
};

/* Works like traverse(). */
bool lavapipe_traverse(const struct lavapipe_scene *scene, const struct ray *ray,
                       const struct traverse_options *options, struct ray_hit *ret_hit,
                       struct traverse_counters *counters);

/* Works like traverse_positions(). */
void lavapipe_positions(const struct lavapipe_scene *scene, const struct ray_hit *hit, float ret_corners[3][3]);

/* Returns the VkGeometryInstanceFlagsKHR of an instance from its sbt_and_flags. */
uint32_t lavapipe_instance_flags(uint32_t sbt_and_flags);

#endif
