/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/support/shader/shader_candidates.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "tests/support/shader/shader_accuracy.h"

enum { SHOWN = 5 };

struct candidate_list {
    struct ray_hit hits[SHADER_BED_CANDIDATES];
    uint32_t count; /* SHADER_BED_CANDIDATES + 1 if there are more */
};

static bool is_same_primitive(const struct ray_hit *a, const struct ray_hit *b)
{
    return a->instance == b->instance && a->geometry == b->geometry && a->primitive == b->primitive;
}

static const struct ray_hit *find(const struct candidate_list *list, const struct ray_hit *hit)
{
    for (uint32_t i = 0; i < list->count; i++)
        if (is_same_primitive(&list->hits[i], hit))
            return &list->hits[i];
    return NULL;
}

/* Adds a candidate if it is new; split references report a primitive several times. */
static void add(struct candidate_list *list, const struct ray_hit *hit)
{
    if (list->count >= SHADER_BED_CANDIDATES)
        list->count = SHADER_BED_CANDIDATES + 1;
    else if (!find(list, hit))
        list->hits[list->count++] = *hit;
}

static enum candidate_verdict note(void *context, const struct ray *ray, const struct candidate_space *space,
                                   struct ray_hit *hit)
{
    (void)ray;
    (void)space;
    add(context, hit);
    return CANDIDATE_IGNORE;
}

/* ---- candidates of one side only ---- */

static bool is_round(const struct ray_hit *hit)
{
    return hit->is_sphere || hit->is_swept_sphere;
}

static const struct portable_instance *find_instance(const struct scene *scene, uint32_t instance)
{
    const struct portable_instance *records = scene->top ? scene->top->records : NULL;
    for (uint32_t i = 0; records && i < scene->top->header->record_count; i++)
        if (records[i].instance == instance)
            return &records[i];
    return NULL;
}

static const struct portable_view *find_bottom(const struct scene *scene, const struct portable_instance *instance)
{
    return scene->bottoms[instance ? instance->handle : 0];
}

static bool find_box(const struct portable_view *view, const struct ray_hit *hit, float ret_box[6])
{
    uint32_t id = view->geometries[hit->geometry].first_primitive + hit->primitive;
    for (uint32_t i = 0; i < view->header->record_count; i++) {
        const struct portable_aabb *box = (const struct portable_aabb *)view->records + i;
        if ((box->id & PORTABLE_ID_MASK) != id)
            continue;
        memcpy(ret_box, box->min, 12);
        memcpy(ret_box + 3, box->max, 12);
        return true;
    }
    return false;
}

static const float *matrix_of(const struct scene *scene, uint32_t instance)
{
    const struct portable_instance *found = find_instance(scene, instance);
    return found ? found->object_to_world : NULL;
}

static bool is_box_right(const struct scene *scene, const struct ray *ray, const struct ray_hit *hit, bool is_candidate)
{
    const struct portable_view *bottom = find_bottom(scene, find_instance(scene, hit->instance));
    struct long_ray local = shader_accuracy_ray(ray, matrix_of(scene, hit->instance));
    long double near, far;
    float box[6];
    if (!find_box(bottom, hit, box))
        return false;
    return is_candidate
               ? candidates_meet(&local, box, shader_accuracy_box(&local, box, bottom->header->bounds), &near, &far)
               : !candidates_surely_meet(&local, box, 1e-5L);
}

static bool is_primitive_right(const struct scene *scene, const struct ray *ray, const struct ray_hit *hit,
                               bool is_candidate, struct memory *memory)
{
    struct shader_case shared = {.flags = ray->flags, .cull_mask = ray->cull_mask};
    struct shader_meshes meshes;
    struct oracle_answer answer;
    struct bvhd_error error;
    struct oracle_mesh one[2];
    struct ray_hit moved = *hit;
    uint32_t count = 0;
    bool is_right = false;
    moved.primitive = 0;
    shader_meshes_make(scene, &shared, &meshes);
    for (uint32_t i = 0; i < meshes.count && count < 2; i++)
        if (meshes.meshes[i].instance == hit->instance && meshes.meshes[i].geometry == hit->geometry)
            one[count++] = shader_meshes_one(&meshes.meshes[i], hit->primitive);
    if (count && oracle_trace(one, count, ray, 1, memory, &parallel_serial, NULL, NULL, &answer, &error) == BVHD_OK) {
        is_right = oracle_judge(&answer, is_candidate ? &moved : NULL, NULL) <= ORACLE_UNDECIDED;
        oracle_finish(&answer, 1, memory);
    }
    shader_meshes_finish(&meshes);
    return is_right;
}

