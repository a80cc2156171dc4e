/* SPDX-License-Identifier: Apache-2.0 */
/* cpu_trace.c - traces the rays of a call, and translates candidates for the program's callback. */
#include <inttypes.h>
#include <math.h>
#include <string.h>

#include "client/cpu/cpu_scene.h"
#include "builder/traverse/traverse_group.h"
#include "client/argument.h"
#include "proto/base/place.h"

/* Rays and hits of a program are those of the traversal, field for field, so that they are copied as bytes. */
#define SAME_PLACE(type, field, inner_type, inner_field)                                                               \
    _Static_assert(offsetof(struct type, field) == offsetof(struct inner_type, inner_field), #field " is elsewhere")
SAME_PLACE(bvhd_cpu_ray, origin, ray, origin);
SAME_PLACE(bvhd_cpu_ray, tmin, ray, tmin);
SAME_PLACE(bvhd_cpu_ray, direction, ray, direction);
SAME_PLACE(bvhd_cpu_ray, tmax, ray, tmax);
SAME_PLACE(bvhd_cpu_ray, flags, ray, flags);
SAME_PLACE(bvhd_cpu_ray, mask, ray, cull_mask);
SAME_PLACE(bvhd_cpu_ray, time, ray, time);
SAME_PLACE(bvhd_cpu_ray, reserved, ray, reserved);
SAME_PLACE(bvhd_cpu_hit, t, ray_hit, t);
SAME_PLACE(bvhd_cpu_hit, u, ray_hit, u);
SAME_PLACE(bvhd_cpu_hit, v, ray_hit, v);
SAME_PLACE(bvhd_cpu_hit, instance, ray_hit, instance);
SAME_PLACE(bvhd_cpu_hit, custom_index, ray_hit, custom_index);
SAME_PLACE(bvhd_cpu_hit, geometry, ray_hit, geometry);
SAME_PLACE(bvhd_cpu_hit, primitive, ray_hit, primitive);
SAME_PLACE(bvhd_cpu_hit, sbt_offset, ray_hit, sbt_offset);
SAME_PLACE(bvhd_cpu_hit, blob, ray_hit, handle);
SAME_PLACE(bvhd_cpu_hit, record, ray_hit, record);
SAME_PLACE(bvhd_cpu_hit, instance_record, ray_hit, instance_record);
_Static_assert(sizeof(struct bvhd_cpu_ray) == sizeof(struct ray), "bvhctl passes arrays of rays");
_Static_assert(sizeof(struct bvhd_cpu_hit) == sizeof(struct ray_hit), "a hit is copied as a whole");
_Static_assert((int)BVHD_CPU_CONFIRM == (int)CANDIDATE_ACCEPT &&
                   (int)BVHD_CPU_TERMINATE == (int)CANDIDATE_IGNORE_AND_END,
               "verdicts have the same bits");

enum {
    SIZE_WITHOUT_TIME = offsetof(struct bvhd_cpu_ray, time),
    FACING_OR_TRIANGLES = RAY_CULL_BACK_FACING | RAY_CULL_FRONT_FACING | RAY_SKIP_TRIANGLES,
    OPACITY = RAY_OPAQUE | RAY_NO_OPAQUE | RAY_CULL_OPAQUE | RAY_CULL_NO_OPAQUE,
    KINDS = RAY_SKIP_TRIANGLES | RAY_SKIP_AABBS,
    KNOWN_FLAGS = FACING_OR_TRIANGLES | OPACITY | KINDS | RAY_TERMINATE_ON_FIRST_HIT,
};

static const struct ray_hit miss = {.t = INFINITY, .instance = RAY_NO_INSTANCE, .handle = RAY_NO_BOTTOM};

/* ---- The arguments of a call ---- */

static enum bvhd_status check_arrays(const struct bvhd_cpu_trace *trace, struct bvhd_error *error)
{
    size_t ray = trace->ray_size, hit = trace->hit_size;
    if (ray != SIZE_WITHOUT_TIME && ray != sizeof(struct bvhd_cpu_ray))
        return bvhd_error_set(error, BVHD_INVALID, "trace.ray_size", "%zu, but a ray has %d or %zu bytes", ray,
                              SIZE_WITHOUT_TIME, sizeof(struct bvhd_cpu_ray));
    if (trace->ray_stride != 0 && trace->ray_stride < ray)
        return bvhd_error_set(error, BVHD_INVALID, "trace.ray_stride", "%zu, which is less than ray_size",
                              trace->ray_stride);
    if (hit == 0 || hit % 4 != 0 || hit > sizeof(struct bvhd_cpu_hit))
        return bvhd_error_set(error, BVHD_INVALID, "trace.hit_size", "%zu, not a multiple of 4 from 4 to %zu", hit,
                              sizeof(struct bvhd_cpu_hit));
    if (trace->hit_stride != 0 && trace->hit_stride < hit)
        return bvhd_error_set(error, BVHD_INVALID, "trace.hit_stride", "%zu, which is less than hit_size",
                              trace->hit_stride);
    if (trace->ray_count > 0 && !trace->rays)
        return bvhd_error_set(error, BVHD_INVALID, "trace.rays", "trace.rays is NULL, but ray_count is %" PRIu64,
                              trace->ray_count);
    if (trace->ray_count > 0 && !trace->hits)
        return bvhd_error_set(error, BVHD_INVALID, "trace.hits", "trace.hits is NULL, but ray_count is %" PRIu64,
                              trace->ray_count);
    return BVHD_OK;
}

static enum bvhd_status check_trace(const struct bvhd_cpu_scene *scene, const struct bvhd_cpu_trace *trace,
                                    struct bvhd_error *error)
{
    if (!scene || !trace)
        return ARGUMENTS_CHECK(error, {scene, "scene"}, {trace, "trace"});
    enum bvhd_status status = BVHD_OK;
    if (trace->struct_size != sizeof *trace) /* seldom, so that most calls of one ray do without a call more */
        status = argument_check_size(trace, sizeof *trace, sizeof *trace, "trace", "bvhd_cpu_trace", error);
    if (status != BVHD_OK)
        return status;
    if (trace->flags & ~(uint32_t)(BVHD_CPU_TRACE_ANY_HIT | BVHD_CPU_TRACE_FLIP_ORDER))
        return bvhd_error_set(error, BVHD_INVALID, "trace.flags", "0x%" PRIx32 " is not known", trace->flags);
    if (trace->reserved != 0)
        return bvhd_error_set(error, BVHD_INVALID, "trace.reserved", "not 0");
    if (trace->counters)
        status = argument_check_size(trace->counters, sizeof *trace->counters, sizeof *trace->counters,
                                     "trace.counters", "bvhd_cpu_counters", error);
    return status == BVHD_OK ? check_arrays(trace, error) : status;
}

/* ---- Rays ---- */

/* Returns whether at most one bit is set. */
static inline bool is_one(uint32_t flags)
{
    return (flags & (flags - 1)) == 0;
}

static inline bool flags_are_sound(uint32_t flags)
{
    if (!(flags & ~(uint32_t)RAY_TERMINATE_ON_FIRST_HIT))
        return true; /* as nearly always */
    return !(flags & ~(uint32_t)KNOWN_FLAGS) && is_one(flags & FACING_OR_TRIANGLES) && is_one(flags & OPACITY) &&
           is_one(flags & KINDS);
}

/* Reads the time of a ray, and returns whether it and what is reserved are sound. Rays without a time have time 0. */
static inline bool read_rest(const unsigned char *from, size_t size, struct ray *ret_ray)
{
    uint32_t reserved;
    ret_ray->time = 0;
    if (size == SIZE_WITHOUT_TIME)
        return true;
    memcpy(&ret_ray->time, from + offsetof(struct bvhd_cpu_ray, time), sizeof ret_ray->time);
    memcpy(&reserved, from + offsetof(struct bvhd_cpu_ray, reserved), sizeof reserved);
    return ret_ray->time >= 0 && ret_ray->time <= 1 && reserved == 0;
}

static enum bvhd_status refuse_ray(uint64_t index, uint32_t flags, const unsigned char *at, struct bvhd_error *error)
{
    struct bvhd_cpu_ray ray;
    if (flags & ~(uint32_t)KNOWN_FLAGS)
        return bvhd_error_set(error, BVHD_INVALID, place("rays[%" PRIu64 "].flags", index).text,
                              "0x%" PRIx32 " has unknown bits", flags);
    if (!flags_are_sound(flags))
        return bvhd_error_set(error, BVHD_INVALID, place("rays[%" PRIu64 "].flags", index).text,
                              "0x%" PRIx32 " has flags that exclude each other", flags);
    memcpy(&ray, at, sizeof ray);
    if (!(ray.time >= 0 && ray.time <= 1))
        return bvhd_error_set(error, BVHD_INVALID, place("rays[%" PRIu64 "].time", index).text, "%g is not in 0 .. 1",
                              (double)ray.time);
    return bvhd_error_set(error, BVHD_INVALID, place("rays[%" PRIu64 "].reserved", index).text, "not 0");
}

/* ---- Candidates ---- */

/* The ray that is being traced, for the callback. */
struct candidate_ray {
    const struct bvhd_cpu_trace *trace;
    const unsigned char *at;
    uint64_t index;
};

/* Inverts a row-major 3x4 matrix by Cramer's rule, in double. */
static void invert(const float matrix[12], float ret_inverse[12])
{
    double cofactors[3][3], determinant = 0;
    for (int row = 0; row < 3; row++)
        for (int column = 0; column < 3; column++) {
            int a = (column + 1) % 3, b = (column + 2) % 3, c = (row + 1) % 3, d = (row + 2) % 3;
            cofactors[row][column] =
                (double)matrix[4 * a + c] * matrix[4 * b + d] - (double)matrix[4 * a + d] * matrix[4 * b + c];
        }
    for (int k = 0; k < 3; k++)
        determinant += matrix[k] * cofactors[k][0];
    for (int row = 0; row < 3; row++) {
        double moved = 0;
        for (int column = 0; column < 3; column++) {
            moved += cofactors[row][column] * matrix[4 * column + 3];
            ret_inverse[4 * row + column] = (float)(cofactors[row][column] / determinant);
        }
        ret_inverse[4 * row + 3] = (float)(-moved / determinant);
    }
}

static enum candidate_verdict ask(void *context, const struct ray *ray, const struct candidate_space *space,
                                  struct ray_hit *hit)
{
    static const float identity[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
    const struct candidate_ray *asking = context;
    struct bvhd_cpu_hit seen;
    struct bvhd_cpu_candidate candidate = {
        .ray = asking->at, .ray_index = asking->index, .hit = &seen, .is_opaque = space->is_opaque};
    (void)ray;
    memcpy(&seen, hit, sizeof seen);
    candidate.tmax = (float)space->tmax;
    for (int axis = 0; axis < 3; axis++) {
        candidate.object_origin[axis] = (float)space->origin[axis];
        candidate.object_direction[axis] = (float)space->direction[axis];
    }
    memcpy(candidate.object_to_world, space->object_to_world ? space->object_to_world : identity, sizeof identity);
    if (space->object_to_world)
        invert(candidate.object_to_world, candidate.world_to_object);
    else
        memcpy(candidate.world_to_object, identity, sizeof identity);
    uint32_t verdict = asking->trace->candidate(asking->trace->context, &candidate);
    hit->t = seen.t;
    return (enum candidate_verdict)(verdict & (BVHD_CPU_CONFIRM | BVHD_CPU_TERMINATE));
}

/* ---- Tracing ---- */

/* The rays of a call, and how far they are traced. */
struct tracing {
    const struct bvhd_cpu_trace *trace;
    const unsigned char *from; /* the next ray */
    unsigned char *to;
    uint64_t index;
    size_t ray_stride, hit_stride;
};

/* Reads a ray. Returns false if it is not sound. */
static inline bool read_ray(const struct bvhd_cpu_trace *trace, const unsigned char *from, struct ray *ret_ray)
{
    memcpy(ret_ray, from, SIZE_WITHOUT_TIME);
    if (!read_rest(from, trace->ray_size, ret_ray) || !flags_are_sound(ret_ray->flags))
        return false;
    ret_ray->flags |= trace->flags & BVHD_CPU_TRACE_ANY_HIT ? RAY_TERMINATE_ON_FIRST_HIT : 0;
    return true;
}

/* Writes as much of a hit as the program wants. Nearly all want all of it, for which the compiler needs no call. */
static inline void write_hit(unsigned char *to, const struct ray_hit *hit, size_t size)
{
    if (size == sizeof *hit)
        memcpy(to, hit, sizeof *hit);
    else
        memcpy(to, hit, size);
}

static inline void advance(struct tracing *tracing, uint32_t count)
{
    tracing->from += count * tracing->ray_stride;
    tracing->to += count * tracing->hit_stride;
    tracing->index += count;
}

/* Traces a ray and writes its hit, or a miss. */
static inline void trace_ray(const struct bvhd_cpu_scene *scene, const struct ray *ray,
                             const struct traverse_options *options, unsigned char *to, size_t hit_size,
                             struct traverse_counters *counters)
{
    struct ray_hit hit;
    bool is_hit = scene->target == &cpu_portable
                      ? traverse(&scene->walk.portable, ray, options, &hit, counters)
                      : lavapipe_traverse(&scene->walk.lavapipe, ray, options, &hit, counters);
    write_hit(to, is_hit ? &hit : &miss, hit_size);
}

/* Traces the next ray. Returns false if it is not sound. `options` is NULL for the default. */
static inline bool trace_one(const struct bvhd_cpu_scene *scene, struct tracing *tracing,
                             const struct traverse_options *options, struct traverse_counters *counters)
{
    struct ray ray;
    if (!read_ray(tracing->trace, tracing->from, &ray))
        return false;
    if (options) {
        struct candidate_ray *asking = options->context;
        asking->at = tracing->from;
        asking->index = tracing->index;
    }
    trace_ray(scene, &ray, options, tracing->to, tracing->trace->hit_size, counters);
    advance(tracing, 1);
    return true;
}

/* Traces the next rays one by one. Returns false if one is not sound; those before it are traced. */
static bool trace_singly(const struct bvhd_cpu_scene *scene, struct tracing *tracing, uint64_t count,
                         const struct traverse_options *options, struct traverse_counters *counters)
{
    while (count > 0 && trace_one(scene, tracing, options, counters))
        count--;
    return count == 0;
}

/* Traces the only ray of a call without options, for which preparing the call would cost as much as the ray. */
static bool trace_single(const struct bvhd_cpu_scene *scene, const struct bvhd_cpu_trace *trace,
                         struct traverse_counters *counters)
{
    struct ray ray;
    if (!read_ray(trace, trace->rays, &ray))
        return false;
    trace_ray(scene, &ray, NULL, trace->hits, trace->hit_size, counters);
    return true;
}

/* Returns where the next hits of a program can be filled in their place, without a copy; else NULL. */
static inline struct ray_hit *hits_in_place(const struct tracing *tracing)
{
    const bool is_array = tracing->hit_stride == sizeof(struct ray_hit) &&
                          tracing->trace->hit_size == sizeof(struct ray_hit) &&
                          (uintptr_t)tracing->to % _Alignof(struct ray_hit) == 0;
    return is_array ? (struct ray_hit *)(void *)tracing->to : NULL;
}

/* Traces the next rays together. Returns false if one is not sound; those before it are traced. */
static bool trace_some(struct tracing *tracing, struct traverse_stream *stream)
{
    struct ray rays[TRAVERSE_GROUP];
    struct ray_hit room[TRAVERSE_GROUP], *in_place = hits_in_place(tracing), *hits = in_place ? in_place : room;
    const uint64_t left = tracing->trace->ray_count - tracing->index;
    uint32_t count = 0, wanted = left < TRAVERSE_GROUP ? (uint32_t)left : TRAVERSE_GROUP;
    while (count < wanted && read_ray(tracing->trace, tracing->from + count * tracing->ray_stride, &rays[count]))
        count++;
    if (count == 0)
        return false;
    const uint64_t is_hit = traverse_group(stream, rays, count, hits);
    for (uint32_t i = 0; i < count; i++)
        if (!(is_hit >> i & 1))
            hits[i] = miss;
    for (uint32_t i = 0; !in_place && i < count; i++)
        write_hit(tracing->to + i * tracing->hit_stride, &hits[i], tracing->trace->hit_size);
    advance(tracing, count);
    return count == wanted;
}

/*
 * Traces all rays. Stops at one that is not sound, and returns its index; else ray_count. It is not inlined, so that
 * calls of one ray do not prepare its frame.
 */
__attribute__((noinline)) static uint64_t trace_all(const struct bvhd_cpu_scene *scene,
                                                    const struct bvhd_cpu_trace *trace,
                                                    struct traverse_counters *counters)
{
    struct tracing tracing = {
        .trace = trace,
        .from = trace->rays,
        .to = trace->hits,
        .ray_stride = trace->ray_stride ? trace->ray_stride : trace->ray_size,
        .hit_stride = trace->hit_stride ? trace->hit_stride : trace->hit_size,
    };
    struct candidate_ray asking = {.trace = trace};
    const struct traverse_options options = {
        .candidate = trace->candidate ? ask : NULL,
        .context = &asking,
        .flip_order = trace->flags & BVHD_CPU_TRACE_FLIP_ORDER,
    };
    const struct traverse_options *given = options.candidate || options.flip_order ? &options : NULL;
    struct traverse_stream stream = {.scene = &scene->walk.portable, .options = given, .counters = counters};
    const bool are_many = trace->ray_count > 1 && scene->target == &cpu_portable && traverse_groups_pay(&stream);
    bool is_sound = true;
    while (is_sound && tracing.index < trace->ray_count) {
        const uint64_t left = trace->ray_count - tracing.index;
        const uint64_t alone = are_many ? traverse_next_alone(&stream, left) : left;
        is_sound = alone > 0 ? trace_singly(scene, &tracing, alone, given, counters) : trace_some(&tracing, &stream);
    }
    return tracing.index;
}

static inline uint64_t trace_rays(const struct bvhd_cpu_scene *scene, const struct bvhd_cpu_trace *trace,
                                  struct traverse_counters *counters)
{
    if (trace->ray_count == 1 && !trace->candidate && !(trace->flags & BVHD_CPU_TRACE_FLIP_ORDER))
        return trace_single(scene, trace, counters);
    return trace_all(scene, trace, counters);
}

/* Refuses the ray at which a call stopped. */
__attribute__((cold)) static enum bvhd_status refuse_next(const struct bvhd_cpu_trace *trace, uint64_t traced,
                                                          struct bvhd_error *error)
{
    const size_t stride = trace->ray_stride ? trace->ray_stride : trace->ray_size;
    const unsigned char *at = (const unsigned char *)trace->rays + traced * stride;
    struct ray ray;
    memcpy(&ray, at, SIZE_WITHOUT_TIME);
    return refuse_ray(traced, ray.flags, at, error);
}

enum bvhd_status bvhd_cpu_scene_trace(const struct bvhd_cpu_scene *scene, const struct bvhd_cpu_trace *trace,
                                      struct bvhd_error *ret_error)
{
    enum bvhd_status status = check_trace(scene, trace, ret_error);
    if (status != BVHD_OK)
        return status;
    struct bvhd_cpu_counters *to = trace->counters;
    struct traverse_counters counters = {0, 0, 0};
    uint64_t traced = trace_rays(scene, trace, to ? &counters : NULL);
    if (to) {
        to->nodes += counters.nodes;
        to->triangles += counters.triangles;
        to->instances += counters.instances;
    }
    return traced == trace->ray_count ? BVHD_OK : refuse_next(trace, traced, ret_error);
}
