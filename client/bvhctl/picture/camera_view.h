/* SPDX-License-Identifier: Apache-2.0 */
/* camera_view.h - the views of a stage from which camera_choose chooses. Internal to camera.h. */
#ifndef BVHCTL_CAMERA_VIEW_H
#define BVHCTL_CAMERA_VIEW_H

#include "client/bvhctl/picture/camera.h"

enum {
    VIEW_AZIMUTHS = 16,
    VIEW_ELEVATIONS = 4,
    VIEW_GRID = 6, /* positions inside along each horizontal axis */
    VIEW_HEIGHTS = 2,
    VIEW_INSIDE_AZIMUTHS = 12,
    VIEWS_OUTSIDE = VIEW_AZIMUTHS * VIEW_ELEVATIONS,
    VIEWS_INSIDE = VIEW_GRID * VIEW_GRID * VIEW_HEIGHTS * VIEW_INSIDE_AZIMUTHS,
    VIEWS = VIEWS_OUTSIDE + VIEWS_INSIDE,
};

/* Returns a unit vector: the azimuth counts from the stage's front, counterclockwise seen from above. */
struct vector view_towards(const struct stage *stage, double azimuth, double elevation);

/* Points a camera: sets everything but its origin and its pivot. */
void view_aim(struct camera *camera, const struct stage *stage, struct vector forward,
              const struct camera_options *options);

/*
 * Returns the view of a number below VIEWS, those from outside first. Azimuths on both sides of the front come first.
 */
struct camera view_make(const struct stage *stage, const struct camera_options *options, int index);

/* Returns the azimuth, from the front, and the level of the elevation of a view from outside. */
double view_azimuth(int index);
int view_level(int index);

/* Returns the view towards `forward` from outside, from a distance from which the whole subject is in the picture. */
struct camera view_outside(const struct stage *stage, const struct camera_options *options, struct vector forward);

/* Returns the height of the bulk in its larger width. */
double view_flatness(const struct stage *stage);

#endif