/* ---- all candidates ---- */

/*
 * Whether all values of a candidate equal the CPU's, or are near enough to the exact ones. A triangle that can also be
 * missed has no certain front side.
 */
static bool is_told_rightly(const struct scene *scene, const struct ray *ray, const struct ray_hit *hit,
                            const struct ray_hit *theirs, struct memory *memory)
{
    const struct portable_view *bottom = find_bottom(scene, find_instance(scene, hit->instance));
    const float *matrix = matrix_of(scene, hit->instance);
    struct ray_hit placed = *theirs;
    float corners[3][3], box[6];
    if (shader_judge_same(ray, hit, theirs))
        return true;
    placed.t = hit->t;
    placed.u = hit->u;
    placed.v = hit->v;
    placed.front_face = hit->front_face;
    if (!shader_judge_same(ray, hit, &placed))
        return false;
    if (hit->is_aabb)
        return find_box(bottom, hit, box) &&
               shader_accuracy_allows_entry(ray, matrix, box, bottom->header->bounds, hit->t);
    if (is_round(hit))
        return hit->front_face && is_primitive_right(scene, ray, hit, true, memory);
    if (hit->front_face != theirs->front_face)
        return is_primitive_right(scene, ray, hit, false, memory);
    traverse_positions(scene, theirs, corners);
    return shader_accuracy_allows(ray, matrix, corners, hit);
}

static void report(const char *what, const char *wrong, const struct ray *ray, const struct ray_hit *hit,
                   struct shader_candidate_tally *tally)
{
    if (tally->defects++ < SHOWN)
        printf("%s: candidate %u.%u.%u%s at %.9g %s; ray (%a %a %a) + t (%a %a %a), %a .. %a, flags %x\n", what,
               hit->instance, hit->geometry, hit->primitive, hit->is_aabb ? " (AABB)" : "", (double)hit->t, wrong,
               (double)ray->origin[0], (double)ray->origin[1], (double)ray->origin[2], (double)ray->direction[0],
               (double)ray->direction[1], (double)ray->direction[2], (double)ray->tmin, (double)ray->tmax, ray->flags);
}

/* Judges the candidates that `list` has and `other` does not have. */
static void judge_missing(const char *what, const struct shader_still *still, const struct ray *ray,
                          const struct candidate_list *list, const struct candidate_list *other, bool is_ours,
                          struct memory *memory, struct shader_candidate_tally *tally)
{
    for (uint32_t i = 0; i < list->count; i++) {
        const struct ray_hit *hit = &list->hits[i];
        if (find(other, hit))
            continue;
        tally->differing++;
        bool is_right = shader_still_is_flat(still, hit->instance) ||
                        (hit->is_aabb ? is_box_right(&still->scene, ray, hit, is_ours)
                                      : is_primitive_right(&still->scene, ray, hit, is_ours, memory));
        if (!is_right)
            report(what, is_ours ? "must not be one" : "is missing", ray, hit, tally);
    }
}

/* The CPU traverses `scene`; `still` is what it is at the ray's time. */
static void judge_ray(const char *what, const struct scene *scene, const struct shader_still *still,
                      const struct ray *ray, const struct shader_full_answer *answer, struct memory *memory,
                      struct shader_candidate_tally *tally)
{
    struct candidate_list ours = {.count = 0}, theirs = {.count = 0};
    struct traverse_options options = {.candidate = note, .context = &theirs};
    struct ray_hit hit;
    if (traverse(scene, ray, &options, &hit, NULL) || answer->answer.type)
        report(what, "though all were ignored there is a hit", ray, &hit, tally);
    if (answer->answer.candidate_count > SHADER_BED_CANDIDATES || theirs.count > SHADER_BED_CANDIDATES)
        return;
    for (uint32_t i = 0; i < answer->answer.candidate_count; i++) {
        hit = shader_judge_hit(&answer->candidates[i]);
        add(&ours, &hit);
        const struct ray_hit *same = find(&theirs, &hit);
        if (same && !shader_still_is_flat(still, hit.instance) &&
            !is_told_rightly(&still->scene, ray, &hit, same, memory))
            report(what, "has wrong values", ray, &hit, tally);
    }
    tally->rays++;
    tally->candidates += ours.count;
    judge_missing(what, still, ray, &ours, &theirs, true, memory, tally);
    judge_missing(what, still, ray, &theirs, &ours, false, memory, tally);
}

