/* SPDX-License-Identifier: Apache-2.0 */
/*
 * light.h - computes the light that a camera ray receives: from a sun with a soft edge, from the sky, by one bounce of
 * both, and from a floor that fades into the distance.
 *
 * It works in steps, between which the caller (sampler.h) traces the rays of many samples at once:
 *
 *     light_begin         gives the camera's ray
 *     light_meet          takes its hit; says whether a ray to the sun is needed (light_shadow_ray)
 *     light_ambient_rays  gives the rays that look for ambient light
 *     light_reflect       takes their hits; says whether rays to the sun are needed from there
 *
 * The caller adds the `gain` of each shadow ray that hits nothing. Random numbers depend on the sample's seed alone, so
 * that pictures are the same for any number of threads and any number of rays at once.
 */
#ifndef BVHCTL_LIGHT_H
#define BVHCTL_LIGHT_H

#include "client/bvhctl/picture/appearance.h"
#include "client/bvhctl/picture/camera.h"
#include "client/bvhctl/picture/surface.h"

struct light {
    const struct stage *stage;
    const struct surfaces *surfaces; /* of the stage's structures */
    const struct appearance *appearance; /* NULL: each geometry has one colour */
    const struct camera *camera;
    double spread; /* the width of a pixel at distance 1 */
    struct vector sun; /* the unit direction towards it */
    bool has_floor;
};

/* `height` is that of the picture, in pixels. Everything must outlive the light. */
void light_init(struct light *light, const struct stage *stage, const struct surfaces *surfaces,
                const struct appearance *appearance, const struct camera *camera, uint32_t height);

/* Returns whether there may be holes, for which light_is_hole has to be asked about every hit. */
bool light_has_holes(const struct light *light);

/* Returns whether the surface that a ray hit has a hole there, so that the ray goes on. */
bool light_is_hole(const struct light *light, bool is_camera, const struct ray *ray, const struct tracer_hit *hit);

enum {
    LIGHT_BOUNCES = 2, /* rays that look for ambient light at each sample's surface */
    /* sectors of the hemisphere above a surface; the bounces of each four samples of a pixel cover every one twice */
    LIGHT_STRATA = 4,
};

/* A ray towards the sun, and the light that it adds when it hits nothing. */
struct light_shadow {
    bool is_needed;
    struct vector from, towards;
    struct vector gain;
};

/*
 * The contribution of one camera ray to a pixel. The components are separate, because ambient light is noisy and is
 * smoothed before they are added up.
 */
struct light_sample {
    struct vector direction; /* of the camera's ray; set by the caller */
    unsigned index; /* among the pixel's samples, modulo 4; set by the caller */
    uint64_t random; /* the seed; set by the caller */
    float time; /* of all its rays; set by the caller */

    struct vector backdrop; /* the sky that is seen directly, or through the fading of the far floor */
    struct vector albedo; /* of the surface, times the weight that the fading leaves it */
    struct vector direct; /* reflected light that came straight from the sun */
    struct vector ambient; /* light that arrives from everywhere else */
    struct vector position, normal; /* of the surface, a little above it */
    bool is_surface;
    bool is_subject; /* the surface is not that of the floor */

    struct light_shadow shadow, bounced[LIGHT_BOUNCES];
};

struct ray light_begin(const struct light *light, const struct light_sample *sample);

/* Takes the hit of the camera's ray. If sample->is_surface is true then, light_ambient_rays is the next step. */
void light_meet(const struct light *light, const struct ray *ray, const struct tracer_hit *hit,
                struct light_sample *sample);
void light_ambient_rays(struct light_sample *sample, struct ray ret_rays[LIGHT_BOUNCES]);

/* Takes the hits of the rays of light_ambient_rays. */
void light_reflect(const struct light *light, const struct ray rays[LIGHT_BOUNCES],
                   const struct tracer_hit hits[LIGHT_BOUNCES], struct light_sample *sample);

/* Returns the ray for a shadow that is needed, at a time. It ends at any hit, unless there may be holes. */
struct ray light_shadow_ray(const struct light *light, const struct light_shadow *shadow, float time);

/*
 * Converts a linear colour, in which 1 is a white wall in the sun, for display: 0 to 1 in the curve of sRGB, with
 * compressed highlights.
 */
struct vector light_display(struct vector colour);

#endif
