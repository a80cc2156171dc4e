/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/support/driver/driver_judge.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "tests/support/driver/ray_pipeline.h"

#define MUST(call) driver_scene_must((call), &error)

enum { MOST_PRINTED = 5 };

#define ROUNDING 1e-5 /* relative rounding error of floats in the quantities compared here, with a margin */

const struct driver_case driver_cases[] = {
    {"no flags", 0, 0xff, QUERY_ACCEPT, false},
    {"cull back", RAY_CULL_BACK_FACING, 0xff, QUERY_ACCEPT, false},
    {"cull front", RAY_CULL_FRONT_FACING, 0xff, QUERY_ACCEPT, false},
    {"cull opaque", RAY_CULL_OPAQUE, 0xff, QUERY_ACCEPT, false},
    {"cull no-opaque", RAY_CULL_NO_OPAQUE, 0xff, QUERY_ACCEPT, false},
    {"opaque", RAY_OPAQUE, 0xff, QUERY_ACCEPT, false},
    {"no-opaque", RAY_NO_OPAQUE, 0xff, QUERY_ACCEPT, false},
    {"skip triangles", RAY_SKIP_TRIANGLES, 0xff, QUERY_ACCEPT, false},
    {"skip AABBs", RAY_SKIP_AABBS, 0xff, QUERY_ACCEPT, false},
    {"cull back+opaque", RAY_CULL_BACK_FACING | RAY_OPAQUE, 0xff, QUERY_ACCEPT, false},
    {"cull front+no-opaque", RAY_CULL_FRONT_FACING | RAY_NO_OPAQUE, 0xff, QUERY_ACCEPT, false},
    {"mask 01", 0, 0x01, QUERY_ACCEPT, false},
    {"mask 80", 0, 0x80, QUERY_ACCEPT, false},
    {"mask 7e", RAY_CULL_BACK_FACING, 0x7e, QUERY_ACCEPT, false},
    {"mask 00", 0, 0, QUERY_ACCEPT, false},
    {"first hit", RAY_TERMINATE_ON_FIRST_HIT, 0xff, QUERY_ACCEPT, true},
    {"first hit+no-opaque", RAY_TERMINATE_ON_FIRST_HIT | RAY_NO_OPAQUE, 0xff, QUERY_ACCEPT, true},
    {"some candidates", RAY_NO_OPAQUE, 0xff, QUERY_SOME, false},
    {"one candidate", RAY_NO_OPAQUE, 0xff, QUERY_END, true},
    {"all candidates", RAY_NO_OPAQUE, 0xff, QUERY_IGNORE, false},
};
const uint32_t driver_case_count = sizeof driver_cases / sizeof *driver_cases;

static void *allocate(uint64_t count, uint64_t size)
{
    void *block = calloc(count + 1, size);
    if (!block) {
        fprintf(stderr, "driver_judge: no memory\n");
        exit(1);
    }
    return block;
}

void driver_judge_init(struct driver_judge *ret_judge, struct driver_scene *scene, VkAccelerationStructureKHR ours)
{
    struct bvhd_error error;
    struct gpu *gpu = scene->gpu;
    *ret_judge = (struct driver_judge){.scene = scene, .ours = ours ? ours : driver_scene_our_top(scene), .listed = 64};
    ret_judge->queries = query_bed_create(gpu);
    query_bed_set_boxes(ret_judge->queries, &scene->boxes);
    if (!gpu->properties.has_ray_pipeline)
        return;
    MUST(ray_pipeline_create(gpu, ret_judge->ours, &scene->memory, &ret_judge->our_pipeline, &error));
    MUST(ray_pipeline_create(gpu, scene->top.handle, &scene->memory, &ret_judge->their_pipeline, &error));
    if (scene->boxes.box_count > 1) {
        MUST(ray_pipeline_set_boxes(ret_judge->our_pipeline, &scene->boxes, &error));
        MUST(ray_pipeline_set_boxes(ret_judge->their_pipeline, &scene->boxes, &error));
    }
}

void driver_judge_finish(struct driver_judge *judge)
{
    tracer_destroy(judge->our_pipeline);
    tracer_destroy(judge->their_pipeline);
    query_bed_destroy(judge->queries);
}

/* ---- Ties ---- */

/*
 * Answers of our structure and of the driver's to the same rays. Rays with different answers are doubtful and judged
 * one by one.
 */
