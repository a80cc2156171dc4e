/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/scene/import_compare.h"

#include <math.h>
#include <stdio.h>

static const struct import_extent nothing = {0, {INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}};

static void extend(struct import_extent *extent, const double point[3])
{
    if (!isfinite(point[0]) || !isfinite(point[1]) || !isfinite(point[2]))
        return;
    for (int axis = 0; axis < 3; axis++) {
        extent->low[axis] = point[axis] < extent->low[axis] ? point[axis] : extent->low[axis];
        extent->high[axis] = point[axis] > extent->high[axis] ? point[axis] : extent->high[axis];
    }
}

/* Adds the triangles of a bottom level, in its own space. */
static void measure_bottom(const struct import *import, const struct import_bottom *bottom,
                           struct import_extent *ret_extent)
{
    *ret_extent = nothing;
    for (uint32_t k = 0; k < bottom->mesh_count; k++) {
        const struct import_mesh *mesh = &import->meshes[bottom->meshes[k]];
        if (mesh->shape != IMPORT_TRIANGLES)
            continue; /* the second reader leaves them out */
        ret_extent->triangles += mesh->primitive_count;
        for (uint64_t i = 0; i < UINT64_C(3) * mesh->primitive_count; i++) {
            const float *at = mesh->positions + 3 * (size_t)mesh->indices[i];
            extend(ret_extent, (const double[3]){at[0], at[1], at[2]});
        }
    }
}

/* Adds an instance of a bottom level by the corners of its box, so that many instances cost little. */
static void add_instance(const struct import_extent *bottom, const float transform[12], struct import_extent *extent)
{
    extent->triangles += bottom->triangles;
    for (int corner = 0; corner < 8 && bottom->low[0] <= bottom->high[0]; corner++) {
        double world[3];
        for (int axis = 0; axis < 3; axis++) {
            const float *row = transform + 4 * axis;
            world[axis] = row[3];
            for (int k = 0; k < 3; k++)
                world[axis] += row[k] * (corner >> k & 1 ? bottom->high[k] : bottom->low[k]);
        }
        extend(extent, world);
    }
}

static bool measure(const struct import *import, struct import_extent *ret_extent)
{
    struct import_extent *bottoms = memory_array(import->memory, import->bottom_count, sizeof *bottoms);
    *ret_extent = nothing;
    for (uint32_t i = 0; bottoms && i < import->bottom_count; i++)
        measure_bottom(import, &import->bottoms[i], &bottoms[i]);
    for (uint32_t i = 0; bottoms && i < import->instance_count; i++)
        if (!import->instances[i].skipped)
            add_instance(&bottoms[import->instances[i].bottom], import->instances[i].transform, ret_extent);
    memory_free(import->memory, bottoms);
    return bottoms != NULL;
}

/* Readers round matrices differently. */
static bool agrees(const struct import_extent *a, const struct import_extent *b)
{
    static const double tolerance = 1e-4;
    double size = 0;
    for (int axis = 0; axis < 3; axis++)
        size = fmax(size, fmax(fabs(a->low[axis]), fabs(a->high[axis])));
    bool same = a->triangles == b->triangles;
    for (int axis = 0; axis < 3 && a->low[axis] <= a->high[axis]; axis++)
        same &= fabs(a->low[axis] - b->low[axis]) <= tolerance * size &&
                fabs(a->high[axis] - b->high[axis]) <= tolerance * size;
    return same;
}

struct import_comparison import_compare(const char *path, const struct import *import, struct memory *memory)
{
    struct import_comparison comparison = {.agreement = IMPORT_NOT_COMPARED};
    struct import second;
    struct bvhd_error error = {0};
    if (!import->has_second_reader)
        return comparison;
    if (import_scene_by_assimp(path, memory, &second, &error)) {
        comparison.agreement = IMPORT_REFUSED;
        snprintf(comparison.text, sizeof comparison.text, "%s", error.text);
        return comparison;
    }
    if (measure(import, &comparison.first) && measure(&second, &comparison.second))
        comparison.agreement = agrees(&comparison.first, &comparison.second) ? IMPORT_AGREES : IMPORT_DIFFERS;
    import_finish(&second);
    return comparison;
}
