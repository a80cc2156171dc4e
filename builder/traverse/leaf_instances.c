/* SPDX-License-Identifier: Apache-2.0 */
/* leaf_instances.c - leaves of instances and of motion instances, whose structures a ray enters. */
#include "builder/traverse/leaf_kind.h"
#include "builder/traverse/motion.h"

/* Returns whether the ray sees an instance, whose bottom level is there; and gives the row of that. */
static inline bool is_seen(const struct traverse_walk *walk, uint32_t custom_and_mask, uint32_t handle,
                           uint32_t *ret_bottom)
{
    const struct scene *scene = walk->scene;
    const uint32_t bottom = scene->rows ? scene->rows[handle] : handle;
    *ret_bottom = bottom;
    return custom_and_mask >> 24 & walk->state.ray->cull_mask && bottom < scene->bottom_count && scene->bottoms[bottom];
}

static inline void enter(struct traverse_walk *walk, const struct traverse_instance *instance, const float matrix[12])
{
    traverse_state_to_object(&walk->state, matrix);
    walk->in_world = false;
    walk->state.counters.instances++;
    traverse_walk_bottom(walk, instance->bottom, instance);
}

void traverse_walk_instance(struct traverse_walk *walk, uint32_t row)
{
    const struct portable_instance *record = (const struct portable_instance *)walk->scene->top->records + row;
    uint32_t bottom;
    if (!is_seen(walk, record->custom_and_mask, record->handle, &bottom))
        return;
    const struct traverse_instance instance = {record->custom_and_mask, record->sbt_and_flags, record->instance, bottom,
                                               row};
    enter(walk, &instance, record->object_to_world);
}

void traverse_walk_moving_instance(struct traverse_walk *walk, uint32_t row)
{
    const struct portable_moving_instance *record =
        (const struct portable_moving_instance *)walk->scene->top->records + row;
    uint32_t bottom;
    if (!is_seen(walk, record->custom_and_mask, record->handle, &bottom) ||
        !motion_matrix(record, walk->state.ray->time, walk->matrix))
        return;
    const struct traverse_instance instance = {record->custom_and_mask, record->sbt_and_flags, record->instance, bottom,
                                               row};
    enter(walk, &instance, walk->matrix);
}

static void visit_instances(struct traverse_walk *walk, uint32_t first, uint32_t count)
{
    for (uint32_t i = 0; i < count && !walk->state.is_done; i++)
        traverse_walk_instance(walk, first + (walk->state.options->flip_order ? count - 1 - i : i));
}

static void visit_moving_instances(struct traverse_walk *walk, uint32_t first, uint32_t count)
{
    for (uint32_t i = 0; i < count && !walk->state.is_done; i++)
        traverse_walk_moving_instance(walk, first + (walk->state.options->flip_order ? count - 1 - i : i));
}

const struct leaf_kind leaf_instances = {
    .is_top = true,
    .can_unpack = true,
    .visit = visit_instances,
};

const struct leaf_kind leaf_moving_instances = {
    .is_top = true,
    .moves = true,
    .visit = visit_moving_instances,
};
