/* SPDX-License-Identifier: Apache-2.0 */
#include <stdatomic.h>

#include "proto/base/clock.h"
#include "client/bvhctl/trace/tracer.h"

enum { CHUNK = 1024 };

struct tracer_cpu {
    struct tracer tracer;
    const struct structures *structures;
    const struct parallel *parallel;
    struct memory *memory;
};

struct cpu_trace {
    const struct structures *structures;
    const struct ray *rays;
    size_t count;
    struct tracer_hit *hits;
    atomic_bool is_refused;
};

static void trace_chunk(void *context, size_t index)
{
    struct cpu_trace *job = context;
    size_t begin, end;
    parallel_chunk(index, CHUNK, job->count, &begin, &end);
    const struct bvhd_cpu_trace trace = {
        .struct_size = sizeof trace,
        .rays = job->rays + begin,
        .ray_size = sizeof *job->rays,
        .hits = job->hits + begin,
        .hit_size = sizeof *job->hits,
        .ray_count = end - begin,
    };
    if (bvhd_cpu_scene_trace(job->structures->scene, &trace, NULL) != BVHD_OK)
        atomic_store(&job->is_refused, true);
}

static enum bvhd_status trace(struct tracer *tracer, const struct ray *rays, uint64_t count,
                              struct tracer_hit *ret_hits, double *ret_seconds, struct bvhd_error *error)
{
    struct tracer_cpu *cpu = (struct tracer_cpu *)tracer;
    struct cpu_trace job = {.structures = cpu->structures, .rays = rays, .count = count, .hits = ret_hits};
    double start = clock_ms();
    parallel_for(cpu->parallel, parallel_chunks(CHUNK, count), trace_chunk, &job);
    if (ret_seconds)
        *ret_seconds = (clock_ms() - start) / 1e3;
    if (job.is_refused)
        return bvhd_error_set(error, BVHD_INVALID, "rays", "a ray has flags that exclude each other");
    return BVHD_OK;
}

static void destroy(struct tracer *tracer)
{
    struct tracer_cpu *cpu = (struct tracer_cpu *)tracer;
    memory_free(cpu->memory, cpu);
}

enum bvhd_status tracer_cpu_create(const struct structures *structures, const struct parallel *parallel,
                                   struct memory *memory, struct tracer **ret_tracer, struct bvhd_error *error)
{
    struct tracer_cpu *cpu = memory_alloc(memory, sizeof *cpu);
    if (!cpu)
        return bvhd_error_no_memory(error, "cpu", "no memory to trace");
    *cpu = (struct tracer_cpu){.tracer = {"cpu", structures->target, trace, destroy},
                               .structures = structures,
                               .parallel = parallel,
                               .memory = memory};
    *ret_tracer = &cpu->tracer;
    return BVHD_OK;
}
