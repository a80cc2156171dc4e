/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/scene/image.h"

#include <string.h>

enum bvhd_status image_rows_init(struct image_rows *rows, uint32_t width, uint32_t height, uint32_t limit,
                                 struct memory *memory, struct bvhd_error *error)
{
    uint32_t side = width > height ? width : height, factor = (side + limit - 1) / limit;
    if (width == 0 || height == 0 || side > IMAGE_MOST_SIDE || (uint64_t)width * height > IMAGE_MOST_PIXELS)
        return bvhd_error_set(error, BVHD_UNSUPPORTED, "image", "%u x %u pixels, which is beyond the limits", width,
                              height);
    struct image_rows made = {.factor = factor, .source_width = width, .memory = memory};
    made.image.width = width >= factor ? width / factor : 1;
    made.image.height = height >= factor ? height / factor : 1;
    made.image.rgba = memory_array(memory, (uint64_t)made.image.width * made.image.height, 4);
    made.sums = memory_array(memory, made.image.width, 4 * sizeof *made.sums);
    if (!made.image.rgba || !made.sums) {
        memory_free(memory, made.image.rgba);
        memory_free(memory, made.sums);
        return bvhd_error_no_memory(error, "image", "no memory for %u x %u pixels", width, height);
    }
    memset(made.sums, 0, made.image.width * 4 * sizeof *made.sums);
    memset(made.image.rgba, 0, (size_t)made.image.width * made.image.height * 4);
    *rows = made;
    return BVHD_OK;
}

/* Writes the row whose sums are complete. */
static void finish_row(struct image_rows *rows, uint32_t row)
{
    uint32_t wide = rows->source_width < rows->factor ? rows->source_width : rows->factor;
    uint32_t high = rows->row - row * rows->factor, pixels = wide * high;
    unsigned char *out = rows->image.rgba + (size_t)row * rows->image.width * 4;
    for (uint32_t i = 0; i < 4 * rows->image.width; i++)
        out[i] = (unsigned char)((rows->sums[i] + pixels / 2) / pixels);
    memset(rows->sums, 0, rows->image.width * 4 * sizeof *rows->sums);
}

void image_rows_add(struct image_rows *rows, const unsigned char *rgba)
{
    uint32_t row = rows->row / rows->factor;
    if (row >= rows->image.height)
        return;
    uint32_t factor = rows->factor < rows->source_width ? rows->factor : rows->source_width;
    for (uint32_t x = 0; x < rows->image.width; x++)
        for (uint32_t i = 0; i < factor; i++)
            for (uint32_t k = 0; k < 4; k++)
                rows->sums[4 * x + k] += rgba[4 * ((size_t)x * rows->factor + i) + k];
    rows->row++;
    if (rows->row % rows->factor == 0)
        finish_row(rows, row);
}

void image_rows_finish(struct image_rows *rows)
{
    if (rows->row % rows->factor && rows->row / rows->factor < rows->image.height)
        finish_row(rows, rows->row / rows->factor); /* the only row of a thin image, or the last of a broken one */
    memory_free(rows->memory, rows->sums);
    rows->sums = NULL;
}

enum bvhd_status image_decode(struct bytes file, uint32_t limit, struct memory *memory, struct import_image *ret_image,
                              struct bvhd_error *error)
{
    static const unsigned char png[4] = {0x89, 'P', 'N', 'G'}, jpeg[3] = {0xff, 0xd8, 0xff};
    if (file.size >= sizeof png && !memcmp(file.data, png, sizeof png))
        return image_decode_png(file, limit, memory, ret_image, error);
    if (file.size >= sizeof jpeg && !memcmp(file.data, jpeg, sizeof jpeg))
        return image_decode_jpeg(file, limit, memory, ret_image, error);
    return bvhd_error_set(error, BVHD_UNSUPPORTED, "image", "neither PNG nor JPEG");
}
