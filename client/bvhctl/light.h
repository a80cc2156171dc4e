/* SPDX-License-Identifier: Apache-2.0 */
/*
 * light.h - what a camera ray sees: a sun with a soft edge, the sky, one bounce of both, and a floor that fades into the distance.
 *
 * Random numbers come from the pixel's place alone, so pictures are the same for any number of threads.
 */
#ifndef BVHCTL_LIGHT_H
#define BVHCTL_LIGHT_H

#include "camera.h"
#include "stage.h"

struct light {
    const struct stage *stage;
    const struct camera *camera;
    struct vector sun; /* unit direction towards it */
    bool has_floor;
};

void light_init(struct light *light, const struct stage *stage, const struct camera *camera);

/* One ray's share of a pixel, in parts, because the noisy part - ambient light - is smoothed before they are put together. */
struct light_sample {
    struct vector backdrop; /* seen directly: sky, or the far floor's share of it */
    struct vector albedo; /* of the surface, times its share */
    struct vector direct; /* light that came straight from the sun, reflected */
    struct vector ambient; /* light from everywhere else that arrives */
    struct vector position, normal; /* of the surface */
    bool is_surface;
    uint32_t rays; /* traced for it */
};

enum { LIGHT_STRATA = 4 }; /* samples of one pixel share the sky out among them; their number is its square */

/* Sample `index` (of a number) of a pixel. *state: random numbers of that pixel. */
struct light_sample light_look(const struct light *light, struct vector direction, unsigned index, uint64_t *state);

/* A linear colour as it is shown: 0 to 1, in sRGB's curve, highlights compressed. 1 is a white wall in the sun. */
struct vector light_display(struct vector colour);

#endif