struct trial {
    struct driver_judge *judge;
    const char *what;
    const struct driver_case *shared;
    const struct ray *rays;
    const struct query_answer *ours, *theirs;
    bool is_partial; /* by a pipeline, which does not report everything, and hits AABBs at another t */
    uint32_t *doubtful; /* numbers of the rays */
    uint32_t doubtful_count;
};

/*
 * Traces each doubtful ray through `top` so that only the primitive of `answers` counts, whether it is opaque or not.
 */
static void trace_alone(const struct trial *trial, VkAccelerationStructureKHR top, const struct query_answer *answers,
                        struct query_answer *ret_answers)
{
    struct ray *rays = allocate(trial->doubtful_count, sizeof *rays);
    struct query_id *targets = allocate(trial->doubtful_count, sizeof *targets);
    for (uint32_t i = 0; i < trial->doubtful_count; i++) {
        const struct query_answer *answer = &answers[trial->doubtful[i]];
        rays[i] = trial->rays[trial->doubtful[i]];
        rays[i].flags &= ~(uint32_t)(RAY_OPAQUE | RAY_CULL_OPAQUE | RAY_CULL_NO_OPAQUE | RAY_TERMINATE_ON_FIRST_HIT);
        rays[i].flags |= RAY_NO_OPAQUE;
        targets[i] = (struct query_id){answer->instance, answer->geometry, answer->primitive};
    }
    const struct query_work work = {
        .top = top, .rays = rays, .count = trial->doubtful_count, .policy = QUERY_ONLY, .targets = targets};
    query_bed_trace(trial->judge->queries, &work, ret_answers, NULL);
    free(targets);
    free(rays);
}

/* Whether an answer about a primitive equals the answer of the other structure about it alone. */
static bool is_confirmed(const struct trial *trial, const struct query_answer *said, const struct query_answer *alone)
{
    if (!trial->is_partial)
        return query_answer_equal(said, alone);
    bool is_same = said->instance == alone->instance && said->custom_index == alone->custom_index &&
                   said->geometry == alone->geometry && said->primitive == alone->primitive &&
                   said->flags == alone->flags;
    return is_same && (said->flags & QUERY_AABB || memcmp(&said->t, &alone->t, 3 * sizeof(float)) == 0);
}

static double triple(const double a[3], const double b[3], const double c[3])
{
    return a[0] * (b[1] * c[2] - b[2] * c[1]) - a[1] * (b[0] * c[2] - b[2] * c[0]) + a[2] * (b[0] * c[1] - b[1] * c[0]);
}

static void to_world(const float m[12], const float point[3], double ret_point[3])
{
    for (ptrdiff_t row = 0; row < 3; row++)
        ret_point[row] = (double)m[4 * row] * (double)point[0] + (double)m[4 * row + 1] * (double)point[1] +
                         (double)m[4 * row + 2] * (double)point[2] + (double)m[4 * row + 3];
}

/* Transforms a point from the world into an instance's space, by Cramer's rule. */
static void to_object(const float m[12], const double point[3], double ret_point[3])
{
    double columns[4][3], determinant;
    for (ptrdiff_t row = 0; row < 3; row++) {
        for (int column = 0; column < 3; column++)
            columns[column][row] = m[4 * row + column];
        columns[3][row] = point[row] - (double)m[4 * row + 3];
    }
    determinant = triple(columns[0], columns[1], columns[2]);
    ret_point[0] = triple(columns[3], columns[1], columns[2]) / determinant;
    ret_point[1] = triple(columns[0], columns[3], columns[2]) / determinant;
    ret_point[2] = triple(columns[0], columns[1], columns[3]) / determinant;
}

/* Whether a point is where an answer's barycentrics say, within rounding errors of floats. */
static bool is_on_triangle(const struct query_answer *answer, const float corners[3][3], const float *transform,
                           const double there[3], double size)
{
    const double weights[3] = {1 - (double)answer->u - (double)answer->v, (double)answer->u, (double)answer->v};
    double point[3] = {0}, away = 0;
    for (int k = 0; k < 3; k++) {
        double corner[3];
        to_world(transform, corners[k], corner);
        for (int axis = 0; axis < 3; axis++) {
            point[axis] += weights[k] * corner[axis];
            size = fmax(size, fabs(corner[axis]));
        }
    }
    for (int axis = 0; axis < 3; axis++)
        away = fmax(away, fabs(there[axis] - point[axis]));
    return weights[0] > -ROUNDING && weights[1] > -ROUNDING && weights[2] > -ROUNDING && away <= ROUNDING * size;
}

