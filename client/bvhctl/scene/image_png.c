/* SPDX-License-Identifier: Apache-2.0 */
#include <assert.h>
#include <png.h>
#include <setjmp.h>
#include <stdio.h>
#include <string.h>

#include "client/bvhctl/scene/image.h"

/* A file that is decoded. After a mistake libpng jumps, so that everything that has to be freed is here. */
struct decoder {
    struct bytes file;
    uint64_t at;
    png_structp png;
    png_infop info;
    struct image_rows rows;
    bool has_rows;
    unsigned char *pixels; /* one row, or all rows of an interlaced image */
    png_bytep *pointers; /* to the rows of an interlaced image */
    struct memory *memory;
    char text[64];
    jmp_buf jump;
};

static void read_bytes(png_structp png, png_bytep ret_bytes, size_t size)
{
    struct decoder *decoder = png_get_io_ptr(png);
    if (size > decoder->file.size - decoder->at)
        png_error(png, "the file is cut off");
    memcpy(ret_bytes, decoder->file.data + decoder->at, size);
    decoder->at += size;
}

__attribute__((noreturn)) static void fail(png_structp png, png_const_charp text)
{
    struct decoder *decoder = png_get_error_ptr(png);
    snprintf(decoder->text, sizeof decoder->text, "%s", text);
    longjmp(decoder->jump, 1);
}

static void ignore(png_structp png, png_const_charp text)
{
    (void)png;
    (void)text;
}

static png_voidp allocate(png_structp png, png_alloc_size_t size)
{
    struct decoder *decoder = png_get_mem_ptr(png);
    return memory_alloc(decoder->memory, size);
}

static void release(png_structp png, png_voidp block)
{
    struct decoder *decoder = png_get_mem_ptr(png);
    memory_free(decoder->memory, block);
}

/* Has libpng convert whatever the file has to four bytes a pixel. */
static void convert_to_rgba(struct decoder *decoder)
{
    png_set_expand(decoder->png);
    png_set_scale_16(decoder->png);
    png_set_gray_to_rgb(decoder->png);
    png_set_add_alpha(decoder->png, 0xff, PNG_FILLER_AFTER);
}

static enum bvhd_status read_interlaced(struct decoder *decoder, uint32_t height, size_t row_bytes)
{
    decoder->pixels = memory_array(decoder->memory, height, row_bytes);
    decoder->pointers = memory_array(decoder->memory, height, sizeof *decoder->pointers);
    if (!decoder->pixels || !decoder->pointers)
        return BVHD_NO_MEMORY;
    for (uint32_t y = 0; y < height; y++)
        decoder->pointers[y] = decoder->pixels + y * row_bytes;
    png_read_image(decoder->png, decoder->pointers);
    for (uint32_t y = 0; y < height; y++)
        image_rows_add(&decoder->rows, decoder->pointers[y]);
    return BVHD_OK;
}

static enum bvhd_status read_rows(struct decoder *decoder, uint32_t height, size_t row_bytes)
{
    decoder->pixels = memory_alloc(decoder->memory, row_bytes);
    for (uint32_t y = 0; y < height && decoder->pixels; y++) {
        png_read_row(decoder->png, decoder->pixels, NULL);
        image_rows_add(&decoder->rows, decoder->pixels);
    }
    return decoder->pixels ? BVHD_OK : BVHD_NO_MEMORY;
}

static enum bvhd_status read_image(struct decoder *decoder, uint32_t limit, struct bvhd_error *error)
{
    png_read_info(decoder->png, decoder->info);
    uint32_t width = png_get_image_width(decoder->png, decoder->info),
             height = png_get_image_height(decoder->png, decoder->info);
    convert_to_rgba(decoder);
    bool is_interlaced = png_set_interlace_handling(decoder->png) > 1;
    png_read_update_info(decoder->png, decoder->info);
    size_t row_bytes = png_get_rowbytes(decoder->png, decoder->info);
    assert(row_bytes == (size_t)width * 4);
    enum bvhd_status status = image_rows_init(&decoder->rows, width, height, limit, decoder->memory, error);
    if (status != BVHD_OK)
        return status;
    decoder->has_rows = true;
    status = is_interlaced ? read_interlaced(decoder, height, row_bytes) : read_rows(decoder, height, row_bytes);
    return status == BVHD_OK ? BVHD_OK : bvhd_error_no_memory(error, "image", "no memory for its rows");
}

static enum bvhd_status decode(struct decoder *decoder, uint32_t limit, struct bvhd_error *error)
{
    decoder->png = png_create_read_struct_2(PNG_LIBPNG_VER_STRING, decoder, fail, ignore, decoder, allocate, release);
    decoder->info = decoder->png ? png_create_info_struct(decoder->png) : NULL;
    if (!decoder->info)
        return bvhd_error_no_memory(error, "image", "no memory to decode it");
    png_set_user_limits(decoder->png, IMAGE_MOST_SIDE, IMAGE_MOST_SIDE);
    png_set_read_fn(decoder->png, decoder, read_bytes);
    return read_image(decoder, limit, error);
}

enum bvhd_status image_decode_png(struct bytes file, uint32_t limit, struct memory *memory,
                                  struct import_image *ret_image, struct bvhd_error *error)
{
    struct decoder decoder = {.file = file, .memory = memory};
    enum bvhd_status status;
    if (setjmp(decoder.jump))
        status = bvhd_error_set(error, BVHD_CORRUPT, "image", "libpng: %s", decoder.text);
    else
        status = decode(&decoder, limit, error);
    png_destroy_read_struct(decoder.png ? &decoder.png : NULL, &decoder.info, NULL);
    memory_free(memory, decoder.pixels);
    memory_free(memory, decoder.pointers);
    if (decoder.has_rows)
        image_rows_finish(&decoder.rows);
    if (status == BVHD_OK)
        *ret_image = decoder.rows.image;
    else
        memory_free(memory, decoder.rows.image.rgba);
    return status;
}
