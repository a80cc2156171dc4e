/* SPDX-License-Identifier: Apache-2.0 */
/* activity.h - counts the primitives of a mesh that no ray can hit, by kind. The builder's definitions apply. */
#ifndef BVHCTL_ACTIVITY_H
#define BVHCTL_ACTIVITY_H

#include "client/bvhctl/scene/import.h"

struct activity {
    uint64_t inactive; /* a corner has a NaN */
    uint64_t degenerate; /* active and finite, without area, or with no radius above 0 */
    uint64_t infinite; /* active, with a corner that is not finite */
};

/* Counts them; the time is a few nanoseconds for each triangle. */
struct activity activity_of(const struct import_mesh *mesh);

#endif
