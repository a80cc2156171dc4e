/* SPDX-License-Identifier: Apache-2.0 */
#include "traverse.h"

#include <math.h>

#include "traverse_state.h"

/* What float box tests accept is usable in any case; this is asked about the others. */
static bool is_usable(const double origin[3], const double direction[3])
{
    bool is_zero = direction[0] == 0 && direction[1] == 0 && direction[2] == 0;
    for (int axis = 0; axis < 3; axis++)
        if (!isfinite(origin[axis]) || !isfinite(direction[axis]))
            return false;
    return !is_zero;
}

void traverse_level(struct traverse_state *state, traverse_leaf leaf)
{
    const struct portable_header *header = state->view->header;
    const double *origin = state->origin, *direction = state->direction;
    float tmin = state->ray->tmin;
    struct boxtest_ray ray;
    struct boxtest_exact exact;
    if (header->node_count == 0)
        return;
    if (state->wide && boxtest_init_wide(origin, direction, tmin, header->bounds, &ray)) {
        (leaf == traverse_leaf_triangles ? traverse_loop_wide_triangles : traverse_loop_wide)(state, &ray, leaf);
    } else if (!state->options->exact_only && boxtest_init(origin, direction, tmin, header->bounds, &ray)) {
        traverse_loop_float(state, &ray, leaf);
    } else if (is_usable(origin, direction)) {
        boxtest_init_exact(origin, direction, tmin, header->bounds, &exact);
        traverse_loop_double(state, &exact, leaf);
    }
}

/* Opacity: the ray's flags come before the instance's, those before the geometry's. */
static enum traverse_opacity resolve_opacity(uint32_t ray_flags, uint32_t instance_flags)
{
    if (ray_flags & (RAY_OPAQUE | RAY_NO_OPAQUE))
        return ray_flags & RAY_OPAQUE ? OPACITY_OPAQUE : OPACITY_NO_OPAQUE;
    if (instance_flags & (INSTANCE_FORCE_OPAQUE | INSTANCE_FORCE_NO_OPAQUE))
        return instance_flags & INSTANCE_FORCE_OPAQUE ? OPACITY_OPAQUE : OPACITY_NO_OPAQUE;
    return OPACITY_AS_BUILT;
}

/* Traverses a bottom level; state->origin and direction are in its space. */
static void visit_bottom(struct traverse_state *state, const struct portable_view *view, const struct portable_instance *instance)
{
    uint32_t ray_flags = state->ray->flags, instance_flags = instance ? instance->sbt_and_flags >> 24 : 0;
    bool is_aabbs = view->header->content == PORTABLE_AABBS;
    if (view->header->content == PORTABLE_INSTANCES || ray_flags & (is_aabbs ? RAY_SKIP_AABBS : RAY_SKIP_TRIANGLES))
        return;
    state->view = view;
    state->instance = instance;
    state->opacity = resolve_opacity(ray_flags, instance_flags);
    bool is_flipped = instance_flags & INSTANCE_FLIP_FACING, is_culled = !(instance_flags & INSTANCE_CULL_DISABLE);
    state->cull_front = is_culled && (ray_flags & (is_flipped ? RAY_CULL_BACK_FACING : RAY_CULL_FRONT_FACING));
    state->cull_back = is_culled && (ray_flags & (is_flipped ? RAY_CULL_FRONT_FACING : RAY_CULL_BACK_FACING));
    if (!is_aabbs)
        triangle_ray_init(state->origin, state->direction, &state->triangle_ray);
    traverse_level(state, is_aabbs ? traverse_leaf_aabbs : traverse_leaf_triangles);
}

static void cross(const double a[3], const double b[3], double ret_product[3])
{
    ret_product[0] = a[1] * b[2] - a[2] * b[1];
    ret_product[1] = a[2] * b[0] - a[0] * b[2];
    ret_product[2] = a[0] * b[1] - a[1] * b[0];
}

