/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/traverse/lavapipe_traverse.h"

#include "builder/traverse/boxtest_kernels.h"
#include "builder/traverse/traverse_state.h"

/* The state of one ray. Levels nest by calls, each with its own stack. */
struct lavapipe_walk {
    struct traverse_state state; /* first, because identify() gets it */
    const struct lavapipe_scene *scene;
    const struct lavapipe_view *view; /* the bottom level that is being traversed */
};

/* Processes a leaf that the ray reached. */
typedef void (*visit_leaf)(struct lavapipe_walk *walk, uint32_t leaf);

static uint64_t id_of(uint32_t geometry_and_flags, uint32_t primitive)
{
    return (uint64_t)(geometry_and_flags & 0xffffff) << 32 | primitive;
}

static void identify(const struct traverse_state *state, uint32_t bottom, uint64_t id, uint32_t *ret_geometry,
                     uint32_t *ret_primitive)
{
    (void)state;
    (void)bottom;
    *ret_geometry = (uint32_t)(id >> 32);
    *ret_primitive = (uint32_t)id;
}

/* The stack: children that the ray meets, with lower bounds of their distances. */
struct box_stack {
    uint32_t references[LAVAPIPE_MAX_LEVELS]; /* on each level at most one child waits while the other is visited */
    double distances[LAVAPIPE_MAX_LEVELS];
    unsigned count;
};

/* Returns which child of a box to visit next: the nearer one that is met. The other one is pushed. */
static uint32_t enter_box(struct lavapipe_walk *walk, const struct boxtest_exact *ray, const struct lavapipe_box *box,
                          struct box_stack *waiting)
{
    const struct traverse_state *state = &walk->state;
    double near[2];
    bool is_met[2];
    for (int child = 0; child < 2; child++)
        is_met[child] = box->children[child] != LAVAPIPE_NONE &&
                        kernel_box(ray, box->bounds[child].min, box->bounds[child].max, state->tmax, &near[child]);
    if (!is_met[0] || !is_met[1])
        return is_met[0] ? box->children[0] : is_met[1] ? box->children[1] : LAVAPIPE_NONE;
    int later = state->options->flip_order ? near[1] <= near[0] : near[1] >= near[0];
    waiting->references[waiting->count] = box->children[later];
    waiting->distances[waiting->count++] = near[later];
    return box->children[!later];
}

/* Pops the next child that can still hold the answer: entries beyond the closest hit so far are dropped. */
static uint32_t next_waiting(const struct lavapipe_walk *walk, struct box_stack *waiting)
{
    while (waiting->count > 0)
        if (waiting->distances[--waiting->count] <= walk->state.tmax)
            return waiting->references[waiting->count];
    return LAVAPIPE_NONE;
}

/* Traverses a structure with the ray in the state's origin and direction. */
static void visit_boxes(struct lavapipe_walk *walk, const struct lavapipe_view *view, visit_leaf leaf)
{
    struct traverse_state *state = &walk->state;
    struct lavapipe_box box = lavapipe_box_at(view, LAVAPIPE_HEADER);
    uint32_t reference = LAVAPIPE_HEADER | LAVAPIPE_BOX;
    struct box_stack waiting = {.count = 0};
    struct boxtest_exact ray;
    float bounds[6];
    if (!traverse_state_is_usable(state))
        return;
    lavapipe_box_bounds(&box, bounds);
    boxtest_init_exact(state->origin, state->direction, state->ray->tmin, bounds, &ray);
    while (reference != LAVAPIPE_NONE && !state->is_done) {
        if ((reference & 3) == LAVAPIPE_BOX) {
            box = lavapipe_box_at(view, reference & ~UINT32_C(3));
            state->counters.nodes++;
            reference = enter_box(walk, &ray, &box, &waiting);
        } else {
            leaf(walk, lavapipe_leaf_index(view, reference));
            reference = LAVAPIPE_NONE;
        }
        if (reference == LAVAPIPE_NONE)
            reference = next_waiting(walk, &waiting);
    }
}

static void visit_triangle(struct lavapipe_walk *walk, uint32_t leaf)
{
    const struct lavapipe_triangle triangle = lavapipe_triangle_at(walk->view, leaf);
    const float *const corners[3] = {triangle.corners[0], triangle.corners[1], triangle.corners[2]};
    walk->state.counters.triangles++;
    traverse_leaf_triangle(&walk->state, leaf, id_of(triangle.geometry_and_flags, triangle.primitive),
                           triangle.geometry_and_flags & LAVAPIPE_GEOMETRY_OPAQUE, corners);
}

