/* SPDX-License-Identifier: Apache-2.0 */
/*
 * random_motion.h - how random instances move: not at all, by a matrix, or by a scale, a rotation and a translation.
 * For test programs only.
 */
#ifndef BVHD_RANDOM_MOTION_H
#define BVHD_RANDOM_MOTION_H

#include "tests/support/builder/random_input.h"

struct random_motion {
    uint32_t type; /* MOTION_ */
    float start[16], end[16]; /* MOTION_SRT: VkSRTDataNV; else a row-major 3x4 matrix, and the same for MOTION_STATIC */
};

/*
 * Makes one of each type. Matrices are those of random_top_transform. Some rotations go nearly all the way round, or
 * through the middle; some scales are 0 at one end; some numbers are missing, so that the instance is inactive.
 */
void random_motion_make(enum random_choice choice, struct random *random, struct random_motion *ret_motion);

/* Writes a VkAccelerationStructureMotionInstanceNV. `words` are those of an instance's fields. */
void random_motion_record(const struct random_motion *motion, const uint32_t words[2], uint64_t handle,
                          unsigned char ret_record[MOTION_RECORD_SIZE]);

/* Makes the matrix of a time. Returns false if it is singular, or nearly. */
bool random_motion_matrix(const struct random_motion *motion, float time, float ret_matrix[12]);

/* Returns whether all numbers are there. */
bool random_motion_is_active(const struct random_motion *motion);

/* Sets how the mesh of an instance moves. */
void random_motion_apply(const struct random_motion *motion, struct oracle_mesh *mesh);

#endif
