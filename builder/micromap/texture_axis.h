/* SPDX-License-Identifier: Apache-2.0 */
/*
 * texture_axis.h - one direction of a texture: which texels a sampler reads at a coordinate.
 *
 * A cell is a part of the texture within which a sampler reads the same texels: with nearest filtering one texel, with
 * bilinear filtering the square between the centres of four texels. A coordinate in cells is the texture coordinate
 * times the number of texels, plus `shift`; its floor is the number of a cell, and numbers outside [0, cells) are
 * wrapped. Bilinear filtering with other modes than repeat has one cell more than texels: its first and its last cell
 * lie half outside and read the texel of that edge only.
 */
#ifndef BVHD_TEXTURE_AXIS_H
#define BVHD_TEXTURE_AXIS_H

#include <stdbool.h>
#include <stdint.h>

#include "proto/base/geometry.h"

struct texture_axis {
    enum bake_wrap wrap;
    bool is_bilinear;
    int64_t texels, cells;
    int64_t period; /* of the texture in cells; 0 if it does not repeat */
    int64_t first_texel; /* the first texel of cell c is c + first_texel, to be wrapped */
    double shift;
};

/* A number of cells that follow each other both on the axis and in the texture. */
struct texture_piece {
    int64_t cell; /* the first one's place in the texture */
    int64_t count; /* at least 1 */
    int direction; /* 1: the cells ascend; -1: they descend; 0: all are the same cell */
};

/* `texels` is at least 1. */
struct texture_axis texture_axis_make(int64_t texels, enum bake_wrap wrap, bool is_bilinear);

/* texture_axis_texel for texels outside the texture. */
int64_t texture_axis_texel_outside(const struct texture_axis *axis, int64_t at);

/* Returns the place in the texture of texel `at`, a number that may be outside it. */
static inline int64_t texture_axis_texel(const struct texture_axis *axis, int64_t at)
{
    return at >= 0 && at < axis->texels ? at : texture_axis_texel_outside(axis, at);
}

/* Returns the greatest whole number up to x, which is below 2^62 in magnitude. */
static inline int64_t texture_axis_floor(double x)
{
    const int64_t whole = (int64_t)x;
    return whole - (x < (double)whole);
}

/* texture_axis_piece for cells outside the texture. */
struct texture_piece texture_axis_wrapped(const struct texture_axis *axis, int64_t at);

/* Returns the longest piece that begins with cell `at`. */
static inline struct texture_piece texture_axis_piece(const struct texture_axis *axis, int64_t at)
{
    if (at >= 0 && at < axis->cells)
        return (struct texture_piece){at, axis->cells - at, 1};
    return texture_axis_wrapped(axis, at);
}

/*
 * Cuts the piece that begins with cell `at` where the texture's blocks of 2^order cells end. Returns the block of its
 * cells, and the number of the cell after them.
 */
static inline int64_t texture_axis_block(const struct texture_axis *axis, unsigned order, int64_t at, int64_t *ret_next)
{
    const struct texture_piece piece = texture_axis_piece(axis, at);
    const int64_t within = piece.cell & ((INT64_C(1) << order) - 1);
    int64_t count = piece.count;
    if (piece.direction != 0) {
        const int64_t most = piece.direction > 0 ? (INT64_C(1) << order) - within : within + 1;
        count = count < most ? count : most;
    }
    *ret_next = at + count;
    return piece.cell >> order;
}

#endif
