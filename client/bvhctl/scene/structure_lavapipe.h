/* SPDX-License-Identifier: Apache-2.0 */
/* structure_lavapipe.h - the functions of structure.h for the lavapipe layout. Internal. */
#ifndef BVHCTL_STRUCTURE_LAVAPIPE_H
#define BVHCTL_STRUCTURE_LAVAPIPE_H

#include "client/bvhctl/scene/structure.h"

/* Of a structure that has its blob and its memory. What it holds on failure, structure_close frees. */
enum bvhd_status structure_lavapipe_open(struct structure *structure, struct bvhd_error *error);

struct structure_instance structure_lavapipe_instance(const struct structure *structure, uint32_t row);

#endif
