/* SPDX-License-Identifier: Apache-2.0 */
/*
 * octants.h - which slot of a wide node each child goes to, so that a ray can visit slots in the order of its
 * direction's signs without sorting (Ylitie 2017, section 4.3).
 */
#ifndef BVHD_OCTANTS_H
#define BVHD_OCTANTS_H

#include <stdbool.h>
#include <stdint.h>

#include "proto/base/box.h"

enum { OCTANTS_ROUNDS = 2 };

/*
 * offsets[child][axis]: the child's centre from the parent's (the fourth number is not looked at), in any scale in
 * which no sum of six overflows; 0 for those that are not there. Gives each of the eight a slot of its own so that the
 * sum over children of +-x +-y +-z, signs by the slot's bits (1: x, 2: y, 4: z; set means +), comes near its maximum:
 * 97 % of it on random ones after OCTANTS_ROUNDS rounds of exchanges, a little less after one. ret_children[slot] is
 * the child that goes there. Deterministic, also of equal ones.
 */
void octants_assign(const float offsets[8][4], unsigned rounds, uint8_t ret_children[8]);

/*
 * The same for children [0, count) at the centres of their boxes around the parent's; what children[count] and those
 * behind point to is not looked at, but is a box. With `avx2` (octants_has_avx2) as fast as the machine can.
 */
void octants_assign_boxes(const struct box *parent, const struct box *const children[8], unsigned count,
                          unsigned rounds, bool avx2, uint8_t ret_children[8]);

/* Whether this machine has AVX2. */
bool octants_has_avx2(void);

#endif
