/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/picture/sampler.h"

enum { CHUNK = 256, WAVE_RAYS = 1 + LIGHT_BOUNCES }; /* samples of a task; most rays of a sample in a wave */

/* The numbers of rays that a chunk's samples have in the next wave; after lay_out(), where they begin in it. */
struct sampler_counts {
    uint32_t shadows, ambients;
};

enum bvhd_status sampler_init(struct sampler *sampler, const struct sampler_options *options, struct memory *memory,
                              struct bvhd_error *error)
{
    uint64_t batch = options->batch;
    *sampler = (struct sampler){.options = *options, .memory = memory};
    sampler->samples = memory_array(memory, batch, sizeof *sampler->samples);
    sampler->wave = memory_array(memory, batch * WAVE_RAYS, sizeof *sampler->wave);
    sampler->hits = memory_array(memory, batch * WAVE_RAYS, sizeof *sampler->hits);
    sampler->chunks = memory_array(memory, batch / CHUNK + 1, sizeof *sampler->chunks);
    if (sampler->samples && sampler->wave && sampler->hits && sampler->chunks)
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
    *sampler = (struct sampler){0};
}

static enum bvhd_status trace_wave(struct sampler *sampler, bool is_camera, uint32_t count, struct bvhd_error *error)
{
    const struct sampler_options *options = &sampler->options;
    double seconds = 0;
    if (count == 0)
        return BVHD_OK;
    enum bvhd_status status =
        options->tracer->trace(options->tracer, sampler->wave, count, sampler->hits, &seconds, error);
    if (status == BVHD_OK && options->watch)
        status = options->watch(options->watch_context, is_camera, sampler->wave, sampler->hits, count, error);
    sampler->rays += count;
    sampler->seconds += seconds;
    return status;
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
        *sample =
            (struct light_sample){.direction = sample->direction, .index = sample->index, .random = sample->random};
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
            sampler->wave[at.shadows++] = light_shadow_ray(&sample->shadow);
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
        for (int k = 0; k < LIGHT_BOUNCES; k++)
            if (sampler->samples[i].bounced[k].is_needed)
                sampler->wave[at++] = light_shadow_ray(&sampler->samples[i].bounced[k]);
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
