/* SPDX-License-Identifier: Apache-2.0 */
/*
 * octants.h - which slot of a wide node each child goes to, so that a ray can visit slots in the order of its direction's signs without
 * sorting (Ylitie 2017, section 4.3).
 */
#ifndef BVHD_OCTANTS_H
#define BVHD_OCTANTS_H

#include <stdint.h>

/*
 * offsets[child][axis]: the child's centre from the parent's (the fourth number is not looked at), in any scale in which no sum of six overflows; 0 for those that are not there. Gives
 * each of the eight a slot of its own so that the sum over children of +-x +-y +-z, signs by the slot's bits (1: x, 2: y, 4: z; set means
 * +), comes near its maximum: 97 % of it on random ones. ret_children[slot] is the child that goes there. Deterministic, also of equal ones.
 */
void octants_assign(const float offsets[8][4], uint8_t ret_children[8]);

#endif
