/* SPDX-License-Identifier: Apache-2.0 */
/* refit_internal.h - what the refits of the layouts share. */
#ifndef BVHD_REFIT_INTERNAL_H
#define BVHD_REFIT_INTERNAL_H

#include "builder/kernel/vec4.h"
#include "builder/update/refit.h"
#include "builder/update/subtrees.h"

/* The result of visiting a node: 32 bytes, the box first. */
struct refit_node {
    struct box box;
    double cost; /* of its subtree, not yet over the root's area */
};

/* The result of the refit of a layout. */
struct refit_output {
    unsigned char *blob;
    struct box bounds; /* empty for an empty tree */
    double cost;
    struct layout_sizes sizes;
};

/*
 * Each layout has these two. The first writes a new blob. The second measures the cost of a structure that was just
 * built.
 */
enum bvhd_status refit_portable(const struct refit_request *request, const struct build_context *context,
                                struct refit_output *ret_output, struct bvhd_error *error);
enum bvhd_status refit_portable_cost(struct bytes blob, const struct build_context *context, double *ret_cost,
                                     struct bvhd_error *error);
enum bvhd_status refit_lavapipe(const struct refit_request *request, const struct build_context *context,
                                struct refit_output *ret_output, struct bvhd_error *error);
enum bvhd_status refit_lavapipe_cost(struct bytes blob, const struct device_format *device,
                                     const struct build_context *context, double *ret_cost, struct bvhd_error *error);

/* Returns the cost of a tree whose nodes cost `sum` in all, over half the area of its root; 0 if the root has none. */
static inline double refit_cost_of(double sum, double area)
{
    return area > 0 ? sum / area : 0;
}

/*
 * Returns a box with finite sides and min <= max, whatever comes in. Leaf boxes of active primitives are cut to the
 * range of floats; those that foreign bytes name could have NaNs.
 */
static inline struct vec4_box refit_box_finite(struct vec4_box box)
{
    const vec4 most = vec4_all(FLT_MAX), least = vec4_all(-FLT_MAX);
    box.min = vec4_max(vec4_min(box.min, most), least);
    box.max = vec4_max(vec4_min(box.max, most), box.min);
    return box;
}

#endif
