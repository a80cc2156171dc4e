/* SPDX-License-Identifier: Apache-2.0 */
/* ply_input.h - describes a mesh from a file as a build input: one opaque geometry, portable target. */
#ifndef BVHD_PLY_INPUT_H
#define BVHD_PLY_INPUT_H

#include "proto/base/geometry.h"
#include "tests/support/scene/ply.h"

/* Both the mesh and *geometry must outlive the description. */
static inline struct build_input ply_input(const struct ply *ply, enum build_quality quality, struct geometry *geometry)
{
    *geometry = (struct geometry){
        .type = GEOMETRY_TRIANGLES,
        .flags = GEOMETRY_OPAQUE,
        .triangles = {.vertex_format = 106, /* R32G32B32_SFLOAT */
                      .max_vertex = ply->vertex_count - 1,
                      .vertex_stride = 12,
                      .index_type = INDEX_UINT32,
                      .vertices = {(const unsigned char *)ply->positions, (uint64_t)ply->vertex_count * 12},
                      .indices = {(const unsigned char *)ply->indices, (uint64_t)ply->triangle_count * 12}},
        .range = {.primitive_count = ply->triangle_count},
    };
    return (struct build_input){
        .type = STRUCTURE_BOTTOM,
        .geometry_count = 1,
        .geometries = geometry,
        .options = {.quality = quality, .target = TARGET_PORTABLE},
    };
}

#endif
