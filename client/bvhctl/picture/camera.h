/* SPDX-License-Identifier: Apache-2.0 */
/* camera.h - a pinhole camera, and a search for a view that shows a scene well. */
#ifndef BVHCTL_CAMERA_H
#define BVHCTL_CAMERA_H

#include "proto/base/parallel.h"
#include "client/bvhctl/picture/stage.h"

struct camera {
    struct vector origin, forward, right, up; /* unit directions */
    struct vector pivot; /* the point around which camera_turn turns: that in the middle, or the origin if inside */
    double half_width, half_height; /* of the picture at distance 1 */
    bool is_inside; /* the camera is inside the scene: in a room, in a street */
};

/* The user's choices of a view; everything else is found. */
struct camera_options {
    double aspect; /* the width of the picture divided by its height */
    double fov; /* the vertical angle of view in radians; 0: it is chosen */
    bool has_eye, has_target;
    struct vector eye, target; /* the position of the camera, and the point in the middle of the picture */
    bool knows_front; /* the format of the scene says that stage->front is the side of the front */
    bool turns; /* camera_turn follows: nothing is cropped from any side */
    double closeness; /* how many times as near as for the whole subject; 0 is 1. camera_choose chooses it */
};

/* Returns the unit direction through a point of the picture: x from 0 (left) to 1, y from 0 (top) to 1. */
struct vector camera_direction(const struct camera *camera, double x, double y);

/*
 * Returns the unit direction towards the sun of a picture. The sun stands to the left of and behind the camera; it
 * stands higher if the camera is inside the scene, where light comes from above.
 */
struct vector camera_sun(const struct stage *stage, const struct camera *camera);

/* Returns the camera after a turn around the vertical axis through its pivot, counterclockwise seen from above. */
struct camera camera_turn(const struct stage *stage, const struct camera *camera, double angle);

/*
 * Finds the view that shows most of the stage. It tries views from around the stage, more likely from the front, and,
 * where the stage encloses a room whose inside cannot be seen from there, from inside, with few rays each. The result
 * is the same for any number of threads. *ret_rays is the number of rays that were traced. BVHD_NO_MEMORY, and
 * BVHD_INVALID if the options name the same point twice.
 */
enum bvhd_status camera_choose(const struct stage *stage, const struct camera_options *options,
                               const struct parallel *parallel, struct memory *memory, struct camera *ret_camera,
                               uint64_t *ret_rays, struct bvhd_error *error);

#endif
