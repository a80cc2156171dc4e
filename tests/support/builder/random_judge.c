/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/support/builder/random_judge.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>

#include "builder/traverse/traverse_group.h"
#include "client/bvhctl/oracle/oracle_moment.h"
#include "client/bvhctl/oracle/rays.h"
#include "tests/support/builder/box_judge.h"
#include "tests/support/builder/random_kind.h"

enum { RAYS = 200, VARIANT_STEP = 4 }; /* one ray in VARIANT_STEP is traced in more ways */

/* ---- rays ---- */

/*
 * Makes a point at right angles to the line of sight beside the middle of a sphere: near its silhouette, or within, and
 * mostly so far that it is certain which.
 */
static void step_aside(const float origin[3], double radius, struct random *random, double point[3])
{
    double from[3], aside[3], size = 0, side[3];
    random_point(random, side);
    for (int axis = 0; axis < 3; axis++)
        from[axis] = point[axis] - origin[axis];
    for (int x = 0; x < 3; x++) {
        aside[x] = from[(x + 1) % 3] * side[(x + 2) % 3] - from[(x + 2) % 3] * side[(x + 1) % 3];
        size += aside[x] * aside[x];
    }
    double reach = random_between(random, 0, 1);
    if (random_chance(random, 0.03))
        reach = 1 + (random_chance(random, 0.5) ? -1 : 1) * pow(10, random_between(random, -4, -1));
    for (int axis = 0; axis < 3 && size > 0; axis++)
        point[axis] += reach * radius * aside[axis] / sqrt(size);
}

/*
 * Aims exactly at a corner of a random triangle, where a traversal that is not watertight leaks, or at an end. With
 * all kinds it seldom aims at corners, because the oracle cannot decide about many of them.
 */
static void aim_at_vertex(const struct random_run *run, const struct oracle_mesh *meshes, uint32_t mesh_count,
                          struct random *random, struct ray *ray)
{
    static const uint32_t vertex_counts[ORACLE_SHAPES] = {3, 1, 2};
    const struct oracle_mesh *mesh = &meshes[random_below(random, mesh_count)];
    if (!mesh->primitive_count || mesh->transform)
        return;
    const uint32_t vertex = random_below(random, vertex_counts[mesh->shape] * mesh->primitive_count);
    struct oracle_moment moment;
    float at[3];
    oracle_moment_make(mesh, ray->time, &moment);
    oracle_moment_vertex(&moment, vertex, at);
    double point[3] = {at[0], at[1], at[2]};
    float direction[3];
    if (mesh->shape != ORACLE_TRIANGLES)
        step_aside(ray->origin, mesh->radii[vertex], random, point);
    else if (run->kinds == RANDOM_ALL && !random_chance(random, 0.005))
        return;
    for (int axis = 0; axis < 3; axis++) {
        direction[axis] = (float)point[axis] - ray->origin[axis];
        if (!isfinite(direction[axis]))
            return;
    }
    memcpy(ray->direction, direction, sizeof direction);
}

static void align_with_axis(struct random *random, struct ray *ray)
{
    int axis = (int)random_below(random, 3);
    for (int i = 0; i < 3; i++)
        ray->direction[i] = i != axis ? 0 : random_chance(random, 0.5) ? 1 : -1.0f;
}

static void make_rays(const struct random_run *run, const struct oracle_mesh *meshes, uint32_t mesh_count,
                      struct random *random, struct ray rays[RAYS])
{
    rays_make(meshes, mesh_count, random_next(random), RAYS, rays);
    static const uint32_t flags[] = {0, 0, 0, RAY_CULL_BACK_FACING, RAY_CULL_FRONT_FACING};
    uint32_t culling = flags[random_below(random, 5)],
             mask = random_chance(random, 0.5) ? 0xff : random_below(random, 256);
    for (uint32_t i = 0; i < RAYS; i++) {
        rays[i].flags = culling;
        rays[i].cull_mask = (uint8_t)mask;
        if (i % 4 == 1 && mesh_count)
            aim_at_vertex(run, meshes, mesh_count, random, &rays[i]);
        if (i % 16 == 3)
            align_with_axis(random, &rays[i]);
        if (i % 16 == 7) {
            rays[i].tmin = (float)random_between(random, 0, 1);
            rays[i].tmax = rays[i].tmin + (float)random_between(random, 0, 2);
        }
    }
}

