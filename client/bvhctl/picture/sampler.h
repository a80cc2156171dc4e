/* SPDX-License-Identifier: Apache-2.0 */
/*
 * sampler.h - computes thousands of samples of light.h at once. Their rays go to the tracer in three waves; between the
 * waves the hits are evaluated in parallel.
 *
 * Rays through holes of surfaces (light_is_hole) are traced again from behind the hole, in waves of their own.
 *
 * The waves are: camera rays; shadow rays from their hits, then ambient rays; shadow rays from the hits of those. Rays
 * of one kind are next to each other, because a GPU traces neighbouring rays together and coherent ones faster.
 */
#ifndef BVHCTL_SAMPLER_H
#define BVHCTL_SAMPLER_H

#include "client/bvhctl/picture/light.h"

/*
 * Is called after every wave, with its rays and the tracer's hits, in order to check them. `is_camera` is true for the
 * wave of camera rays. An error ends the sampling.
 */
typedef enum bvhd_status (*sampler_watch)(void *context, bool is_camera, const struct ray *rays,
                                          const struct tracer_hit *hits, uint64_t count, struct bvhd_error *error);

struct sampler_options {
    const struct light *light;
    struct tracer *tracer;
    const struct parallel *parallel;
    uint32_t batch; /* samples at once, at least 1; more need more memory, and keep a large device busier */
    sampler_watch watch; /* may be NULL */
    void *watch_context;
};

struct sampler_counts; /* of a chunk of samples */
struct sampler_hole;

struct sampler {
    struct sampler_options options;
    struct light_sample *samples; /* [batch]; the caller sets direction, index, random and time of each */
    uint64_t rays; /* traced so far */
    double seconds; /* that the tracer needed for them */
    /* the batch that is sampled: */
    uint32_t count; /* samples */
    struct ray *wave;
    struct tracer_hit *hits; /* of the wave */
    struct sampler_hole *holes; /* the rays of the wave that go on; these four are NULL if there are no holes */
    struct ray *further; /* those rays, from behind the holes */
    struct tracer_hit *further_hits;
    bool *is_hole; /* of each ray of a wave */
    struct sampler_counts *chunks; /* where each chunk's rays begin in the wave */
    struct memory *memory;
};

/* BVHD_NO_MEMORY. End with sampler_finish. */
enum bvhd_status sampler_init(struct sampler *sampler, const struct sampler_options *options, struct memory *memory,
                              struct bvhd_error *error);
/* NULL-safe, idempotent. */
void sampler_finish(struct sampler *sampler);

/* Computes samples[0 .. count). The result is the same for any number of threads and any batch. */
enum bvhd_status sampler_take(struct sampler *sampler, uint32_t count, struct bvhd_error *error);

#endif
