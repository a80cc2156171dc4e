/* SPDX-License-Identifier: Apache-2.0 */
/* alpha_cells.c - tests all texels of a texture, and makes the table of what they decide. */
#include "builder/micromap/alpha_cells.h"

#include <math.h>

/* The lowest two bits of an entry; ALPHA_MIXED is bit 0 of a set, and so on. */
enum { ENTRY_MIXED, ENTRY_PASSES, ENTRY_FAILS, RUN_MAX = 63, ROWS_A_TASK = 32 };

static const char place_of_texels[] = "texture";

static enum bvhd_status check(const struct alpha_source *source, struct bvhd_error *error)
{
    if (source->width == 0 || source->height == 0)
        return bvhd_error_set(error, BVHD_INVALID, place_of_texels, "the texture has no texels");
    if (source->width > ALPHA_SIZE_MAX || source->height > ALPHA_SIZE_MAX)
        return bvhd_error_set(error, BVHD_TOO_LARGE, place_of_texels,
                              "%u x %u texels are more than %d in one direction", source->width, source->height,
                              ALPHA_SIZE_MAX);
    if (!source->texels.data || source->row_stride < source->width ||
        !bytes_reach(source->texels.size, 0, source->row_stride, source->height - 1, source->width))
        return bvhd_error_set(error, BVHD_INVALID, place_of_texels, "its rows do not lie in its memory");
    if ((unsigned)source->wrap_u > BAKE_CLAMP_TO_EDGE || (unsigned)source->wrap_v > BAKE_CLAMP_TO_EDGE)
        return bvhd_error_set(error, BVHD_INVALID, place_of_texels, "its wrap mode is unknown");
    if ((unsigned)source->mode > BAKE_BLEND || (source->mode == BAKE_MASK && isnan(source->cutoff)))
        return bvhd_error_set(error, BVHD_INVALID, place_of_texels, "its alpha test is unknown");
    return BVHD_OK;
}

/* Texels are compared as a shader does, which gets them as floats. */
static void set_thresholds(const struct alpha_source *source, struct alpha_cells *cells)
{
    const float cutoff = source->mode == BAKE_MASK ? source->cutoff : 0.5f;
    int least = 0;
    while (least < 256 && !((float)least / 255.0f >= cutoff))
        least++;
    cells->least_passing = source->mode == BAKE_MASK ? least : 255;
    cells->most_failing = source->mode == BAKE_MASK ? least - 1 : 0;
    cells->least_opaque = least;
    cells->threshold = (double)cutoff * 255;
    cells->is_mask = source->mode == BAKE_MASK;
    cells->may_bound = source->mode == BAKE_MASK && !source->is_nearest && least > 0 && least < 256;
}

/* Allocates all orders, each with half the rows and columns of the one below. */
static enum bvhd_status allocate(struct alpha_cells *cells, struct memory *memory, struct bvhd_error *error)
{
    int64_t width = cells->axes[0].cells, height = cells->axes[1].cells;
    uint64_t total = 0;
    cells->order_count = 0;
    for (;;) {
        cells->orders[cells->order_count++] = (struct alpha_order){.width = width, .height = height};
        total += (uint64_t)(width * height);
        if (width == 1 && height == 1)
            break;
        width = (width + 1) / 2;
        height = (height + 1) / 2;
    }
    cells->block = memory_alloc(memory, total);
    if (!cells->block)
        return bvhd_error_no_memory(error, place_of_texels, "no memory for a table of its texels");
    unsigned char *at = cells->block;
    for (unsigned order = 0; order < cells->order_count; order++) {
        cells->orders[order].rows = at;
        at += cells->orders[order].width * cells->orders[order].height;
    }
    return BVHD_OK;
}

struct fill {
    struct alpha_cells *cells;
    unsigned order;
    /* The thresholds for bytes, and the bits that they set: none if no byte reaches them. */
    unsigned char least_passing, most_failing, passes, fails;
};

/* Turns a row of sets of bits, of which at most one is left in each, into entries. */
static void finish_row(unsigned char *row, int64_t width)
{
    static const unsigned char entry_of[] = {
        [0] = ENTRY_MIXED, [1 << ENTRY_PASSES] = ENTRY_PASSES, [1 << ENTRY_FAILS] = ENTRY_FAILS};
    unsigned last = 4, run = 0;
    for (int64_t x = width; x-- > 0;) {
        const unsigned entry = entry_of[row[x]];
        run = (run + (run < RUN_MAX)) & (0 - (unsigned)(entry == last)); /* 0 where another run begins; no branch */
        row[x] = (unsigned char)(entry | run << 2);
        last = entry;
    }
}

