/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/traverse/traverse.h"

#include "builder/traverse/boxtest_moving.h"
#include "builder/traverse/leaf_kind.h"

void traverse_walk_identify(const struct traverse_state *state, uint32_t bottom, uint64_t id, uint32_t *ret_geometry,
                            uint32_t *ret_primitive)
{
    const struct traverse_walk *walk = (const struct traverse_walk *)state;
    const struct portable_view *view = walk->scene->bottoms[bottom];
    uint32_t geometry = view->header->geometry_count == 1 ? 0 : portable_geometry_of(view, (uint32_t)id);
    *ret_geometry = geometry;
    *ret_primitive = (uint32_t)id - view->geometries[geometry].first_primitive;
}

static bool init_avx2(const struct traverse_walk *walk, struct boxtest_ray *ret_ray)
{
    const struct ray *ray = walk->state.ray;
    const float *bounds = walk->view->header->bounds;
    if (walk->in_world)
        return boxtest_init_floats(ray->origin, ray->direction, ray->tmin, bounds, ret_ray);
    return boxtest_init_avx2(walk->state.origin, walk->state.direction, ray->tmin, bounds, ret_ray);
}

/* Returns whether the ray may end at any hit, in the order that is the fastest. */
static bool is_any(const struct traverse_walk *walk)
{
    const struct traverse_options *options = walk->state.options;
    return !options->candidate && !options->flip_order && walk->state.ray->flags & RAY_TERMINATE_ON_FIRST_HIT;
}

/* Traverses moving nodes with the general loops. */
static void visit_moving_nodes(struct traverse_walk *walk, const struct leaf_kind *kind)
{
    const float *bounds = walk->view->header->bounds;
    const double *origin = walk->state.origin, *direction = walk->state.direction;
    const float tmin = walk->state.ray->tmin;
    struct boxtest_moving ray = {.at = motion_weights_at(walk->state.ray->time)};
    struct boxtest_moving_exact exact = {.at = ray.at};
    if (walk->avx2 && init_avx2(walk, &ray.still)) {
        boxtest_widen(&ray.still, bounds);
        (kind->is_top && is_any(walk) ? traverse_avx2_any_moving_instances : traverse_loop_moving_avx2)(walk, &ray,
                                                                                                        kind->visit);
    } else if (!walk->state.options->exact_only && boxtest_init(origin, direction, tmin, bounds, &ray.still)) {
        boxtest_widen(&ray.still, bounds);
        traverse_loop_moving_float(walk, &ray, kind->visit);
    } else if (traverse_state_is_usable(&walk->state)) {
        boxtest_init_exact(origin, direction, tmin, bounds, &exact.still);
        boxtest_widen_exact(&exact.still, bounds);
        traverse_loop_moving_double(walk, &exact, kind->visit);
    }
}

/* Traverses walk->view with the ray in the state's origin and direction. */
static void visit_nodes(struct traverse_walk *walk, const struct leaf_kind *kind)
{
    const struct portable_header *header = walk->view->header;
    const double *origin = walk->state.origin, *direction = walk->state.direction;
    float tmin = walk->state.ray->tmin;
    struct boxtest_ray ray;
    struct boxtest_exact exact;
    if (header->node_count == 0)
        return;
    if (walk->avx2 && kind->walk_avx2 && !walk->state.options->flip_order &&
        kind->walk_avx2(&walk->state, walk->view, walk->unpacked))
        return;
    if (kind->moves) {
        visit_moving_nodes(walk, kind);
        return;
    }
    if (kind->prepare)
        kind->prepare(&walk->state);
    if (walk->avx2 && init_avx2(walk, &ray)) {
        if (kind->is_top && is_any(walk))
            traverse_avx2_any_instances(walk, &ray, kind->visit);
        else
            traverse_loop_avx2(walk, &ray, kind->visit);
    } else if (!walk->state.options->exact_only && boxtest_init(origin, direction, tmin, header->bounds, &ray)) {
        traverse_loop_float(walk, &ray, kind->visit);
    } else if (traverse_state_is_usable(&walk->state)) {
        /* A ray that the float box tests accept is usable in any case. */
        boxtest_init_exact(origin, direction, tmin, header->bounds, &exact);
        traverse_loop_double(walk, &exact, kind->visit);
    }
}

enum { UNPACKED_NODES_MAX = 1 << 15 };

/*
 * Returns the unpacked nodes that a single ray is to use. Those of a large structure miss the caches more often than
 * the portable ones, which costs single rays more than they gain where only the nodes differ.
 */
static inline const struct unpacked_node *unpacked_of(const struct scene *scene, uint32_t bottom)
{
    const struct portable_header *header = scene->bottoms[bottom]->header;
    if (!scene->unpacked || (header->node_count > UNPACKED_NODES_MAX && leaf_kinds[header->content]->unpacks_few))
        return NULL;
    return scene->unpacked[bottom];
}

void traverse_walk_bottom(struct traverse_walk *walk, uint32_t bottom, const struct traverse_instance *instance)
{
    const struct portable_view *view = walk->scene->bottoms[bottom];
    const struct leaf_kind *kind = leaf_kind_of(view);
    if (kind->is_top || !traverse_state_enter(&walk->state, instance, kind->skip_flag, kind->is_triangles))
        return;
    walk->view = view;
    walk->unpacked = unpacked_of(walk->scene, bottom);
    visit_nodes(walk, kind);
}

