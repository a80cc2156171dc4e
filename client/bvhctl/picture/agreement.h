/* SPDX-License-Identifier: Apache-2.0 */
/*
 * agreement.h - whether a tracer's answers are right: compared with the CPU traversal ray by ray, and by brute force in
 * double where the two differ.
 *
 * Answers agree when the same triangle of the same instance is hit from the same side, or nothing by both; of rays that
 * any hit ends, when both or none are ended. t may differ by rounding: by what the distance to the triangle's plane
 * moves when the coordinates that it follows from - of the ray's origin, of the way to the hit, of the corners, of the
 * instance's place - are each off by 8 units of float's precision. That is a few roundings of a computation in float,
 * and grows, as their effect does, where the ray grazes the triangle. Barycentrics are not compared: those of slivers
 * are all rounding.
 *
 * Of answers that differ, the oracle tells those that are uncertain, and those that are both right, because triangles
 * are tied. Drivers trace structures of their own format in float, without knowing their errors, and lavapipe takes
 * rays into an instance by an inverse of its matrix that may be off by many units in the last place. So of native
 * structures a ray is uncertain, too, where the oracle, going by that inverse, says what the device says of the ray or
 * of one that is 8 units beside it. All others are mismatches.
 */
#ifndef BVHCTL_AGREEMENT_H
#define BVHCTL_AGREEMENT_H

#include "client/bvhctl/picture/sampler.h"

struct agreement_case;

struct agreement {
    const struct surfaces *surfaces;
    const struct parallel *parallel;
    uint32_t camera_stride, other_stride; /* of rays, one in so many is compared */
    uint64_t camera_seen, other_seen;
    uint64_t checked, differing; /* of agreement_doubt's, all count as differing */
    uint64_t uncertain, mismatches; /* after agreement_judge */
    struct agreement_case *cases; /* for the oracle */
    uint32_t case_count;
    unsigned char *verdicts; /* of a wave */
    uint64_t verdict_capacity;
    struct memory *memory;
};

/*
 * For pictures of `pixels` pixels: of camera rays about 4 million, spread over the picture, are compared (all of them
 * below a million pixels), of the rays that follow a million. End with agreement_finish.
 */
void agreement_init(struct agreement *agreement, const struct surfaces *surfaces, uint64_t pixels,
                    const struct parallel *parallel, struct memory *memory);
/* NULL-safe, idempotent. */
void agreement_finish(struct agreement *agreement);

/* Compares a wave; a sampler_watch, `context` is the agreement. BVHD_NO_MEMORY. */
enum bvhd_status agreement_watch(void *context, bool is_camera, const struct ray *rays, const struct tracer_hit *hits,
                                 uint64_t count, struct bvhd_error *error);

/*
 * Leaves it to the oracle alone whether these are right: for what the CPU has traced. At most 4096 in all.
 * BVHD_NO_MEMORY.
 */
enum bvhd_status agreement_doubt(struct agreement *agreement, const struct ray *rays, const struct tracer_hit *hits,
                                 uint32_t count, struct bvhd_error *error);

/*
 * Asks the oracle, over the triangles in the structures. Of more than 4096 cases, or fewer in scenes of many millions
 * of triangles, the rest are mismatches unasked. `progress` as for oracle_trace.
 */
enum bvhd_status agreement_judge(struct agreement *agreement,
                                 void (*progress)(void *context, uint64_t done, uint64_t total), void *progress_context,
                                 struct bvhd_error *error);

#endif