/* The bits of a cell with texels from least to most. */
static inline unsigned char set_of(const struct fill *fill, unsigned char least, unsigned char most)
{
    return (unsigned char)((least >= fill->least_passing ? fill->passes : 0) |
                           (most <= fill->most_failing ? fill->fails : 0));
}

/* Makes cells that read texels x and x + 1 of two rows. It is a loop over bytes that compilers turn into vectors. */
static void fill_squares(const struct fill *fill, const unsigned char *upper, const unsigned char *lower, int64_t count,
                         unsigned char *restrict out)
{
    const struct fill local = *fill;
    for (int64_t x = 0; x < count; x++) {
        const unsigned char least_left = upper[x] < lower[x] ? upper[x] : lower[x];
        const unsigned char least_right = upper[x + 1] < lower[x + 1] ? upper[x + 1] : lower[x + 1];
        const unsigned char most_left = upper[x] > lower[x] ? upper[x] : lower[x];
        const unsigned char most_right = upper[x + 1] > lower[x + 1] ? upper[x + 1] : lower[x + 1];
        out[x] = set_of(&local, least_left < least_right ? least_left : least_right,
                        most_left > most_right ? most_left : most_right);
    }
}

/* Makes one cell that may lie at an edge of the texture. */
static unsigned char border_cell(const struct fill *fill, const unsigned char *const rows[2], int64_t x)
{
    const struct texture_axis *across = &fill->cells->axes[0];
    unsigned char least = 255, most = 0;
    for (int corner = 0; corner < 4; corner++) {
        const int64_t right = across->is_bilinear ? corner % 2 : 0;
        const unsigned char texel = rows[corner / 2][texture_axis_texel(across, x + across->first_texel + right)];
        least = texel < least ? texel : least;
        most = texel > most ? texel : most;
    }
    return set_of(fill, least, most);
}

/* Makes one row of cells from the one or two rows of texels that it reads. */
static void fill_cells(const struct fill *fill, int64_t y)
{
    const struct alpha_cells *cells = fill->cells;
    const struct texture_axis *across = &cells->axes[0], *down = &cells->axes[1];
    const int64_t first = y + down->first_texel, last = down->is_bilinear ? first + 1 : first;
    const unsigned char *const rows[2] = {cells->texels + (uint64_t)texture_axis_texel(down, first) * cells->row_stride,
                                          cells->texels + (uint64_t)texture_axis_texel(down, last) * cells->row_stride};
    unsigned char *out = cells->orders[0].rows + y * cells->orders[0].width;
    if (across->is_bilinear) {
        fill_squares(fill, rows[0], rows[1], across->texels - 1, out - across->first_texel);
        out[0] = border_cell(fill, rows, 0);
        out[across->cells - 1] = border_cell(fill, rows, across->cells - 1);
    } else {
        for (int64_t x = 0; x < across->cells; x++)
            out[x] = set_of(fill, rows[0][x], rows[0][x]);
    }
    finish_row(out, across->cells);
}

/* Makes one row of blocks from those of the order below. */
static void fill_blocks(const struct fill *fill, int64_t y)
{
    const struct alpha_order *from = &fill->cells->orders[fill->order - 1], *to = &fill->cells->orders[fill->order];
    const unsigned char *upper = from->rows + 2 * y * from->width;
    const unsigned char *lower = 2 * y + 1 < from->height ? upper + from->width : upper;
    unsigned char *out = to->rows + y * to->width;
    for (int64_t x = 0; x < to->width; x++) {
        const int64_t left = 2 * x, right = left + 1 < from->width ? left + 1 : left;
        const unsigned set = (1u << (upper[left] & 3)) & (1u << (upper[right] & 3)) & (1u << (lower[left] & 3)) &
                             (1u << (lower[right] & 3));
        out[x] = (unsigned char)(set & ((1u << ENTRY_PASSES) | (1u << ENTRY_FAILS)));
    }
    finish_row(out, to->width);
}

static void fill_task(void *context, size_t index)
{
    const struct fill *fill = context;
    size_t begin, end;
    parallel_chunk(index, ROWS_A_TASK, (size_t)fill->cells->orders[fill->order].height, &begin, &end);
    for (size_t y = begin; y < end; y++) {
        if (fill->order == 0)
            fill_cells(fill, (int64_t)y);
        else
            fill_blocks(fill, (int64_t)y);
    }
}

