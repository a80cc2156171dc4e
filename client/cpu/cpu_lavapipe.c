/* SPDX-License-Identifier: Apache-2.0 */
/* cpu_lavapipe.c - scenes of structures in the native layout of lavapipe. */
#include "client/cpu/cpu_scene.h"

#include <string.h>

#include "client/library.h"

/*
 * A native blob begins with the UUID of a driver's build, which no table here knows: only its contents say that it is
 * of another driver.
 */
static enum bvhd_status open_structure(struct cpu_structure *structure, struct bvhd_error *error)
{
    struct bvhd_error inner = {0};
    enum bvhd_status status = lavapipe_open_any(structure->blob, &library_memory, &structure->view.lavapipe, &inner);
    if (status == BVHD_CORRUPT)
        return bvhd_error_set(error, status, inner.where, "%s, or this is the structure of another driver", inner.text);
    if (status == BVHD_OK)
        status = positions_of_lavapipe(structure->blob, &structure->view.lavapipe, &library_memory,
                                       &structure->positions, &inner);
    if (status != BVHD_OK && error)
        *error = inner;
    return status;
}

static enum cpu_level level(const struct cpu_structure *structure)
{
    const struct lavapipe_view *view = &structure->view.lavapipe;
    return view->handle_count > 0 ? CPU_TOP : view->leaf_count > 0 ? CPU_BOTTOM : CPU_EITHER;
}

static bool make_walk(struct bvhd_cpu_scene *scene)
{
    const struct cpu_structure *top = cpu_scene_top(scene);
    const struct lavapipe_view **bottoms =
        memory_array(&library_memory, (uint64_t)scene->bottom_count + 1, sizeof *bottoms);
    if (!bottoms)
        return false;
    for (uint32_t i = 0; i < scene->bottom_count; i++)
        bottoms[i] = scene->structures[i].blob.data ? &scene->structures[i].view.lavapipe : NULL;
    scene->views = bottoms;
    scene->walk.lavapipe = (struct lavapipe_scene){
        .top = top ? &top->view.lavapipe : NULL,
        .bottoms = bottoms,
        .bottom_count = scene->bottom_count,
        .rows = scene->rows,
    };
    return true;
}

static uint32_t instance_count(const struct cpu_structure *top)
{
    return (uint32_t)top->view.lavapipe.handle_count;
}

static uint64_t handle_count(const struct cpu_structure *top)
{
    return top->view.lavapipe.handle_count;
}

static uint64_t handle(const struct cpu_structure *top, uint64_t index)
{
    return bytes_get64(top->view.lavapipe.handles + 8 * index);
}

static uint64_t bottom(const struct bvhd_cpu_scene *scene, uint32_t record, uint32_t *ret_instance)
{
    const struct cpu_structure *top = cpu_scene_top(scene);
    *ret_instance = lavapipe_instance_at(&top->view.lavapipe, record).instance;
    return scene->rows ? scene->rows[record] : handle(top, record) - 1;
}

static void get_bounds(const struct cpu_structure *structure, float ret_bounds[6])
{
    const struct lavapipe_box root = lavapipe_box_at(&structure->view.lavapipe, LAVAPIPE_HEADER);
    lavapipe_box_bounds(&root, ret_bounds);
}

static bool get_corners(const struct bvhd_cpu_scene *scene, const struct ray_hit *hit, const float *time,
                        float ret_corners[3][3])
{
    (void)time; /* nothing moves here */
    const struct lavapipe_view *view = &scene->structures[hit->handle].view.lavapipe;
    if (hit->record >= view->leaf_count || view->kind != LAVAPIPE_TRIANGLE)
        return false;
    lavapipe_positions(&scene->walk.lavapipe, hit, ret_corners);
    return true;
}

static bool get_matrix(const struct cpu_structure *top, uint32_t record, const float *time, float ret_matrix[12])
{
    (void)time;
    const struct lavapipe_instance instance = lavapipe_instance_at(&top->view.lavapipe, record);
    memcpy(ret_matrix, instance.object_to_world, sizeof instance.object_to_world);
    return true;
}

const struct cpu_target cpu_lavapipe = {
    .target = TARGET_LAVAPIPE,
    .open = open_structure,
    .level = level,
    .make_walk = make_walk,
    .instance_count = instance_count,
    .handle_count = handle_count,
    .handle = handle,
    .bottom = bottom,
    .bounds = get_bounds,
    .corners = get_corners,
    .object_to_world = get_matrix,
};
