/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/scene/import_counts.h"

#include <stddef.h>

const struct import_count_kind import_count_kinds[IMPORT_COUNT_KINDS] = {
    {"points", "point is left out", "points are left out", "--points"},
    {"lines", "line is left out", "lines are left out", "--lines"},
    {"skins", "skinned mesh is built at rest", "skinned meshes are built at rest", NULL},
    {"morphs", "morph target is left out", "morph targets are left out", NULL},
    {"animations", "animation is left out", "animations are left out", NULL},
    {"channels", "channel of the animation is left out", "channels of the animation are left out", NULL},
    {"incomplete", "primitive ends with corners that make no triangle or line",
     "primitives end with corners that make no triangle or line", NULL},
    {"positionless", "primitive has no positions and is left out", "primitives have no positions and are left out",
     NULL},
    {"meshes", "mesh is left out, because no node has it", "meshes are left out, because no node has them", NULL},
    {"nodes", "node with a mesh is left out, because it is in no scene",
     "nodes with a mesh are left out, because they are in no scene", NULL},
    {"scenes", "scene is left out", "scenes are left out", NULL},
    {"extensions", "extension is used that this version does not know; it may change geometry",
     "extensions are used that this version does not know; they may change geometry", NULL},
    {"bounds", "array of positions has other bounds than the file says",
     "arrays of positions have other bounds than the file says", NULL},
    {"empty_faces", "face without corners is left out", "faces without corners are left out", NULL},
    {"fanned", "polygon crosses itself: some of its triangles may overlap",
     "polygons cross themselves: some of their triangles may overlap", NULL},
    {"lost", "triangle is missing: assimp could not cut all polygons",
     "triangles are missing: assimp could not cut all polygons", NULL},
    {"unknown_rows", "row of unknown elements is left out", "rows of unknown elements are left out", NULL},
    {"unknown_lines", "line of the header is not understood and ignored",
     "lines of the header are not understood and ignored", NULL},
    {"unknown_chunks", "chunk of an unknown kind is left out", "chunks of unknown kinds are left out", NULL},
    {"unmoved", "mesh of points or lines does not move: it stays as at the beginning of the shutter interval",
     "meshes of points or lines do not move: they stay as at the beginning of the shutter interval", NULL},
    {"extra_bytes", "byte after the end of the data is left out", "bytes after the end of the data are left out", NULL},
};

uint64_t import_counts_get(const struct import_counts *counts, int kind)
{
    const uint64_t values[IMPORT_COUNT_KINDS] = {
        counts->points,     counts->lines,        counts->skins,         counts->morphs,         counts->animations,
        counts->channels,   counts->incomplete,   counts->positionless,  counts->meshes,         counts->nodes,
        counts->scenes,     counts->extensions,   counts->bounds,        counts->empty_faces,    counts->fanned,
        counts->lost,       counts->unknown_rows, counts->unknown_lines, counts->unknown_chunks, counts->unmoved,
        counts->extra_bytes};
    return values[kind];
}

void import_counts_add_mesh(struct import_counts *sum, const struct import_counts *mesh)
{
    sum->points += mesh->points;
    sum->lines += mesh->lines;
    sum->skins += mesh->skins;
    sum->morphs += mesh->morphs;
    sum->incomplete += mesh->incomplete;
    sum->positionless += mesh->positionless;
    sum->bounds += mesh->bounds;
    sum->empty_faces += mesh->empty_faces;
    sum->fanned += mesh->fanned;
    sum->lost += mesh->lost;
    sum->unmoved += mesh->unmoved;
}

bool import_counts_any(const struct import_counts *counts)
{
    for (int i = 0; i < IMPORT_COUNT_KINDS; i++)
        if (import_counts_get(counts, i))
            return true;
    return false;
}
