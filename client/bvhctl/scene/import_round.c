/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/scene/import_round.h"

#include <math.h>
#include <string.h>

const struct import_shape_kind import_shape_kinds[IMPORT_SHAPES] = {
    [IMPORT_TRIANGLES] = {3, ORACLE_TRIANGLES, "triangle", "triangles", "triangles", ""},
    [IMPORT_POINTS] = {1, ORACLE_SPHERES, "sphere", "spheres", "spheres", "-points"},
    [IMPORT_LINES] = {2, ORACLE_SWEPT_SPHERES, "swept sphere", "swept spheres", "swept_spheres", "-lines"},
};

float import_round_radius(const struct import_wish *wish, enum import_shape shape)
{
    return shape == IMPORT_POINTS ? wish->point_radius : shape == IMPORT_LINES ? wish->line_radius : 0;
}

bool import_round_find_wrong(const float *radii, uint32_t count, uint32_t *ret_vertex)
{
    for (uint32_t i = 0; i < count; i++)
        if (!isfinite(radii[i]) || radii[i] < 0) {
            *ret_vertex = i;
            return true;
        }
    return false;
}

void import_round_count(struct import *import)
{
    uint64_t *const totals[IMPORT_SHAPES] = {&import->triangle_count, &import->point_count, &import->line_count};
    for (uint32_t i = 0; i < import->mesh_count; i++)
        *totals[import->meshes[i].shape] += import->meshes[i].primitive_count;
}

bool import_round_any(const struct import *import)
{
    return import->triangle_count || import->point_count || import->line_count;
}

const char *import_round_hint(const struct import_counts *counts)
{
    if (counts->points && counts->lines)
        return "; --points RADIUS and --lines RADIUS read points and lines";
    return counts->points ? "; --points RADIUS reads points" : counts->lines ? "; --lines RADIUS reads lines" : "";
}

_Static_assert((int)IMPORT_CAP_FIRST == ORACLE_CAP_FIRST && (int)IMPORT_CAP_SECOND == ORACLE_CAP_SECOND,
               "the caps of a mesh are those of the oracle's");

/*
 * Writes the old number of each new vertex, and replaces the indices. A line begins with a new vertex unless the one
 * before it has ended there. Returns the number of new vertices.
 */
static uint64_t number_vertices(struct import_mesh *mesh, uint32_t *ret_old)
{
    uint32_t corners = import_shape_kinds[mesh->shape].corners;
    uint64_t count = 0;
    for (uint64_t i = 0; i < mesh->primitive_count; i++) {
        uint32_t *primitive = mesh->indices + i * corners;
        bool goes_on = mesh->shape == IMPORT_LINES && i > 0 && primitive[0] == ret_old[count - 1];
        if (mesh->caps)
            mesh->caps[i] = goes_on ? IMPORT_CAP_SECOND : IMPORT_CAP_FIRST | IMPORT_CAP_SECOND;
        for (uint32_t k = goes_on; k < corners; k++)
            ret_old[count++] = primitive[k];
        for (uint32_t k = 0; k < corners; k++)
            primitive[k] = (uint32_t)(count - corners + k);
    }
    return count;
}

/* Replaces an array, which may be NULL, of so many floats a vertex. Returns false when there is no memory. */
static bool gather(float **array, uint32_t components, const uint32_t *old, uint32_t count, struct memory *memory)
{
    if (!*array)
        return true;
    float *gathered = memory_array(memory, (uint64_t)count + 1, components * sizeof *gathered);
    for (size_t i = 0; i < count && gathered; i++)
        memcpy(gathered + i * components, *array + (size_t)old[i] * components, components * sizeof *gathered);
    if (gathered) {
        memory_free(memory, *array);
        *array = gathered;
    }
    return gathered != NULL;
}

static void drop(float **array, struct memory *memory)
{
    memory_free(memory, *array);
    *array = NULL;
}

bool import_round_order(struct import_mesh *mesh, struct memory *memory)
{
    if (mesh->shape == IMPORT_TRIANGLES)
        return true;
    uint32_t *old = memory_array(memory, import_corner_count(mesh) + 1, sizeof *old);
    if (mesh->shape == IMPORT_LINES)
        mesh->caps = memory_alloc(memory, (uint64_t)mesh->primitive_count + 1);
    bool ok = old && (mesh->caps || mesh->shape != IMPORT_LINES);
    uint64_t wanted = ok ? number_vertices(mesh, old) : 0;
    uint32_t count = (uint32_t)wanted;
    ok = ok && wanted == count && gather(&mesh->positions, 3, old, count, memory) &&
         gather(&mesh->radii, 1, old, count, memory) && gather(&mesh->look.colours, 4, old, count, memory);
    drop(&mesh->look.normals, memory);
    drop(&mesh->look.texcoords, memory);
    mesh->look.has_image = false;
    mesh->vertex_count = count;
    memory_free(memory, old);
    return ok;
}
