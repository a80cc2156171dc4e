/* SPDX-License-Identifier: Apache-2.0 */
/*
 * moving_world.h - a small scene that moves, built and opened: a sheet that is flat at time 0 and waves at time 1, a
 * cube that flies over it, one that turns, and a ball that rises. y is up.
 *
 * Bottom levels, which are the first files of the structures: 0 the sheet, of motion triangles; 1 a cube of side 2; 2 a
 * sphere. Instances: 0 the sheet, which is static, 1 the cube by two matrices, 2 the cube by two SRTs, which lets it
 * turn by 80 degrees about y, 3 the sphere by two matrices. For test programs only.
 */
#ifndef BVHD_MOVING_WORLD_H
#define BVHD_MOVING_WORLD_H

#include "client/bvhctl/scene/structures.h"
#include "client/bvhctl/service/backend_local.h"
#include "client/bvhctl/service/local.h"

enum {
    MOVING_WORLD_SIDE = 8, /* quads of the sheet along each side */
    MOVING_WORLD_VERTICES = (MOVING_WORLD_SIDE + 1) * (MOVING_WORLD_SIDE + 1),
    MOVING_WORLD_TRIANGLES = 2 * MOVING_WORLD_SIDE * MOVING_WORLD_SIDE,
    MOVING_WORLD_BOTTOMS = 3,
    MOVING_WORLD_INSTANCES = 4,
};

/* The sheet. */
struct moving_sheet {
    float start[3 * MOVING_WORLD_VERTICES], end[3 * MOVING_WORLD_VERTICES]; /* at times 0 and 1 */
    uint32_t indices[3 * MOVING_WORLD_TRIANGLES];
};

/* How an instance moves. */
struct moving_place {
    uint32_t bottom;
    uint32_t motion; /* MOTION_ */
    float start[16], end[16]; /* as in struct structure_instance */
};

extern const struct moving_place moving_places[MOVING_WORLD_INSTANCES];

struct moving_world {
    struct local local;
    struct backend_local backend;
    struct moving_sheet sheet;
    struct bvhd_result bottoms[MOVING_WORLD_BOTTOMS], top;
    void *holds[2]; /* of the results */
    struct structures structures;
};

/* Builds and opens the world. A failure ends the program. `threads` is that of local_open. */
void moving_world_init(struct moving_world *world, uint32_t threads);
void moving_world_finish(struct moving_world *world);

#endif
