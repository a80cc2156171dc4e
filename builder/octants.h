/* SPDX-License-Identifier: Apache-2.0 */
/*
 * octants.h - which slot of a wide node each child goes to, so that a ray can visit slots in the order of its direction's signs without
 * sorting (Ylitie 2017, section 4.3).
 */
#ifndef BVHD_OCTANTS_H
#define BVHD_OCTANTS_H

#include <stdint.h>

/*
 * offsets[axis][child]: the child's centre from the parent's, in any scale, finite. Gives each of `count` <= 8 children a slot of its own so
 * that the sum over children of +-x +-y +-z, signs by the slot's bits (1: x, 2: y, 4: z; set means +), comes near its maximum: greedy, the
 * farthest child first, then exchanges while they gain. Deterministic.
 */
void octants_assign(const float offsets[3][8], unsigned count, uint8_t ret_slots[8]);

#endif
