/* SPDX-License-Identifier: Apache-2.0 */
#include "assemble.h"

#include <stdlib.h>
#include <string.h>

#include "vulkan_input.h"

/* What both batches share while they are described and built. */
struct job {
    const struct import *import;
    const struct options *options;
    const struct build_context *context;
    struct bvhd_error *error;
};

static enum bvhd_status no_memory(const struct job *job)
{
    return bvhd_error_set(job->error, BVHD_NO_MEMORY, job->import->name, "no memory to describe the scene");
}

/* In process a handle only has to differ from the others: part + 1; one more for the top level. */
static VkAccelerationStructureKHR make_handle(uint64_t number)
{
    VkAccelerationStructureKHR handle;
    _Static_assert(sizeof handle == sizeof number, "non-dispatchable handles have 64 bits");
    memcpy(&handle, &number, sizeof handle);
    return handle;
}

static uint32_t max_vertex(const struct import_mesh *mesh)
{
    return mesh->vertex_count ? mesh->vertex_count - 1 : 0;
}

static VkAccelerationStructureGeometryKHR describe_mesh(const struct import_mesh *mesh, uint32_t geometry_flags)
{
    return (VkAccelerationStructureGeometryKHR){
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_KHR,
        .geometryType = VK_GEOMETRY_TYPE_TRIANGLES_KHR,
        .geometry.triangles = {.sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_TRIANGLES_DATA_KHR,
                               .vertexFormat = VK_FORMAT_R32G32B32_SFLOAT,
                               .vertexData.hostAddress = mesh->positions,
                               .vertexStride = 3 * sizeof(float),
                               .maxVertex = max_vertex(mesh),
                               .indexType = VK_INDEX_TYPE_UINT32,
                               .indexData.hostAddress = mesh->indices},
        .flags = geometry_flags,
    };
}

static VkAccelerationStructureBuildGeometryInfoKHR describe_build(const struct options *options, VkAccelerationStructureTypeKHR type,
                                                                  uint64_t handle, uint32_t geometry_count,
                                                                  const VkAccelerationStructureGeometryKHR *geometries)
{
    return (VkAccelerationStructureBuildGeometryInfoKHR){
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_BUILD_GEOMETRY_INFO_KHR,
        .type = type,
        .flags = options->build_flags,
        .mode = VK_BUILD_ACCELERATION_STRUCTURE_MODE_BUILD_KHR,
        .dstAccelerationStructure = make_handle(handle),
        .geometryCount = geometry_count,
        .pGeometries = geometries,
    };
}

/* From Vulkan's structs to results, as a client of the service goes. ret_items[count]. */
static enum bvhd_status build_infos(const struct job *job, const VkAccelerationStructureBuildGeometryInfoKHR *infos, uint32_t count,
                                    const VkAccelerationStructureBuildRangeInfoKHR *const *ranges, const struct reference *references,
                                    uint32_t reference_count, struct batch_item *ret_items)
{
    struct bvhd_error *errors = memory_array(job->context->memory, count, sizeof *errors);
    if (!errors)
        return no_memory(job);
    memset(errors, 0, count * sizeof *errors);
    struct vulkan_input *input = NULL;
    struct limits limits = limits_default();
    enum bvhd_status status =
        vulkan_input_create(infos, count, ranges, references, reference_count, &job->options->build, &input, errors);
    if (status)
        *job->error = errors[0];
    else
        status = batch_build(vulkan_input_entries(input), count, &limits, job->context, ret_items, job->error);
    for (uint32_t i = 0; i < count && !status; i++)
        if (errors[i].status) { /* said before any building: the first rule that the entry breaks */
            ret_items[i].status = errors[i].status;
            ret_items[i].error = errors[i];
        }
    vulkan_input_destroy(input);
    memory_free(job->context->memory, errors);
    return status;
}

/* The bottom levels' descriptions: geometries and ranges of all parts behind each other. */
struct bottom_arrays {
    VkAccelerationStructureBuildGeometryInfoKHR *infos;
    const VkAccelerationStructureBuildRangeInfoKHR **ranges;
    VkAccelerationStructureGeometryKHR *geometries;
    VkAccelerationStructureBuildRangeInfoKHR *range_rows;
};

static void bottom_arrays_finish(struct bottom_arrays *arrays, struct memory *memory)
{
    memory_free(memory, arrays->infos);
    memory_free(memory, arrays->ranges);
    memory_free(memory, arrays->geometries);
    memory_free(memory, arrays->range_rows);
}

