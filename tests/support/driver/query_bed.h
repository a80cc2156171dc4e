/* SPDX-License-Identifier: Apache-2.0 */
/*
 * query_bed.h - traces rays by a device's own ray queries and returns all that they report about the committed hit and
 * about every candidate. For test programs only: failures end the program.
 */
#ifndef BVHD_TEST_QUERY_BED_H
#define BVHD_TEST_QUERY_BED_H

#include "tests/support/builder/scene_boxes.h"
#include "client/bvhctl/trace/tracer.h"

/* The query's policy for candidates. AABBs are hit half way between where the ray enters and leaves them. */
enum query_policy {
    QUERY_ACCEPT,
    QUERY_IGNORE,
    QUERY_SOME, /* accepts two of three, by a hash of their numbers */
    QUERY_END, /* accepts one and ends the query */
    QUERY_ONLY /* accepts only the ray's target */
};

struct query_id {
    uint32_t instance, geometry, primitive;
};

/* Written by the kernel. On a miss t is infinity, the instance RAY_NO_INSTANCE, and all else 0. */
struct query_answer {
    float t, u, v;
    uint32_t instance, custom_index, geometry, primitive;
    uint32_t flags; /* QUERY_ */
    uint32_t sbt_offset;
    uint32_t matrices; /* a checksum of the matrices of the instance and the ray in its space */
    uint32_t candidates; /* number of reported candidates; it depends on the order of visits, except for QUERY_IGNORE */
    uint32_t reserved;
};

enum { QUERY_FRONT_FACE = 1, QUERY_AABB = 2, QUERY_HIT = 4 };

/* Whether all fields but the number of candidates are equal. */
bool query_answer_equal(const struct query_answer *a, const struct query_answer *b);

struct query_bed;

struct query_bed *query_bed_create(struct gpu *gpu);
void query_bed_destroy(struct query_bed *bed);

/* Sets the AABBs of the scenes that are traced from now on. */
void query_bed_set_boxes(struct query_bed *bed, const struct scene_boxes *boxes);

struct query_work {
    VkAccelerationStructureKHR top;
    const struct ray *rays; /* must be valid for Vulkan */
    uint32_t count;
    enum query_policy policy;
    const struct query_id *targets; /* QUERY_ONLY: one for each ray */
    uint32_t listed; /* how many candidates of each ray are listed */
};

/*
 * Traces the rays. ret_candidates[ray * listed + i] receives the first candidates of each ray in the order in which
 * they came; answers[ray].candidates is their total number. It may be NULL if `listed` is 0.
 */
void query_bed_trace(struct query_bed *bed, const struct query_work *work, struct query_answer *ret_answers,
                     struct query_id *ret_candidates);

#endif
