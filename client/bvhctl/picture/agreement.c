/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/picture/agreement.h"

#include <float.h>
#include <stdlib.h>
#include <string.h>

#include "client/bvhctl/oracle/oracle_timed.h"
#include "client/bvhctl/oracle/rays.h"
#include "client/bvhctl/scene/target_reader.h"
#include "client/bvhctl/scene/unpack.h"
#include "proto/base/clock.h"

enum { CAMERA_RAYS = 1 << 22, OTHER_RAYS = 1 << 20, OTHER_RAYS_A_SAMPLE = 5 };
enum { FIRST_CASES = 1 << 8, MOST_DISPUTES = 1 << 12, MOST_DOUBTS = 1 << 16, CHUNK = 256, AROUND = 9, BATCH = 4096 };

static const double roundings = 8;

/* The share of the time in which cases are judged for the first time; the rest is for those that stay open. */
#define FIRST_SHARE 0.75

/* How two answers to one ray compare. */
enum {
    ANSWERS_AGREE,
    ANSWERS_DIFFER,
    FACTS_DIFFER /* t is NaN, or both report the same triangle with different facts: rounding explains neither */
};

struct agreement_case {
    struct ray ray;
    struct tracer_hit device, own;
    bool is_disputed; /* FACTS_DIFFER */
};

static uint32_t stride(double rays, double limit)
{
    return rays > limit ? (uint32_t)ceil(rays / limit) : 1;
}

void agreement_init(struct agreement *agreement, const struct surfaces *surfaces, uint64_t samples,
                    const struct parallel *parallel, struct memory *memory)
{
    *agreement = (struct agreement){.surfaces = surfaces,
                                    .parallel = parallel,
                                    .camera_stride = stride((double)samples, CAMERA_RAYS),
                                    .other_stride = stride((double)samples * OTHER_RAYS_A_SAMPLE, OTHER_RAYS),
                                    .memory = memory};
}

void agreement_finish(struct agreement *agreement)
{
    if (!agreement || !agreement->memory)
        return;
    memory_free(agreement->memory, agreement->disputes.cases);
    memory_free(agreement->memory, agreement->doubts.cases);
    memory_free(agreement->memory, agreement->verdicts);
    *agreement = (struct agreement){0};
}

/* ---- two answers ---- */

static bool is_miss(const struct tracer_hit *hit)
{
    return hit->t == INFINITY;
}

/* Computes the distance to the triangle's plane, and by how much rounding may change it. */
static void plane_distance(const struct ray *ray, const struct surface *surface, double *ret_t, double *ret_tolerance)
{
    struct vector normal = surface_normal(surface);
    double above = 0, facing = 0, wobble = 0;
    for (int axis = 0; axis < 3; axis++) {
        double n = vector_component(normal, axis), corner = vector_component(surface->corners[0], axis),
               farthest = fabs(corner);
        for (int i = 1; i < 3; i++)
            farthest = fmax(farthest, fabs(vector_component(surface->corners[i], axis)));
        above += n * (corner - (double)ray->origin[axis]);
        facing += n * (double)ray->direction[axis];
        wobble += fabs(n) * (fabs((double)ray->origin[axis]) + farthest + fabs(vector_component(surface->shift, axis)));
    }
    double t = above / facing;
    for (int axis = 0; axis < 3; axis++)
        wobble += fabs(vector_component(normal, axis) * t * (double)ray->direction[axis]);
    *ret_t = t;
    *ret_tolerance = roundings * FLT_EPSILON * wobble / fabs(facing) + FLT_TRUE_MIN;
}

/* Returns whether two distances to the same triangle differ by rounding alone. */
static bool is_near(const struct agreement *agreement, const struct ray *ray, const struct tracer_hit *device,
                    const struct tracer_hit *own)
{
    double apart = fabs((double)device->t - (double)own->t), t, tolerance;
    struct surface surface;
    if (apart <= roundings * FLT_EPSILON * fabs((double)own->t))
        return true;
    if (!isfinite(apart) || !surfaces_find(agreement->surfaces, ray, own, &surface))
        return false;
    plane_distance(ray, &surface, &t, &tolerance);
    return apart <= tolerance;
}

static bool same_instance(const struct agreement *agreement, const struct tracer_hit *a, const struct tracer_hit *b)
{
    return !agreement->surfaces->structures->has_top || a->instance == b->instance;
}

