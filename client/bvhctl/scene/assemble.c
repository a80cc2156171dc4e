/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/scene/assemble_internal.h"

#include <stdlib.h>
#include <string.h>

#include "builder/format/serialized.h"

static enum bvhd_status no_memory(const struct scene_build *job)
{
    return bvhd_error_no_memory(job->error, job->import->name, "no memory to describe the scene");
}

VkAccelerationStructureKHR assemble_handle(uint64_t number)
{
    VkAccelerationStructureKHR handle;
    _Static_assert(sizeof handle == sizeof number, "non-dispatchable handles have 64 bits");
    memcpy(&handle, &number, sizeof handle);
    return handle;
}

static VkAccelerationStructureBuildGeometryInfoKHR describe_build(const struct options *options,
                                                                  VkAccelerationStructureTypeKHR type, bool moves,
                                                                  uint64_t handle, uint32_t geometry_count,
                                                                  const VkAccelerationStructureGeometryKHR *geometries)
{
    return (VkAccelerationStructureBuildGeometryInfoKHR){
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_BUILD_GEOMETRY_INFO_KHR,
        .type = type,
        .flags = options->build_flags | (moves ? VK_BUILD_ACCELERATION_STRUCTURE_MOTION_BIT_NV : 0u),
        .mode = VK_BUILD_ACCELERATION_STRUCTURE_MODE_BUILD_KHR,
        .dstAccelerationStructure = assemble_handle(handle),
        .geometryCount = geometry_count,
        .pGeometries = geometries,
    };
}

static struct bvhd_build make_request(const struct options *options, uint32_t count,
                                      const VkAccelerationStructureBuildGeometryInfoKHR *infos,
                                      const VkAccelerationStructureBuildRangeInfoKHR *const *ranges)
{
    return (struct bvhd_build){
        .struct_size = sizeof(struct bvhd_build),
        .info_count = count,
        .infos = infos,
        .ranges = ranges,
        .quality = (enum bvhd_quality)options->build.quality,
        .target = (enum bvhd_target)options->build.target,
        .layout_flags = options->build.layout_flags,
        .format = options->format,
        .rays_per_primitive = (float)options->rays,
        .deadline_ms = options->deadline_ms,
        .builder = (enum bvhd_builder)options->build.builder,
    };
}

/* The descriptions of all bottom levels. Their geometries are in one array, their ranges in another, and so on. */
struct bottom_arrays {
    VkAccelerationStructureBuildGeometryInfoKHR *infos;
    const VkAccelerationStructureBuildRangeInfoKHR **ranges;
    VkAccelerationStructureGeometryKHR *geometries;
    union assemble_chain *chains; /* one for each geometry */
    VkAccelerationStructureBuildRangeInfoKHR *range_rows;
};

static void bottom_arrays_finish(struct bottom_arrays *arrays, struct memory *memory)
{
    memory_free(memory, arrays->infos);
    memory_free(memory, arrays->ranges);
    memory_free(memory, arrays->geometries);
    memory_free(memory, arrays->chains);
    memory_free(memory, arrays->range_rows);
}

static bool bottom_arrays_init(struct bottom_arrays *arrays, const struct import *import, struct memory *memory)
{
    uint64_t geometry_count = 0;
    for (uint32_t i = 0; i < import->bottom_count; i++)
        geometry_count += import->bottoms[i].mesh_count;
    arrays->infos = memory_array(memory, import->bottom_count, sizeof *arrays->infos);
    arrays->ranges = memory_array(memory, import->bottom_count, sizeof *arrays->ranges);
    arrays->geometries = memory_array(memory, geometry_count, sizeof *arrays->geometries);
    arrays->chains = memory_array(memory, geometry_count, sizeof *arrays->chains);
    arrays->range_rows = memory_array(memory, geometry_count, sizeof *arrays->range_rows);
    return arrays->infos && arrays->ranges && arrays->geometries && arrays->chains && arrays->range_rows;
}

