/* SPDX-License-Identifier: Apache-2.0 */
/* assemble_run.c - runs the requests of an assembly: updates, and the builds that are needed after all. */
#include <string.h>

#include "builder/update/decay.h"
#include "client/bvhctl/scene/assemble_internal.h"

/* The handles of sources are numbered from here: those of the scene's structures are smaller. */
static const uint64_t first_source = UINT64_C(1) << 32;

static enum bvhd_status no_memory(const struct scene_build *job)
{
    return bvhd_error_no_memory(job->error, job->import->name, "no memory to describe the scene");
}

/* Makes updates of the infos that have a source, which become references with a key. */
static void name_sources(const struct assembly_request *request, struct bvhd_build *build,
                         struct bvhd_reference *references)
{
    if (build->reference_count)
        memcpy(references, build->references, build->reference_count * sizeof *references);
    for (uint32_t i = 0; i < build->info_count; i++) {
        if (!request->sources[i].has_key)
            continue;
        request->infos[i].mode = VK_BUILD_ACCELERATION_STRUCTURE_MODE_UPDATE_KHR;
        request->infos[i].srcAccelerationStructure = assemble_handle(first_source + i);
        references[build->reference_count++] =
            (struct bvhd_reference){.handle = first_source + i, .has_key = 1, .key = request->sources[i].key};
    }
    build->references = references;
}

static enum bvhd_status run_updates(const struct scene_build *job, const struct assembly_request *request)
{
    struct bvhd_build build = *request->build;
    uint64_t room = (uint64_t)build.reference_count + build.info_count + 1;
    struct bvhd_reference *references = memory_array(job->import->memory, room, sizeof *references);
    if (!references)
        return no_memory(job);
    name_sources(request, &build, references);
    enum bvhd_status status = job->backend->build(job->backend, &build, request->items, &request->holds[0], job->error);
    memory_free(job->import->memory, references);
    return status;
}

static bool has_decayed(const struct assembly_sources *sources, const struct bvhd_result *item)
{
    const double most = sources->most_decay > 0 ? sources->most_decay
                                                : decay_to_rebuild((enum build_quality)item->quality, sources->rays);
    return item->decay > most;
}

/* Says what came of an item that was to be updated. */
static enum assembly_method judge(const struct scene_build *job, const struct bvhd_result *item)
{
    const struct bvhd_error *error = &item->error;
    if (error->status == BVHD_SOURCE_LOST)
        return ASSEMBLY_LOST;
    if (error->status == BVHD_INVALID && (error->vuid == BVHD_VUID_03663 || error->vuid == BVHD_VUID_03664))
        return ASSEMBLY_OTHER_ACTIVE;
    bool is_decayed = error->status == BVHD_OK && has_decayed(job->sources, item);
    return is_decayed ? ASSEMBLY_DECAYED : ASSEMBLY_UPDATED;
}

/* Collects the items that have to be built after all. Returns how many there are. */
static uint32_t judge_all(const struct scene_build *job, const struct assembly_request *request, uint32_t *ret_rebuilt)
{
    uint32_t count = 0;
    for (uint32_t i = 0; i < request->build->info_count; i++) {
        if (!request->sources[i].has_key)
            continue;
        request->outcomes[i] =
            (struct assembly_outcome){.method = judge(job, &request->items[i]), .decay = request->items[i].decay};
        if (request->outcomes[i].method != ASSEMBLY_UPDATED)
            ret_rebuilt[count++] = i;
    }
    return count;
}

/* Builds the listed items. The arrays have room for all. */
static enum bvhd_status rebuild(const struct scene_build *job, const struct assembly_request *request,
                                const uint32_t *rebuilt, uint32_t count, struct bvhd_result *results,
                                VkAccelerationStructureBuildGeometryInfoKHR *infos,
                                const VkAccelerationStructureBuildRangeInfoKHR **ranges)
{
    struct bvhd_build build = *request->build;
    for (uint32_t i = 0; i < count; i++) {
        infos[i] = request->infos[rebuilt[i]];
        infos[i].mode = VK_BUILD_ACCELERATION_STRUCTURE_MODE_BUILD_KHR;
        infos[i].srcAccelerationStructure = VK_NULL_HANDLE;
        ranges[i] = build.ranges[rebuilt[i]];
    }
    build.info_count = count;
    build.infos = infos;
    build.ranges = ranges;
    enum bvhd_status status = job->backend->build(job->backend, &build, results, &request->holds[1], job->error);
    for (uint32_t i = 0; i < count && status == BVHD_OK; i++)
        request->items[rebuilt[i]] = results[i];
    return status;
}

static enum bvhd_status rebuild_some(const struct scene_build *job, const struct assembly_request *request)
{
    struct memory *memory = job->import->memory;
    uint32_t room = request->build->info_count;
    uint32_t *rebuilt = memory_array(memory, room, sizeof *rebuilt);
    struct bvhd_result *results = memory_array(memory, room, sizeof *results);
    VkAccelerationStructureBuildGeometryInfoKHR *infos = memory_array(memory, room, sizeof *infos);
    const VkAccelerationStructureBuildRangeInfoKHR **ranges = memory_array(memory, room, sizeof *ranges);
    enum bvhd_status status = rebuilt && results && infos && ranges ? BVHD_OK : no_memory(job);
    uint32_t count = status == BVHD_OK ? judge_all(job, request, rebuilt) : 0;
    if (count)
        status = rebuild(job, request, rebuilt, count, results, infos, ranges);
    memory_free(memory, rebuilt);
    memory_free(memory, results);
    memory_free(memory, infos);
    memory_free(memory, ranges);
    return status;
}

enum bvhd_status assemble_run(const struct scene_build *job, const struct assembly_request *request)
{
    if (!request->sources)
        return job->backend->build(job->backend, request->build, request->items, &request->holds[0], job->error);
    enum bvhd_status status = run_updates(job, request);
    return status == BVHD_OK ? rebuild_some(job, request) : status;
}
