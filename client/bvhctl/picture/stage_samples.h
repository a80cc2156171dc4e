/* SPDX-License-Identifier: Apache-2.0 */
/* stage_samples.h - takes random points of the triangles of a stage. Internal to stage.h. */
#ifndef BVHCTL_STAGE_SAMPLES_H
#define BVHCTL_STAGE_SAMPLES_H

#include "client/bvhctl/picture/stage.h"

/*
 * Fills samples[0 .. sample_count), whose array has room for STAGE_SAMPLES, and sets even_count, which is 0 if no
 * triangle is finite. The instances and the number of triangles are set before.
 */
void stage_samples_take(struct stage *stage);

#endif
