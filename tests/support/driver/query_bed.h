/* SPDX-License-Identifier: Apache-2.0 */
/*
 * query_bed.h - rays by a device's own ray queries, with all that they say: of what is committed and of every
 * candidate. For test programs only: what fails ends them.
 */
#ifndef BVHD_TEST_QUERY_BED_H
#define BVHD_TEST_QUERY_BED_H

#include "tests/support/builder/scene_boxes.h"
#include "client/bvhctl/trace/tracer.h"

/* What becomes of candidates. AABBs are hit half way between where the ray enters and leaves them. */
enum query_policy {
    QUERY_ACCEPT,
    QUERY_IGNORE,
    QUERY_SOME, /* two of three, by their numbers */
    QUERY_END, /* accepts one and ends the query */
    QUERY_ONLY /* the ray's target alone */
};

struct query_id {
    uint32_t instance, geometry, primitive;
};

/* As the kernel writes it; all 0, infinity and RAY_NO_INSTANCE on a miss. */
struct query_answer {
    float t, u, v;
    uint32_t instance, custom_index, geometry, primitive;
    uint32_t flags; /* QUERY_ */
    uint32_t sbt_offset;
    uint32_t matrices; /* a sum over the matrices of the instance and the ray in its space */
    uint32_t candidates; /* how many were reported: up to the order of visits, but for QUERY_IGNORE */
    uint32_t reserved;
};

enum { QUERY_FRONT_FACE = 1, QUERY_AABB = 2, QUERY_HIT = 4 };

/* Whether all is equal but the number of candidates. */
bool query_answer_equal(const struct query_answer *a, const struct query_answer *b);

struct query_bed;

struct query_bed *query_bed_create(struct gpu *gpu);
void query_bed_destroy(struct query_bed *bed);

/* The AABBs of what is traced from now on. */
void query_bed_set_boxes(struct query_bed *bed, const struct scene_boxes *boxes);

struct query_work {
    VkAccelerationStructureKHR top;
    const struct ray *rays; /* as Vulkan allows them */
    uint32_t count;
    enum query_policy policy;
    const struct query_id *targets; /* QUERY_ONLY: one a ray */
    uint32_t listed; /* so many candidates of each ray are listed */
};

/*
 * ret_candidates[ray * listed + i], in the order in which they came, of the first answers[ray].candidates; may be NULL
 * without any.
 */
void query_bed_trace(struct query_bed *bed, const struct query_work *work, struct query_answer *ret_answers,
                     struct query_id *ret_candidates);

#endif