/* ---- hits: closest hit, any hit, either order, positions ---- */

static bool hits_equal(const struct ray_hit *a, const struct ray_hit *b)
{
    return a->t == b->t && a->u == b->u && a->v == b->v && a->instance == b->instance && a->geometry == b->geometry &&
           a->primitive == b->primitive && a->front_face == b->front_face;
}

/* Checks variants of the traversal that must not change the answer. */
static void check_variants(struct random_run *run, const struct scene *scene, const struct ray *ray, bool is_hit,
                           const struct ray_hit *hit)
{
    const struct traverse_options variants[] = {{.flip_order = true}, {.baseline_only = true}, {.exact_only = true}};
    static const char *const names[] = {"flip_order", "baseline_only", "exact_only"};
    struct ray_hit other;
    for (int i = 0; i < 3; i++) {
        bool is_other = traverse(scene, ray, &variants[i], &other, NULL);
        if (is_other != is_hit || (is_hit && !hits_equal(hit, &other)))
            random_run_fail(run, "%s changes the answer", names[i]);
    }
    if (run->native) {
        bool is_other = lavapipe_traverse(run->native, ray, NULL, &other, NULL);
        if (is_other != is_hit || (is_hit && !hits_equal(hit, &other)))
            random_run_fail(run, "the native layout changes the answer");
    }
    struct ray any = *ray;
    any.flags |= RAY_TERMINATE_ON_FIRST_HIT;
    if (traverse(scene, &any, NULL, &other, NULL) != is_hit)
        random_run_fail(run, "any hit says %d, closest hit %d", !is_hit, is_hit);
}

static void judge_ray(struct random_run *run, const struct scene *scene, const struct ray *ray,
                      const struct oracle_answer *answer)
{
    static const char *const names[] = {"right", "undecided", "wrong miss", "wrong hit", "wrong primitive"};
    struct ray_hit hit = {0};
    bool is_hit = traverse(scene, ray, NULL, &hit, NULL);
    enum oracle_verdict verdict = oracle_judge(answer, is_hit ? &hit : NULL, NULL);
    run->rays++;
    run->hits += is_hit;
    run->uncertain += verdict == ORACLE_UNDECIDED;
    if (verdict > ORACLE_UNDECIDED && !box_judge_is_beyond_floats(ray, answer->t_end))
        random_run_fail(
            run,
            "%s: t %.9g instead of %.9g [%.9g, %.9g], primitive %u.%u.%u, ray (%a %a %a) + t (%a %a %a), %a .. %a, "
            "time %a, flags %x",
            names[verdict], (double)hit.t, answer->t, answer->t_low, answer->t_end, hit.instance, hit.geometry,
            hit.primitive, (double)ray->origin[0], (double)ray->origin[1], (double)ray->origin[2],
            (double)ray->direction[0], (double)ray->direction[1], (double)ray->direction[2], (double)ray->tmin,
            (double)ray->tmax, (double)ray->time, ray->flags);
    if (run->rays % VARIANT_STEP == 0)
        check_variants(run, scene, ray, is_hit, &hit);
}

