/* SPDX-License-Identifier: Apache-2.0 */
/* image.h - decodes PNG and JPEG images, which are hostile. */
#ifndef BVHCTL_IMAGE_H
#define BVHCTL_IMAGE_H

#include "client/bvhctl/scene/import_look.h"
#include "proto/base/bytes.h"
#include "proto/base/status.h"

enum { IMAGE_MOST_SIDE = 1 << 15, IMAGE_MOST_PIXELS = 1 << 28 };

/*
 * Decodes an image. One that has more than `limit` pixels along a side is made smaller, by a whole factor. The caller
 * frees ret_image->rgba with memory_free. The text of an error says what is wrong: BVHD_UNSUPPORTED for other formats
 * and for images beyond the limits above, BVHD_CORRUPT if the decoder refuses it, BVHD_NO_MEMORY.
 */
enum bvhd_status image_decode(struct bytes file, uint32_t limit, struct memory *memory, struct import_image *ret_image,
                              struct bvhd_error *error);

/* Does the same for files of one format. Internal to image.c. */
enum bvhd_status image_decode_png(struct bytes file, uint32_t limit, struct memory *memory,
                                  struct import_image *ret_image, struct bvhd_error *error);
enum bvhd_status image_decode_jpeg(struct bytes file, uint32_t limit, struct memory *memory,
                                   struct import_image *ret_image, struct bvhd_error *error);

/* The rows of an image while they are decoded: squares of `factor` pixels become one. Internal to image.c. */
struct image_rows {
    struct import_image image; /* that is made */
    uint32_t factor;
    uint32_t source_width, row; /* the number of rows that were added */
    uint32_t *sums; /* of the row of the image that is being made, rgba each */
    struct memory *memory;
};

/*
 * Prepares an image for rows of a larger one. On an error, nothing has to be finished. Only whole squares count; of an
 * image that is thinner than a square, its row or column of pixels does.
 */
enum bvhd_status image_rows_init(struct image_rows *rows, uint32_t width, uint32_t height, uint32_t limit,
                                 struct memory *memory, struct bvhd_error *error);
/* Adds the next row, rgba each; rows after the last that counts are ignored. */
void image_rows_add(struct image_rows *rows, const unsigned char *rgba);
/* Frees everything but the image. */
void image_rows_finish(struct image_rows *rows);

#endif