enum bvhd_status alpha_cells_init(const struct alpha_source *source, const struct build_context *context,
                                  struct alpha_cells *ret_cells, struct bvhd_error *error)
{
    enum bvhd_status status = check(source, error);
    if (status != BVHD_OK)
        return status;
    struct alpha_cells cells = {.texels = source->texels.data, .row_stride = source->row_stride};
    cells.axes[0] = texture_axis_make(source->width, source->wrap_u, !source->is_nearest);
    cells.axes[1] = texture_axis_make(source->height, source->wrap_v, !source->is_nearest);
    set_thresholds(source, &cells);
    status = allocate(&cells, context->memory, error);
    if (status != BVHD_OK)
        return status;
    struct fill fill = {
        .cells = &cells,
        .least_passing = (unsigned char)cells.least_passing,
        .most_failing = (unsigned char)cells.most_failing,
        .passes = cells.least_passing <= 255 ? 1 << ENTRY_PASSES : 0,
        .fails = cells.most_failing >= 0 ? 1 << ENTRY_FAILS : 0,
    };
    for (fill.order = 0; fill.order < cells.order_count; fill.order++) {
        const size_t tasks = parallel_chunks(ROWS_A_TASK, (size_t)cells.orders[fill.order].height);
        if (!parallel_for_until(context->parallel, context->cancel, tasks, fill_task, &fill)) {
            alpha_cells_finish(&cells, context->memory);
            return bvhd_error_set(error, BVHD_CANCELLED, place_of_texels, "cancelled");
        }
    }
    *ret_cells = cells;
    return BVHD_OK;
}

void alpha_cells_finish(struct alpha_cells *cells, struct memory *memory)
{
    memory_free(memory, cells->block);
    cells->block = NULL;
}

unsigned alpha_cells_wrapped_run(const struct alpha_cells *cells, unsigned order, int64_t row, int64_t first,
                                 int64_t last)
{
    const struct texture_axis *axis = &cells->axes[0];
    unsigned seen = 0;
    if (axis->period > 0 && last - first >= axis->period)
        last = first + axis->period - 1;
    while (first <= last) {
        const struct texture_piece piece = texture_axis_piece(axis, first);
        const int64_t count = piece.count < last - first + 1 ? piece.count : last - first + 1;
        const int64_t end = piece.cell + piece.direction * (count - 1);
        const int64_t low = end < piece.cell ? end : piece.cell, high = end < piece.cell ? piece.cell : end;
        seen |= alpha_cells_run(&cells->orders[order], row, low >> order, high >> order);
        first += count;
    }
    return seen;
}

void alpha_cells_prefetch(const struct alpha_cells *cells, const double low[2], const double high[2])
{
    enum { LINE = 64, ROWS_MAX = 512, COLUMNS_MAX = 1024 };
    if (!(high[0] - low[0] < COLUMNS_MAX && high[1] - low[1] < ROWS_MAX && low[0] >= 0 && low[1] >= 0))
        return;
    const int64_t width = cells->axes[0].texels, height = cells->axes[1].texels;
    const int64_t first = (int64_t)low[0] & -LINE;
    const int64_t last = high[0] < (double)width ? (int64_t)high[0] : width - 1;
    const int64_t end = high[1] < (double)height ? (int64_t)high[1] : height - 1;
    for (int64_t y = (int64_t)low[1]; y <= end; y++)
        for (int64_t x = first; x <= last; x += LINE) {
            __builtin_prefetch(cells->orders[0].rows + y * cells->orders[0].width + x);
            __builtin_prefetch(cells->texels + (uint64_t)y * cells->row_stride + x);
        }
}

bool alpha_cells_pass(const struct alpha_cells *cells, double x, double y)
{
    const struct texture_axis *across = &cells->axes[0], *down = &cells->axes[1];
    const int64_t left = texture_axis_floor(x), top = texture_axis_floor(y);
    const int64_t i = left + across->first_texel, j = top + down->first_texel;
    if (!across->is_bilinear)
        return alpha_cells_texel(cells, i, j) >= cells->least_opaque;
    const double s = x - (double)left, t = y - (double)top;
    int texels[2][2];
    if (i >= 0 && j >= 0 && i + 1 < across->texels && j + 1 < down->texels) {
        const unsigned char *upper = cells->texels + (uint64_t)j * cells->row_stride + i;
        const unsigned char *lower = upper + cells->row_stride;
        texels[0][0] = upper[0];
        texels[0][1] = upper[1];
        texels[1][0] = lower[0];
        texels[1][1] = lower[1];
    } else {
        for (int corner = 0; corner < 4; corner++)
            texels[corner / 2][corner % 2] = alpha_cells_texel(cells, i + corner % 2, j + corner / 2);
    }
    const double above = texels[0][0] + s * (texels[0][1] - texels[0][0]);
    const double below = texels[1][0] + s * (texels[1][1] - texels[1][0]);
    return above + t * (below - above) >= cells->threshold;
}