/* Rays that are traced in groups find what each of them finds alone. A group has rays of different times. */
static void check_groups(struct random_run *run, const struct scene *scene, const struct ray rays[RAYS])
{
    const uint32_t step = rays[0].time == rays[RAYS - 1].time ? 1 : 73; /* has no divisor in common with RAYS */
    struct traverse_stream stream = {.scene = scene};
    for (uint32_t begin = 0; begin < RAYS; begin += TRAVERSE_GROUP) {
        const uint32_t count = RAYS - begin < TRAVERSE_GROUP ? RAYS - begin : TRAVERSE_GROUP;
        struct ray group[TRAVERSE_GROUP];
        struct ray_hit hits[TRAVERSE_GROUP], alone;
        for (uint32_t i = 0; i < count; i++)
            group[i] = rays[(begin + i) * step % RAYS];
        const uint64_t are_hits = traverse_group(&stream, group, count, hits);
        for (uint32_t i = 0; i < count; i++) {
            const bool is_hit = traverse(scene, &group[i], NULL, &alone, NULL);
            if (is_hit != (bool)(are_hits >> i & 1) || (is_hit && !hits_equal(&hits[i], &alone)))
                random_run_fail(run, "ray %u finds something else in a group", begin + i);
        }
    }
}

static void judge_rays(struct random_run *run, const struct scene *scene, const struct oracle_mesh *meshes,
                       uint32_t mesh_count, struct ray rays[RAYS])
{
    struct oracle_answer answers[RAYS];
    for (uint32_t i = 0; i < RAYS; i++)
        rays[i].flags |= RAY_SKIP_AABBS;
    struct bvhd_error error;
    if (oracle_trace(meshes, mesh_count, rays, RAYS, &run->memory, &parallel_serial, NULL, NULL, answers, &error) !=
        BVHD_OK) {
        random_run_fail(run, "oracle: %s", error.text);
        return;
    }
    for (uint32_t i = 0; i < RAYS; i++)
        judge_ray(run, scene, &rays[i], &answers[i]);
    oracle_finish(answers, RAYS, &run->memory);
    check_groups(run, scene, rays);
}

static bool same_position(float a, float b, bool moved)
{
    return a == b || (a != a && b != b) || (moved && (nextafterf(a, b) == b));
}

/* Checks that the stored corners of a hit triangle are those that the request means, at the ray's time. */
static void check_corners(struct random_run *run, const struct scene *scene, const struct random_meaning *meaning,
                          const struct ray *ray, const struct ray_hit *hit)
{
    float corners[3][3];
    traverse_positions_at(scene, hit, ray->time, corners);
    for (int i = 0; i < 9; i++) {
        float right = meaning->corners[hit->primitive][i / 3][i % 3];
        if (meaning->end_corners) {
            const float before = right * (1 - ray->time),
                        after = meaning->end_corners[hit->primitive][i / 3][i % 3] * ray->time;
            right = before + after;
        }
        if (!same_position(corners[i / 3][i % 3], right, meaning->moved)) {
            random_run_fail(run, "positions of primitive %u.%u differ", hit->geometry, hit->primitive);
            return;
        }
    }
}

/*
 * Returns whether the sphere at u, between the ends of a linear swept sphere, is the one that touches the body's
 * surface at the hit: the body does not reach farther at any other u.
 */
static bool touches_at(const float ends[2][3], const float radii[2], const struct ray *ray, const struct ray_hit *hit)
{
    long double away = 0, length = 0, taper = (long double)radii[0] - radii[1], bend = 0, reach = 0, size = 0;
    for (int axis = 0; axis < 3; axis++) {
        long double at = ray->origin[axis] + (long double)hit->t * ray->direction[axis];
        long double way = (long double)ends[1][axis] - ends[0][axis], beside = at - (ends[0][axis] + hit->u * way);
        away += beside * beside;
        length += way * way;
        bend += beside * way;
        size += fabsl(at) + fabsl(ray->origin[axis]) + fabsl(way);
    }
    reach = radii[0] - hit->u * taper;
    size = (size + radii[0] + radii[1]) * 16 * FLT_EPSILON + FLT_TRUE_MIN;
    long double slope = bend - taper * reach, open = size * (sqrtl(length) + fabsl(taper));
    return fabsl(sqrtl(away) - reach) <= size && (hit->u == 0 || slope >= -open) && (hit->u == 1 || slope <= open);
}