static bool is_in_box(const float *box, const double point[3])
{
    double size = 0, away = 0;
    for (int axis = 0; axis < 3; axis++) {
        size = fmax(size, fmax(fabs((double)box[axis]), fabs((double)box[axis + 3])));
        away = fmax(away, fmax((double)box[axis] - point[axis], point[axis] - (double)box[axis + 3]));
    }
    return away <= ROUNDING * size;
}

/* Whether an answer is true by the geometry alone. */
static bool is_true(const struct trial *trial, const struct ray *ray, const struct query_answer *answer)
{
    const struct driver_scene_options *scene = &trial->judge->scene->options;
    struct canonical_instance instance = canonical_instance(&scene->top->geometries[0], answer->instance);
    const struct canonical *bottom =
        &scene->bottoms[driver_scene_bottom(trial->judge->scene, (uint32_t)instance.reference - 1)];
    const struct canonical_geometry *geometry = &bottom->geometries[answer->geometry];
    double there[3], in_object[3], size = 0;
    float corners[3][3];
    for (int axis = 0; axis < 3; axis++) {
        there[axis] = (double)ray->origin[axis] + (double)answer->t * (double)ray->direction[axis];
        size = fmax(size, fmax(fabs(there[axis]), fabs((double)ray->origin[axis])));
    }
    if (answer->flags & QUERY_AABB) {
        to_object(instance.transform, there, in_object);
        return is_in_box(geometry->boxes + 6 * (size_t)answer->primitive, in_object);
    }
    canonical_triangle(geometry, answer->primitive, corners);
    return is_on_triangle(answer, (const float(*)[3])corners, instance.transform, there, size);
}

static bool is_lost_by_driver(const struct trial *trial, uint32_t ray, const struct query_answer *ours_alone,
                              const struct query_answer *theirs_alone)
{
    const struct query_answer *ours = &trial->ours[ray], *theirs = &trial->theirs[ray];
    bool is_nearer = !(theirs->flags & QUERY_HIT) ||
                     (is_confirmed(trial, theirs, theirs_alone) && (trial->shared->is_any || ours->t <= theirs->t));
    return ours->flags & QUERY_HIT && !(ours_alone->flags & QUERY_HIT) && is_nearer &&
           is_true(trial, &trial->rays[ray], ours);
}

static void print_answer(const char *who, const struct query_answer *answer)
{
    printf(
        "    %s: t %.9g u %.9g v %.9g instance %u custom %u geometry %u primitive %u flags %u sbt %u matrices %08x\n",
        who, (double)answer->t, (double)answer->u, (double)answer->v, answer->instance, answer->custom_index,
        answer->geometry, answer->primitive, answer->flags, answer->sbt_offset, answer->matrices);
}

static void print_defect(const struct trial *trial, uint32_t ray)
{
    const struct ray *r = &trial->rays[ray];
    if (trial->judge->tally.other > MOST_PRINTED)
        return;
    printf("%s, %s: ray %u from (%a, %a, %a) along (%a, %a, %a), tmin %g tmax %g\n", trial->what, trial->shared->name,
           ray, (double)r->origin[0], (double)r->origin[1], (double)r->origin[2], (double)r->direction[0],
           (double)r->direction[1], (double)r->direction[2], (double)r->tmin, (double)r->tmax);
    print_answer("driver", &trial->theirs[ray]);
    print_answer("ours  ", &trial->ours[ray]);
}

static bool may_differ(const struct trial *trial, const struct query_answer *a, const struct query_answer *b)
{
    return a->flags & QUERY_HIT && b->flags & QUERY_HIT &&
           (trial->shared->is_any || memcmp(&a->t, &b->t, sizeof a->t) == 0);
}

