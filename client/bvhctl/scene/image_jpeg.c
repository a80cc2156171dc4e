/* SPDX-License-Identifier: Apache-2.0 */
#include <setjmp.h>
#include <stdio.h>

#include <jpeglib.h>

#include "client/bvhctl/scene/image.h"

/* A file that is decoded. After a mistake libjpeg jumps, so that everything that has to be freed is here. */
struct decoder {
    struct jpeg_decompress_struct jpeg;
    struct jpeg_error_mgr errors;
    struct image_rows rows;
    bool has_rows;
    unsigned char *rgb, *rgba; /* one row */
    struct memory *memory;
    char text[JMSG_LENGTH_MAX];
    jmp_buf jump;
};

__attribute__((noreturn)) static void fail(j_common_ptr jpeg)
{
    struct decoder *decoder = jpeg->client_data;
    jpeg->err->format_message(jpeg, decoder->text);
    longjmp(decoder->jump, 1);
}

/* Warnings are about damaged data, whose pixels are wrong. */
static void warn(j_common_ptr jpeg, int level)
{
    if (level < 0)
        fail(jpeg);
}

static void widen(const struct decoder *decoder)
{
    for (size_t x = 0; x < decoder->jpeg.output_width; x++) {
        for (int k = 0; k < 3; k++)
            decoder->rgba[4 * x + (size_t)k] = decoder->rgb[3 * x + (size_t)k];
        decoder->rgba[4 * x + 3] = 0xff;
    }
}

/* Sets the scale by which libjpeg makes an image smaller, which is faster than to decode all of it. */
static void choose_scale(struct jpeg_decompress_struct *jpeg, uint32_t limit)
{
    uint32_t side = jpeg->image_width > jpeg->image_height ? jpeg->image_width : jpeg->image_height;
    jpeg->scale_num = jpeg->scale_denom = 1;
    while (jpeg->scale_denom < 8 && side / jpeg->scale_denom > limit)
        jpeg->scale_denom *= 2;
}

static enum bvhd_status read_image(struct decoder *decoder, uint32_t limit, struct bvhd_error *error)
{
    struct jpeg_decompress_struct *jpeg = &decoder->jpeg;
    jpeg_read_header(jpeg, TRUE);
    if (jpeg->image_width > IMAGE_MOST_SIDE || jpeg->image_height > IMAGE_MOST_SIDE)
        return bvhd_error_set(error, BVHD_UNSUPPORTED, "image", "%u x %u pixels, which is beyond the limits",
                              jpeg->image_width, jpeg->image_height);
    if (jpeg->num_components > 3)
        return bvhd_error_set(error, BVHD_UNSUPPORTED, "image", "a JPEG of %d colour components", jpeg->num_components);
    choose_scale(jpeg, limit);
    jpeg->out_color_space = JCS_RGB;
    jpeg_start_decompress(jpeg);
    enum bvhd_status status =
        image_rows_init(&decoder->rows, jpeg->output_width, jpeg->output_height, limit, decoder->memory, error);
    if (status != BVHD_OK)
        return status;
    decoder->has_rows = true;
    decoder->rgb = memory_array(decoder->memory, jpeg->output_width, 3);
    decoder->rgba = memory_array(decoder->memory, jpeg->output_width, 4);
    if (!decoder->rgb || !decoder->rgba)
        return bvhd_error_no_memory(error, "image", "no memory for its rows");
    while (jpeg->output_scanline < jpeg->output_height) {
        jpeg_read_scanlines(jpeg, &decoder->rgb, 1);
        widen(decoder);
        image_rows_add(&decoder->rows, decoder->rgba);
    }
    return BVHD_OK;
}

static enum bvhd_status decode(struct decoder *decoder, struct bytes file, uint32_t limit, struct bvhd_error *error)
{
    decoder->jpeg.err = jpeg_std_error(&decoder->errors);
    decoder->errors.error_exit = fail;
    decoder->errors.emit_message = warn;
    decoder->jpeg.client_data = decoder;
    jpeg_create_decompress(&decoder->jpeg);
    decoder->jpeg.mem->max_memory_to_use = IMAGE_MOST_PIXELS;
    jpeg_mem_src(&decoder->jpeg, file.data, file.size);
    return read_image(decoder, limit, error);
}

enum bvhd_status image_decode_jpeg(struct bytes file, uint32_t limit, struct memory *memory,
                                   struct import_image *ret_image, struct bvhd_error *error)
{
    struct decoder decoder = {.memory = memory};
    enum bvhd_status status;
    if (setjmp(decoder.jump))
        status = bvhd_error_set(error, BVHD_CORRUPT, "image", "libjpeg: %.100s", decoder.text);
    else
        status = decode(&decoder, file, limit, error);
    jpeg_destroy_decompress(&decoder.jpeg);
    memory_free(memory, decoder.rgb);
    memory_free(memory, decoder.rgba);
    if (decoder.has_rows)
        image_rows_finish(&decoder.rows);
    if (status == BVHD_OK)
        *ret_image = decoder.rows.image;
    else
        memory_free(memory, decoder.rows.image.rgba);
    return status;
}