static int compare(const struct agreement *agreement, const struct ray *ray, const struct tracer_hit *device,
                   const struct tracer_hit *own)
{
    if (isnan(device->t))
        return FACTS_DIFFER;
    if (is_miss(device) || is_miss(own) || ray->flags & RAY_TERMINATE_ON_FIRST_HIT)
        return is_miss(device) == is_miss(own) ? ANSWERS_AGREE : ANSWERS_DIFFER;
    if (!same_instance(agreement, device, own) || device->geometry != own->geometry ||
        device->primitive != own->primitive)
        return ANSWERS_DIFFER;
    if (device->flags != own->flags ||
        (agreement->surfaces->structures->has_top && device->custom_index != own->custom_index))
        return FACTS_DIFFER;
    return is_near(agreement, ray, device, own) ? ANSWERS_AGREE : ANSWERS_DIFFER;
}

/* ---- a wave ---- */

struct wave {
    const struct agreement *agreement;
    const struct ray *rays;
    const struct tracer_hit *hits;
    uint64_t first, count; /* the first ray that is compared, and the number of those that are */
    uint32_t stride;
};

static struct tracer_hit trace_own(const struct structures *structures, const struct ray *ray)
{
    struct ray_hit hit;
    return structures_trace(structures, ray, &hit) ? tracer_hit_of(&hit) : tracer_miss;
}

static void compare_chunk(void *context, size_t index)
{
    const struct wave *wave = context;
    const struct agreement *agreement = wave->agreement;
    size_t begin, end;
    parallel_chunk(index, CHUNK, wave->count, &begin, &end);
    for (size_t i = begin; i < end; i++) {
        uint64_t at = wave->first + i * wave->stride;
        struct tracer_hit own = trace_own(agreement->surfaces->structures, &wave->rays[at]);
        agreement->verdicts[i] = (unsigned char)compare(agreement, &wave->rays[at], &wave->hits[at], &own);
    }
}

static bool has_room(struct agreement *agreement, uint64_t verdicts)
{
    if (verdicts > agreement->verdict_capacity) {
        unsigned char *block = memory_resize(agreement->memory, agreement->verdicts, verdicts);
        if (!block)
            return false;
        agreement->verdicts = block;
        agreement->verdict_capacity = verdicts;
    }
    return true;
}

/* Makes room for another case, unless there are enough. Returns false if there is no room. */
static bool sample_grow(struct agreement_sample *sample, uint32_t most, struct memory *memory)
{
    if (sample->count < sample->capacity)
        return true;
    uint32_t capacity = sample->capacity ? sample->capacity * 2 : FIRST_CASES;
    struct agreement_case *grown =
        capacity <= most ? memory_resize(memory, sample->cases, capacity * sizeof *grown) : NULL;
    if (!grown)
        return false;
    sample->cases = grown;
    sample->capacity = capacity;
    return true;
}

/*
 * Keeps each case that is seen with the same probability, and those that are kept in random order. Without memory the
 * sample stays as small as it is; false if that is nothing.
 */
static bool sample_add(struct agreement_sample *sample, uint32_t most, struct agreement *agreement,
                       const struct agreement_case *one)
{
    uint64_t place = rays_random(&agreement->random) % ++sample->seen;
    if (sample->seen == sample->count + UINT64_C(1) && sample_grow(sample, most, agreement->memory)) {
        uint32_t last = sample->count++;
        if (place < last)
            sample->cases[last] = sample->cases[place];
        sample->cases[place] = *one;
    } else if (place < sample->count) {
        sample->cases[place] = *one;
    }
    return sample->count > 0;
}

static bool keep_case(struct agreement *agreement, const struct ray *ray, const struct tracer_hit *device,
                      const struct tracer_hit *own, int verdict)
{
    const struct agreement_case one = {*ray, *device, *own, verdict == FACTS_DIFFER};
    agreement->differing++;
    return one.is_disputed ? sample_add(&agreement->disputes, MOST_DISPUTES, agreement, &one)
                           : sample_add(&agreement->doubts, MOST_DOUBTS, agreement, &one);
}

static enum bvhd_status no_memory(struct bvhd_error *error)
{
    return bvhd_error_no_memory(error, "trace", "no memory to compare with the CPU");
}

/* Selects every stride-th ray over all waves of a kind. Returns the first one in this wave. */
static uint64_t next_ray(uint64_t *seen, uint64_t count, uint32_t stride)
{
    uint64_t first = (stride - *seen % stride) % stride;
    *seen += count;
    return first;
}

