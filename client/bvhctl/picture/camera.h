/* SPDX-License-Identifier: Apache-2.0 */
/* camera.h - a pinhole camera, and the choice of a view that shows a scene well. */
#ifndef BVHCTL_CAMERA_H
#define BVHCTL_CAMERA_H

#include "proto/base/parallel.h"
#include "client/bvhctl/picture/stage.h"

struct camera {
    struct vector origin, forward, right, up; /* unit directions */
    double half_width, half_height; /* of the picture at distance 1 */
    bool is_inside; /* stands inside the scene: a room, a street */
};

/* Unit direction through a point of the picture: x from 0 (left) to 1, y from 0 (top) to 1. */
struct vector camera_direction(const struct camera *camera, double x, double y);

/*
 * Unit direction towards the sun of a picture: from the left and behind the camera; steeper inside, where it has to
 * come in from above.
 */
struct vector camera_sun(const struct stage *stage, const struct camera *camera);

/*
 * Tries views from around the stage and, where it encloses one, from inside, looks through each with few rays, and
 * takes the one that shows most. `aspect`: width by height. The same for any number of threads. *ret_rays: how many
 * were traced for it.
 */
enum bvhd_status camera_choose(const struct stage *stage, double aspect, const struct parallel *parallel,
                               struct memory *memory, struct camera *ret_camera, uint64_t *ret_rays,
                               struct bvhd_error *error);

#endif