static double dot(const double a[3], const double b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/*
 * The ray in an instance's object space: its matrix inverted in double (Cramer's rule), once for the visit. The stored inverse is rounded to
 * float, which is not enough for rays to meet at shared edges what the exact ray meets.
 */
static void to_object_space(const struct portable_instance *instance, const struct ray *ray, double ret_origin[3],
                            double ret_direction[3])
{
    double columns[3][3], offset[3], direction[3], rows[3][3];
    for (int i = 0; i < 3; i++) {
        for (int j = 0; j < 3; j++)
            columns[j][i] = instance->object_to_world[4 * i + j];
        offset[i] = (double)ray->origin[i] - instance->object_to_world[4 * i + 3];
        direction[i] = ray->direction[i];
    }
    cross(columns[1], columns[2], rows[0]);
    cross(columns[2], columns[0], rows[1]);
    cross(columns[0], columns[1], rows[2]);
    double scale = 1 / dot(columns[0], rows[0]);
    for (int i = 0; i < 3; i++) {
        ret_origin[i] = dot(rows[i], offset) * scale;
        ret_direction[i] = dot(rows[i], direction) * scale;
    }
}

static void visit_instance(struct traverse_state *state, const struct portable_instance *instance)
{
    const struct scene *scene = state->scene;
    if (!(instance->custom_and_mask >> 24 & state->ray->cull_mask) || instance->handle >= scene->bottom_count)
        return;
    const struct portable_view *view = scene->bottoms[instance->handle];
    if (!view)
        return;
    to_object_space(instance, state->ray, state->origin, state->direction);
    state->counters.instances++;
    visit_bottom(state, view, instance);
}

static void visit_instances(struct traverse_state *state, uint32_t first, uint32_t count)
{
    const struct portable_instance *instances = state->scene->top->records;
    for (uint32_t i = 0; i < count && !state->is_done; i++)
        visit_instance(state, &instances[first + (state->options->flip_order ? count - 1 - i : i)]);
}

static void visit_scene(struct traverse_state *state)
{
    const struct scene *scene = state->scene;
    if (!scene->top && scene->bottom_count && scene->bottoms[0]) {
        visit_bottom(state, scene->bottoms[0], NULL);
    } else if (scene->top && scene->top->header->content == PORTABLE_INSTANCES) {
        state->view = scene->top;
        traverse_level(state, visit_instances);
    }
}

/* Field by field: clearing all of it costs more than a short traversal. */
static void start(struct traverse_state *state, const struct scene *scene, const struct ray *ray,
                  const struct traverse_options *options)
{
    static const struct traverse_options defaults = {0};
    state->scene = scene;
    state->ray = ray;
    state->options = options ? options : &defaults;
    state->counters = (struct traverse_counters){0, 0, 0};
    state->wide = !state->options->narrow_only && !state->options->exact_only && boxtest_has_wide();
    state->tmax = ray->tmax;
    state->tmax_above = ray->tmax;
    state->is_hit = state->is_done = false;
    for (int axis = 0; axis < 3; axis++) {
        state->origin[axis] = ray->origin[axis];
        state->direction[axis] = ray->direction[axis];
    }
}

bool traverse(const struct scene *scene, const struct ray *ray, const struct traverse_options *options, struct ray_hit *ret_hit,
              struct traverse_counters *counters)
{
    struct traverse_state state;
    start(&state, scene, ray, options);
    if (!(ray->tmin <= ray->tmax))
        return false;
    visit_scene(&state);
    if (counters) {
        counters->nodes += state.counters.nodes;
        counters->triangles += state.counters.triangles;
        counters->instances += state.counters.instances;
    }
    if (state.is_hit)
        traverse_leaf_describe(&state.best, ret_hit);
    return state.is_hit;
}

void traverse_positions(const struct scene *scene, const struct ray_hit *hit, float ret_corners[3][3])
{
    const float *corners[3];
    traverse_corners(scene->bottoms[hit->handle], hit->record, corners);
    for (int k = 0; k < 3; k++)
        memcpy(ret_corners[k], corners[k], sizeof ret_corners[k]);
}
