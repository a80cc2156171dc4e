/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/picture/light.h"

#include "client/bvhctl/oracle/rays.h"

static const double pi = 3.14159265358979323846;
static const double sun_radius = 0.012,
                    /* of the sun's disc, in radians: shadows are a little softer than real ones */
    sun_radius_inside = 0.0045;
static const struct vector sun_light = {2.5, 2.2, 1.8};
static const struct vector horizon = {0.92, 0.93, 0.95}, zenith = {0.36, 0.55, 0.92};
static const struct vector floor_albedo = {0.42, 0.415, 0.41};
static const struct vector floor_bounce = {0.34, 0.32, 0.29}; /* the light that a floor in the sun reflects upward */
static const struct vector inside_fill = {0.20, 0.19, 0.18},
                           outside_fill = {0.16, 0.17, 0.19}; /* the light after more than one bounce */

/* Muted colours that differ clearly. A scene of one geometry has the first one. */
static const struct vector palette[] = {
    {0.56, 0.38, 0.25}, {0.30, 0.44, 0.20}, {0.36, 0.48, 0.60}, {0.72, 0.58, 0.28}, {0.62, 0.34, 0.26},
    {0.52, 0.52, 0.50}, {0.45, 0.36, 0.50}, {0.24, 0.48, 0.46}, {0.70, 0.64, 0.54},
};
enum { COLOURS = sizeof palette / sizeof *palette };

static double smooth_step(double low, double high, double value)
{
    double fraction = fmin(fmax((value - low) / (high - low), 0), 1);
    return fraction * fraction * (3 - 2 * fraction);
}

void light_init(struct light *light, const struct stage *stage, const struct surfaces *surfaces,
                const struct appearance *appearance, const struct camera *camera, uint32_t height)
{
    *light = (struct light){.stage = stage,
                            .surfaces = surfaces,
                            .appearance = appearance,
                            .camera = camera,
                            .spread = 2 * camera->half_height / height,
                            .sun = camera_sun(stage, camera),
                            .has_floor = !camera->is_inside};
}

static struct vector sky(const struct light *light, struct vector direction)
{
    double height = vector_dot(direction, light->stage->up);
    if (height < 0)
        return light->has_floor ? floor_bounce : vector_scale(horizon, 0.5);
    return vector_mix(horizon, zenith, pow(height, 0.6));
}

/*
 * Returns the colour of the background. It is paler than the sky that gives light, so that it does not compete with the
 * scene.
 */
static struct vector backdrop(const struct light *light, struct vector direction)
{
    double height = vector_dot(direction, light->stage->up);
    if (light->camera->is_inside)
        return vector_scale(sky(light, direction), 1.4);
    return vector_mix(vector_make(0.72, 0.77, 0.83), vector_make(0.27, 0.41, 0.62), smooth_step(-0.02, 0.75, height));
}

/* Limits a colour, because no real surface absorbs or reflects all light. */
static struct vector reflectance(struct vector colour)
{
    return vector_make(0.03 + 0.82 * colour.x, 0.03 + 0.82 * colour.y, 0.03 + 0.82 * colour.z);
}

/* Makes the colours of instances differ a little. */
static struct vector tint(struct vector albedo, uint32_t instance)
{
    uint64_t state = instance * UINT64_C(0x9e3779b97f4a7c15) + 1;
    double brightness = 0.82 + 0.36 * rays_uniform(&state), warmth = 0.92 + 0.16 * rays_uniform(&state);
    return vector_mul(albedo, vector_make(brightness * warmth, brightness, brightness / warmth));
}

/* Returns the colour of a geometry of which the scene's file, if it is there, says nothing more. */
static struct vector plain_albedo(const struct light *light, const struct stage_hit *hit)
{
    const float *colour = structures_colour(light->stage->structures, hit->handle, hit->geometry);
    return colour ? reflectance(vector_from_floats(colour)) : palette[(hit->handle + hit->geometry) % COLOURS];
}

/* The look of the surface at a hit, and the place from which rays leave it. */
struct seen {
    struct vector albedo, normal, position;
};

