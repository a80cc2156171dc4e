/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/support/shader/shader_meshes.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* The primitives of one structure, by their numbers. Those without a record have NaNs. */
struct bottom {
    enum oracle_shape shape;
    float *positions;
    float *radii; /* of spheres and linear swept spheres */
    uint8_t *caps; /* of linear swept spheres */
};

uint32_t shader_meshes_vertices(enum oracle_shape shape)
{
    static const uint32_t counts[ORACLE_SHAPES] = {
        [ORACLE_TRIANGLES] = 3, [ORACLE_SPHERES] = 1, [ORACLE_SWEPT_SPHERES] = 2};
    return counts[shape];
}

static void *keep(struct shader_meshes *meshes, uint64_t count, size_t size)
{
    void *block = calloc((size_t)count + 1, size);
    if (!block) {
        fprintf(stderr, "shader meshes: no memory\n");
        exit(1);
    }
    return meshes->blocks[meshes->block_count++] = block;
}

/* ---- unpacking ---- */

/* Makes something that rays can be aimed at: a triangle through opposite corners of each box. */
static void unpack_boxes(const struct portable_view *view, struct bottom *bottom)
{
    for (uint32_t i = 0; i < view->header->record_count; i++) {
        const struct portable_aabb *box = (const struct portable_aabb *)view->records + i;
        float *corners = bottom->positions + UINT64_C(9) * (box->id & PORTABLE_ID_MASK);
        memcpy(corners, box->min, 12);
        memcpy(corners + 3, box->max, 12);
        memcpy(corners + 6, (const float[3]){box->min[0], box->max[1], box->min[2]}, 12);
    }
}

static void unpack_triangles(const struct portable_view *view, struct bottom *bottom)
{
    for (uint32_t i = 0; i < view->header->record_count; i++) {
        const struct portable_indexed_triangle *indexed = (const struct portable_indexed_triangle *)view->records + i;
        const struct portable_triangle *fast = (const struct portable_triangle *)view->records + i;
        bool is_fast = view->header->content == PORTABLE_TRIANGLES;
        float *corners = bottom->positions + UINT64_C(9) * ((is_fast ? fast->id : indexed->id) & PORTABLE_ID_MASK);
        const float *const fasts[3] = {fast->v0, fast->v1, fast->v2};
        for (int k = 0; k < 3; k++)
            memcpy(corners + 3 * k, is_fast ? fasts[k] : view->vertices + UINT64_C(3) * indexed->vertices[k], 12);
    }
}

static const struct portable_round *round_at(const struct portable_view *view, uint32_t record)
{
    return (const struct portable_round *)view->records + record;
}

void shader_meshes_ends(const struct portable_view *view, uint32_t record, float ret_ends[2][4])
{
    const uint32_t first = round_at(view, record)->vertex, is_swept = view->header->content == PORTABLE_SWEPT_SPHERES;
    for (uint32_t end = 0; end < 2; end++)
        memcpy(ret_ends[end], view->vertices + UINT64_C(4) * (first + end * is_swept), 16);
}

static void unpack_round(const struct portable_view *view, struct bottom *bottom)
{
    const uint32_t vertices = shader_meshes_vertices(bottom->shape);
    for (uint32_t i = 0; i < view->header->record_count; i++) {
        const uint32_t id = round_at(view, i)->id;
        const uint64_t primitive = id & PORTABLE_ID_MASK;
        float ends[2][4];
        shader_meshes_ends(view, i, ends);
        for (uint32_t end = 0; end < vertices; end++) {
            memcpy(bottom->positions + 3 * (vertices * primitive + end), ends[end], 12);
            bottom->radii[vertices * primitive + end] = ends[end][3];
        }
        bottom->caps[primitive] = (uint8_t)((id & PORTABLE_ID_CAP_FIRST ? ORACLE_CAP_FIRST : 0) |
                                            (id & PORTABLE_ID_CAP_SECOND ? ORACLE_CAP_SECOND : 0));
    }
}

