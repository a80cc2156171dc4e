/* SPDX-License-Identifier: Apache-2.0 */
/*
 * outline.h - finds how far a bottom level reaches along fixed directions (its slabs, a k-DOP: slabs.h), and uses them
 * to make the boxes of its instances tighter.
 */
#ifndef BVHD_OUTLINE_H
#define BVHD_OUTLINE_H

#include "builder/format/canonical.h"
#include "builder/context.h"

/*
 * Finds slabs, rounded outward, that contain everything that can be hit in a bottom level: all vertices from the first
 * to the last in use, or all active boxes. Slabs stay unknown (all 0) when there is nothing, or when values do not fit
 * floats. The result is the same for any number of threads. Returns false when cancelled.
 */
bool outline_find(const struct canonical *canonical, const struct build_context *context, struct slabs *ret_slabs);

/*
 * Makes the world box of an instance tighter. `box` comes in as a box around the transformed bounds, and is cut to the
 * transformed slabs. It does not change when the slabs are unknown, and an axis on which the slabs would leave nothing
 * does not change. `matrix` is the instance's, finite, a row-major 3x4; `bounds` and `slabs` are those of its bottom
 * level, in object space.
 */
void outline_narrow(const float matrix[12], const struct box *bounds, const struct slabs *slabs, struct box *box);

#endif
