/* SPDX-License-Identifier: Apache-2.0 */
/* picture.h - a picture of a scene, rendered by rays through its built structures, and its PNG file. */
#ifndef BVHCTL_PICTURE_H
#define BVHCTL_PICTURE_H

#include "light.h"

struct picture {
    uint32_t width, height;
    uint8_t *rgb; /* rows from the top, three bytes a pixel */
    uint64_t rays; /* traced for it */
    double seconds; /* spent on them, shading counted in */
    struct memory *memory;
};

/* The same bytes for any number of threads. `progress` may be NULL. End with picture_finish. */
enum bvhd_status picture_render(const struct light *light, uint32_t width, uint32_t height, const struct parallel *parallel,
                                void (*progress)(void *context, uint64_t done, uint64_t total), void *progress_context,
                                struct memory *memory, struct picture *ret_picture, struct bvhd_error *error);

/* Through a temporary file and a rename. */
enum bvhd_status picture_write_png(const struct picture *picture, const char *path, struct bvhd_error *error);

/* NULL-safe, idempotent. */
void picture_finish(struct picture *picture);

#endif
