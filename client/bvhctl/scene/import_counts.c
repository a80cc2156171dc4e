/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/scene/import_counts.h"

const struct import_count_kind import_count_kinds[IMPORT_COUNT_KINDS] = {
    {"points", "points are left out"},
    {"lines", "lines are left out"},
    {"skins", "skinned meshes are built at rest"},
    {"morphs", "morph targets are left out"},
    {"animations", "animations are left out"},
    {"incomplete", "primitives end with corners that make no triangle"},
    {"positionless", "primitives have no positions and are left out"},
    {"meshes", "meshes are left out, because no node has them"},
    {"nodes", "nodes with a mesh are left out, because they are in no scene"},
    {"scenes", "scenes are left out"},
    {"extensions", "extensions are used that this version does not know; they may change geometry"},
    {"bounds", "arrays of positions have other bounds than the file says"},
    {"empty_faces", "faces without corners are left out"},
    {"fanned", "polygons cross themselves: some of their triangles may overlap"},
    {"lost", "triangles are missing: assimp could not cut all polygons"},
    {"unknown_rows", "rows of unknown elements are left out"},
    {"unknown_lines", "lines of the header are not understood and ignored"},
    {"extra_bytes", "bytes after the end of the data are left out"},
};

uint64_t import_counts_get(const struct import_counts *counts, int kind)
{
    const uint64_t values[IMPORT_COUNT_KINDS] = {
        counts->points,       counts->lines,         counts->skins,       counts->morphs, counts->animations,
        counts->incomplete,   counts->positionless,  counts->meshes,      counts->nodes,  counts->scenes,
        counts->extensions,   counts->bounds,        counts->empty_faces, counts->fanned, counts->lost,
        counts->unknown_rows, counts->unknown_lines, counts->extra_bytes};
    return values[kind];
}

void import_counts_add_mesh(struct import_counts *sum, const struct import_counts *mesh)
{
    sum->points += mesh->points;
    sum->lines += mesh->lines;
    sum->skins += mesh->skins;
    sum->morphs += mesh->morphs;
    sum->empty_faces += mesh->empty_faces;
    sum->fanned += mesh->fanned;
    sum->lost += mesh->lost;
}