static void describe_bottoms(const struct scene_build *job, struct bottom_arrays *arrays)
{
    VkAccelerationStructureGeometryKHR *geometries = arrays->geometries;
    union assemble_chain *chains = arrays->chains;
    VkAccelerationStructureBuildRangeInfoKHR *ranges = arrays->range_rows;
    for (uint32_t i = 0; i < job->import->bottom_count; i++) {
        const struct import_bottom *bottom = &job->import->bottoms[i];
        bool moves = false;
        for (uint32_t k = 0; k < bottom->mesh_count; k++) {
            const struct import_mesh *mesh = &job->import->meshes[bottom->meshes[k]];
            moves |= mesh->end_positions != NULL;
            geometries[k] = assemble_describe_mesh(mesh, job->options->geometry_flags, &chains[k]);
            ranges[k] = (VkAccelerationStructureBuildRangeInfoKHR){.primitiveCount = mesh->primitive_count};
        }
        arrays->infos[i] = describe_build(job->options, VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR, moves,
                                          UINT64_C(1) + i, bottom->mesh_count, geometries);
        arrays->ranges[i] = ranges;
        geometries += bottom->mesh_count;
        chains += bottom->mesh_count;
        ranges += bottom->mesh_count;
    }
}

static enum bvhd_status build_bottoms(const struct scene_build *job, struct assembly *assembly)
{
    struct bottom_arrays arrays = {0};
    enum bvhd_status status = BVHD_OK;
    if (!bottom_arrays_init(&arrays, job->import, job->import->memory)) {
        status = no_memory(job);
    } else {
        describe_bottoms(job, &arrays);
        struct bvhd_build request = make_request(job->options, job->import->bottom_count, arrays.infos, arrays.ranges);
        const struct assembly_request bottoms = {.build = &request,
                                                 .infos = arrays.infos,
                                                 .sources = job->sources ? job->sources->items : NULL,
                                                 .items = assembly->items,
                                                 .outcomes = assembly->outcomes,
                                                 .holds = assembly->results.holds};
        status = assemble_run(job, &bottoms);
    }
    bottom_arrays_finish(&arrays, job->import->memory);
    return status;
}

struct keyed_bottom {
    const struct bvhd_key *key;
    uint32_t bottom;
};

static int compare_bottoms(const void *a, const void *b)
{
    const struct keyed_bottom *x = a, *y = b;
    int order = memcmp(x->key, y->key, sizeof *x->key);
    return order ? order : (x->bottom > y->bottom) - (x->bottom < y->bottom);
}

/*
 * Sets ret_shared[i] to the first bottom level with the same content as bottom level i, so that one structure is loaded
 * for all equal meshes of a scene.
 */
static enum bvhd_status share_equal_bottoms(const struct scene_build *job, const struct assembly *assembly,
                                            uint32_t *ret_shared)
{
    uint32_t count = job->import->bottom_count, built = 0;
    struct keyed_bottom *bottoms = memory_array(job->import->memory, count, sizeof *bottoms);
    if (!bottoms)
        return no_memory(job);
    for (uint32_t i = 0; i < count; i++) {
        ret_shared[i] = i;
        if (assembly->items[i].error.status == BVHD_OK)
            bottoms[built++] = (struct keyed_bottom){&assembly->items[i].key, i};
    }
    qsort(bottoms, built, sizeof *bottoms, compare_bottoms);
    for (uint32_t i = 1; i < built; i++)
        if (!memcmp(bottoms[i].key, bottoms[i - 1].key, sizeof *bottoms[i].key))
            ret_shared[bottoms[i].bottom] = ret_shared[bottoms[i - 1].bottom];
    memory_free(job->import->memory, bottoms);
    return BVHD_OK;
}

/* Collects the structures that the top level names, each once, in the order in which its instances first name them. */
static enum bvhd_status collect_references(const struct scene_build *job, struct assembly *assembly,
                                           const uint32_t *shared, struct bvhd_reference *references, bool *seen,
                                           struct bvhd_error *ret_failure)
{
    const struct import *import = job->import;
    memset(seen, 0, import->bottom_count * sizeof *seen);
    for (uint32_t i = 0; i < import->instance_count; i++) {
        if (import->instances[i].skipped || seen[shared[import->instances[i].bottom]])
            continue;
        uint32_t bottom = shared[import->instances[i].bottom];
        const struct bvhd_result *item = &assembly->items[bottom];
        if (item->error.status != BVHD_OK)
            return bvhd_error_set(ret_failure, item->error.status, import->name,
                                  "bottom level %u, which it needs, was not built", bottom);
        seen[bottom] = true;
        assembly->handles[assembly->handle_count] = bottom;
        struct bvhd_reference *reference = &references[assembly->handle_count++];
        *reference = (struct bvhd_reference){
            .handle = UINT64_C(1) + bottom, .has_key = 1, .key = item->key, .moves = item->moves};
        memcpy(reference->bounds, item->bounds, sizeof reference->bounds);
        memcpy(reference->slabs, item->slabs, sizeof reference->slabs);
    }
    return BVHD_OK;
}