enum bvhd_status agreement_watch(void *context, bool is_camera, const struct ray *rays, const struct tracer_hit *hits,
                                 uint64_t count, struct bvhd_error *error)
{
    struct agreement *agreement = context;
    struct wave wave = {.agreement = agreement, .rays = rays, .hits = hits};
    wave.stride = is_camera ? agreement->camera_stride : agreement->other_stride;
    wave.first = next_ray(is_camera ? &agreement->camera_seen : &agreement->other_seen, count, wave.stride);
    wave.count = wave.first < count ? (count - wave.first - 1) / wave.stride + 1 : 0;
    if (!has_room(agreement, wave.count))
        return no_memory(error);
    parallel_for(agreement->parallel, parallel_chunks(CHUNK, wave.count), compare_chunk, &wave);
    agreement->checked += wave.count;
    for (uint64_t i = 0; i < wave.count; i++) {
        uint64_t at = wave.first + i * wave.stride;
        if (agreement->verdicts[i] == ANSWERS_AGREE)
            continue;
        struct tracer_hit own = trace_own(agreement->surfaces->structures, &rays[at]);
        if (!keep_case(agreement, &rays[at], &hits[at], &own, agreement->verdicts[i]))
            return no_memory(error);
    }
    return BVHD_OK;
}

enum bvhd_status agreement_doubt(struct agreement *agreement, const struct ray *rays, const struct tracer_hit *hits,
                                 uint32_t count, struct bvhd_error *error)
{
    agreement->checked += count;
    for (uint32_t i = 0; i < count; i++)
        if (!keep_case(agreement, &rays[i], &hits[i], &hits[i], ANSWERS_DIFFER))
            return no_memory(error);
    return BVHD_OK;
}

/* ---- the judgement of the oracle ---- */

/*
 * Has the oracle judge a hit. It tolerates less rounding of t than plane_distance() allows; if t is within that
 * tolerance, the oracle therefore gets the distance to the triangle's plane instead.
 */
static enum oracle_verdict judge_hit(const struct agreement *agreement, const struct oracle_answer *answer,
                                     const struct ray *ray, const struct tracer_hit *hit)
{
    struct ray_hit judged = {
        .t = hit->t, .instance = hit->instance, .geometry = hit->geometry, .primitive = hit->primitive};
    judged.is_aabb = hit->flags & TRACER_AABB;
    if (!agreement->surfaces->structures->has_top)
        judged.instance = RAY_NO_INSTANCE;
    if (is_miss(hit))
        return oracle_judge(answer, NULL, NULL);
    struct surface surface;
    double t, tolerance;
    if (surfaces_find(agreement->surfaces, ray, hit, &surface)) {
        plane_distance(ray, &surface, &t, &tolerance);
        judged.t = fabs((double)hit->t - t) <= tolerance ? (float)t : hit->t;
    }
    return oracle_judge(answer, &judged, NULL);
}

static bool is_any_hit(const struct agreement_case *one)
{
    return one->ray.flags & RAY_TERMINATE_ON_FIRST_HIT;
}

/* Rays that end at any hit are right if they report whether there is one. */
static bool is_right(const struct agreement *agreement, const struct oracle_answer *answer,
                     const struct agreement_case *one, const struct tracer_hit *hit)
{
    if (is_any_hit(one))
        return is_miss(hit) == (answer->outcome == ORACLE_MISS);
    return judge_hit(agreement, answer, &one->ray, hit) == ORACLE_RIGHT;
}

enum opinion { OPINION_RIGHT, OPINION_UNCERTAIN, OPINION_WRONG, OPINION_OPEN };

/* OPINION_OPEN: the device's answer is wrong, but a driver's inverse or its rounding may explain it. */
static enum opinion judge_case(const struct agreement *agreement, const struct agreement_case *one,
                               const struct oracle_answer *answer)
{
    if (answer->outcome == ORACLE_UNCERTAIN && !isnan(one->device.t))
        return OPINION_UNCERTAIN;
    bool own_is_right = !one->is_disputed && is_right(agreement, answer, one, &one->own);
    if (own_is_right && is_right(agreement, answer, one, &one->device))
        return OPINION_RIGHT;
    bool may_be_explained =
        target_reader_find(agreement->surfaces->structures->target)->is_native && own_is_right && !isnan(one->device.t);
    return may_be_explained ? OPINION_OPEN : OPINION_WRONG;
}

