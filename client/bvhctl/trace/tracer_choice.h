/* SPDX-License-Identifier: Apache-2.0 */
/* tracer_choice.h - the tracer that `--device` asks for. */
#ifndef BVHCTL_TRACER_CHOICE_H
#define BVHCTL_TRACER_CHOICE_H

#include "client/bvhctl/trace/tracer.h"

struct tracer_choice {
    struct tracer *tracer;
    struct gpu *gpu; /* that it is on; may be NULL */
    bool is_cpu; /* the CPU traversal itself: there is nothing to compare it with but brute force */
};

/* As tracer_choose. */
typedef enum bvhd_status (*tracer_chooser)(const char *device, const struct structures *structures,
                                           const struct parallel *parallel, struct memory *memory,
                                           struct tracer_choice *ret_choice, struct bvhd_error *error);

/*
 * `device`: "cpu"; a part of a Vulkan device's name, as gpu_open takes it; or "auto": the first device of gpu_list that
 * loads the structures, else the CPU. Vulkan drivers that compute on the CPU are not chosen by "auto": the CPU
 * traversal has the same processor, and is made for it. A device that should do and does not work is remarked on stderr
 * then. Portable structures are traced by compute shaders, native ones by ray queries.
 *
 * The structures, and `parallel`, must outlive it. Fails as gpu_open and what creates tracers. End with
 * tracer_choice_finish.
 */
enum bvhd_status tracer_choose(const char *device, const struct structures *structures, const struct parallel *parallel,
                               struct memory *memory, struct tracer_choice *ret_choice, struct bvhd_error *error);
/* NULL-safe, idempotent. */
void tracer_choice_finish(struct tracer_choice *choice);

#endif