/*
 * Converts the blob's handles to bottom levels of the import. Returns false when a handle is not one of this request.
 */
static bool bottoms_of_handles(struct bytes blob, uint64_t count, const struct assembly *assembly,
                               uint32_t *ret_bottoms)
{
    for (uint64_t i = 0; i < count; i++) {
        uint64_t row = bytes_get64(blob.data + SERIALIZED_HANDLES + 8 * i) - 1; /* a handle is its row + 1 */
        if (row >= assembly->handle_count)
            return false;
        ret_bottoms[i] = assembly->handles[row];
    }
    return true;
}

/* Reads the handles of the built top level: some targets have one for each bottom level, others for each instance. */
static enum bvhd_status read_handles(const struct scene_build *job, struct assembly *assembly)
{
    struct memory *memory = job->import->memory;
    struct bvhd_result *top = &assembly->items[job->import->bottom_count];
    struct bytes blob = {top->data, top->size};
    struct serialized_header header;
    if (serialized_read(blob, &header, &top->error) != BVHD_OK)
        return BVHD_OK; /* this structure alone has failed, and top->error says so */
    uint32_t *bottoms = memory_array(memory, header.handle_count + 1, sizeof *bottoms);
    if (!bottoms)
        return no_memory(job);
    if (header.handle_count > UINT32_MAX || !bottoms_of_handles(blob, header.handle_count, assembly, bottoms)) {
        memory_free(memory, bottoms);
        bvhd_error_set(&top->error, BVHD_CORRUPT, "handles", "they name structures that were not requested");
        return BVHD_OK;
    }
    assembly->rows = assembly->handles;
    assembly->row_count = assembly->handle_count;
    assembly->handles = bottoms;
    assembly->handle_count = (uint32_t)header.handle_count;
    return BVHD_OK;
}

/* The records of a top level: motion instances, if anything in the scene moves. */
struct top_records {
    bool move;
    void *data; /* VkAccelerationStructureInstanceKHR or struct assemble_motion_record, one for each instance */
};

static bool top_records_init(struct top_records *records, const struct import *import)
{
    records->move = import->motion_count || import->moving_meshes;
    records->data = memory_array(import->memory, import->instance_count,
                                 records->move ? sizeof(struct assemble_motion_record)
                                               : sizeof(VkAccelerationStructureInstanceKHR));
    return records->data != NULL;
}

static void describe_instances(const struct import *import, const uint32_t *shared, const struct top_records *records)
{
    VkAccelerationStructureInstanceKHR *still = records->data;
    struct assemble_motion_record *moving = records->data;
    for (uint32_t i = 0; i < import->instance_count; i++) {
        uint64_t handle = UINT64_C(1) + shared[import->instances[i].bottom];
        if (records->move)
            moving[i] = assemble_describe_motion(import, i, handle);
        else
            still[i] = assemble_describe_instance(import, i, handle);
    }
}

static enum bvhd_status build_described_top(const struct scene_build *job, struct assembly *assembly,
                                            const struct top_records *records, const struct bvhd_reference *references)
{
    const struct import *import = job->import;
    VkAccelerationStructureGeometryKHR geometry = {
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_KHR,
        .geometryType = VK_GEOMETRY_TYPE_INSTANCES_KHR,
        .geometry.instances = {.sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_INSTANCES_DATA_KHR,
                               .data.hostAddress = records->data},
    };
    VkAccelerationStructureBuildGeometryInfoKHR info =
        describe_build(job->options, VK_ACCELERATION_STRUCTURE_TYPE_TOP_LEVEL_KHR, records->move,
                       UINT64_C(1) + import->bottom_count, 1, &geometry);
    VkAccelerationStructureBuildRangeInfoKHR range = {.primitiveCount = import->instance_count};
    const VkAccelerationStructureBuildRangeInfoKHR *ranges = &range;
    struct bvhd_build request = make_request(job->options, 1, &info, &ranges);
    request.references = references;
    request.reference_count = assembly->handle_count;
    const struct assembly_request top = {.build = &request,
                                         .infos = &info,
                                         .sources = job->sources ? &job->sources->items[import->bottom_count] : NULL,
                                         .items = &assembly->items[import->bottom_count],
                                         .outcomes = &assembly->outcomes[import->bottom_count],
                                         .holds = assembly->results.holds + 2};
    return assemble_run(job, &top);
}

