/* SPDX-License-Identifier: Apache-2.0 */
/* texture.h - an image on a surface: smaller copies of it (mip maps), and samples that mix their pixels. */
#ifndef BVHCTL_TEXTURE_H
#define BVHCTL_TEXTURE_H

#include "client/bvhctl/picture/vector.h"
#include "client/bvhctl/scene/import_look.h"

enum { TEXTURE_LEVELS = 16 };

struct texture {
    struct import_image levels[TEXTURE_LEVELS]; /* the first one is the image itself */
    uint32_t level_count;
    struct memory *memory;
};

/* A linear colour with its alpha. */
struct texture_colour {
    struct vector rgb;
    double alpha;
};

/* Makes the smaller copies. `image`, which must have pixels, must outlive the texture. Returns false without memory. */
bool texture_init(struct texture *texture, const struct import_image *image, struct memory *memory);
/* NULL-safe, idempotent. */
void texture_finish(struct texture *texture);

/* How a texture is sampled, as glTF says it. */
struct texture_filter {
    enum import_wrap wrap[2]; /* along u and v */
    bool is_pixelated; /* neighbouring pixels are not mixed */
    double level; /* which copy: 0 is the image, and each following one has half as many pixels along a side */
};

/* Returns the colour at (u, v); (0, 0) is the upper left corner of the image. u and v may be any numbers. */
struct texture_colour texture_sample(const struct texture *texture, double u, double v,
                                     const struct texture_filter *filter);

/* Converts a colour from the curve of sRGB, 0 to 255, to a linear one, 0 to 1. */
double texture_linear(unsigned char value);

#endif