static bool bottom_arrays_init(struct bottom_arrays *arrays, const struct import *import, struct memory *memory)
{
    uint64_t geometry_count = 0;
    for (uint32_t i = 0; i < import->part_count; i++)
        geometry_count += import->parts[i].mesh_count;
    arrays->infos = memory_array(memory, import->part_count, sizeof *arrays->infos);
    arrays->ranges = memory_array(memory, import->part_count, sizeof *arrays->ranges);
    arrays->geometries = memory_array(memory, geometry_count, sizeof *arrays->geometries);
    arrays->range_rows = memory_array(memory, geometry_count, sizeof *arrays->range_rows);
    return arrays->infos && arrays->ranges && arrays->geometries && arrays->range_rows;
}

static void describe_bottoms(const struct job *job, struct bottom_arrays *arrays)
{
    VkAccelerationStructureGeometryKHR *geometries = arrays->geometries;
    VkAccelerationStructureBuildRangeInfoKHR *ranges = arrays->range_rows;
    for (uint32_t i = 0; i < job->import->part_count; i++) {
        const struct import_part *part = &job->import->parts[i];
        for (uint32_t k = 0; k < part->mesh_count; k++) {
            const struct import_mesh *mesh = &job->import->meshes[part->meshes[k]];
            geometries[k] = describe_mesh(mesh, job->options->geometry_flags);
            ranges[k] = (VkAccelerationStructureBuildRangeInfoKHR){.primitiveCount = mesh->triangle_count};
        }
        arrays->infos[i] = describe_build(job->options, VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR, UINT64_C(1) + i,
                                          part->mesh_count, geometries);
        arrays->ranges[i] = ranges;
        geometries += part->mesh_count;
        ranges += part->mesh_count;
    }
}

static enum bvhd_status build_bottoms(const struct job *job, struct batch_item *ret_items)
{
    struct bottom_arrays arrays = {0};
    enum bvhd_status status = BVHD_OK;
    if (!bottom_arrays_init(&arrays, job->import, job->context->memory)) {
        status = no_memory(job);
    } else {
        describe_bottoms(job, &arrays);
        status = build_infos(job, arrays.infos, job->import->part_count, arrays.ranges, NULL, 0, ret_items);
    }
    bottom_arrays_finish(&arrays, job->context->memory);
    return status;
}

