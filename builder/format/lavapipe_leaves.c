/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/format/lavapipe_leaves.h"

#include <inttypes.h>

enum { INSTANCE_SIZE = 64, INSTANCE_REFERENCE = 56 };

static enum lavapipe_kind kind_of(const struct canonical *canonical)
{
    if (canonical->type == STRUCTURE_TOP)
        return LAVAPIPE_INSTANCE;
    bool boxes = canonical->geometry_count > 0 && canonical->geometries[0].type == GEOMETRY_AABBS;
    return boxes ? LAVAPIPE_AABB : LAVAPIPE_TRIANGLE;
}

static bool is_null(const struct canonical_geometry *geometry, uint32_t instance)
{
    return bytes_get64(geometry->instances + (uint64_t)INSTANCE_SIZE * instance + INSTANCE_REFERENCE) == 0;
}

static uint32_t count_instances(const struct canonical *canonical, const atomic_bool *cancel)
{
    uint32_t count = 0;
    for (uint32_t g = 0; g < canonical->geometry_count; g++)
        for (uint32_t i = 0; i < canonical->geometries[g].primitive_count && !parallel_cancelled_at(cancel, i); i++)
            count += !is_null(&canonical->geometries[g], i);
    return count;
}

static void number_instances(struct lavapipe_leaves *leaves)
{
    const struct canonical *canonical = leaves->canonical;
    uint32_t next = 0, *place = leaves->places;
    for (uint32_t g = 0; g < canonical->geometry_count; g++)
        for (uint32_t i = 0; i < canonical->geometries[g].primitive_count; i++)
            *place++ = is_null(&canonical->geometries[g], i) ? LAVAPIPE_NONE : next++;
}

static enum bvhd_status init_instances(struct lavapipe_leaves *leaves, const atomic_bool *cancel,
                                       struct bvhd_error *error)
{
    uint32_t all = leaves->canonical->primitive_count;
    leaves->count = leaves->handle_count = count_instances(leaves->canonical, cancel);
    if (parallel_cancelled(cancel))
        return bvhd_error_set(error, BVHD_CANCELLED, "blob", "cancelled");
    if (leaves->count == all)
        return BVHD_OK;
    leaves->places = memory_array(leaves->memory, all, sizeof *leaves->places);
    if (!leaves->places)
        return bvhd_error_no_memory(error, "instances", "no memory for the places of %" PRIu32 " instances", all);
    number_instances(leaves);
    return BVHD_OK;
}

enum bvhd_status lavapipe_leaves_init(struct lavapipe_leaves *leaves, const struct layout_input *input,
                                      struct bvhd_error *error)
{
    const struct canonical *canonical = input->canonical;
    *leaves = (struct lavapipe_leaves){.canonical = canonical,
                                       .memory = input->memory,
                                       .kind = kind_of(canonical),
                                       .count = canonical->primitive_count};
    /*
     * The earlier driver multiplies every triangle by a matrix, which leaves no -0; the later one does so only if there
     * is a matrix.
     */
    leaves->unsigned_zeros = leaves->kind == LAVAPIPE_TRIANGLE && input->device->variant == LAVAPIPE_PLAIN;
    return leaves->kind == LAVAPIPE_INSTANCE ? init_instances(leaves, input->cancel, error) : BVHD_OK;
}

void lavapipe_leaves_finish(struct lavapipe_leaves *leaves)
{
    if (leaves->places)
        memory_free(leaves->memory, leaves->places);
    leaves->places = NULL;
}

static uint32_t geometry_and_flags(const struct canonical *canonical, const struct canonical_geometry *geometry)
{
    return (uint32_t)(geometry - canonical->geometries) |
           (geometry->flags & GEOMETRY_OPAQUE ? LAVAPIPE_GEOMETRY_OPAQUE : 0);
}