static struct seen look_at(const struct light *light, const struct stage_hit *hit, double spread)
{
    struct appearance_point point = {.normal = hit->normal, .position = hit->position};
    struct stage_hit lifted = *hit;
    if (light->appearance)
        appearance_describe(light->appearance, hit, spread, &point);
    lifted.position = point.position;
    struct vector albedo = point.is_coloured ? reflectance(point.albedo) : plain_albedo(light, hit);
    if (light->surfaces->instance_count > 1 && !point.is_textured)
        albedo = tint(albedo, hit->instance);
    if (light->camera->is_inside) /* many bounces would make the colour too strong */
        albedo = vector_mix(albedo, vector_make(0.62, 0.59, 0.55), point.is_coloured ? 0.25 : 0.6);
    /* The colour depends slightly on the normal, so that shapes are visible even in even light. */
    struct vector n = point.normal;
    albedo = vector_mul(albedo, vector_make(1 + 0.05 * n.x, 1 + 0.05 * n.y, 1 + 0.05 * n.z));
    return (struct seen){albedo, n, stage_leave(light->stage, &lifted)};
}

/*
 * Returns a vector that has the component `cosine` along `axis`, and `sine` perpendicular to it, in the direction
 * `azimuth`, which counts from 0 to 1 around the axis.
 */
static struct vector around(struct vector axis, double azimuth, double sine, double cosine)
{
    struct vector a, b;
    vector_basis(axis, &a, &b);
    double angle = 2 * pi * azimuth;
    return vector_mad(vector_mad(vector_scale(axis, cosine), a, sine * cos(angle)), b, sine * sin(angle));
}

/*
 * Returns the ray to a random point of the sun's disc, which azimuth and outward, both in [0, 1), choose, and the light
 * that comes from there if the ray hits nothing, multiplied by `reflected`.
 */
static struct light_shadow sun_on(const struct light *light, struct vector position, struct vector normal,
                                  double azimuth, double outward, struct vector reflected)
{
    double radius = light->camera->is_inside ? sun_radius_inside : sun_radius;
    struct vector towards = vector_unit(around(light->sun, azimuth, radius * sqrt(outward), 1));
    double cosine = vector_dot(normal, towards);
    return (struct light_shadow){.is_needed = cosine > 0,
                                 .from = position,
                                 .towards = towards,
                                 .gain = vector_mul(reflected, vector_scale(sun_light, cosine))};
}

static void shade(const struct light *light, struct vector position, struct vector normal, struct vector albedo,
                  double share, struct light_sample *sample)
{
    double azimuth = (sample->index % 4 + rays_uniform(&sample->random)) / 4, outward = rays_uniform(&sample->random);
    sample->albedo = vector_scale(albedo, share);
    sample->position = position;
    sample->normal = normal;
    sample->is_surface = true;
    sample->shadow = sun_on(light, position, normal, azimuth, outward, sample->albedo);
}

/* Returns the distance to the floor along a ray from the camera, INFINITY if the ray does not descend to it. */
static double floor_distance(const struct light *light, struct vector direction)
{
    double down = -vector_dot(direction, light->stage->up);
    double height = vector_dot(light->camera->origin, light->stage->up) - light->stage->floor;
    return light->has_floor && down > 0 && height > 0 ? height / down : INFINITY;
}

static void look_at_floor(const struct light *light, double distance, struct light_sample *sample)
{
    const struct stage *stage = light->stage;
    struct vector position = vector_mad(light->camera->origin, sample->direction, distance);
    struct vector middle = stage_to_world(stage, vector_scale(vector_add(stage->low, stage->high), 0.5));
    double away = vector_length(vector_sub(position, middle)) / stage->size;
    double share = 1 - smooth_step(0.7, 2.6, away);
    sample->backdrop = vector_scale(backdrop(light, sample->direction), 1 - share);
    if (share > 0)
        shade(light, vector_mad(position, stage->up, 1e-5 * stage->size), stage->up, floor_albedo, share, sample);
}

struct ray light_begin(const struct light *light, const struct light_sample *sample)
{
    return stage_ray(light->camera->origin, sample->direction, sample->time);
}

