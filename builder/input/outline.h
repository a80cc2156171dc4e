/* SPDX-License-Identifier: Apache-2.0 */
/*
 * outline.h - how far a bottom level reaches in any direction: found in its vertices (slabs.h), used for the boxes of
 * its instances.
 */
#ifndef BVHD_OUTLINE_H
#define BVHD_OUTLINE_H

#include "builder/format/canonical.h"
#include "builder/context.h"

/*
 * Slabs that contain all that can be hit in a bottom level: of all vertices from the first in use to the last, or of
 * all active boxes, rounded outward. Not known where there is nothing, or what is there does not fit floats. The same
 * for any number of threads. False when cancelled.
 */
bool outline_find(const struct canonical *canonical, const struct build_context *context, struct slabs *ret_slabs);

/*
 * Makes the world box of an instance smaller: `box` contains all that the bounds contain, and is cut to what the slabs
 * leave of them. Slabs that are not known, or that leave nothing, change nothing. The matrix is finite, row-major 3x4.
 */
void outline_narrow(const float matrix[12], const struct box *bounds, const struct slabs *slabs, struct box *box);

#endif
