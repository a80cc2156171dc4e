/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_world.h - a small imported scene, built and opened: a ground of two triangles, and two cubes that stand on it; y
 * is up.
 *
 * Instances: 0 the ground, 1 a cube of side 2 at (0, 1, 0), 2 a cube that is flattened to nothing (skipped), 3 a cube
 * of side 1 at (3, 0.5, 0). For test programs only.
 */
#ifndef BVHD_TEST_WORLD_H
#define BVHD_TEST_WORLD_H

#include "client/bvhctl/scene/assemble.h"
#include "client/bvhctl/service/backend_local.h"
#include "client/bvhctl/service/local.h"
#include "client/bvhctl/scene/structures.h"

enum { TEST_WORLD_INSTANCES = 4, TEST_WORLD_FILES = 3 };

/* Gives the import alone, in static arrays that need not be freed; `memory` becomes its `memory`. */
void test_world_import(struct import *ret_import, struct memory *memory);

/* Sets the matrix of an instance, row-major 3x4, for all worlds that are made after this call. */
void test_world_place(uint32_t instance, const float object_to_world[12]);

struct test_world {
    struct local local;
    struct backend_local backend;
    struct options options;
    struct import import;
    struct assembly assembly;
    struct structures structures;
};

/* Builds and opens the world. A failure ends the program. `threads` is that of local_open. */
void test_world_init(struct test_world *world, uint32_t threads);
/* Does the same for the format of a device, or, with NULL, for the portable target. `format` must outlive the world. */
void test_world_init_for(struct test_world *world, uint32_t threads, const struct bvhd_format *format);
/* Does the same for another import, whose arrays must outlive the world. */
void test_world_init_from(struct test_world *world, uint32_t threads, const struct import *import);
void test_world_finish(struct test_world *world);

#endif
