/* SPDX-License-Identifier: Apache-2.0 */
/*
 * driver_judge.h - the same rays through both structures of a driver_scene, by ray queries and by ray-tracing
 * pipelines: what is not equal to the last bit has to be a tie, which is verified by tracing each of the two primitives
 * alone in the other one's structure, or a hit that is lost in the driver's own. For test programs only.
 */
#ifndef BVHD_TEST_DRIVER_JUDGE_H
#define BVHD_TEST_DRIVER_JUDGE_H

#include "tests/support/driver/driver_scene.h"
#include "tests/support/driver/query_bed.h"

/* What rays have in common. */
struct driver_case {
    const char *name;
    uint32_t flags; /* RAY_ */
    uint8_t mask;
    enum query_policy policy;
    bool is_any; /* any hit is right, if it is one */
};

extern const struct driver_case driver_cases[];
extern const uint32_t driver_case_count;

struct driver_tally {
    uint64_t rays, hits; /* hits of the driver's */
    uint64_t same; /* equal in every bit */
    uint64_t tied; /* the same t in every bit, and both primitives have it */
    uint64_t another; /* another hit, of rays that want any, and both are hits */
    /*
     * Ours is a hit, by the exact geometry as well, and nearer; in its own structure the driver does not find that
     * primitive even alone: its boxes of instances are too small by a rounding, and it misses boxes in whose upper
     * faces a ray lies.
     */
    uint64_t lost;
    uint64_t other; /* neither: a defect */
    uint64_t candidates; /* of the driver's, where none is accepted */
    uint64_t repeated; /* of ours, the same primitive once more for the same ray */
};

struct driver_judge {
    struct driver_scene *scene;
    struct query_bed *queries;
    VkAccelerationStructureKHR ours; /* instead of the scene's: a copy of it */
    struct tracer *our_pipeline, *their_pipeline; /* NULL where the device has none */
    struct driver_tally tally;
    bool tells_repeated; /* candidates that are reported twice are no defect */
    uint32_t listed; /* the candidates of how many of each ray are compared one by one */
};

/* `ours`: VK_NULL_HANDLE for the scene's own. The scene must outlive it. */
void driver_judge_init(struct driver_judge *ret_judge, struct driver_scene *scene, VkAccelerationStructureKHR ours);
void driver_judge_finish(struct driver_judge *judge);

/*
 * Adds to judge->tally, and prints the first defects as "WHAT: ...". The rays' flags and masks are those of the case;
 * where it has none (mask 0xff), the rays' own mask.
 */
void driver_judge_queries(struct driver_judge *judge, const char *what, const struct driver_case *shared,
                          const struct ray *rays, uint32_t count);
/* The same by pipelines; nothing where there are none, or for policies that are those of a query's loop. */
void driver_judge_pipelines(struct driver_judge *judge, const char *what, const struct driver_case *shared,
                            const struct ray *rays, uint32_t count);

#endif
