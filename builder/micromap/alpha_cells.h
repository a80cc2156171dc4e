/* SPDX-License-Identifier: Apache-2.0 */
/*
 * alpha_cells.h - what an alpha test decides in each cell of a texture (texture_axis.h), in a form in which rows of
 * cells are looked up fast.
 *
 * A cell passes if the test passes with each texel that it reads, fails if it fails with each, and is mixed otherwise.
 * Filtered alpha is a weighted mean of these texels, so what all of them decide holds everywhere in the cell.
 *
 * The table has a byte for each cell: what the test decides, and how many cells to the right of it in its row decide
 * the same. Each further order of the table has one for each block of 2 x 2 of the order below, up to one block.
 */
#ifndef BVHD_ALPHA_CELLS_H
#define BVHD_ALPHA_CELLS_H

#include "builder/context.h"
#include "builder/micromap/texture_axis.h"
#include "proto/base/bytes.h"
#include "proto/base/status.h"

enum { ALPHA_SIZE_MAX = 16384, ALPHA_ORDERS = 16 };

/* What the test decides in a cell, or in several ones: sets of these bits. */
enum { ALPHA_MIXED = 1, ALPHA_PASSES = 2, ALPHA_FAILS = 4 };

/* A texture's alpha, and how it is sampled and tested. The bytes are the caller's. */
struct alpha_source {
    struct bytes texels; /* row y begins at y * row_stride and has one byte for each texel, 0 to 255 */
    uint64_t row_stride;
    uint32_t width, height; /* 1 to ALPHA_SIZE_MAX */
    enum bake_wrap wrap_u, wrap_v;
    bool is_nearest; /* the filter: one texel, or bilinear between four */
    enum bake_mode mode;
    float cutoff; /* of BAKE_MASK, not a NaN: alpha passes if it is at least that, and fails if not */
};

struct alpha_order {
    unsigned char *rows; /* height rows of width bytes: the number of the bit above, and 4 times the equal ones */
    int64_t width, height;
};

struct alpha_cells {
    const unsigned char *texels;
    uint64_t row_stride;
    struct texture_axis axes[2];
    struct alpha_order orders[ALPHA_ORDERS];
    unsigned order_count;
    int least_passing, most_failing; /* texels; 256 and -1 if there is none */
    int least_opaque; /* texels that count as opaque where one or the other has to be said */
    double threshold; /* what filtered alpha, from 0 to 255, has to reach for that */
    bool is_mask; /* points where alpha is tested pass or fail; with BLEND most do neither */
    bool may_bound; /* whether bounds of filtered alpha can decide more than texels do */
    unsigned char *block; /* memory of all orders */
};

/*
 * Checks a source that may be hostile, and makes its table: about 4/3 bytes a texel. The texels are read on, and have
 * to stay, until alpha_cells_finish; if they change meanwhile, the results are of no use, but nothing worse happens.
 * The table is the same for any number of threads. Fails with BVHD_INVALID, BVHD_TOO_LARGE, BVHD_NO_MEMORY or
 * BVHD_CANCELLED.
 */
enum bvhd_status alpha_cells_init(const struct alpha_source *source, const struct build_context *context,
                                  struct alpha_cells *ret_cells, struct bvhd_error *error);

/* Frees the table. `memory` is that of the context. */
void alpha_cells_finish(struct alpha_cells *cells, struct memory *memory);

/* Returns what the test decides in blocks first to last of a row of the order: the sum of their bits. */
static inline unsigned alpha_cells_run(const struct alpha_order *order, int64_t row, int64_t first, int64_t last)
{
    const unsigned char *at = order->rows + row * order->width;
    unsigned seen = 0;
    do {
        const unsigned entry = at[first];
        seen |= 1u << (entry & 3);
        first += 1 + (entry >> 2);
    } while (first <= last);
    return seen;
}

/* Returns the same for cells first to last of a row of blocks, where cells outside the texture are wrapped. */
unsigned alpha_cells_wrapped_run(const struct alpha_cells *cells, unsigned order, int64_t row, int64_t first,
                                 int64_t last);

/*
 * Asks the processor for the part of the table and of the texels that covers a box of cells, from `low` to `high`, so
 * that what follows does not wait for one row after the other. Large boxes, and what lies outside the texture, are left
 * out.
 */
void alpha_cells_prefetch(const struct alpha_cells *cells, const double low[2], const double high[2]);

/* Returns the alpha of a texel, from 0 to 255, with numbers that are wrapped. */
static inline int alpha_cells_texel(const struct alpha_cells *cells, int64_t x, int64_t y)
{
    return cells->texels[(uint64_t)texture_axis_texel(&cells->axes[1], y) * cells->row_stride +
                         (uint64_t)texture_axis_texel(&cells->axes[0], x)];
}

/*
 * Returns whether the point at (x, y), in cells, passes the test with filtered alpha, in double; with BLEND whether its
 * alpha is at least one half.
 */
bool alpha_cells_pass(const struct alpha_cells *cells, double x, double y);

#endif
