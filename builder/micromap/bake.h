/* SPDX-License-Identifier: Apache-2.0 */
/*
 * bake.h - makes an opacity micromap from a texture's alpha and the texture coordinates of triangles.
 *
 * The result is what VkMicromapBuildInfoEXT takes: an array of micromap triangles with their states, and an index for
 * each triangle of the mesh. A triangle that is all of one state gets a special index and no micromap triangle;
 * triangles whose micromaps are equal share one.
 *
 * In the 4-state format "transparent" and "opaque" are certain: the alpha test, with the texture's filter and wrap
 * modes on its full resolution (no mip maps), says so at every point of the micro-triangle, in exact arithmetic, and
 * also at points that rounding moves: by 2^-20 of the triangle's largest texture coordinate, which is what a shader's
 * floats may do, by `extra`, and by 1/256 texel, which samplers may. The other micro-triangles are unknown-opaque or
 * unknown-transparent as the test decides at their middle. In the 2-state format each micro-triangle has the state of
 * its middle, which is an approximation.
 *
 * Triangles may be degenerate in the texture, extend over any number of its repeats, and have coordinates that are no
 * numbers; these are unknown, unless the whole texture is of one state. The time a micro-triangle takes is bounded:
 * where it covers more than 32 rows of texels, blocks of texels are looked at.
 */
#ifndef BVHD_BAKE_H
#define BVHD_BAKE_H

#include "builder/context.h"
#include "builder/format/micro_triangle.h"
#include "builder/micromap/alpha_cells.h"
#include "proto/base/status.h"

/* What a byte of states has to decide, in triangles, if nothing else is asked for. */
#define BAKE_WORTH 1e-4

/* What to bake. Everything may be hostile; pointers have to reach what the counts say. */
struct bake_request {
    struct alpha_source texture;
    const float (*coordinates)[2]; /* texture coordinates, after any transform */
    uint32_t coordinate_count;
    const uint32_t *indices; /* three for each triangle; NULL: 0, 1, 2, ... */
    uint32_t triangle_count;
    const float *weights; /* how much each triangle counts, at least 0; NULL: 1 each */
    float extra[2]; /* how far samplers' coordinates may be off beyond rounding, as with a transform in the shader */
    enum micro_format format;
    uint32_t level; /* 0 to MICRO_LEVEL_MAX, or BAKE_LEVEL_AUTO, which chooses levels (level_choice.h) */
    /* Of BAKE_LEVEL_AUTO: */
    unsigned last_level; /* the highest level */
    double worth; /* what a byte has to decide, in triangles */
    uint64_t budget; /* the most bytes, counted before equal states are stored once */
};

/* What the triangles of the mesh are made of. Shares are means over them, by weight. */
struct bake_statistics {
    double shares[MICRO_STATES]; /* of micro-triangles by their state */
    double decided; /* share that is certain; in the 2-state format it is not known, and 1 */
    uint64_t special[MICRO_STATES]; /* triangles with a special index, by its state */
    uint64_t micros[MICRO_STATES]; /* micro-triangles of the others */
    uint64_t states[MICRO_STATES]; /* those that are stored, in the data */
};

/* A micromap. bake_finish frees it. */
struct baked {
    struct micromap_triangle *triangles;
    uint32_t triangle_count;
    unsigned char *data;
    uint64_t data_size;
    uint32_t *indices; /* one for each triangle of the mesh: of a micromap triangle, or special (MICROMAP_FULLY_) */
    uint32_t usages[MICRO_LEVEL_MAX + 1]; /* micromap triangles by level */
    uint32_t references[MICRO_LEVEL_MAX + 1]; /* triangles of the mesh without special index, by level */
    struct bake_statistics statistics;
};

/*
 * Bakes on the threads of the context, with memory from it. The result is the same for any number of threads. Fails
 * with BVHD_INVALID, BVHD_TOO_LARGE (states of 4 GiB and more, which offsets cannot reach, and too large textures),
 * BVHD_NO_MEMORY or BVHD_CANCELLED, and then holds nothing.
 */
enum bvhd_status bake(const struct bake_request *request, const struct build_context *context, struct baked *ret_baked,
                      struct bvhd_error *error);

/* Frees what a bake made. `memory` is that of its context. */
void bake_finish(struct baked *baked, struct memory *memory);

#endif