static void judge_doubtful(struct trial *trial)
{
    struct driver_tally *tally = &trial->judge->tally;
    struct query_answer *ours_alone = allocate(trial->doubtful_count, sizeof *ours_alone),
                        *theirs_alone = allocate(trial->doubtful_count, sizeof *theirs_alone);
    trace_alone(trial, trial->judge->scene->top.handle, trial->ours, ours_alone);
    trace_alone(trial, trial->judge->ours, trial->theirs, theirs_alone);
    for (uint32_t i = 0; i < trial->doubtful_count; i++) {
        uint32_t ray = trial->doubtful[i];
        bool is_right = may_differ(trial, &trial->ours[ray], &trial->theirs[ray]) &&
                        is_confirmed(trial, &trial->ours[ray], &ours_alone[i]) &&
                        is_confirmed(trial, &trial->theirs[ray], &theirs_alone[i]);
        bool is_lost = !is_right && is_lost_by_driver(trial, ray, &ours_alone[i], &theirs_alone[i]);
        tally->tied += is_right && !trial->shared->is_any;
        tally->another += is_right && trial->shared->is_any;
        tally->lost += is_lost;
        tally->other += !is_right && !is_lost;
        if (!is_right && !is_lost)
            print_defect(trial, ray);
    }
    free(theirs_alone);
    free(ours_alone);
}

static void judge_answers(struct trial *trial, uint32_t count)
{
    struct driver_tally *tally = &trial->judge->tally;
    trial->doubtful = allocate(count, sizeof *trial->doubtful);
    tally->rays += count;
    for (uint32_t i = 0; i < count; i++) {
        tally->hits += (trial->theirs[i].flags & QUERY_HIT) != 0;
        if (query_answer_equal(&trial->ours[i], &trial->theirs[i]))
            tally->same++;
        else
            trial->doubtful[trial->doubtful_count++] = i;
    }
    if (trial->doubtful_count)
        judge_doubtful(trial);
    free(trial->doubtful);
}

static struct ray *rays_of_case(const struct driver_case *shared, const struct ray *rays, uint32_t count)
{
    struct ray *own = allocate(count, sizeof *own);
    memcpy(own, rays, count * sizeof *own);
    for (uint32_t i = 0; i < count; i++) {
        own[i].flags = shared->flags;
        own[i].cull_mask = shared->mask == 0xff ? rays[i].cull_mask : shared->mask;
    }
    return own;
}

/* ---- Candidates ---- */

/* Any total order is good enough. */
static int compare_ids(const void *a, const void *b)
{
    return memcmp(a, b, sizeof(struct query_id));
}

/* Sorts the list and removes duplicates. Returns the new length. */
static uint32_t tidy(struct query_id *ids, uint32_t count)
{
    uint32_t kept = 0;
    qsort(ids, count, sizeof *ids, compare_ids);
    for (uint32_t i = 0; i < count; i++)
        if (!kept || compare_ids(&ids[kept - 1], &ids[i]) != 0)
            ids[kept++] = ids[i];
    return kept;
}

enum verdict { SAME, LOST, WRONG };

/*
 * Every candidate of the driver has to be among ours. Ours may have more only in instances in which the driver's own
 * structure has found nothing, so that it has missed their boxes.
 */
static enum verdict compare_lists(const struct query_id *ours, uint32_t our_count, const struct query_id *theirs,
                                  uint32_t their_count)
{
    uint32_t found = 0;
    enum verdict verdict = SAME;
    for (uint32_t i = 0; i < our_count; i++) {
        if (found < their_count && compare_ids(&ours[i], &theirs[found]) == 0) {
            found++;
            continue;
        }
        verdict = LOST;
        for (uint32_t k = 0; k < their_count; k++)
            if (theirs[k].instance == ours[i].instance)
                return WRONG;
    }
    return found == their_count ? verdict : WRONG;
}

static enum verdict compare_candidates(struct driver_judge *judge, const struct query_answer *ours,
                                       const struct query_answer *theirs, struct query_id *our_ids,
                                       struct query_id *their_ids)
{
    uint32_t listed = judge->listed;
    judge->tally.candidates += theirs->candidates;
    /* Longer lists are incomplete, so only their lengths are compared, as far as these say something. */
    if (ours->candidates > listed || theirs->candidates > listed) {
        bool is_same =
            judge->tells_repeated ? ours->candidates >= theirs->candidates : ours->candidates == theirs->candidates;
        return is_same ? SAME : WRONG;
    }
    uint32_t our_count = tidy(our_ids, ours->candidates), their_count = tidy(their_ids, theirs->candidates);
    judge->tally.repeated += ours->candidates - our_count;
    if (their_count != theirs->candidates || (our_count != ours->candidates && !judge->tells_repeated))
        return WRONG;
    return compare_lists(our_ids, our_count, their_ids, their_count);
}