/* How the records of each content are unpacked. A top level has none of these. */
static const struct {
    enum oracle_shape shape;
    void (*unpack)(const struct portable_view *view, struct bottom *bottom);
} contents[PORTABLE_CONTENTS] = {
    [PORTABLE_INDEXED_TRIANGLES] = {ORACLE_TRIANGLES, unpack_triangles},
    [PORTABLE_TRIANGLES] = {ORACLE_TRIANGLES, unpack_triangles},
    [PORTABLE_AABBS] = {ORACLE_TRIANGLES, unpack_boxes},
    [PORTABLE_SPHERES] = {ORACLE_SPHERES, unpack_round},
    [PORTABLE_SWEPT_SPHERES] = {ORACLE_SWEPT_SPHERES, unpack_round},
};

static void unpack(struct shader_meshes *meshes, const struct portable_view *view, struct bottom *ret_bottom)
{
    const uint32_t content = view->header->content;
    const uint64_t vertices = (uint64_t)shader_meshes_vertices(contents[content].shape) * view->header->primitive_count;
    *ret_bottom = (struct bottom){.shape = contents[content].shape,
                                  .positions = keep(meshes, 3 * vertices, sizeof(float)),
                                  .radii = keep(meshes, vertices, sizeof(float)),
                                  .caps = keep(meshes, view->header->primitive_count, 1)};
    for (uint64_t i = 0; i < 3 * vertices; i++)
        ret_bottom->positions[i] = NAN;
    contents[content].unpack(view, ret_bottom);
}

/* ---- what rays can hit ---- */

static bool is_opaque(const struct shader_case *rays, uint32_t instance_flags, uint32_t geometry_flags)
{
    if (rays->flags & (RAY_OPAQUE | RAY_NO_OPAQUE))
        return rays->flags & RAY_OPAQUE;
    if (instance_flags & (INSTANCE_FORCE_OPAQUE | INSTANCE_FORCE_NO_OPAQUE))
        return instance_flags & INSTANCE_FORCE_OPAQUE;
    return geometry_flags & GEOMETRY_OPAQUE;
}

static float *copy_accepted(struct shader_meshes *meshes, const struct oracle_mesh *mesh)
{
    const uint64_t each = UINT64_C(3) * shader_meshes_vertices(mesh->shape);
    float *copy = keep(meshes, each * mesh->primitive_count, sizeof *copy);
    memcpy(copy, mesh->positions, (size_t)each * mesh->primitive_count * sizeof *copy);
    for (uint32_t i = 0; i < mesh->primitive_count; i++)
        if (!shader_policy_accepts(mesh->instance, mesh->geometry, i))
            copy[each * i] = NAN;
    return copy;
}

static float *copy_turned(struct shader_meshes *meshes, const struct oracle_mesh *mesh)
{
    float *copy = keep(meshes, UINT64_C(9) * mesh->primitive_count, sizeof *copy);
    for (uint64_t i = 0; i < mesh->primitive_count; i++) {
        memcpy(copy + 9 * i, mesh->positions + 9 * i, 12);
        memcpy(copy + 9 * i + 3, mesh->positions + 9 * i + 6, 12);
        memcpy(copy + 9 * i + 6, mesh->positions + 9 * i + 3, 12);
    }
    return copy;
}

static void add_mesh(struct shader_meshes *meshes, const struct shader_case *rays, struct oracle_mesh mesh,
                     uint32_t instance_flags, uint32_t geometry_flags)
{
    if (!rays) {
        meshes->meshes[meshes->count++] = mesh;
        return;
    }
    bool opaque = is_opaque(rays, instance_flags, geometry_flags);
    if (rays->flags & (RAY_SKIP_TRIANGLES | (opaque ? RAY_CULL_OPAQUE : RAY_CULL_NO_OPAQUE)))
        return;
    if (!opaque && rays->policy == SHADER_IGNORE)
        return;
    if (!opaque && rays->policy == SHADER_SOME)
        mesh.positions = copy_accepted(meshes, &mesh);
    bool is_culling = mesh.shape == ORACLE_TRIANGLES && rays->flags & (RAY_CULL_BACK_FACING | RAY_CULL_FRONT_FACING);
    struct oracle_mesh turned = mesh;
    if (is_culling && instance_flags & (INSTANCE_FLIP_FACING | INSTANCE_CULL_DISABLE))
        turned.positions = copy_turned(meshes, &mesh);
    /* Where nothing is culled, both orientations can be hit. */
    if (!is_culling || !(instance_flags & INSTANCE_FLIP_FACING) || instance_flags & INSTANCE_CULL_DISABLE)
        meshes->meshes[meshes->count++] = mesh;
    if (turned.positions != mesh.positions)
        meshes->meshes[meshes->count++] = turned;
}

