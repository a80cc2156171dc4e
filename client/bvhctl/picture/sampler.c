/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/picture/sampler.h"

#include <math.h>

enum { CHUNK = 256, WAVE_RAYS = 1 + LIGHT_BOUNCES }; /* samples of a task; most rays of a sample in a wave */

/* The numbers of rays that a chunk's samples have in the next wave; after lay_out(), where they begin in it. */
struct sampler_counts {
    uint32_t shadows, ambients;
};

/* A ray that went through a hole: its number in the wave. */
struct sampler_hole {
    uint32_t ray;
};

static bool make_room_for_holes(struct sampler *sampler, uint64_t rays)
{
    sampler->holes = memory_array(sampler->memory, rays, sizeof *sampler->holes);
    sampler->further = memory_array(sampler->memory, rays, sizeof *sampler->further);
    sampler->further_hits = memory_array(sampler->memory, rays, sizeof *sampler->further_hits);
    sampler->is_hole = memory_array(sampler->memory, rays, sizeof *sampler->is_hole);
    return sampler->holes && sampler->further && sampler->further_hits && sampler->is_hole;
}

enum bvhd_status sampler_init(struct sampler *sampler, const struct sampler_options *options, struct memory *memory,
                              struct bvhd_error *error)
{
    uint64_t batch = options->batch;
    *sampler = (struct sampler){.options = *options, .memory = memory};
    sampler->samples = memory_array(memory, batch, sizeof *sampler->samples);
    sampler->wave = memory_array(memory, batch * WAVE_RAYS, sizeof *sampler->wave);
    sampler->hits = memory_array(memory, batch * WAVE_RAYS, sizeof *sampler->hits);
    sampler->chunks = memory_array(memory, batch / CHUNK + 1, sizeof *sampler->chunks);
    bool ok = sampler->samples && sampler->wave && sampler->hits && sampler->chunks;
    if (ok && light_has_holes(options->light))
        ok = make_room_for_holes(sampler, batch * WAVE_RAYS);
    if (ok)
        return BVHD_OK;
    sampler_finish(sampler);
    return bvhd_error_no_memory(error, "trace", "no memory for %u samples at once", options->batch);
}

void sampler_finish(struct sampler *sampler)
{
    if (!sampler || !sampler->memory)
        return;
    memory_free(sampler->memory, sampler->samples);
    memory_free(sampler->memory, sampler->wave);
    memory_free(sampler->memory, sampler->hits);
    memory_free(sampler->memory, sampler->chunks);
    memory_free(sampler->memory, sampler->holes);
    memory_free(sampler->memory, sampler->further);
    memory_free(sampler->memory, sampler->further_hits);
    memory_free(sampler->memory, sampler->is_hole);
    *sampler = (struct sampler){0};
}

/* Traces rays, counts them and shows them to the watch. */
static enum bvhd_status trace_rays(struct sampler *sampler, bool is_camera, const struct ray *rays, uint32_t count,
                                   struct tracer_hit *ret_hits, struct bvhd_error *error)
{
    const struct sampler_options *options = &sampler->options;
    double seconds = 0;
    enum bvhd_status status = options->tracer->trace(options->tracer, rays, count, ret_hits, &seconds, error);
    if (status == BVHD_OK && options->watch)
        status = options->watch(options->watch_context, is_camera, rays, ret_hits, count, error);
    sampler->rays += count;
    sampler->seconds += seconds;
    return status;
}

/* ---- holes in surfaces ---- */

/* Hits of which it has to be found out whether they are in holes. */
struct hole_search {
    const struct sampler *sampler;
    const struct ray *rays;
    const struct tracer_hit *hits;
    uint32_t count;
    bool is_camera;
};

static void find_holes(void *context, size_t index)
{
    const struct hole_search *search = context;
    const struct light *light = search->sampler->options.light;
    size_t first, end;
    parallel_chunk(index, CHUNK, search->count, &first, &end);
    for (size_t i = first; i < end; i++)
        search->sampler->is_hole[i] =
            isfinite(search->hits[i].t) && light_is_hole(light, search->is_camera, &search->rays[i], &search->hits[i]);
}