/*
 * Returns whether the oracle, with the driver's inverse, agrees with the device. judge_hit() cannot be used, because
 * the inverse changes t and the position of the triangle.
 */
static bool is_explained(const struct agreement *agreement, const struct oracle_answer *answer,
                         const struct agreement_case *one)
{
    struct surface surface;
    double t, tolerance;
    if (answer->outcome == ORACLE_UNCERTAIN)
        return true;
    if (is_any_hit(one) || is_miss(&one->device))
        return is_miss(&one->device) == (answer->outcome == ORACLE_MISS);
    if (answer->outcome == ORACLE_MISS || !surfaces_find(agreement->surfaces, &one->ray, &one->device, &surface))
        return false;
    plane_distance(&one->ray, &surface, &t, &tolerance);
    struct ray_hit judged = {
        .t = (float)answer->t, .geometry = one->device.geometry, .primitive = one->device.primitive};
    judged.is_aabb = one->device.flags & TRACER_AABB;
    judged.instance = agreement->surfaces->structures->has_top ? one->device.instance : RAY_NO_INSTANCE;
    double device_t = (double)one->device.t;
    return device_t >= answer->t_low - tolerance && device_t <= answer->t_end + tolerance &&
           oracle_judge(answer, &judged, NULL) == ORACLE_RIGHT;
}

/* The inputs of the oracle, and how long it may work. */
struct questions {
    struct unpacked unpacked;
    struct oracle_work work;
    double deadline; /* clock_ms */
};

/*
 * Has the oracle answer `count` rays of each of the cases, as long as there is time. The answers to the first
 * *ret_answered rays are freed by the caller with oracle_finish, and *ret_answers with memory_free.
 */
static enum bvhd_status ask_oracle(struct questions *questions, const struct ray *rays, uint32_t count,
                                   struct oracle_answer **ret_answers, uint32_t *ret_answered, struct bvhd_error *error)
{
    struct memory *memory = questions->work.memory;
    struct oracle_answer *answers = memory_array(memory, count, sizeof *answers);
    if (!answers)
        return no_memory(error);
    questions->work.meshes = questions->unpacked.meshes;
    questions->work.mesh_count = questions->unpacked.mesh_count;
    double seconds = (questions->deadline - clock_ms()) / 1000;
    enum bvhd_status status = oracle_trace_timed(&questions->work, rays, count, seconds, answers, ret_answered, error);
    if (status == BVHD_OK)
        *ret_answers = answers;
    else
        memory_free(memory, answers);
    return status;
}

/* Makes the ray of a case, and rays beside it that are as far away as rounding may move it. */
static void ask_around(const struct agreement_case *one, struct ray rays[AROUND])
{
    const struct ray *ray = &one->ray;
    struct vector direction =
                      vector_make((double)ray->direction[0], (double)ray->direction[1], (double)ray->direction[2]),
                  side, up;
    double farthest = 0, t = is_miss(&one->device) ? 0 : (double)one->device.t;
    vector_basis(vector_unit(direction), &side, &up);
    for (int axis = 0; axis < 3; axis++) {
        double from = (double)ray->origin[axis], to = from + t * vector_component(direction, axis);
        farthest = fmax(farthest, fmax(fabs(from), fabs(to)));
    }
    for (int i = 0; i < AROUND; i++) {
        double distance = roundings * FLT_EPSILON * farthest;
        rays[i] = *ray;
        for (int axis = 0; axis < 3; axis++)
            rays[i].origin[axis] += (float)(distance * ((i % 3 - 1) * vector_component(side, axis) +
                                                        (i / 3 - 1) * vector_component(up, axis)));
    }
}

static void count_opinion(struct agreement *agreement, enum opinion opinion)
{
    agreement->judged++;
    agreement->uncertain += opinion == OPINION_UNCERTAIN;
    agreement->mismatches += opinion == OPINION_WRONG;
}

/*
 * Finds which of the open cases a driver's rounding explains, because it traces its own structures in float without
 * bounds on its errors. Those become uncertain, the others mismatches. The instances are already where the driver's
 * inverses put them.
 */