static void judge_candidates(struct driver_judge *judge, const struct trial *trial, uint32_t count,
                             struct query_id *our_ids, struct query_id *their_ids)
{
    for (uint32_t i = 0; i < count; i++) {
        size_t at = (size_t)i * judge->listed;
        enum verdict verdict =
            compare_candidates(judge, &trial->ours[i], &trial->theirs[i], our_ids + at, their_ids + at);
        judge->tally.same -= verdict != SAME;
        judge->tally.lost += verdict == LOST;
        judge->tally.other += verdict == WRONG;
        if (verdict == WRONG && judge->tally.other <= MOST_PRINTED)
            printf("%s, %s: ray %u has %u candidates, the driver's %u, or not the same ones\n", trial->what,
                   trial->shared->name, i, trial->ours[i].candidates, trial->theirs[i].candidates);
    }
}

void driver_judge_queries(struct driver_judge *judge, const char *what, const struct driver_case *shared,
                          const struct ray *rays, uint32_t count)
{
    bool lists = shared->policy == QUERY_IGNORE;
    uint32_t listed = lists ? judge->listed : 0;
    struct ray *own = rays_of_case(shared, rays, count);
    struct query_answer *ours = allocate(count, sizeof *ours), *theirs = allocate(count, sizeof *theirs);
    struct query_id *our_ids = allocate((uint64_t)count * listed, sizeof *our_ids),
                    *their_ids = allocate((uint64_t)count * listed, sizeof *their_ids);
    struct query_work work = {
        .top = judge->ours, .rays = own, .count = count, .policy = shared->policy, .listed = listed};
    query_bed_trace(judge->queries, &work, ours, our_ids);
    work.top = judge->scene->top.handle;
    query_bed_trace(judge->queries, &work, theirs, their_ids);
    struct trial trial = {.judge = judge, .what = what, .shared = shared, .rays = own, .ours = ours, .theirs = theirs};
    judge_answers(&trial, count);
    if (lists)
        judge_candidates(judge, &trial, count, our_ids, their_ids);
    free(their_ids);
    free(our_ids);
    free(theirs);
    free(ours);
    free(own);
}

/* ---- Pipelines ---- */

static struct query_answer answer_of(const struct tracer_hit *hit)
{
    bool is_hit = hit->instance != RAY_NO_INSTANCE;
    return (struct query_answer){.t = hit->t,
                                 .u = hit->u,
                                 .v = hit->v,
                                 .instance = hit->instance,
                                 .custom_index = hit->custom_index,
                                 .geometry = hit->geometry,
                                 .primitive = hit->primitive,
                                 .flags = (hit->flags & TRACER_FRONT_FACE ? QUERY_FRONT_FACE : 0) |
                                          (hit->flags & TRACER_AABB ? QUERY_AABB : 0) | (is_hit ? QUERY_HIT : 0)};
}

static void trace_pipeline(struct tracer *tracer, const struct ray *rays, uint32_t count,
                           struct query_answer *ret_answers)
{
    struct bvhd_error error;
    struct tracer_hit *hits = allocate(count, sizeof *hits);
    MUST(tracer->trace(tracer, rays, count, hits, NULL, &error));
    for (uint32_t i = 0; i < count; i++)
        ret_answers[i] = answer_of(&hits[i]);
    free(hits);
}

void driver_judge_pipelines(struct driver_judge *judge, const char *what, const struct driver_case *shared,
                            const struct ray *rays, uint32_t count)
{
    if (!judge->our_pipeline || shared->policy != QUERY_ACCEPT)
        return;
    struct ray *own = rays_of_case(shared, rays, count);
    struct query_answer *ours = allocate(count, sizeof *ours), *theirs = allocate(count, sizeof *theirs);
    trace_pipeline(judge->our_pipeline, own, count, ours);
    trace_pipeline(judge->their_pipeline, own, count, theirs);
    struct trial trial = {.judge = judge,
                          .what = what,
                          .shared = shared,
                          .rays = own,
                          .ours = ours,
                          .theirs = theirs,
                          .is_partial = true};
    judge_answers(&trial, count);
    free(theirs);
    free(ours);
    free(own);
}