/* Returns the ray from behind its hit, which keeps its origin so that distances stay what they are. */
static struct ray behind(const struct ray *ray, float t)
{
    static const float step = 1e-5f; /* in the distance: more than the rounding errors of devices */
    struct ray further = *ray;
    further.tmin = fmaxf(nextafterf(t, INFINITY), t * (1 + step));
    return further;
}

/* Traces the rays on that went through holes, until they meet a surface or nothing. */
static enum bvhd_status go_through_holes(struct sampler *sampler, bool is_camera, uint32_t count,
                                         struct bvhd_error *error)
{
    enum { MOST_HOLES = 64 }; /* on one ray; the last of more than these counts as a surface */
    struct hole_search search = {sampler, sampler->wave, sampler->hits, count, is_camera};
    for (int pass = 0; pass < MOST_HOLES; pass++) {
        uint32_t holes = 0;
        parallel_for(sampler->options.parallel, parallel_chunks(CHUNK, search.count), find_holes, &search);
        for (uint32_t i = 0; i < search.count; i++)
            if (sampler->is_hole[i]) {
                uint32_t ray = pass ? sampler->holes[i].ray : i;
                sampler->holes[holes] = (struct sampler_hole){ray};
                sampler->further[holes++] = behind(&sampler->wave[ray], sampler->hits[ray].t);
            }
        if (holes == 0)
            return BVHD_OK;
        search = (struct hole_search){sampler, sampler->further, sampler->further_hits, holes, is_camera};
        enum bvhd_status status = trace_rays(sampler, is_camera, sampler->further, holes, sampler->further_hits, error);
        if (status != BVHD_OK)
            return status;
        for (uint32_t i = 0; i < holes; i++)
            sampler->hits[sampler->holes[i].ray] = sampler->further_hits[i];
    }
    return BVHD_OK;
}

static enum bvhd_status trace_wave(struct sampler *sampler, bool is_camera, uint32_t count, struct bvhd_error *error)
{
    if (count == 0)
        return BVHD_OK;
    enum bvhd_status status = trace_rays(sampler, is_camera, sampler->wave, count, sampler->hits, error);
    return status == BVHD_OK && sampler->holes ? go_through_holes(sampler, is_camera, count, error) : status;
}

static uint32_t chunk_count(const struct sampler *sampler)
{
    return (uint32_t)parallel_chunks(CHUNK, sampler->count);
}

static void in_chunks(struct sampler *sampler, parallel_task task)
{
    parallel_for(sampler->options.parallel, chunk_count(sampler), task, sampler);
}

/*
 * Converts the chunks' numbers of rays to positions in the wave: the shadow rays of all chunks come first, then the
 * ambient rays. Returns the number of rays in the wave.
 */
static uint32_t lay_out(struct sampler *sampler)
{
    uint32_t shadows = 0, ambients = 0;
    for (uint32_t i = 0; i < chunk_count(sampler); i++) {
        struct sampler_counts counts = sampler->chunks[i];
        sampler->chunks[i] = (struct sampler_counts){shadows, ambients};
        shadows += counts.shadows;
        ambients += counts.ambients;
    }
    for (uint32_t i = 0; i < chunk_count(sampler); i++)
        sampler->chunks[i].ambients += shadows;
    return shadows + ambients;
}

/* ---- the steps of each sample between waves ---- */

static void begin(void *context, size_t index)
{
    const struct sampler *sampler = context;
    size_t first, end;
    parallel_chunk(index, CHUNK, sampler->count, &first, &end);
    for (size_t i = first; i < end; i++) {
        struct light_sample *sample = &sampler->samples[i];
        *sample = (struct light_sample){
            .direction = sample->direction, .index = sample->index, .random = sample->random, .time = sample->time};
        sampler->wave[i] = light_begin(sampler->options.light, sample);
    }
}