/* Checks what a hit of a round primitive says except its distance. */
static void check_round(struct random_run *run, const struct random_meaning *meaning, const struct ray *ray,
                        const struct ray_hit *hit)
{
    const size_t at = (size_t)2 * hit->primitive;
    bool is_right = hit->v == 0 && hit->front_face && hit->u >= 0 && hit->u <= 1;
    if (meaning->shape == ORACLE_SPHERES)
        is_right = is_right && hit->u == 0;
    else
        is_right = is_right && touches_at((const float(*)[3])(meaning->centres + at), meaning->radii + at, ray, hit);
    if (!is_right)
        random_run_fail(run, "hit of %u.%u at t %a with u %a, v %a, front %d", hit->geometry, hit->primitive,
                        (double)hit->t, (double)hit->u, (double)hit->v, hit->front_face);
}

/* Checks what hits say besides their distance. */
static void check_hit(struct random_run *run, const struct scene *scene, const struct random_meaning *meanings,
                      const struct ray *ray)
{
    struct ray_hit hit;
    if (!traverse(scene, ray, NULL, &hit, NULL) || hit.is_aabb)
        return;
    const struct random_meaning *meaning = &meanings[hit.geometry];
    if (meaning->corners)
        check_corners(run, scene, meaning, ray, &hit);
    else
        check_round(run, meaning, ray, &hit);
}

/* ---- boxes: each box that is certainly hit is a candidate, and no box that is clearly missed ---- */

struct found {
    uint8_t *seen; /* indexed by geometry and primitive, numbered through all geometries */
    const uint32_t *first;
    uint32_t instance;
};

static enum candidate_verdict note_candidate(void *context, const struct ray *ray, const struct candidate_space *space,
                                             struct ray_hit *hit)
{
    struct found *found = context;
    (void)ray;
    (void)space;
    if (hit->is_aabb && hit->instance == found->instance)
        found->seen[found->first[hit->geometry] + hit->primitive]++;
    return CANDIDATE_IGNORE;
}

static void check_box(struct random_run *run, const struct box_judge *judge, const char *what, const float box[6],
                      bool seen)
{
    const struct long_ray *ray = &judge->local;
    const char *wrong = box_judge_find(judge, box, seen);
    run->boxes++;
    if (wrong)
        random_run_fail(run, "%s: box (%a %a %a .. %a %a %a) is %s, ray (%La %La %La) + t (%La %La %La), %La .. %La",
                        what, (double)box[0], (double)box[1], (double)box[2], (double)box[3], (double)box[4],
                        (double)box[5], wrong, ray->origin[0], ray->origin[1], ray->origin[2], ray->direction[0],
                        ray->direction[1], ray->direction[2], ray->tmin, ray->tmax);
}

static void check_boxes(struct random_run *run, const struct scene *scene, const struct random_input *bottom,
                        const struct ray *ray, uint32_t instance, const float *matrix)
{
    uint32_t first[RANDOM_INPUT_GEOMETRIES + 1] = {0};
    for (uint32_t g = 0; g < bottom->input.geometry_count; g++)
        first[g + 1] = first[g] + bottom->meanings[g].count;
    struct found found = {calloc(first[bottom->input.geometry_count] + 1, 1), first, instance};
    struct traverse_options options = {.candidate = note_candidate, .context = &found};
    struct ray only_boxes = *ray;
    struct ray_hit hit;
    only_boxes.flags = RAY_SKIP_TRIANGLES;
    if (traverse(scene, &only_boxes, &options, &hit, NULL))
        random_run_fail(run, "a candidate that was ignored is a hit");
    struct box_judge judge;
    box_judge_init(&judge, ray, matrix);
    for (uint32_t g = 0; g < bottom->input.geometry_count; g++)
        for (uint32_t i = 0; i < bottom->meanings[g].count; i++)
            check_box(run, &judge, matrix ? "under a top level" : "bottom level", bottom->meanings[g].boxes[i],
                      found.seen[first[g] + i]);
    free(found.seen);
}

