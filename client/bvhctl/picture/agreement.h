/* SPDX-License-Identifier: Apache-2.0 */
/*
 * agreement.h - checks whether a tracer's answers are right. They are compared ray by ray with those of the CPU
 * traversal and, where the two differ, with brute force in double (the oracle).
 *
 * Two answers agree when both report the same triangle of the same instance from the same side, or both report a miss.
 * For rays that end at any hit it is enough that both report a hit. t may differ by rounding: by the amount that the
 * distance to the triangle's plane changes when the coordinates it is computed from (the ray's origin, the vector to
 * the hit, the corners, the position of the instance) are each off by 8 units of float's precision. That is a few
 * roundings of a computation in float and, like the effect of roundings, it grows where the ray grazes the triangle.
 * Barycentrics are not compared, because those of slivers are dominated by rounding.
 *
 * For answers that differ, the oracle finds out which rays are uncertain, and which answers are both right because
 * triangles are tied. Drivers trace structures of their own format in float without bounds on their errors, and
 * lavapipe transforms rays into an instance by an inverse of its matrix that may be off by many units in the last
 * place. Therefore a ray through native structures is also uncertain when the oracle, using that inverse, gives the
 * device's answer for the ray or for one that is 8 units beside it. All other answers that were judged are mismatches,
 * which is to say wrong.
 *
 * Where answers differ by the hundred thousand, the oracle judges a random sample of them, as large as it can judge in
 * a few seconds. Answers that no rounding explains (t is not a number, or the same triangle has another side or custom
 * index) are judged first. What was not judged is counted, and is no mismatch.
 */
#ifndef BVHCTL_AGREEMENT_H
#define BVHCTL_AGREEMENT_H

#include "client/bvhctl/picture/sampler.h"

struct agreement_case;

/* A random sample of rays whose answers differ. */
struct agreement_sample {
    struct agreement_case *cases;
    uint32_t count, capacity;
    uint64_t seen; /* rays that the sample was taken from */
};

struct agreement {
    const struct surfaces *surfaces;
    const struct parallel *parallel;
    uint32_t camera_stride, other_stride; /* every n-th camera ray, and every n-th other ray, is compared */
    uint64_t camera_seen, other_seen; /* rays, compared or not */
    uint64_t checked, differing; /* rays that were compared; all those of agreement_doubt count as differing */
    uint64_t judged; /* of those that differ; complete after agreement_judge, as are the two that follow */
    uint64_t uncertain, mismatches; /* of those that were judged */
    struct agreement_sample disputes; /* no rounding explains why they differ */
    struct agreement_sample doubts; /* the others */
    uint64_t random; /* state of the choice of samples */
    unsigned char *verdicts; /* of one wave, by ray */
    uint64_t verdict_capacity;
    struct memory *memory;
};

/*
 * Prepares the comparison for pictures of `samples` camera rays. About 4 million of these, spread over the pictures,
 * are compared (all of them if there are fewer), and about a million of the other rays. End with agreement_finish.
 */
void agreement_init(struct agreement *agreement, const struct surfaces *surfaces, uint64_t samples,
                    const struct parallel *parallel, struct memory *memory);
/* NULL-safe, idempotent. */
void agreement_finish(struct agreement *agreement);

/* Compares the rays of a wave. It is a sampler_watch whose `context` is the agreement. BVHD_NO_MEMORY. */
enum bvhd_status agreement_watch(void *context, bool is_camera, const struct ray *rays, const struct tracer_hit *hits,
                                 uint64_t count, struct bvhd_error *error);

/*
 * Has the oracle alone judge these hits, which the CPU traversal itself has found. They all count as differing.
 * BVHD_NO_MEMORY.
 */
enum bvhd_status agreement_doubt(struct agreement *agreement, const struct ray *rays, const struct tracer_hit *hits,
                                 uint32_t count, struct bvhd_error *error);

/*
 * Has the oracle judge the answers that differ, over the triangles in the structures, for at most about `seconds`; in
 * scenes of many millions of triangles that is a few answers. `progress` is that of oracle_trace.
 */
enum bvhd_status agreement_judge(struct agreement *agreement, double seconds,
                                 void (*progress)(void *context, uint64_t done, uint64_t total), void *progress_context,
                                 struct bvhd_error *error);

#endif