static enum bvhd_status build_top(const struct scene_build *job, struct assembly *assembly)
{
    const struct import *import = job->import;
    struct memory *memory = import->memory;
    struct bvhd_error *failure = &assembly->items[import->bottom_count].error;
    struct top_records records;
    bool has_records = top_records_init(&records, import);
    struct bvhd_reference *references = memory_array(memory, import->bottom_count, sizeof *references);
    bool *seen = memory_array(memory, import->bottom_count, sizeof *seen);
    uint32_t *shared = memory_array(memory, import->bottom_count, sizeof *shared);
    enum bvhd_status status =
        has_records && references && seen && shared ? share_equal_bottoms(job, assembly, shared) : no_memory(job);
    if (status == BVHD_OK && collect_references(job, assembly, shared, references, seen, failure) == BVHD_OK)
        describe_instances(import, shared, &records);
    if (status == BVHD_OK && failure->status == BVHD_OK)
        status = build_described_top(job, assembly, &records, references);
    if (status == BVHD_OK && failure->status == BVHD_OK)
        status = read_handles(job, assembly);
    memory_free(memory, shared);
    memory_free(memory, seen);
    memory_free(memory, references);
    memory_free(memory, records.data);
    return status;
}

enum bvhd_status assemble_update(const struct import *import, const struct options *options,
                                 const struct assembly_sources *sources, struct backend *backend,
                                 struct assembly *ret_assembly, struct bvhd_error *error)
{
    struct scene_build job = {import, options, sources, backend, error};
    struct assembly assembly = {.import = import, .results = {.backend = backend}, .is_update = sources != NULL};
    uint64_t count = (uint64_t)import->bottom_count + 1;
    assembly.items = memory_array(import->memory, count, sizeof *assembly.items);
    assembly.outcomes = memory_array(import->memory, count, sizeof *assembly.outcomes);
    assembly.handles = memory_array(import->memory, count, sizeof *assembly.handles);
    enum bvhd_status status = BVHD_OK;
    if (assembly.items)
        memset(assembly.items, 0, count * sizeof *assembly.items);
    if (assembly.outcomes)
        memset(assembly.outcomes, 0, count * sizeof *assembly.outcomes);
    if (!assembly.items || !assembly.outcomes || !assembly.handles)
        status = no_memory(&job);
    if (status == BVHD_OK)
        status = build_bottoms(&job, &assembly);
    if (status == BVHD_OK)
        status = build_top(&job, &assembly);
    if (status != BVHD_OK)
        assembly_finish(&assembly);
    else
        *ret_assembly = assembly;
    return status;
}

enum bvhd_status assemble(const struct import *import, const struct options *options, struct backend *backend,
                          struct assembly *ret_assembly, struct bvhd_error *error)
{
    return assemble_update(import, options, NULL, backend, ret_assembly, error);
}

struct assembly_holds assembly_take(struct assembly *assembly)
{
    struct assembly_holds results = assembly->results;
    assembly->results = (struct assembly_holds){.backend = NULL};
    return results;
}

void assembly_release(struct assembly_holds *results)
{
    for (size_t i = sizeof results->holds / sizeof *results->holds; results->backend && i-- > 0;)
        results->backend->release(results->backend, results->holds[i]);
    *results = (struct assembly_holds){.backend = NULL};
}

void assembly_finish(struct assembly *assembly)
{
    if (!assembly || !assembly->import)
        return;
    assembly_release(&assembly->results);
    memory_free(assembly->import->memory, assembly->items);
    memory_free(assembly->import->memory, assembly->outcomes);
    memory_free(assembly->import->memory, assembly->handles);
    memory_free(assembly->import->memory, assembly->rows);
    *assembly = (struct assembly){0};
}