static void write_triangle(const struct lavapipe_leaves *leaves, const struct canonical_geometry *geometry,
                           uint32_t index, unsigned char *at)
{
    struct lavapipe_triangle leaf = {.primitive = index,
                                     .geometry_and_flags = geometry_and_flags(leaves->canonical, geometry)};
    canonical_triangle(geometry, index, leaf.corners);
    for (int k = 0; leaves->unsigned_zeros && k < 9; k++)
        leaf.corners[k / 3][k % 3] += 0.0f;
    memcpy(at, &leaf, sizeof leaf);
}

static void write_aabb(const struct lavapipe_leaves *leaves, const struct canonical_geometry *geometry, uint32_t index,
                       unsigned char *at)
{
    struct lavapipe_aabb leaf = {.primitive = index,
                                 .geometry_and_flags = geometry_and_flags(leaves->canonical, geometry)};
    const float *box = geometry->boxes + (uint64_t)6 * index;
    memcpy(leaf.min, box, sizeof leaf.min);
    memcpy(leaf.max, box + 3, sizeof leaf.max);
    memcpy(at, &leaf, sizeof leaf);
}

static uint32_t sbt_and_flags(const struct canonical_instance *instance)
{
    uint32_t flags = instance->sbt_offset;
    flags |= instance->flags & INSTANCE_FORCE_OPAQUE ? LAVAPIPE_FORCE_OPAQUE : 0;
    flags |= instance->flags & INSTANCE_FORCE_NO_OPAQUE ? 0 : LAVAPIPE_NOT_FORCE_NO_OPAQUE;
    flags |= instance->flags & INSTANCE_CULL_DISABLE ? LAVAPIPE_CULL_DISABLE : 0;
    return flags | (instance->flags & INSTANCE_FLIP_FACING ? LAVAPIPE_FLIP_FACING : 0);
}

/* The address is the same number as the handle, until a loader replaces both. */
static void write_instance(const struct canonical_geometry *geometry, uint32_t index, unsigned char *at,
                           unsigned char *handle)
{
    struct canonical_instance instance = canonical_instance(geometry, index);
    struct lavapipe_instance leaf = {
        .address = instance.reference,
        .custom_and_mask = instance.custom_index | instance.mask << 24,
        .sbt_and_flags = sbt_and_flags(&instance),
        .instance = index,
    };
    memcpy(leaf.object_to_world, instance.transform, sizeof leaf.object_to_world);
    lavapipe_invert(instance.transform, leaf.world_to_object);
    memcpy(at, &leaf, sizeof leaf);
    bytes_put64(handle, instance.reference);
}

static void write_one(const struct lavapipe_leaves *leaves, const struct canonical_geometry *geometry, uint32_t id,
                      unsigned char *body_leaves, unsigned char *handles)
{
    uint32_t place = lavapipe_leaves_place(leaves, id), index = id - geometry->first_primitive;
    if (place == LAVAPIPE_NONE)
        return;
    unsigned char *at = body_leaves + (uint64_t)place * lavapipe_leaf_size(leaves->kind);
    if (leaves->kind == LAVAPIPE_TRIANGLE)
        write_triangle(leaves, geometry, index, at);
    else if (leaves->kind == LAVAPIPE_AABB)
        write_aabb(leaves, geometry, index, at);
    else
        write_instance(geometry, index, at, handles + (uint64_t)8 * place);
}

void lavapipe_leaves_write(const struct lavapipe_leaves *leaves, uint32_t begin, uint32_t end,
                           unsigned char *body_leaves, unsigned char *handles)
{
    const struct canonical *canonical = leaves->canonical;
    const struct canonical_geometry *geometry = &canonical->geometries[canonical_geometry_of(canonical, begin)];
    for (; begin < end; geometry++) {
        uint32_t last = geometry->first_primitive + geometry->primitive_count;
        for (last = last < end ? last : end; begin < last; begin++)
            write_one(leaves, geometry, begin, body_leaves, handles);
    }
}
