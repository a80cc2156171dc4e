/* SPDX-License-Identifier: Apache-2.0 */
/*
 * ply.h - reads triangle meshes for benchmarks: binary little-endian PLY, with float x y z first, and faces as uchar 3,
 * int x3.
 *
 * For test programs only: for a file of another kind, or without memory, it returns NULL with a line on stderr.
 */
#ifndef BVHD_PLY_H
#define BVHD_PLY_H

#include <stdint.h>

struct ply {
    uint32_t vertex_count, triangle_count;
    float *positions; /* xyz */
    uint32_t *indices; /* three for each triangle, each < vertex_count */
};

struct ply *ply_read(const char *path);

/* Accepts NULL. */
void ply_free(struct ply *ply);

#endif