static enum bvhd_status ask_again(struct agreement *agreement, struct questions *questions,
                                  const struct agreement_case *cases, uint32_t count, struct bvhd_error *error)
{
    struct ray *rays = memory_array(agreement->memory, (uint64_t)count * AROUND, sizeof *rays);
    struct oracle_answer *answers;
    uint32_t answered;
    if (!rays)
        return no_memory(error);
    for (uint32_t i = 0; i < count; i++)
        ask_around(&cases[i], rays + (uint64_t)i * AROUND);
    enum bvhd_status status = ask_oracle(questions, rays, count * AROUND, &answers, &answered, error);
    memory_free(agreement->memory, rays);
    if (status != BVHD_OK)
        return status;
    for (uint32_t i = 0; i < answered / AROUND; i++) {
        bool is_settled = false;
        for (int k = 0; k < AROUND; k++)
            is_settled |= is_explained(agreement, &answers[(uint64_t)i * AROUND + k], &cases[i]);
        count_opinion(agreement, is_settled ? OPINION_UNCERTAIN : OPINION_WRONG);
    }
    oracle_finish(answers, answered, agreement->memory);
    memory_free(agreement->memory, answers);
    return BVHD_OK;
}

/* Judges cases, of which those that stay open are moved to the front of the list. */
static enum bvhd_status ask(struct agreement *agreement, struct questions *questions, struct agreement_case *cases,
                            uint32_t count, uint32_t *ret_open, struct bvhd_error *error)
{
    struct ray *rays = memory_array(agreement->memory, count, sizeof *rays);
    struct oracle_answer *answers;
    uint32_t answered, open_count = 0;
    if (!rays)
        return no_memory(error);
    for (uint32_t i = 0; i < count; i++)
        rays[i] = cases[i].ray;
    enum bvhd_status status = ask_oracle(questions, rays, count, &answers, &answered, error);
    memory_free(agreement->memory, rays);
    if (status != BVHD_OK)
        return status;
    for (uint32_t i = 0; i < answered; i++) {
        enum opinion opinion = judge_case(agreement, &cases[i], &answers[i]);
        if (opinion == OPINION_OPEN)
            cases[open_count++] = cases[i];
        else
            count_opinion(agreement, opinion);
    }
    oracle_finish(answers, answered, agreement->memory);
    memory_free(agreement->memory, answers);
    *ret_open = open_count;
    return BVHD_OK;
}

static int compare_times(const void *a, const void *b)
{
    float x = ((const struct agreement_case *)a)->ray.time, y = ((const struct agreement_case *)b)->ray.time;
    return (x > y) - (x < y);
}

/* Puts cases of one time next to each other, as the oracle wants them. */
static void sort_by_time(struct agreement_sample *sample)
{
    if (sample->count)
        qsort(sample->cases, sample->count, sizeof *sample->cases, compare_times);
}

/* Judges the disputes and then the other cases, and with the time that is left those that stay open. */
static enum bvhd_status judge(struct agreement *agreement, struct questions *questions, double seconds,
                              struct bvhd_error *error)
{
    struct agreement_sample *samples[] = {&agreement->disputes, &agreement->doubts};
    double start = clock_ms();
    enum bvhd_status status = BVHD_OK;
    uint32_t open_count = 0;
    for (int i = 0; i < 2 && status == BVHD_OK; i++) {
        if (isinf(seconds)) /* all are judged, so that their order need not be random */
            sort_by_time(samples[i]);
        questions->deadline = start + seconds * 1000 * FIRST_SHARE;
        if (samples[i]->count)
            status = ask(agreement, questions, samples[i]->cases, samples[i]->count, &open_count, error);
    }
    questions->deadline = start + seconds * 1000;
    if (open_count)
        unpack_follow_inverses(&questions->unpacked, target_reader_find(agreement->surfaces->structures->target));
    for (uint32_t i = 0; i < open_count && status == BVHD_OK && (i == 0 || clock_ms() < questions->deadline);
         i += BATCH)
        status = ask_again(agreement, questions, agreement->doubts.cases + i,
                           open_count - i < BATCH ? open_count - i : BATCH, error);
    return status;
}

enum bvhd_status agreement_judge(struct agreement *agreement, double seconds,
                                 void (*progress)(void *context, uint64_t done, uint64_t total), void *progress_context,
                                 struct bvhd_error *error)
{
    if (agreement->differing == 0)
        return BVHD_OK;
    struct questions questions = {.work = {.memory = agreement->memory,
                                           .parallel = agreement->parallel,
                                           .progress = progress,
                                           .progress_context = progress_context}};
    enum bvhd_status status =
        unpack_structures(agreement->surfaces->structures, agreement->memory, &questions.unpacked, error);
    if (status == BVHD_OK)
        status = judge(agreement, &questions, seconds, error);
    unpack_finish(&questions.unpacked);
    return status;
}
