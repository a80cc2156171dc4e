/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/scene/unpack.h"

#include <math.h>
#include <string.h>

#include "client/bvhctl/scene/target_reader.h"

/* Returns nine floats for each primitive, or NULL when there is no memory. */
static float *unpack_positions(const struct structure *bottom, struct memory *memory)
{
    uint64_t count = UINT64_C(9) * bottom->primitive_count;
    float *positions = memory_array(memory, count + 1, sizeof *positions);
    for (uint64_t i = 0; i < count && positions; i++)
        positions[i] = NAN;
    for (uint32_t row = 0; row < structure_triangle_count(bottom) && positions; row++) {
        float corners[3][3];
        uint32_t primitive;
        structure_triangle(bottom, row, corners, &primitive);
        memcpy(positions + UINT64_C(9) * primitive, corners, sizeof corners);
    }
    return positions;
}

static void add_meshes(struct unpacked *unpacked, const struct structure *bottom, const float *positions,
                       const struct structure_instance *instance)
{
    for (uint32_t i = 0; i < bottom->geometry_count; i++) {
        const struct structure_geometry *geometry = &bottom->geometries[i];
        unpacked->meshes[unpacked->mesh_count++] =
            (struct oracle_mesh){.positions = positions + UINT64_C(9) * geometry->first_primitive,
                                 .primitive_count = geometry->primitive_count,
                                 .transform = instance ? instance->object_to_world : NULL,
                                 .instance = instance ? instance->instance : RAY_NO_INSTANCE,
                                 .geometry = geometry->geometry};
        unpacked->triangle_count += geometry->primitive_count;
    }
}

static void add_instances(const struct structures *structures, struct unpacked *unpacked)
{
    for (uint32_t i = 0; i < unpacked->instance_count; i++) {
        const struct structure_instance *instance = &unpacked->instances[i];
        if (unpacked->positions[instance->bottom])
            add_meshes(unpacked, &structures->files[instance->bottom].structure, unpacked->positions[instance->bottom],
                       instance);
    }
}

static bool unpack_bottoms(const struct structures *structures, struct unpacked *unpacked)
{
    for (uint32_t i = 0; i < structures->bottom_count; i++) {
        const struct structure *bottom = &structures->files[i].structure;
        unpacked->positions[i] = structure_triangle_count(bottom) ? unpack_positions(bottom, unpacked->memory) : NULL;
        unpacked->bottom_count++;
        if (structure_triangle_count(bottom) && !unpacked->positions[i])
            return false;
    }
    return true;
}

static bool unpack_instances(const struct structure *top, struct unpacked *unpacked)
{
    uint32_t count = top ? structure_instance_count(top) : 0;
    unpacked->instances = memory_array(unpacked->memory, (uint64_t)count + 1, sizeof *unpacked->instances);
    for (uint32_t i = 0; i < count && unpacked->instances; i++)
        unpacked->instances[i] = structure_instance(top, i);
    unpacked->instance_count = count;
    return unpacked->instances != NULL;
}

static uint64_t count_meshes(const struct structures *structures, const struct unpacked *unpacked)
{
    if (!structures->has_top)
        return structures->files[0].structure.geometry_count;
    uint64_t count = 0;
    for (uint32_t i = 0; i < unpacked->instance_count; i++)
        count += structures->files[unpacked->instances[i].bottom].structure.geometry_count;
    return count;
}

static bool unpack_all(const struct structures *structures, struct unpacked *unpacked)
{
    struct memory *memory = unpacked->memory;
    unpacked->positions = memory_array(memory, (uint64_t)structures->bottom_count + 1, sizeof *unpacked->positions);
    if (!unpacked->positions || !unpack_bottoms(structures, unpacked) ||
        !unpack_instances(structures_top(structures), unpacked))
        return false;
    unpacked->meshes = memory_array(memory, count_meshes(structures, unpacked) + 1, sizeof *unpacked->meshes);
    if (!unpacked->meshes)
        return false;
    if (structures->has_top)
        add_instances(structures, unpacked);
    else if (unpacked->positions[0])
        add_meshes(unpacked, &structures->files[0].structure, unpacked->positions[0], NULL);
    return true;
}

enum bvhd_status unpack_structures(const struct structures *structures, struct memory *memory,
                                   struct unpacked *ret_unpacked, struct bvhd_error *error)
{
    struct unpacked unpacked = {.memory = memory};
    if (!unpack_all(structures, &unpacked)) {
        unpack_finish(&unpacked);
        return bvhd_error_no_memory(error, "trace", "no memory for the triangles");
    }
    *ret_unpacked = unpacked;
    return BVHD_OK;
}

/* Computes the inverse of an affine matrix, by cofactors in double; it is zero if the matrix has none. */
static void invert(const float matrix[12], float ret_inverse[12])
{
    double inverse[12] = {0}, determinant = 0;
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++) {
            int a = (k + 1) % 3, b = (k + 2) % 3, c = (i + 1) % 3, d = (i + 2) % 3;
            inverse[4 * i + k] = (double)matrix[4 * a + c] * (double)matrix[4 * b + d] -
                                 (double)matrix[4 * a + d] * (double)matrix[4 * b + c];
        }
    for (int k = 0; k < 3; k++)
        determinant += (double)matrix[k] * inverse[4 * k];
    for (int i = 0; i < 3; i++) {
        for (int k = 0; k < 3; k++) {
            inverse[4 * i + k] = determinant != 0 ? inverse[4 * i + k] / determinant : 0;
            inverse[4 * i + 3] -= inverse[4 * i + k] * (double)matrix[4 * k + 3];
        }
    }
    for (int i = 0; i < 12; i++)
        ret_inverse[i] = (float)inverse[i];
}

void unpack_follow_inverses(struct unpacked *unpacked, const struct target_reader *reader)
{
    for (uint32_t i = 0; i < unpacked->instance_count; i++) {
        float world_to_object[12];
        reader->invert(unpacked->instances[i].object_to_world, world_to_object);
        invert(world_to_object, unpacked->instances[i].object_to_world);
    }
}

void unpack_finish(struct unpacked *unpacked)
{
    if (!unpacked || !unpacked->memory)
        return;
    for (uint32_t i = 0; i < unpacked->bottom_count; i++)
        memory_free(unpacked->memory, unpacked->positions[i]);
    memory_free(unpacked->memory, unpacked->positions);
    memory_free(unpacked->memory, unpacked->instances);
    memory_free(unpacked->memory, unpacked->meshes);
    *unpacked = (struct unpacked){0};
}