static void visit_scene(struct traverse_walk *walk)
{
    const struct scene *scene = walk->scene;
    traverse_state_to_world(&walk->state);
    walk->in_world = true;
    if (!scene->top && scene->bottom_count && scene->bottoms[0]) {
        traverse_walk_bottom(walk, 0, NULL);
    } else if (scene->top && leaf_kind_of(scene->top)->is_top) {
        walk->view = scene->top;
        visit_nodes(walk, leaf_kind_of(scene->top));
    }
}

/* Does the work of visit_bottom_only() for a structure of another kind than triangles that stand still. */
static bool visit_others_only(struct traverse_walk *walk, const struct portable_view *view)
{
    const struct leaf_kind *kind = leaf_kind_of(view);
    if (!kind->walk_avx2)
        return false;
    if (kind->walk_world)
        return !traverse_state_settle(&walk->state, NULL, kind->skip_flag, kind->is_triangles) ||
               kind->walk_world(&walk->state, view, unpacked_of(walk->scene, 0));
    traverse_state_to_world(&walk->state);
    return !traverse_state_enter(&walk->state, NULL, kind->skip_flag, kind->is_triangles) ||
           kind->walk_avx2(&walk->state, view, unpacked_of(walk->scene, 0));
}

/*
 * Traverses one bottom level in world space, in the fastest way; most are of triangles. Returns false if the general
 * way is needed.
 */
static inline bool visit_bottom_only(struct traverse_walk *walk)
{
    const struct scene *scene = walk->scene;
    if (!walk->avx2 || walk->state.options->flip_order || scene->top || scene->bottom_count == 0 || !scene->bottoms[0])
        return false;
    const struct portable_header *header = scene->bottoms[0]->header;
    if (header->node_count == 0)
        return false;
    if (header->content > PORTABLE_TRIANGLES)
        return visit_others_only(walk, scene->bottoms[0]);
    return !traverse_state_settle(&walk->state, NULL, RAY_SKIP_TRIANGLES, true) ||
           traverse_avx2_world(&walk->state, scene->bottoms[0], unpacked_of(scene, 0));
}

/* Calls boxtest_has_avx2() once. Threads that come first at the same time find the same result. */
static inline bool has_avx2(void)
{
    enum { UNKNOWN, NO, YES };
    static unsigned char known;
    unsigned char is = __atomic_load_n(&known, __ATOMIC_RELAXED);
    if (__builtin_expect(is == UNKNOWN, 0)) {
        is = boxtest_has_avx2() ? YES : NO;
        __atomic_store_n(&known, is, __ATOMIC_RELAXED);
    }
    return is == YES;
}

void traverse_settle(struct scene *scene)
{
    scene->plain = NULL;
    if (scene->top || scene->bottom_count == 0 || !scene->bottoms[0] || !unpacked_of(scene, 0))
        return;
    const struct portable_header *header = scene->bottoms[0]->header;
    if (header->node_count > 0 && has_avx2())
        scene->plain = leaf_kinds[header->content]->walk_plain;
}

/*
 * Traces a plain ray through a scene with a shorter way. Returns false if it needs the general way, else *is_hit. The
 * general way would decide for each ray what is decided for the scene, which takes as long as a ray that leaves it at
 * once.
 */
static inline bool trace_simply(const struct scene *scene, const struct ray *ray, struct ray_hit *ret_hit,
                                struct traverse_counters *counters, bool *is_hit)
{
    struct traverse_walk walk;
    traverse_state_begin(&walk.state, ray, NULL);
    traverse_walk_begin(&walk, scene);
    traverse_state_settle_plain(&walk.state);
    if (!scene->plain(&walk.state, scene->bottoms[0], scene->unpacked[0]))
        return false;
    *is_hit = traverse_state_finish(&walk.state, ret_hit, counters);
    return true;
}

bool traverse(const struct scene *scene, const struct ray *ray, const struct traverse_options *options,
              struct ray_hit *ret_hit, struct traverse_counters *counters)
{
    struct traverse_walk walk;
    bool is_hit;
    if (scene->plain && !options && ray_is_plain(ray) && trace_simply(scene, ray, ret_hit, counters, &is_hit))
        return is_hit;
    if (!traverse_state_begin(&walk.state, ray, options))
        return false;
    traverse_walk_begin(&walk, scene);
    walk.avx2 = !walk.state.options->baseline_only && !walk.state.options->exact_only && has_avx2();
    if (!visit_bottom_only(&walk))
        visit_scene(&walk);
    return traverse_state_finish(&walk.state, ret_hit, counters);
}

void traverse_positions_at(const struct scene *scene, const struct ray_hit *hit, float time, float ret_corners[3][3])
{
    const struct portable_view *view = scene->bottoms[hit->handle];
    if (view->header->content == PORTABLE_MOVING_TRIANGLES)
        motion_corners(view, hit->record, motion_weights_at(time), ret_corners);
    else
        traverse_positions(scene, hit, ret_corners);
}

void traverse_positions(const struct scene *scene, const struct ray_hit *hit, float ret_corners[3][3])
{
    const float *corners[3];
    traverse_corners(scene->bottoms[hit->handle], hit->record, corners);
    for (int k = 0; k < 3; k++)
        memcpy(ret_corners[k], corners[k], sizeof ret_corners[k]);
}
