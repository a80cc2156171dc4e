/* SPDX-License-Identifier: Apache-2.0 */
/*
 * service_apart.c - measures what the machine itself allows: the work of a batch in processes that share nothing but
 * the machine.
 */
#include <stdlib.h>
#include <sys/wait.h>
#include <unistd.h>

#include "builder/build.h"
#include "builder/content_key.h"
#include "builder/input/prepare.h"
#include "tests/bench/service_bench.h"
#include "client/vulkan_input.h"

/* Does what a worker does for a mesh, on this thread alone. */
static void build_mesh(struct memory *memory, const struct terrain *mesh)
{
    struct build_context context = {.memory = memory, .parallel = &parallel_serial};
    struct build_options options = {.quality = QUALITY_BALANCED, .target = TARGET_PORTABLE};
    struct limits limits = limits_default();
    struct vulkan_input *input;
    struct canonical canonical;
    struct build_stats stats;
    struct bvhd_error error = {0};
    struct key key;
    unsigned char *blob;
    if (vulkan_input_create(&mesh->info, 1, &mesh->ranges, NULL, 0, &options, &input, &error) != BVHD_OK ||
        prepare(vulkan_input_entries(input), 0, &limits, &context, &canonical, &error) != BVHD_OK ||
        content_key(&canonical, &options, &context, &key, &error) != BVHD_OK ||
        build(&canonical, &options, &context, &blob, &stats, &error) != BVHD_OK)
        bench_fail("%s: %s", error.where, error.text);
    memory_free(memory, blob);
    prepare_finish(&canonical, memory);
    vulkan_input_destroy(input);
}

/* Builds every `step`-th mesh, starting with `first`. */
static void build_part(struct memory *memory, const struct terrain *meshes, unsigned count, unsigned first,
                       unsigned step)
{
    for (unsigned i = first; i < count; i += step)
        build_mesh(memory, &meshes[i]);
}

static void pass(int descriptor)
{
    char byte = 0;
    if (write(descriptor, &byte, 1) != 1)
        bench_fail("a pipe is broken");
}

static void await(int descriptor)
{
    char byte;
    if (read(descriptor, &byte, 1) != 1)
        bench_fail("a process has failed");
}

/* Runs as one of the processes. Its first round only warms up caches and heaps. */
static void be_process(const struct terrain *meshes, unsigned count, unsigned index, unsigned processes, int go,
                       int done)
{
    struct memory memory;
    memory_keep();
    memory_init(&memory, UINT64_MAX);
    build_part(&memory, meshes, count, index, processes);
    pass(done);
    await(go);
    build_part(&memory, meshes, count, index, processes);
    pass(done);
    _exit(0);
}

static void each(unsigned processes, int descriptor, void (*what)(int descriptor))
{
    for (unsigned i = 0; i < processes; i++)
        what(descriptor);
}

double bench_apart(const struct terrain *meshes, unsigned count, unsigned processes)
{
    int go[2], done[2];
    pid_t *pids = calloc(processes, sizeof *pids);
    if (!pids || pipe(go) || pipe(done))
        bench_fail("no memory or no pipes");
    for (unsigned i = 0; i < processes; i++) {
        pids[i] = fork();
        if (pids[i] == 0) {
            close(go[1]);
            be_process(meshes, count, i, processes, go[0], done[1]);
        }
        if (pids[i] < 0)
            bench_fail("cannot fork");
    }
    close(done[1]);
    each(processes, done[0], await);
    double begin = bench_now();
    each(processes, go[1], pass);
    each(processes, done[0], await);
    double ms = bench_now() - begin;
    for (unsigned i = 0; i < processes; i++)
        waitpid(pids[i], NULL, 0);
    close(go[0]);
    close(go[1]);
    close(done[0]);
    free(pids);
    return ms;
}
