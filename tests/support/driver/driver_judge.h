/* SPDX-License-Identifier: Apache-2.0 */
/*
 * driver_judge.h - traces the same rays through both structures of a driver_scene, by ray queries and by ray-tracing
 * pipelines, and compares the results. A result that is not equal to the last bit has to be a tie, which is verified by
 * tracing each of the two primitives alone in the other structure, or a hit that is lost in the driver's own structure.
 * For test programs only.
 */
#ifndef BVHD_TEST_DRIVER_JUDGE_H
#define BVHD_TEST_DRIVER_JUDGE_H

#include "tests/support/driver/driver_scene.h"
#include "tests/support/driver/query_bed.h"

/* The properties that the rays of a case share. */
struct driver_case {
    const char *name;
    uint32_t flags; /* RAY_ */
    uint8_t mask;
    enum query_policy policy;
    bool is_any; /* any hit is correct, as long as it is a hit */
};

extern const struct driver_case driver_cases[];
extern const uint32_t driver_case_count;

struct driver_tally {
    uint64_t rays, hits; /* hits in the driver's structure */
    uint64_t same; /* equal in every bit */
    uint64_t tied; /* t is equal in every bit, and both primitives have it */
    uint64_t another; /* another hit, for rays that accept any, and both are hits */
    /*
     * Ours is a hit, also by the exact geometry, and nearer; in its own structure the driver does not find that
     * primitive even alone. Its boxes of instances are too small by a rounding error, and it misses boxes whose upper
     * faces contain the ray.
     */
    uint64_t lost;
    uint64_t other; /* differences of no kind above: defects */
    uint64_t candidates; /* candidates in the driver's structure, where none is accepted */
    uint64_t repeated; /* candidates in ours that repeat a primitive for the same ray */
};

struct driver_judge {
    struct driver_scene *scene;
    struct query_bed *queries;
    VkAccelerationStructureKHR ours; /* traced instead of the scene's own top level: a copy of it */
    struct tracer *our_pipeline, *their_pipeline; /* NULL where the device has no pipelines */
    struct driver_tally tally;
    bool tells_repeated; /* candidates that are reported twice are no defect */
    uint32_t listed; /* number of candidates of each ray that are compared one by one */
};

/* `ours` is a copy to trace, or VK_NULL_HANDLE for the scene's own. The scene must outlive the judge. */
void driver_judge_init(struct driver_judge *ret_judge, struct driver_scene *scene, VkAccelerationStructureKHR ours);
void driver_judge_finish(struct driver_judge *judge);

/*
 * Adds to judge->tally, and prints the first defects as "WHAT: ...". The rays get the flags and mask of the case; with
 * mask 0xff they keep their own mask.
 */
void driver_judge_queries(struct driver_judge *judge, const char *what, const struct driver_case *shared,
                          const struct ray *rays, uint32_t count);
/* Does the same by pipelines. Does nothing where there are none, or for policies that need the loop of a query. */
void driver_judge_pipelines(struct driver_judge *judge, const char *what, const struct driver_case *shared,
                            const struct ray *rays, uint32_t count);

#endif
