/* SPDX-License-Identifier: Apache-2.0 */
#include "unpack.h"

#include <math.h>
#include <string.h>

static bool has_triangles(const struct portable_view *view)
{
    return view && view->header->content <= PORTABLE_TRIANGLES;
}

static void put_record(const struct portable_view *view, uint32_t row, float *positions)
{
    if (view->header->content == PORTABLE_TRIANGLES) {
        const struct portable_triangle *triangle = (const struct portable_triangle *)view->records + row;
        float *at = positions + UINT64_C(9) * (triangle->id & PORTABLE_ID_MASK);
        memcpy(at, triangle->v0, sizeof triangle->v0);
        memcpy(at + 3, triangle->v1, sizeof triangle->v1);
        memcpy(at + 6, triangle->v2, sizeof triangle->v2);
        return;
    }
    const struct portable_indexed_triangle *triangle = (const struct portable_indexed_triangle *)view->records + row;
    float *at = positions + UINT64_C(9) * (triangle->id & PORTABLE_ID_MASK);
    for (int i = 0; i < 3; i++)
        memcpy(at + 3 * i, view->vertices + UINT64_C(3) * triangle->vertices[i], 3 * sizeof(float));
}

static float *unpack_positions(const struct portable_view *view, struct memory *memory)
{
    uint64_t count = UINT64_C(9) * view->header->primitive_count;
    float *positions = memory_array(memory, count + 1, sizeof *positions);
    for (uint64_t i = 0; i < count && positions; i++)
        positions[i] = NAN;
    for (uint32_t row = 0; row < view->header->record_count && positions; row++)
        put_record(view, row, positions);
    return positions;
}

static void add_meshes(struct unpacked *unpacked, const struct portable_view *view, uint32_t bottom, const float *transform,
                       uint32_t instance)
{
    for (uint32_t i = 0; i < view->header->geometry_count; i++) {
        const struct portable_geometry *geometry = &view->geometries[i];
        unpacked->meshes[unpacked->mesh_count++] =
            (struct oracle_mesh){.positions = unpacked->positions[bottom] + UINT64_C(9) * geometry->first_primitive,
                                 .triangle_count = geometry->primitive_count,
                                 .transform = transform,
                                 .instance = instance,
                                 .geometry = i};
        unpacked->triangle_count += geometry->primitive_count;
    }
}

static uint64_t count_meshes(const struct scene *scene)
{
    if (!scene->top)
        return scene->bottoms[0]->header->geometry_count;
    const struct portable_instance *instances = scene->top->records;
    uint64_t count = 0;
    for (uint32_t i = 0; i < scene->top->header->record_count; i++)
        count += scene->bottoms[instances[i].handle]->header->geometry_count;
    return count;
}

static bool unpack_bottoms(const struct scene *scene, struct unpacked *unpacked)
{
    bool ok = unpacked->positions != NULL;
    for (uint32_t i = 0; i < scene->bottom_count && ok; i++) {
        unpacked->positions[i] = has_triangles(scene->bottoms[i]) ? unpack_positions(scene->bottoms[i], unpacked->memory) : NULL;
        ok = unpacked->positions[i] || !has_triangles(scene->bottoms[i]);
        unpacked->bottom_count++;
    }
    return ok;
}

enum bvhd_status unpack_scene(const struct scene *scene, struct memory *memory, struct unpacked *ret_unpacked, struct bvhd_error *error)
{
    struct unpacked unpacked = {.memory = memory};
    unpacked.positions = memory_array(memory, (uint64_t)scene->bottom_count + 1, sizeof *unpacked.positions);
    unpacked.meshes = memory_array(memory, count_meshes(scene) + 1, sizeof *unpacked.meshes);
    if (!unpacked.meshes || !unpack_bottoms(scene, &unpacked)) {
        unpack_finish(&unpacked);
        return bvhd_error_set(error, BVHD_NO_MEMORY, "trace", "no memory for the triangles");
    }
    const struct portable_instance *instances = scene->top ? scene->top->records : NULL;
    if (!scene->top && unpacked.positions[0])
        add_meshes(&unpacked, scene->bottoms[0], 0, NULL, RAY_NO_INSTANCE);
    for (uint32_t i = 0; scene->top && i < scene->top->header->record_count; i++)
        if (unpacked.positions[instances[i].handle])
            add_meshes(&unpacked, scene->bottoms[instances[i].handle], instances[i].handle, instances[i].object_to_world,
                       instances[i].instance);
    *ret_unpacked = unpacked;
    return BVHD_OK;
}

void unpack_finish(struct unpacked *unpacked)
{
    if (!unpacked || !unpacked->memory)
        return;
    for (uint32_t i = 0; i < unpacked->bottom_count; i++)
        memory_free(unpacked->memory, unpacked->positions[i]);
    memory_free(unpacked->memory, unpacked->positions);
    memory_free(unpacked->memory, unpacked->meshes);
    *unpacked = (struct unpacked){0};
}
