/* SPDX-License-Identifier: Apache-2.0 */
/* camera.h - a pinhole camera, and a search for a view that shows a scene well. */
#ifndef BVHCTL_CAMERA_H
#define BVHCTL_CAMERA_H

#include "proto/base/parallel.h"
#include "client/bvhctl/picture/stage.h"

struct camera {
    struct vector origin, forward, right, up; /* unit directions */
    double half_width, half_height; /* of the picture at distance 1 */
    bool is_inside; /* the camera is inside the scene: in a room, in a street */
};

/* Returns the unit direction through a point of the picture: x from 0 (left) to 1, y from 0 (top) to 1. */
struct vector camera_direction(const struct camera *camera, double x, double y);

/*
 * Returns the unit direction towards the sun of a picture. The sun stands to the left of and behind the camera; it
 * stands higher if the camera is inside the scene, where light comes from above.
 */
struct vector camera_sun(const struct stage *stage, const struct camera *camera);

/*
 * Finds the view that shows most of the stage. It tries views from around the stage and, where the stage encloses a
 * point, from inside, with few rays each. `aspect` is the width of the picture divided by its height. The result is the
 * same for any number of threads. *ret_rays is the number of rays that were traced. BVHD_NO_MEMORY.
 */
enum bvhd_status camera_choose(const struct stage *stage, double aspect, const struct parallel *parallel,
                               struct memory *memory, struct camera *ret_camera, uint64_t *ret_rays,
                               struct bvhd_error *error);

#endif
