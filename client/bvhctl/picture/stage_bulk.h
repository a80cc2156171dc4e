/* SPDX-License-Identifier: Apache-2.0 */
/*
 * stage_bulk.h - finds what a picture of a stage should be about, and which direction is up. Internal to stage.h.
 *
 * Three kinds of triangles do not belong to it, because everything else would be too small to see: a ground of
 * triangles that are much larger than all the others together; spikes, which reach to a far vertex; and few triangles
 * that are far away.
 */
#ifndef BVHCTL_STAGE_BULK_H
#define BVHCTL_STAGE_BULK_H

#include "client/bvhctl/picture/stage.h"

/*
 * Marks the samples that belong to the subject, and sets the axes, the bulk, its size and its floor. `up` is 'x', 'y',
 * 'z', or 'a' for a guess. Returns false when there is no memory.
 */
bool stage_bulk_find(struct stage *stage, char up);

#endif
