/* SPDX-License-Identifier: Apache-2.0 */
/*
 * picture.h - renders a picture of a scene by rays through its built structures, and writes it to a PNG file.
 *
 * Each pixel is the mean of samples, which are spread over it, and in time over the times of the stage: what moves is
 * blurred.
 */
#ifndef BVHCTL_PICTURE_H
#define BVHCTL_PICTURE_H

#include "client/bvhctl/picture/sampler.h"

struct picture {
    uint32_t width, height;
    uint8_t *rgb; /* rows from the top, three bytes a pixel */
    uint64_t rays; /* that were traced for it */
    double seconds; /* that the tracer needed for them */
    double exposure; /* the factor of its light */
    struct memory *memory;
};

struct picture_options {
    const struct light *light;
    struct tracer *tracer;
    const struct parallel *parallel;
    uint32_t width, height;
    double exposure; /* the factor of the light; 0: by a histogram (exposure.h) */
    uint32_t samples; /* of each pixel, at most PICTURE_MOST_SAMPLES; 0: picture_samples chooses, with more on edges */
    uint32_t batch; /* samples at once (sampler.h), at least PICTURE_LEAST_BATCH and those of a pixel */
    sampler_watch watch; /* may be NULL */
    void *watch_context;
    void (*progress)(void *context, uint64_t done, uint64_t total); /* may be NULL */
    void *progress_context;
};

enum { PICTURE_LEAST_BATCH = 32, PICTURE_MOST_SAMPLES = 1024 };

/*
 * How many samples pixels get: all of them, and how many more those on the edges of objects and of shadows, to which
 * belongs what is blurred.
 */
struct picture_samples {
    uint32_t all, edges;
};

/* Returns what picture_render takes of a stage for an option `samples`. */
struct picture_samples picture_samples(const struct stage *stage, uint32_t samples);

/*
 * Renders a picture: the same bytes for any number of threads and any batch. It needs memory for the pixels and for one
 * batch. It fails with the errors of the tracer and of the watch. End with picture_finish.
 */
enum bvhd_status picture_render(const struct picture_options *options, struct memory *memory,
                                struct picture *ret_picture, struct bvhd_error *error);

/* Writes the PNG file, through a temporary file and a rename. */
enum bvhd_status picture_write_png(const struct picture *picture, const char *path, struct bvhd_error *error);

/* NULL-safe, idempotent. */
void picture_finish(struct picture *picture);

#endif
