/* SPDX-License-Identifier: Apache-2.0 */
/*
 * driver_world.h - generated scenes for comparing structures on a device: meshes in several geometries and in shuffled
 * order, boxes, inactive primitives, and instances of them with every kind of matrix, flag and mask. For test programs
 * only: failures end the program.
 */
#ifndef BVHD_TEST_DRIVER_WORLD_H
#define BVHD_TEST_DRIVER_WORLD_H

#include "builder/format/canonical.h"
#include "proto/base/memory.h"
#include "tests/support/random.h"
#include "builder/traverse/traverse.h"

enum { DRIVER_WORLD_BOTTOMS = 8 };

struct driver_world {
    struct memory memory;
    const char *name;
    struct canonical bottoms[DRIVER_WORLD_BOTTOMS], top; /* in the form that driver_scene.h needs */
    /*
     * The same, but with triangles without area and far points in place of inactive primitives, because drivers may
     * lose primitives beside a NaN.
     */
    struct canonical driver_bottoms[DRIVER_WORLD_BOTTOMS];
    unsigned char *blocks[DRIVER_WORLD_BOTTOMS];
    struct box bounds[DRIVER_WORLD_BOTTOMS];
    uint32_t bottom_count;
    struct box all; /* the whole scene */
};

/* Makes one scene with everything in it. */
void driver_world_init(struct driver_world *ret_world, uint64_t seed);

/* Makes one adversarial mesh (adversarial.h) of about `size` triangles in shuffled order, plain and mirrored. */
void driver_world_init_mesh(struct driver_world *ret_world, const char *name, uint32_t size, uint64_t seed);

void driver_world_finish(struct driver_world *world);

enum driver_rays { RAYS_FROM_OUTSIDE, RAYS_WITHIN, RAYS_AT_CORNERS, DRIVER_RAYS };
extern const char *const driver_rays_names[DRIVER_RAYS];

/*
 * From outside: the rays of a picture. Within: from anywhere to anywhere, some along an axis. At corners: at vertices
 * and edges, where several primitives are hit at once.
 */
void driver_world_rays(const struct driver_world *world, enum driver_rays kind, uint64_t seed, uint32_t count,
                       struct ray *ret_rays);

#endif
