/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/scene/unpack.h"

#include <math.h>
#include <string.h>

#include "client/bvhctl/scene/target_reader.h"

/* What the oracle gets of a content. */
struct shape {
    enum oracle_shape oracle;
    uint32_t vertices; /* of a primitive; 0: the oracle does not know it */
};

static struct shape shape_of(const struct structure *bottom)
{
    static const struct shape shapes[] = {
        [CONTENT_UNKNOWN] = {ORACLE_TRIANGLES, 0}, [CONTENT_TRIANGLES] = {ORACLE_TRIANGLES, 3},
        [CONTENT_AABBS] = {ORACLE_TRIANGLES, 0},   [CONTENT_INSTANCES] = {ORACLE_TRIANGLES, 0},
        [CONTENT_SPHERES] = {ORACLE_SPHERES, 1},   [CONTENT_SWEPT_SPHERES] = {ORACLE_SWEPT_SPHERES, 2}};
    return shapes[bottom->content];
}

/* Unpacks the corners as they are at a time. */
static void unpack_triangles(const struct structure *bottom, float time, float *ret_positions)
{
    for (uint32_t row = 0; row < structure_triangle_count(bottom); row++) {
        float corners[3][3];
        uint32_t primitive;
        structure_triangle(bottom, row, time, corners, &primitive);
        memcpy(ret_positions + UINT64_C(9) * primitive, corners, sizeof corners);
    }
}

static void unpack_round(const struct structure *bottom, uint32_t vertices, struct unpacked_bottom *unpacked)
{
    for (uint32_t row = 0; row < structure_round_count(bottom); row++) {
        struct structure_round round = structure_round(bottom, row);
        for (uint32_t end = 0; end < vertices; end++) {
            uint64_t vertex = (uint64_t)round.primitive * vertices + end;
            memcpy(unpacked->positions + 3 * vertex, round.ends[end], 3 * sizeof(float));
            unpacked->radii[vertex] = round.ends[end][3];
        }
        if (unpacked->caps)
            unpacked->caps[round.primitive] = (uint8_t)round.caps;
    }
}

/* Makes positions that no ray can hit. */
static float *make_positions(uint64_t vertices, struct memory *memory)
{
    float *positions = memory_array(memory, vertices + 1, 3 * sizeof *positions);
    for (uint64_t i = 0; positions && i < 3 * vertices; i++)
        positions[i] = NAN;
    return positions;
}

/* Returns false when there is no memory. */
static bool unpack_bottom(const struct structure *bottom, struct memory *memory, struct unpacked_bottom *unpacked)
{
    struct shape shape = shape_of(bottom);
    uint64_t count = (uint64_t)bottom->primitive_count * shape.vertices;
    bool is_round = shape.oracle != ORACLE_TRIANGLES, has_caps = shape.oracle == ORACLE_SWEPT_SPHERES;
    bool moves = bottom->moves;
    if (shape.vertices == 0)
        return true;
    unpacked->positions = make_positions(count, memory);
    unpacked->end_positions = moves ? make_positions(count, memory) : NULL;
    unpacked->radii = is_round ? memory_array(memory, count + 1, sizeof *unpacked->radii) : NULL;
    unpacked->caps = has_caps ? memory_alloc(memory, (uint64_t)bottom->primitive_count + 1) : NULL;
    if (!unpacked->positions || (moves && !unpacked->end_positions) || (is_round && !unpacked->radii) ||
        (has_caps && !unpacked->caps))
        return false;
    if (is_round)
        memset(unpacked->radii, 0, count * sizeof *unpacked->radii);
    if (has_caps)
        memset(unpacked->caps, 0, bottom->primitive_count);
    if (is_round)
        unpack_round(bottom, shape.vertices, unpacked);
    else
        unpack_triangles(bottom, 0, unpacked->positions);
    if (moves)
        unpack_triangles(bottom, 1, unpacked->end_positions);
    return true;
}

