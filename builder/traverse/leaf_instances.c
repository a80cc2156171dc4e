/* SPDX-License-Identifier: Apache-2.0 */
/* leaf_instances.c - leaves of instances, whose structures a ray enters. */
#include "builder/traverse/leaf_kind.h"

void traverse_walk_instance(struct traverse_walk *walk, uint32_t row)
{
    const struct scene *scene = walk->scene;
    const struct portable_instance *record = (const struct portable_instance *)scene->top->records + row;
    uint32_t bottom = scene->rows ? scene->rows[record->handle] : record->handle;
    if (!(record->custom_and_mask >> 24 & walk->state.ray->cull_mask) || bottom >= scene->bottom_count)
        return;
    if (!scene->bottoms[bottom])
        return;
    const struct traverse_instance instance = {record->custom_and_mask, record->sbt_and_flags, record->instance, bottom,
                                               row};
    traverse_state_to_object(&walk->state, record->object_to_world);
    walk->in_world = false;
    walk->state.counters.instances++;
    traverse_walk_bottom(walk, bottom, &instance);
}

static void visit_instances(struct traverse_walk *walk, uint32_t first, uint32_t count)
{
    for (uint32_t i = 0; i < count && !walk->state.is_done; i++)
        traverse_walk_instance(walk, first + (walk->state.options->flip_order ? count - 1 - i : i));
}

const struct leaf_kind leaf_instances = {
    .is_top = true,
    .can_unpack = true,
    .visit = visit_instances,
};
