/* SPDX-License-Identifier: Apache-2.0 */
/*
 * octants.h - decides which slot of a wide node each child goes to, so that a ray can visit slots in the order given by
 * the signs of its direction, without sorting (Ylitie 2017, section 4.3).
 */
#ifndef BVHD_OCTANTS_H
#define BVHD_OCTANTS_H

#include <stdbool.h>
#include <stdint.h>

#include "proto/base/box.h"

enum { OCTANTS_ROUNDS = 2 };

/*
 * Assigns eight children to eight slots. offsets[child][axis] is the distance of the child's centre from the parent's,
 * in any scale in which no sum of six overflows, and 0 for children that do not exist; the fourth number is not read.
 *
 * The assignment brings the sum over all children of +-x +-y +-z, with signs from the bits of the slot's number (1: x,
 * 2: y, 4: z; a set bit means +), near its maximum: to 97 % of it for random children after OCTANTS_ROUNDS rounds of
 * exchanges, and a little less after one. ret_children[slot] is the child that goes there. The result is deterministic,
 * also for equal children.
 */
void octants_assign(const float offsets[8][4], unsigned rounds, uint8_t ret_children[8]);

/*
 * Does the same for children [0, count), given by boxes, around the centre of the parent's box. Pointers from
 * children[count] on must point to boxes too, which do not affect the result. `avx2` (from octants_has_avx2) selects
 * the faster version, with the same result.
 */
void octants_assign_boxes(const struct box *parent, const struct box *const children[8], unsigned count,
                          unsigned rounds, bool avx2, uint8_t ret_children[8]);

/* True when this machine has AVX2. */
bool octants_has_avx2(void);

#endif