/* Places a mesh by an instance, whose numbers it refers to. */
static void place_mesh(const struct structure_instance *instance, struct oracle_mesh *mesh)
{
    static const enum oracle_motion motions[MOTION_TYPES] = {
        [MOTION_STATIC] = ORACLE_STILL, [MOTION_MATRIX] = ORACLE_MATRIX, [MOTION_SRT] = ORACLE_SRT};
    mesh->instance = instance->instance;
    mesh->transform = instance->start;
    mesh->motion = motions[instance->motion];
    mesh->end_transform = mesh->motion == ORACLE_STILL ? NULL : instance->end;
}

static void add_meshes(struct unpacked *unpacked, const struct structure *bottom, const struct unpacked_bottom *from,
                       const struct structure_instance *instance)
{
    struct shape shape = shape_of(bottom);
    for (uint32_t i = 0; i < bottom->geometry_count && from->positions; i++) {
        const struct structure_geometry *geometry = &bottom->geometries[i];
        uint64_t vertex = (uint64_t)geometry->first_primitive * shape.vertices;
        struct oracle_mesh *mesh = &unpacked->meshes[unpacked->mesh_count++];
        *mesh = (struct oracle_mesh){.shape = shape.oracle,
                                     .positions = from->positions + 3 * vertex,
                                     .end_positions = from->end_positions ? from->end_positions + 3 * vertex : NULL,
                                     .radii = from->radii ? from->radii + vertex : NULL,
                                     .caps = from->caps ? from->caps + geometry->first_primitive : NULL,
                                     .primitive_count = geometry->primitive_count,
                                     .instance = RAY_NO_INSTANCE,
                                     .geometry = geometry->geometry};
        if (instance)
            place_mesh(instance, mesh);
        unpacked->primitive_count += geometry->primitive_count;
    }
}

static void add_instances(const struct structures *structures, struct unpacked *unpacked)
{
    for (uint32_t i = 0; i < unpacked->instance_count; i++) {
        const struct structure_instance *instance = &unpacked->instances[i];
        add_meshes(unpacked, &structures->files[instance->bottom].structure, &unpacked->bottoms[instance->bottom],
                   instance);
    }
}

static bool unpack_bottoms(const struct structures *structures, struct unpacked *unpacked)
{
    for (uint32_t i = 0; i < structures->bottom_count; i++) {
        struct unpacked_bottom *bottom = &unpacked->bottoms[unpacked->bottom_count++];
        *bottom = (struct unpacked_bottom){0};
        if (!unpack_bottom(&structures->files[i].structure, unpacked->memory, bottom))
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
    unpacked->bottoms = memory_array(memory, (uint64_t)structures->bottom_count + 1, sizeof *unpacked->bottoms);
    if (!unpacked->bottoms || !unpack_bottoms(structures, unpacked) ||
        !unpack_instances(structures_top(structures), unpacked))
        return false;
    unpacked->meshes = memory_array(memory, count_meshes(structures, unpacked) + 1, sizeof *unpacked->meshes);
    if (!unpacked->meshes)
        return false;
    if (structures->has_top)
        add_instances(structures, unpacked);
    else
        add_meshes(unpacked, &structures->files[0].structure, &unpacked->bottoms[0], NULL);
    return true;
}

enum bvhd_status unpack_structures(const struct structures *structures, struct memory *memory,
                                   struct unpacked *ret_unpacked, struct bvhd_error *error)
{
    struct unpacked unpacked = {.memory = memory};
    if (!unpack_all(structures, &unpacked)) {
        unpack_finish(&unpacked);
        return bvhd_error_no_memory(error, "trace", "no memory for the primitives");
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
        reader->invert(unpacked->instances[i].start, world_to_object);
        invert(world_to_object, unpacked->instances[i].start);
    }
}

void unpack_finish(struct unpacked *unpacked)
{
    if (!unpacked || !unpacked->memory)
        return;
    for (uint32_t i = 0; i < unpacked->bottom_count; i++) {
        memory_free(unpacked->memory, unpacked->bottoms[i].positions);
        memory_free(unpacked->memory, unpacked->bottoms[i].end_positions);
        memory_free(unpacked->memory, unpacked->bottoms[i].radii);
        memory_free(unpacked->memory, unpacked->bottoms[i].caps);
    }
    memory_free(unpacked->memory, unpacked->bottoms);
    memory_free(unpacked->memory, unpacked->instances);
    memory_free(unpacked->memory, unpacked->meshes);
    *unpacked = (struct unpacked){0};
}