/* Makes something that rays can be aimed at: a triangle through opposite corners of each box. */
static struct oracle_mesh boxes_as_triangles(const struct random_meaning *meaning)
{
    float *corners = calloc((size_t)meaning->count + 1, 9 * sizeof *corners);
    for (uint32_t i = 0; i < meaning->count; i++) {
        const float *box = meaning->boxes[i];
        const float triangle[9] = {box[0], box[1], box[2], box[3], box[4], box[5], box[0], box[4], box[2]};
        memcpy(corners + 9 * (size_t)i, triangle, sizeof triangle);
    }
    return (struct oracle_mesh){.positions = corners, .primitive_count = meaning->count, .instance = RAY_NO_INSTANCE};
}

/* ---- whole scenes ---- */

static void judge_hits(struct random_run *run, const struct random_input *bottom, const struct scene *scene,
                       struct random *random)
{
    struct oracle_mesh meshes[RANDOM_INPUT_GEOMETRIES] = {0};
    struct ray rays[RAYS];
    uint32_t count = bottom->input.geometry_count;
    for (uint32_t g = 0; g < count; g++)
        meshes[g] = random_input_mesh(bottom, g);
    make_rays(run, meshes, count, random, rays);
    judge_rays(run, scene, meshes, count, rays);
    for (uint32_t i = 0; i < RAYS; i++)
        check_hit(run, scene, bottom->meanings, &rays[i]);
}

static void judge_candidates(struct random_run *run, const struct random_input *bottom, const struct scene *scene,
                             struct random *random)
{
    struct oracle_mesh meshes[RANDOM_INPUT_GEOMETRIES] = {0};
    struct ray rays[RAYS];
    uint32_t count = bottom->input.geometry_count;
    for (uint32_t g = 0; g < count; g++)
        meshes[g] = boxes_as_triangles(&bottom->meanings[g]);
    make_rays(run, meshes, count, random, rays);
    for (uint32_t i = 0; i < RAYS; i++)
        check_boxes(run, scene, bottom, &rays[i], RAY_NO_INSTANCE, NULL);
    for (uint32_t g = 0; g < count; g++)
        free((void *)(uintptr_t)meshes[g].positions);
}

void random_judge_bottom(struct random_run *run, const struct random_input *bottom, const struct scene *scene,
                         struct random *random)
{
    bool candidates = bottom->kind->are_candidates && bottom->input.geometry_count;
    (candidates ? judge_candidates : judge_hits)(run, bottom, scene, random);
}

void random_judge_top(struct random_run *run, struct random_top *top, const struct scene *scene, struct random *random)
{
    struct ray rays[RAYS];
    random_top_mean(top, 0xff);
    make_rays(run, top->meshes, top->mesh_count, random, rays);
    if (top->culling_disabled)
        for (uint32_t i = 0; i < RAYS; i++)
            rays[i].flags = 0;
    uint32_t mask = rays[0].cull_mask;
    random_top_mean(top, mask);
    judge_rays(run, scene, top->meshes, top->mesh_count, rays);
    for (uint32_t i = 0; i < top->instance_count; i++) {
        const struct random_instance *instance = &top->instances[i];
        const struct random_input *bottom = instance->bottom < 0 ? NULL : &top->bottoms[instance->bottom];
        if (!bottom || !(instance->mask & mask) || !bottom->kind->are_candidates || !bottom->input.geometry_count ||
            !random_motion_is_active(&instance->motion))
            continue;
        for (uint32_t k = i % 8; k < RAYS; k += 8) {
            float matrix[12];
            if (random_top_matrix(top, i, rays[k].time, matrix))
                check_boxes(run, scene, bottom, &rays[k], i, matrix);
        }
    }
}