static void visit_aabb(struct lavapipe_walk *walk, uint32_t leaf)
{
    const struct lavapipe_aabb aabb = lavapipe_aabb_at(walk->view, leaf);
    walk->state.counters.triangles++;
    traverse_leaf_aabb(&walk->state, leaf, id_of(aabb.geometry_and_flags, aabb.primitive),
                       aabb.geometry_and_flags & LAVAPIPE_GEOMETRY_OPAQUE, aabb.min, aabb.max);
}

static void visit_bottom(struct lavapipe_walk *walk, const struct lavapipe_view *view,
                         const struct traverse_instance *instance)
{
    bool is_aabbs = view->kind == LAVAPIPE_AABB;
    const uint32_t skip_flag = is_aabbs ? RAY_SKIP_AABBS : RAY_SKIP_TRIANGLES;
    if (view->kind == LAVAPIPE_INSTANCE || !traverse_state_enter(&walk->state, instance, skip_flag, !is_aabbs))
        return;
    walk->view = view;
    visit_boxes(walk, view, is_aabbs ? visit_aabb : visit_triangle);
}

uint32_t lavapipe_instance_flags(uint32_t sbt_and_flags)
{
    uint32_t flags = sbt_and_flags & LAVAPIPE_CULL_DISABLE ? INSTANCE_CULL_DISABLE : 0;
    flags |= sbt_and_flags & LAVAPIPE_FLIP_FACING ? INSTANCE_FLIP_FACING : 0;
    flags |= sbt_and_flags & LAVAPIPE_FORCE_OPAQUE ? INSTANCE_FORCE_OPAQUE : 0;
    return flags | (sbt_and_flags & LAVAPIPE_NOT_FORCE_NO_OPAQUE ? 0 : INSTANCE_FORCE_NO_OPAQUE);
}

static void visit_instance(struct lavapipe_walk *walk, uint32_t leaf)
{
    const struct lavapipe_scene *scene = walk->scene;
    const struct lavapipe_instance record = lavapipe_instance_at(scene->top, leaf);
    uint64_t row = scene->rows ? scene->rows[leaf] : bytes_get64(scene->top->handles + UINT64_C(8) * leaf) - 1;
    if (!(record.custom_and_mask >> 24 & walk->state.ray->cull_mask) || row >= scene->bottom_count ||
        !scene->bottoms[row])
        return;
    const struct traverse_instance instance = {
        .custom_and_mask = record.custom_and_mask,
        .sbt_and_flags = (record.sbt_and_flags & 0xffffff) | lavapipe_instance_flags(record.sbt_and_flags) << 24,
        .instance = record.instance,
        .bottom = (uint32_t)row,
        .record = leaf,
    };
    traverse_state_to_object(&walk->state, record.object_to_world);
    walk->state.counters.instances++;
    visit_bottom(walk, scene->bottoms[row], &instance);
}

static void visit_scene(struct lavapipe_walk *walk)
{
    const struct lavapipe_scene *scene = walk->scene;
    if (!scene->top && scene->bottom_count && scene->bottoms[0])
        visit_bottom(walk, scene->bottoms[0], NULL);
    else if (scene->top && scene->top->kind == LAVAPIPE_INSTANCE)
        visit_boxes(walk, scene->top, visit_instance);
}

bool lavapipe_traverse(const struct lavapipe_scene *scene, const struct ray *ray,
                       const struct traverse_options *options, struct ray_hit *ret_hit,
                       struct traverse_counters *counters)
{
    struct lavapipe_walk walk;
    if (!traverse_state_start(&walk.state, ray, options))
        return false;
    walk.state.identify = identify;
    walk.scene = scene;
    visit_scene(&walk);
    return traverse_state_finish(&walk.state, ret_hit, counters);
}

void lavapipe_positions(const struct lavapipe_scene *scene, const struct ray_hit *hit, float ret_corners[3][3])
{
    const struct lavapipe_triangle triangle = lavapipe_triangle_at(scene->bottoms[hit->handle], hit->record);
    memcpy(ret_corners, triangle.corners, sizeof triangle.corners);
}