static void meet(void *context, size_t index)
{
    const struct sampler *sampler = context;
    struct sampler_counts counts = {0};
    size_t first, end;
    parallel_chunk(index, CHUNK, sampler->count, &first, &end);
    for (size_t i = first; i < end; i++) {
        struct light_sample *sample = &sampler->samples[i];
        light_meet(sampler->options.light, &sampler->wave[i], &sampler->hits[i], sample);
        counts.shadows += sample->shadow.is_needed;
        counts.ambients += sample->is_surface ? LIGHT_BOUNCES : 0;
    }
    sampler->chunks[index] = counts;
}

static void look_around(void *context, size_t index)
{
    const struct sampler *sampler = context;
    struct sampler_counts at = sampler->chunks[index];
    size_t first, end;
    parallel_chunk(index, CHUNK, sampler->count, &first, &end);
    for (size_t i = first; i < end; i++) {
        struct light_sample *sample = &sampler->samples[i];
        if (sample->shadow.is_needed)
            sampler->wave[at.shadows++] = light_shadow_ray(sampler->options.light, &sample->shadow, sample->time);
        if (!sample->is_surface)
            continue;
        light_ambient_rays(sample, &sampler->wave[at.ambients]);
        at.ambients += LIGHT_BOUNCES;
    }
}

static bool is_lit(const struct sampler *sampler, uint32_t ray)
{
    return isinf(sampler->hits[ray].t);
}

static void reflect(void *context, size_t index)
{
    const struct sampler *sampler = context;
    struct sampler_counts at = sampler->chunks[index], counts = {0};
    size_t first, end;
    parallel_chunk(index, CHUNK, sampler->count, &first, &end);
    for (size_t i = first; i < end; i++) {
        struct light_sample *sample = &sampler->samples[i];
        if (sample->shadow.is_needed && is_lit(sampler, at.shadows++))
            sample->direct = sample->shadow.gain;
        if (!sample->is_surface)
            continue;
        light_reflect(sampler->options.light, &sampler->wave[at.ambients], &sampler->hits[at.ambients], sample);
        at.ambients += LIGHT_BOUNCES;
        for (int k = 0; k < LIGHT_BOUNCES; k++)
            counts.shadows += sample->bounced[k].is_needed;
    }
    sampler->chunks[index] = counts;
}

static void look_at_sun(void *context, size_t index)
{
    const struct sampler *sampler = context;
    uint32_t at = sampler->chunks[index].shadows;
    size_t first, end;
    parallel_chunk(index, CHUNK, sampler->count, &first, &end);
    for (size_t i = first; i < end; i++)
        for (int k = 0; k < LIGHT_BOUNCES; k++) {
            const struct light_sample *sample = &sampler->samples[i];
            if (sample->bounced[k].is_needed)
                sampler->wave[at++] = light_shadow_ray(sampler->options.light, &sample->bounced[k], sample->time);
        }
}

static void settle(void *context, size_t index)
{
    const struct sampler *sampler = context;
    uint32_t at = sampler->chunks[index].shadows;
    size_t first, end;
    parallel_chunk(index, CHUNK, sampler->count, &first, &end);
    for (size_t i = first; i < end; i++) {
        struct light_sample *sample = &sampler->samples[i];
        for (int k = 0; k < LIGHT_BOUNCES; k++)
            if (sample->bounced[k].is_needed && is_lit(sampler, at++))
                sample->ambient = vector_add(sample->ambient, sample->bounced[k].gain);
    }
}

enum bvhd_status sampler_take(struct sampler *sampler, uint32_t count, struct bvhd_error *error)
{
    sampler->count = count;
    in_chunks(sampler, begin);
    enum bvhd_status status = trace_wave(sampler, true, count, error);
    if (status != BVHD_OK)
        return status;
    in_chunks(sampler, meet);
    uint32_t rays = lay_out(sampler);
    in_chunks(sampler, look_around);
    status = trace_wave(sampler, false, rays, error);
    if (status != BVHD_OK)
        return status;
    in_chunks(sampler, reflect);
    rays = lay_out(sampler);
    in_chunks(sampler, look_at_sun);
    status = trace_wave(sampler, false, rays, error);
    if (status != BVHD_OK)
        return status;
    in_chunks(sampler, settle);
    return BVHD_OK;
}