static void add_bottom(struct shader_meshes *meshes, const struct shader_case *rays, const struct portable_view *view,
                       const struct bottom *bottom, const struct portable_instance *instance)
{
    const uint64_t vertices = shader_meshes_vertices(bottom->shape);
    for (uint32_t g = 0; g < view->header->geometry_count; g++) {
        const struct portable_geometry *geometry = &view->geometries[g];
        struct oracle_mesh mesh = {
            .shape = bottom->shape,
            .positions = bottom->positions + 3 * vertices * geometry->first_primitive,
            .radii = bottom->radii + vertices * geometry->first_primitive,
            .caps = bottom->caps + geometry->first_primitive,
            .primitive_count = geometry->primitive_count,
            .transform = instance ? instance->object_to_world : NULL,
            .instance = instance ? instance->instance : RAY_NO_INSTANCE,
            .geometry = g,
        };
        add_mesh(meshes, rays, mesh, instance ? instance->sbt_and_flags >> 24 : 0, geometry->flags);
    }
}

static uint64_t most_meshes(const struct scene *scene)
{
    uint64_t count = 0;
    for (uint32_t i = 0; scene->top && i < scene->top->header->record_count; i++) {
        const struct portable_view *view =
            scene->bottoms[((const struct portable_instance *)scene->top->records)[i].handle];
        count += view ? view->header->geometry_count : 0;
    }
    return scene->top ? count : scene->bottoms[0]->header->geometry_count;
}

void shader_meshes_make(const struct scene *scene, const struct shader_case *rays, struct shader_meshes *ret_meshes)
{
    uint64_t most = most_meshes(scene);
    struct shader_meshes meshes = {.meshes = calloc((size_t)(2 * most + 1), sizeof *meshes.meshes),
                                   .blocks =
                                       calloc((size_t)(2 * most + 3 * scene->bottom_count + 2), sizeof *meshes.blocks)};
    if (!meshes.meshes || !meshes.blocks)
        exit(1);
    struct bottom *bottoms = keep(&meshes, scene->bottom_count, sizeof *bottoms);
    for (uint32_t i = 0; i < scene->bottom_count; i++)
        if (scene->bottoms[i] && (!rays || scene->bottoms[i]->header->content != PORTABLE_AABBS))
            unpack(&meshes, scene->bottoms[i], &bottoms[i]);
    if (!scene->top && bottoms[0].positions)
        add_bottom(&meshes, rays, scene->bottoms[0], &bottoms[0], NULL);
    for (uint32_t i = 0; scene->top && i < scene->top->header->record_count; i++) {
        const struct portable_instance *instance = (const struct portable_instance *)scene->top->records + i;
        if (bottoms[instance->handle].positions && (!rays || instance->custom_and_mask >> 24 & rays->cull_mask))
            add_bottom(&meshes, rays, scene->bottoms[instance->handle], &bottoms[instance->handle], instance);
    }
    *ret_meshes = meshes;
}

void shader_meshes_finish(struct shader_meshes *meshes)
{
    for (uint32_t i = 0; i < meshes->block_count; i++)
        free(meshes->blocks[i]);
    free(meshes->blocks);
    free(meshes->meshes);
    *meshes = (struct shader_meshes){0};
}

struct oracle_mesh shader_meshes_one(const struct oracle_mesh *mesh, uint32_t primitive)
{
    const uint64_t vertices = shader_meshes_vertices(mesh->shape);
    struct oracle_mesh one = *mesh;
    one.positions += 3 * vertices * primitive;
    one.radii += vertices * primitive;
    one.caps += primitive;
    one.primitive_count = 1;
    return one;
}
