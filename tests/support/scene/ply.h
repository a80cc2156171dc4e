/* SPDX-License-Identifier: Apache-2.0 */
/*
 * ply.h - reads the triangle meshes that benchmarks are given: binary little-endian PLY with float x y z first and
 * faces as uchar 3, int x3.
 *
 * For test programs only: a file of another kind, or no memory, gives NULL and a line on stderr.
 */
#ifndef BVHD_PLY_H
#define BVHD_PLY_H

#include <stdint.h>

struct ply {
    uint32_t vertex_count, triangle_count;
    float *positions; /* xyz */
    uint32_t *indices; /* three a triangle, each < vertex_count */
};

struct ply *ply_read(const char *path);

/* NULL-safe. */
void ply_free(struct ply *ply);

#endif