void shader_candidates_judge(const char *what, const struct scene *scene, const struct ray *rays, uint32_t count,
                             const struct shader_full_answer *answers, struct memory *memory,
                             struct shader_candidate_tally *tally)
{
    struct shader_still still;
    shader_still_make(scene, rays[0].time, &still);
    for (uint32_t i = 0; i < count; i++)
        judge_ray(what, scene, &still, &rays[i], &answers[i], memory, tally);
    shader_still_finish(&still);
}

/* ---- details ---- */

static bool are_close(const long double *exact, const float *got)
{
    long double size = 0;
    for (int axis = 0; axis < 3; axis++)
        size = fmaxl(size, fabsl(exact[axis]));
    for (int axis = 0; axis < 3; axis++)
        if (!(fabsl(exact[axis] - got[axis]) <= 1e-6L * size))
            return false;
    return true;
}

/* Whether a number of a matrix is right: to the bit where it is stored, nearly where shaders compute it. */
static bool is_number_right(float got, float exact, const float *row, bool is_computed)
{
    float largest = fmaxf(fmaxf(fabsf(row[0]), fabsf(row[1])), fmaxf(fabsf(row[2]), fabsf(row[3])));
    return got == exact || (is_computed && fabsf(got - exact) <= 1e-6f * largest);
}

static bool are_matrices_right(const struct portable_instance *instance, bool is_computed,
                               const struct shader_details *details)
{
    static const float identity[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
    const float *there = instance ? instance->object_to_world : identity,
                *back = instance ? instance->world_to_object : identity;
    for (int row = 0; row < 3; row++)
        for (int column = 0; column < 4; column++)
            if (!is_number_right(details->object_to_world[column][row], there[4 * row + column], there + 4 * row,
                                 is_computed) ||
                !is_number_right(details->world_to_object[column][row], back[4 * row + column], back + 4 * row,
                                 is_computed))
                return false;
    return true;
}

/* The corners of a triangle; of spheres and linear swept spheres both centres, and both radii; 0 of a box. */
static void expect_corners(const struct scene *scene, const struct ray_hit *hit, float ret_corners[3][3])
{
    const struct portable_view *bottom = scene->bottoms[hit->handle];
    float ends[2][4];
    memset(ret_corners, 0, sizeof(float[3][3]));
    if (hit->is_aabb)
        return;
    if (!is_round(hit)) {
        traverse_positions(scene, hit, ret_corners);
        return;
    }
    shader_meshes_ends(bottom, hit->record, ends);
    for (int end = 0; end < 2; end++) {
        memcpy(ret_corners[end], ends[end], 12);
        ret_corners[2][end] = ends[end][3];
    }
}

static const char *wrong_detail(const struct shader_still *still, const struct ray *ray, const struct ray_hit *hit,
                                const struct shader_details *details)
{
    const struct portable_instance *instance = find_instance(&still->scene, hit->instance);
    struct long_ray local = candidates_ray(ray);
    float corners[3][3];
    if (instance)
        local = candidates_ray_into(&local, instance->object_to_world);
    expect_corners(&still->scene, hit, corners);
    if (memcmp(corners, details->corners, sizeof corners) != 0)
        return "has other corners";
    if (!are_matrices_right(instance, still->has_moving_top, details))
        return "has other matrices";
    if (!are_close(local.origin, details->object_origin) || !are_close(local.direction, details->object_direction))
        return "has another ray in object space";
    return NULL;
}

uint64_t shader_details_judge(const char *what, const struct scene *scene, const struct ray *rays, uint32_t count,
                              const struct shader_full_answer *answers)
{
    struct shader_candidate_tally tally = {0};
    struct shader_still still;
    shader_still_make(scene, rays[0].time, &still);
    for (uint32_t i = 0; i < count; i++) {
        struct ray_hit hit, ours = shader_judge_hit(&answers[i].answer.hit);
        if (!answers[i].answer.type || shader_still_is_flat(&still, ours.instance) ||
            !traverse(scene, &rays[i], NULL, &hit, NULL) || !is_same_primitive(&hit, &ours))
            continue;
        const char *wrong = wrong_detail(&still, &rays[i], &hit, &answers[i].details);
        if (wrong)
            report(what, wrong, &rays[i], &ours, &tally);
    }
    shader_still_finish(&still);
    return tally.defects;
}
