/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/scene/import_compare.h"

#include <float.h>
#include <math.h>
#include <string.h>

/* Bounds may differ by this part of the largest coordinate: assimp's numbers from text are not rounded correctly. */
static const double tolerance = 1e-5;

static void add_corner(struct import_figures *figures, const float *transform, const float *corner)
{
    for (int row = 0; row < 3; row++) {
        const float *m = transform + 4 * row;
        double value = m[3];
        for (int axis = 0; axis < 3; axis++)
            value += (double)m[axis] * (double)corner[axis];
        if (!isfinite(value))
            continue;
        figures->min[row] = fmin(figures->min[row], value);
        figures->max[row] = fmax(figures->max[row], value);
    }
}

static void add_mesh(struct import_figures *figures, const float *transform, const struct import_mesh *mesh)
{
    figures->triangles += mesh->triangle_count;
    for (uint64_t i = 0; i < 3 * (uint64_t)mesh->triangle_count; i++)
        add_corner(figures, transform, mesh->positions + 3 * (size_t)mesh->indices[i]);
}

struct import_figures import_figures(const struct import *import)
{
    struct import_figures figures = {.min = {DBL_MAX, DBL_MAX, DBL_MAX}, .max = {-DBL_MAX, -DBL_MAX, -DBL_MAX}};
    for (uint32_t i = 0; i < import->instance_count; i++) {
        const struct import_instance *instance = &import->instances[i];
        const struct import_bottom *bottom = &import->bottoms[instance->bottom];
        for (uint32_t k = 0; k < bottom->mesh_count && !instance->skipped; k++)
            add_mesh(&figures, instance->transform, &import->meshes[bottom->meshes[k]]);
    }
    return figures;
}

static bool agree(const struct import_figures *a, const struct import_figures *b)
{
    bool same = a->triangles == b->triangles;
    for (int axis = 0; axis < 3; axis++) {
        double size = fmax(fmax(fabs(a->min[axis]), fabs(a->max[axis])), fmax(fabs(b->min[axis]), fabs(b->max[axis])));
        same &= fabs(a->min[axis] - b->min[axis]) <= tolerance * size;
        same &= fabs(a->max[axis] - b->max[axis]) <= tolerance * size;
    }
    return same;
}

struct import_comparison import_compare(const char *path, const struct import *import)
{
    struct import_comparison comparison = {.agreement = IMPORT_ONE_READER};
    struct import other;
    if (!import->has_second_reader)
        return comparison;
    comparison.own = import_figures(import);
    if (import_scene_by_assimp(path, import->memory, &other, &comparison.error)) {
        comparison.agreement = IMPORT_NOT_READ;
        return comparison;
    }
    comparison.assimp = import_figures(&other);
    comparison.agreement = agree(&comparison.own, &comparison.assimp) ? IMPORT_AGREES : IMPORT_DIFFERS;
    import_finish(&other);
    return comparison;
}
