/* SPDX-License-Identifier: Apache-2.0 */
/*
 * fair.h - a fair that moves for four seconds, in all ways that a shutter interval knows: a fan that turns twice a
 * second, a flag that waves by morph targets, a carousel whose seats turn on their own, and balls that fall and bounce.
 *
 * For test programs only: without memory, they print a message and end.
 */
#ifndef BVHD_FAIR_H
#define BVHD_FAIR_H

#include <stdint.h>

enum { FAIR_SIZE = 6000 };

/* Writes a GLB, whose flag has about `size` triangles. Returns 0, or -1 with errno set. */
int fair_write(const char *path, uint32_t size);

#endif
