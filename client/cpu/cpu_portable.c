/* SPDX-License-Identifier: Apache-2.0 */
/* cpu_portable.c - scenes of portable structures. */
#include "client/cpu/cpu_scene.h"

#include <inttypes.h>
#include <string.h>

#include "builder/format/record_kind.h"
#include "builder/traverse/boxtest.h"
#include "builder/traverse/motion.h"
#include "client/library.h"

/* Puts the corners of triangles beside each other, so that rays need not fetch them one by one. */
static enum bvhd_status store_corners(struct cpu_structure *structure, struct bvhd_error *error)
{
    const uint32_t count = structure->view.portable.header->record_count;
    structure->triangles = memory_alloc(&library_memory, unpacked_triangles_size(count));
    if (!structure->triangles)
        return bvhd_error_no_memory(error, "data", "no memory for the corners of %" PRIu32 " triangles", count);
    unpacked_store_corners(&structure->view.portable, structure->triangles);
    return BVHD_OK;
}

/* Unpacks what moves, of which the first node stands for all that is unpacked. */
static enum bvhd_status unpack_moving(struct cpu_structure *structure, struct bvhd_error *error)
{
    const struct portable_header *header = structure->view.portable.header;
    struct unpacked_moving_node *nodes = memory_alloc(&library_memory, unpacked_moving_size(header));
    if (!nodes)
        return bvhd_error_no_memory(error, "data", "no memory to unpack %" PRIu32 " nodes", header->node_count);
    unpacked_moving_fill(&structure->view.portable, nodes);
    structure->unpacked = &nodes->start;
    return BVHD_OK;
}

/* Unpacks the nodes where the traversal uses them. */
static enum bvhd_status unpack(struct cpu_structure *structure, struct bvhd_error *error)
{
    const struct portable_header *header = structure->view.portable.header;
    const bool moves = header->content == PORTABLE_MOVING_TRIANGLES || header->content == PORTABLE_MOVING_INSTANCES;
    if (moves && header->node_count > 0 && boxtest_has_avx2())
        return unpack_moving(structure, error);
    if (!unpacked_takes(header->content) || header->node_count == 0 || !boxtest_has_avx2())
        return BVHD_OK;
    structure->unpacked = memory_alloc(&library_memory, unpacked_size(header));
    if (!structure->unpacked)
        return bvhd_error_no_memory(error, "data", "no memory to unpack %" PRIu32 " nodes", header->node_count);
    unpacked_fill(&structure->view.portable, structure->unpacked);
    return header->content == PORTABLE_INDEXED_TRIANGLES ? store_corners(structure, error) : BVHD_OK;
}

static enum bvhd_status open_structure(struct cpu_structure *structure, struct bvhd_error *error)
{
    if ((uintptr_t)structure->blob.data % 16 != 0)
        return bvhd_error_set(error, BVHD_INVALID, "data", "a portable structure is aligned to 16 bytes");
    const struct portable_view *view = &structure->view.portable;
    enum bvhd_status status = portable_open(structure->blob, &library_memory, &structure->view.portable, error);
    if (status == BVHD_OK && view->header->build_flags & BUILD_ALLOW_DATA_ACCESS) /* before its records are unpacked */
        status = positions_of_portable(structure->blob, view, &library_memory, &structure->positions, error);
    return status == BVHD_OK ? unpack(structure, error) : status;
}

static enum cpu_level level(const struct cpu_structure *structure)
{
    return record_kind_is_top(structure->view.portable.header->content) ? CPU_TOP : CPU_BOTTOM;
}

static bool make_walk(struct bvhd_cpu_scene *scene)
{
    const struct cpu_structure *top = cpu_scene_top(scene);
    const struct portable_view **bottoms =
        memory_array(&library_memory, (uint64_t)scene->bottom_count + 1, sizeof *bottoms);
    if (!bottoms)
        return false;
    scene->views = bottoms;
    scene->unpacked = memory_array(&library_memory, (uint64_t)scene->bottom_count + 1, sizeof *scene->unpacked);
    if (!scene->unpacked)
        return false;
    for (uint32_t i = 0; i < scene->bottom_count; i++) {
        bottoms[i] = scene->structures[i].blob.data ? &scene->structures[i].view.portable : NULL;
        scene->unpacked[i] = scene->structures[i].unpacked;
    }
    scene->walk.portable = (struct scene){
        .top = top ? &top->view.portable : NULL,
        .bottoms = bottoms,
        .bottom_count = scene->bottom_count,
        .rows = scene->rows,
        .unpacked = scene->unpacked,
        .unpacked_top = top ? top->unpacked : NULL,
    };
    traverse_settle(&scene->walk.portable);
    return true;
}