void light_meet(const struct light *light, const struct ray *ray, const struct tracer_hit *hit,
                struct light_sample *sample)
{
    struct stage_hit met = {.distance = INFINITY};
    bool is_hit = surfaces_meet(light->surfaces, ray, hit, &met);
    double to_floor = floor_distance(light, sample->direction);
    if (is_hit && met.distance <= to_floor) {
        struct seen seen = look_at(light, &met, light->spread);
        shade(light, seen.position, seen.normal, seen.albedo, 1, sample);
        sample->is_subject = true;
    } else if (isfinite(to_floor))
        look_at_floor(light, to_floor, sample);
    else
        sample->backdrop = backdrop(light, sample->direction);
}

/*
 * Stratified: each sample of a pixel takes its rays from other cells of the hemisphere, so that they cover it evenly.
 */
void light_ambient_rays(struct light_sample *sample, struct ray ret_rays[LIGHT_BOUNCES])
{
    for (unsigned i = 0; i < LIGHT_BOUNCES; i++) {
        unsigned cell = sample->index * LIGHT_BOUNCES + i;
        double azimuth = (cell % LIGHT_STRATA + rays_uniform(&sample->random)) / LIGHT_STRATA;
        double outward = (cell / LIGHT_STRATA % 2 + rays_uniform(&sample->random)) / 2;
        struct vector direction = vector_unit(around(sample->normal, azimuth, sqrt(outward), sqrt(1 - outward)));
        ret_rays[i] = stage_ray(sample->position, direction, sample->time);
    }
}

/*
 * Returns the light that arrives along one ray, from the sky or from a surface; the sun's light there is *ret_shadow.
 */
static struct vector arriving(const struct light *light, const struct ray *ray, const struct tracer_hit *hit,
                              uint64_t *state, struct light_shadow *ret_shadow)
{
    static const double wide = 0.25; /* the spread of a ray that stands for a part of the hemisphere */
    struct stage_hit met;
    *ret_shadow = (struct light_shadow){0};
    if (!surfaces_meet(light->surfaces, ray, hit, &met))
        return sky(light, vector_make((double)ray->direction[0], (double)ray->direction[1], (double)ray->direction[2]));
    double azimuth = rays_uniform(state), outward = rays_uniform(state);
    struct seen seen = look_at(light, &met, wide);
    struct vector fill = light->camera->is_inside ? inside_fill : outside_fill;
    /* Corners receive less light that has bounced more than once. */
    double room = met.distance / (met.distance + 0.03 * light->stage->size);
    *ret_shadow =
        sun_on(light, seen.position, seen.normal, azimuth, outward, vector_scale(seen.albedo, 1.0 / LIGHT_BOUNCES));
    return vector_mul(seen.albedo, vector_scale(fill, 2 * room));
}

void light_reflect(const struct light *light, const struct ray rays[LIGHT_BOUNCES],
                   const struct tracer_hit hits[LIGHT_BOUNCES], struct light_sample *sample)
{
    for (unsigned i = 0; i < LIGHT_BOUNCES; i++) {
        struct vector light_there = arriving(light, &rays[i], &hits[i], &sample->random, &sample->bounced[i]);
        sample->ambient = vector_mad(sample->ambient, light_there, 1.0 / LIGHT_BOUNCES);
    }
}

bool light_has_holes(const struct light *light)
{
    return light->appearance && light->appearance->has_holes;
}

bool light_is_hole(const struct light *light, bool is_camera, const struct ray *ray, const struct tracer_hit *hit)
{
    struct stage_hit met;
    return surfaces_meet(light->surfaces, ray, hit, &met) &&
           appearance_is_hole(light->appearance, &met, is_camera ? light->spread : 0);
}

struct ray light_shadow_ray(const struct light *light, const struct light_shadow *shadow, float time)
{
    struct ray ray = stage_ray(shadow->from, shadow->towards, time);
    ray.flags = light_has_holes(light) ? 0 : RAY_TERMINATE_ON_FIRST_HIT;
    return ray;
}

/* A filmic tone curve with a toe, a nearly straight middle and a long shoulder (the fit of Narkowicz 2015). */
static double film(double value)
{
    double x = fmax(value, 0) * 0.55;
    return fmin(x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14), 1);
}

static double srgb(double value)
{
    return value <= 0.0031308 ? 12.92 * value : 1.055 * pow(value, 1 / 2.4) - 0.055;
}

struct vector light_display(struct vector colour)
{
    return vector_make(srgb(film(colour.x)), srgb(film(colour.y)), srgb(film(colour.z)));
}
