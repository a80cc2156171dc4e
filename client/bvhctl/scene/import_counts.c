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
};

uint64_t import_counts_get(const struct import_counts *counts, int kind)
{
    const uint64_t values[IMPORT_COUNT_KINDS] = {
        counts->points,       counts->lines,  counts->skins, counts->morphs, counts->animations, counts->incomplete,
        counts->positionless, counts->meshes, counts->nodes, counts->scenes, counts->extensions, counts->bounds};
    return values[kind];
}
