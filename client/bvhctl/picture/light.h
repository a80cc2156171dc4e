/* SPDX-License-Identifier: Apache-2.0 */
/*
 * light.h - what a camera ray sees: a sun with a soft edge, the sky, one bounce of both, and a floor that fades into
 * the distance.
 *
 * In steps, with rays traced in between, many samples' at once (sampler.h):
 *
 *     light_begin    the camera's ray
 *     light_meet     what it met        -> whether a ray to the sun is needed, and rays that look for ambient light
 *     light_reflect  what those met     -> whether rays to the sun are needed from there
 *     light_settle   which of those got through
 *
 * Random numbers come from the sample's seed alone, so pictures are the same for any number of threads and rays at
 * once.
 */
#ifndef BVHCTL_LIGHT_H
#define BVHCTL_LIGHT_H

#include "client/bvhctl/picture/camera.h"
#include "client/bvhctl/picture/surface.h"

struct light {
    const struct stage *stage;
    const struct surfaces *surfaces; /* of the stage's structures */
    const struct camera *camera;
    struct vector sun; /* unit direction towards it */
    bool has_floor;
};

void light_init(struct light *light, const struct stage *stage, const struct surfaces *surfaces,
                const struct camera *camera);

enum {
    LIGHT_BOUNCES = 2, /* rays that look for ambient light at each sample's surface */
    LIGHT_STRATA = 4, /* samples of one pixel share the sky out among them; their number is its square */
};

/* A ray towards the sun, and the light that it brings when nothing is in its way. */
struct light_shadow {
    bool is_needed;
    struct vector from, towards;
    struct vector gain;
};

/*
 * One ray's share of a pixel, in parts, because the noisy part - ambient light - is smoothed before they are put
 * together.
 */
struct light_sample {
    struct vector direction; /* of the camera's ray; set by the caller */
    unsigned index; /* among the pixel's samples, modulo 4; set by the caller */
    uint64_t random; /* the seed; set by the caller */

    struct vector backdrop; /* seen directly: sky, or the far floor's share of it */
    struct vector albedo; /* of the surface, times its share */
    struct vector direct; /* light that came straight from the sun, reflected */
    struct vector ambient; /* light from everywhere else that arrives */
    struct vector position, normal; /* of the surface, a little above it */
    bool is_surface;

    struct light_shadow shadow, bounced[LIGHT_BOUNCES];
};

struct ray light_begin(const struct light *light, const struct light_sample *sample);

/* With a surface, LIGHT_BOUNCES ambient rays follow. */
void light_meet(const struct light *light, const struct ray *ray, const struct tracer_hit *hit,
                struct light_sample *sample);
void light_ambient_rays(struct light_sample *sample, struct ray ret_rays[LIGHT_BOUNCES]);

/* `hits` of light_ambient_rays' rays. */
void light_reflect(const struct light *light, const struct ray rays[LIGHT_BOUNCES],
                   const struct tracer_hit hits[LIGHT_BOUNCES], struct light_sample *sample);

/* Any hit will do. */
struct ray light_shadow_ray(const struct light_shadow *shadow);

/* A linear colour as it is shown: 0 to 1, in sRGB's curve, highlights compressed. 1 is a white wall in the sun. */
struct vector light_display(struct vector colour);

#endif
