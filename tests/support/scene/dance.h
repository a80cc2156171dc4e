/* SPDX-License-Identifier: Apache-2.0 */
/*
 * dance.h - a scene that moves for four seconds: a skinned worm that sways, a ball that grows spikes by morph targets,
 * and balls that circle on an arm and bounce. Its animation has all interpolations and all properties of nodes.
 *
 * For test programs only: without memory, they print a message and end.
 */
#ifndef BVHD_DANCE_H
#define BVHD_DANCE_H

#include <stdint.h>

enum { DANCE_SIZE = 10000 };

/* Writes a GLB of about `size` triangles. Returns 0, or -1 with errno set. */
int dance_write(const char *path, uint32_t size);

#endif
