/* SPDX-License-Identifier: Apache-2.0 */
/*
 * lavapipe_traverse.h - rays through structures of the lavapipe layout, on the CPU: for checking what was written,
 * without the driver.
 *
 * The semantics, options and answers of traverse.h, by the same exact triangle test; not the driver's arithmetic.
 * Instances' rays are transformed in double with the inverse of object_to_world; the inverse in the structure, which is
 * the driver's in float, is not looked at. `record` of a hit is the leaf's place, `handle` the row of the scene's
 * bottoms, so both targets give the same.
 */
#ifndef BVHD_LAVAPIPE_TRAVERSE_H
#define BVHD_LAVAPIPE_TRAVERSE_H

#include "builder/format/lavapipe.h"
#include "builder/traverse/traverse.h"

/*
 * One bottom level, or a top level with what its handles name: an instance whose handle is row + 1, as written, is of
 * bottoms[row]. Where there is no such row, or its view is NULL, the instance is as if inactive.
 */
struct lavapipe_scene {
    const struct lavapipe_view *top; /* NULL: bottoms[0] alone */
    const struct lavapipe_view *const *bottoms;
    uint32_t bottom_count;
};

/* As traverse(). */
bool lavapipe_traverse(const struct lavapipe_scene *scene, const struct ray *ray,
                       const struct traverse_options *options, struct ray_hit *ret_hit,
                       struct traverse_counters *counters);

/* As traverse_positions(). */
void lavapipe_positions(const struct lavapipe_scene *scene, const struct ray_hit *hit, float ret_corners[3][3]);

/* An instance's VkGeometryInstanceFlagsKHR, of its sbt_and_flags. */
uint32_t lavapipe_instance_flags(uint32_t sbt_and_flags);

#endif
