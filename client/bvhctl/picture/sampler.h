/* SPDX-License-Identifier: Apache-2.0 */
/*
 * sampler.h - light's samples by the thousand: the rays of all of them go to the tracer in three waves, what follows
 * from hits is computed in parallel.
 *
 * Waves: camera rays; shadow rays of what they met, then ambient rays; shadow rays of what those met. Rays of one kind
 * lie together, for the sake of devices that trace neighbours in step.
 */
#ifndef BVHCTL_SAMPLER_H
#define BVHCTL_SAMPLER_H

#include "client/bvhctl/picture/light.h"

/*
 * Told of every wave's rays, with what the tracer answered: to check it. `is_camera`: the wave of camera rays. An error
 * ends the sampling.
 */
typedef enum bvhd_status (*sampler_watch)(void *context, bool is_camera, const struct ray *rays,
                                          const struct tracer_hit *hits, uint64_t count, struct bvhd_error *error);

struct sampler_options {
    const struct light *light;
    struct tracer *tracer;
    const struct parallel *parallel;
    uint32_t batch; /* samples at once, at least 1: memory, against devices that are faster with many */
    sampler_watch watch; /* may be NULL */
    void *watch_context;
};

struct sampler_counts; /* of a chunk of samples */

struct sampler {
    struct sampler_options options;
    struct light_sample *samples; /* `batch` of them: direction, index and random are the caller's to fill */
    uint64_t rays; /* traced so far */
    double seconds; /* that the tracer spent on them */
    /* Of the batch that is sampled. */
    uint32_t count;
    struct ray *wave;
    struct tracer_hit *hits;
    struct sampler_counts *chunks; /* where each chunk's rays of the wave begin */
    struct memory *memory;
};

/* BVHD_NO_MEMORY. End with sampler_finish. */
enum bvhd_status sampler_init(struct sampler *sampler, const struct sampler_options *options, struct memory *memory,
                              struct bvhd_error *error);
/* NULL-safe, idempotent. */
void sampler_finish(struct sampler *sampler);

/* Completes samples[0 .. count). The same for any number of threads and any batch. */
enum bvhd_status sampler_take(struct sampler *sampler, uint32_t count, struct bvhd_error *error);

#endif
