/* SPDX-License-Identifier: Apache-2.0 */
/* camera_probe.h - judges views of a stage by a few rays each. Internal to camera.h. */
#ifndef BVHCTL_CAMERA_PROBE_H
#define BVHCTL_CAMERA_PROBE_H

#include "client/bvhctl/picture/camera.h"

enum { PROBE_WIDTH = 40, PROBE_HEIGHT = 24, PROBE_TARGETS = 96 };

/* The hits of a few rays through a view. */
struct view_probe {
    double distance[PROBE_HEIGHT][PROBE_WIDTH]; /* INFINITY for a miss */
    struct vector normal[PROBE_HEIGHT][PROBE_WIDTH];
    uint32_t hits, subject_hits; /* the latter in the bulk */
    double nearest;
};

void probe_take(const struct stage *stage, const struct camera *camera, struct view_probe *ret_probe);

/* Returns the entropy, in bits, of the directions in which the visible surfaces face: 0 for one flat wall. */
double probe_facing(const struct view_probe *probe);

/*
 * Returns the fraction of neighbouring rays between which the distance jumps. Those are outlines, of which views with
 * detail and depth have many.
 */
double probe_outlines(const struct view_probe *probe);

/* Returns the entropy of the visible distances: it is high if near and far are both visible. */
double probe_depth(const struct view_probe *probe);

/* Returns the fraction of the picture that the sun shines on. */
double probe_sunlit(const struct stage *stage, const struct camera *camera, const struct view_probe *probe);

/*
 * Returns the fraction of some random points of the subject that the camera sees. Of points whose triangle is seen from
 * the back it counts less.
 */
double probe_visibility(const struct stage *stage, const struct camera *camera);

/* Returns whether the camera sees a point at a time, within its picture, and from the front of the surface there. */
bool probe_sees(const struct stage *stage, const struct camera *camera, struct vector point, float time,
                bool *ret_is_back);

#endif