static VkAccelerationStructureInstanceKHR describe_instance(const struct import_instance *instance, uint32_t index)
{
    VkAccelerationStructureInstanceKHR record = {
        .instanceCustomIndex = index & 0xffffff,
        .mask = 0xff,
        .accelerationStructureReference = instance->skipped ? 0 : UINT64_C(1) + instance->part,
    };
    static const float identity[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
    memcpy(record.transform.matrix, instance->skipped ? identity : instance->transform, sizeof record.transform.matrix);
    return record;
}

/* The structures that the top level names, each once, in the order in which its instances first name them. */
static enum bvhd_status collect_references(const struct job *job, struct assembly *assembly, struct reference *references, bool *seen,
                                           struct bvhd_error *ret_failure)
{
    const struct import *import = job->import;
    memset(seen, 0, import->part_count * sizeof *seen);
    for (uint32_t i = 0; i < import->instance_count; i++) {
        uint32_t part = import->instances[i].part;
        if (import->instances[i].skipped || seen[part])
            continue;
        const struct batch_item *item = &assembly->items[part];
        if (item->status)
            return bvhd_error_set(ret_failure, item->status, import->name, "bottom level %u, which it needs, was not built", part);
        seen[part] = true;
        assembly->handles[assembly->handle_count] = part;
        references[assembly->handle_count++] = (struct reference){
            .kind = REFERENCE_BLAS, .handle = UINT64_C(1) + part, .has_key = true, .key = item->key, .bounds = item->stats.bounds};
    }
    return BVHD_OK;
}

/* Orders parts by content: equal ones share their bytes. */
struct shared_blob {
    const unsigned char *blob;
    uint32_t position; /* in the list of handles */
};

static int compare_blobs(const void *a, const void *b)
{
    const struct shared_blob *x = a, *y = b;
    uintptr_t left = (uintptr_t)x->blob, right = (uintptr_t)y->blob;
    return left != right ? (left > right) - (left < right) : (x->position > y->position) - (x->position < y->position);
}

/* A top level has one handle for equal bottom levels, where the first of them is named. `seen` has room for all handles. */
static enum bvhd_status merge_equal_handles(const struct job *job, struct assembly *assembly, bool *seen)
{
    uint32_t count = assembly->handle_count, kept = 0;
    struct shared_blob *blobs = memory_array(job->context->memory, (uint64_t)count + 1, sizeof *blobs);
    if (!blobs)
        return no_memory(job);
    for (uint32_t i = 0; i < count; i++)
        blobs[i] = (struct shared_blob){assembly->items[assembly->handles[i]].blob, i};
    qsort(blobs, count, sizeof *blobs, compare_blobs);
    for (uint32_t i = 0; i < count; i++)
        seen[blobs[i].position] = i > 0 && blobs[i].blob == blobs[i - 1].blob;
    for (uint32_t i = 0; i < count; i++)
        if (!seen[i])
            assembly->handles[kept++] = assembly->handles[i];
    assembly->handle_count = kept;
    memory_free(job->context->memory, blobs);
    return BVHD_OK;
}

static enum bvhd_status build_described_top(const struct job *job, const struct assembly *assembly,
                                            VkAccelerationStructureInstanceKHR *records, const struct reference *references,
                                            struct batch_item *ret_item)
{
    const struct import *import = job->import;
    for (uint32_t i = 0; i < import->instance_count; i++)
        records[i] = describe_instance(&import->instances[i], i);
    VkAccelerationStructureGeometryKHR geometry = {
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_KHR,
        .geometryType = VK_GEOMETRY_TYPE_INSTANCES_KHR,
        .geometry.instances = {.sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_INSTANCES_DATA_KHR,
                               .data.hostAddress = records},
    };
    VkAccelerationStructureBuildGeometryInfoKHR info =
        describe_build(job->options, VK_ACCELERATION_STRUCTURE_TYPE_TOP_LEVEL_KHR, UINT64_C(1) + import->part_count, 1, &geometry);
    VkAccelerationStructureBuildRangeInfoKHR range = {.primitiveCount = import->instance_count};
    const VkAccelerationStructureBuildRangeInfoKHR *ranges = &range;
    return build_infos(job, &info, 1, &ranges, references, assembly->handle_count, ret_item);
}

static enum bvhd_status build_top(const struct job *job, struct assembly *assembly, struct batch_item *ret_item)
{
    const struct import *import = job->import;
    struct memory *memory = job->context->memory;
    VkAccelerationStructureInstanceKHR *records = memory_array(memory, import->instance_count, sizeof *records);
    struct reference *references = memory_array(memory, import->part_count, sizeof *references);
    bool *seen = memory_array(memory, import->part_count, sizeof *seen);
    enum bvhd_status status = BVHD_OK;
    if (!records || !references || !seen)
        status = no_memory(job);
    else if (collect_references(job, assembly, references, seen, &ret_item->error))
        ret_item->status = ret_item->error.status;
    else
        status = build_described_top(job, assembly, records, references, ret_item);
    if (!status && !ret_item->status)
        status = merge_equal_handles(job, assembly, seen);
    memory_free(memory, seen);
    memory_free(memory, references);
    memory_free(memory, records);
    return status;
}

enum bvhd_status assemble(const struct import *import, const struct options *options, const struct build_context *context,
                          struct assembly *ret_assembly, struct bvhd_error *error)
{
    struct job job = {import, options, context, error};
    struct assembly assembly = {.import = import, .memory = context->memory};
    uint64_t count = (uint64_t)import->part_count + 1;
    assembly.items = memory_array(context->memory, count, sizeof *assembly.items);
    assembly.handles = memory_array(context->memory, count, sizeof *assembly.handles);
    enum bvhd_status status = BVHD_OK;
    if (assembly.items)
        memset(assembly.items, 0, count * sizeof *assembly.items);
    if (!assembly.items || !assembly.handles)
        status = no_memory(&job);
    if (!status)
        status = build_bottoms(&job, assembly.items);
    if (!status)
        status = build_top(&job, &assembly, &assembly.items[import->part_count]);
    if (status)
        assembly_finish(&assembly);
    else
        *ret_assembly = assembly;
    return status;
}

void assembly_finish(struct assembly *assembly)
{
    if (!assembly || !assembly->memory)
        return;
    if (assembly->items) {
        batch_finish(&assembly->items[assembly->import->part_count], 1, assembly->memory);
        batch_finish(assembly->items, assembly->import->part_count, assembly->memory);
    }
    memory_free(assembly->memory, assembly->items);
    memory_free(assembly->memory, assembly->handles);
    *assembly = (struct assembly){0};
}
