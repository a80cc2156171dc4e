/* SPDX-License-Identifier: Apache-2.0 */
/*
 * lavapipe_traverse.h - rays through structures of the lavapipe layout, on the CPU: for checking what was written, without the driver.
 *
 * The semantics, options and answers of traverse.h, by the same exact triangle test; not the driver's arithmetic. `record` of a hit is the leaf's place,
 * `handle` the handle's row, which for this layout is the instance's leaf.
 */
#ifndef BVHD_LAVAPIPE_TRAVERSE_H
#define BVHD_LAVAPIPE_TRAVERSE_H

#include "lavapipe.h"
#include "traverse.h"

/* One bottom level, or a top level with one view for each handle of it (NULL view: as if inactive). */
struct lavapipe_scene {
    const struct lavapipe_view *top; /* NULL: bottoms[0] alone */
    const struct lavapipe_view *const *bottoms;
    uint32_t bottom_count;
};

/* As traverse(). */
bool lavapipe_traverse(const struct lavapipe_scene *scene, const struct ray *ray, const struct traverse_options *options,
                       struct ray_hit *ret_hit, struct traverse_counters *counters);

/* As traverse_positions(). */
void lavapipe_positions(const struct lavapipe_scene *scene, const struct ray_hit *hit, float ret_corners[3][3]);

#endif