static uint32_t instance_count(const struct cpu_structure *top)
{
    return top->view.portable.header->record_count;
}

static uint64_t handle_count(const struct cpu_structure *top)
{
    return top->view.portable.handle_count;
}

static uint64_t handle(const struct cpu_structure *top, uint64_t index)
{
    return bytes_get64(top->view.portable.handles + 8 * index);
}

static bool has_moving_instances(const struct cpu_structure *top)
{
    return top->view.portable.header->content == PORTABLE_MOVING_INSTANCES;
}

static const struct portable_instance *instance_at(const struct cpu_structure *top, uint32_t record)
{
    return (const struct portable_instance *)top->view.portable.records + record;
}

static const struct portable_moving_instance *moving_instance_at(const struct cpu_structure *top, uint32_t record)
{
    return (const struct portable_moving_instance *)top->view.portable.records + record;
}

static uint64_t bottom(const struct bvhd_cpu_scene *scene, uint32_t record, uint32_t *ret_instance)
{
    const struct cpu_structure *top = cpu_scene_top(scene);
    const bool moves = has_moving_instances(top);
    const uint32_t handle = moves ? moving_instance_at(top, record)->handle : instance_at(top, record)->handle;
    *ret_instance = moves ? moving_instance_at(top, record)->instance : instance_at(top, record)->instance;
    return scene->rows ? scene->rows[handle] : handle;
}

static void get_bounds(const struct cpu_structure *structure, float ret_bounds[6])
{
    memcpy(ret_bounds, structure->view.portable.header->bounds, sizeof(float[6]));
}

static bool get_corners(const struct bvhd_cpu_scene *scene, const struct ray_hit *hit, const float *time,
                        float ret_corners[3][3])
{
    const struct portable_header *header = scene->structures[hit->handle].view.portable.header;
    const bool moves = header->content == PORTABLE_MOVING_TRIANGLES;
    if (!(moves ? time != NULL : header->content <= PORTABLE_TRIANGLES) || hit->record >= header->record_count)
        return false;
    traverse_positions_at(&scene->walk.portable, hit, time ? *time : 0, ret_corners);
    return true;
}

static bool get_ends(const struct bvhd_cpu_scene *scene, const struct ray_hit *hit, float ret_ends[2][4])
{
    const struct portable_view *view = &scene->structures[hit->handle].view.portable;
    const bool is_swept = view->header->content == PORTABLE_SWEPT_SPHERES;
    if ((!is_swept && view->header->content != PORTABLE_SPHERES) || hit->record >= view->header->record_count)
        return false;
    const struct portable_round *round = (const struct portable_round *)view->records + hit->record;
    const float *vertex = view->vertices + (uint64_t)4 * round->vertex;
    memcpy(ret_ends[0], vertex, sizeof ret_ends[0]);
    memcpy(ret_ends[1], is_swept ? vertex + 4 : vertex, sizeof ret_ends[1]);
    return true;
}

static bool get_matrix(const struct cpu_structure *top, uint32_t record, const float *time, float ret_matrix[12])
{
    if (has_moving_instances(top)) {
        const struct portable_moving_instance *instance = moving_instance_at(top, record);
        return (time || instance->motion == MOTION_STATIC) && motion_matrix(instance, time ? *time : 0, ret_matrix);
    }
    memcpy(ret_matrix, instance_at(top, record)->object_to_world, sizeof(float[12]));
    return true;
}

const struct cpu_target cpu_portable = {
    .target = TARGET_PORTABLE,
    .open = open_structure,
    .level = level,
    .make_walk = make_walk,
    .instance_count = instance_count,
    .handle_count = handle_count,
    .handle = handle,
    .bottom = bottom,
    .bounds = get_bounds,
    .corners = get_corners,
    .ends = get_ends,
    .object_to_world = get_matrix,
};
