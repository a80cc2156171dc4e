/* SPDX-License-Identifier: Apache-2.0 */
#include "proto/base/clock.h"
#include "client/bvhctl/trace/tracer.h"

enum { CHUNK = 256 };

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
};

static void trace_chunk(void *context, size_t index)
{
    const struct cpu_trace *job = context;
    size_t begin, end;
    parallel_chunk(index, CHUNK, job->count, &begin, &end);
    for (size_t i = begin; i < end; i++) {
        struct ray_hit hit;
        bool is_hit = structures_trace(job->structures, &job->rays[i], NULL, &hit);
        job->hits[i] = is_hit ? tracer_hit_of(&hit) : tracer_miss;
    }
}

static enum bvhd_status trace(struct tracer *tracer, const struct ray *rays, uint64_t count,
                              struct tracer_hit *ret_hits, double *ret_seconds, struct bvhd_error *error)
{
    (void)error;
    struct tracer_cpu *cpu = (struct tracer_cpu *)tracer;
    struct cpu_trace job = {cpu->structures, rays, count, ret_hits};
    double start = clock_ms();
    parallel_for(cpu->parallel, parallel_chunks(CHUNK, count), trace_chunk, &job);
    if (ret_seconds)
        *ret_seconds = (clock_ms() - start) / 1e3;
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
