/* SPDX-License-Identifier: Apache-2.0 */
/*
 * same_results.c - tests that a client gets the same from a daemon and from builds in its own process: every field of
 * every result except times, for batches that are built and for batches that are refused.
 *
 *     same_results BVHD
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <bvhd/bvhd.h>

#include "builder/format/lavapipe.h"
#include "tests/support/daemon/service_process.h"

/* Info 0 is what a case changes; info 1 is a mesh, 2 boxes, 3 a top level over info 1. */
enum { INFOS = 4, VERTICES = 30, INSTANCES = 5 };

/* A batch, which a case changes before it is submitted. */
struct request {
    float vertices[VERTICES * 3];
    uint32_t indices[VERTICES];
    float transform[12];
    float boxes[4 * 6];
    VkAccelerationStructureInstanceKHR instances[INSTANCES];
    VkAccelerationStructureGeometryKHR geometries[INFOS][2];
    VkAccelerationStructureBuildRangeInfoKHR ranges[INFOS][2];
    const VkAccelerationStructureBuildRangeInfoKHR *range_pointers[INFOS];
    VkAccelerationStructureBuildGeometryInfoKHR infos[INFOS];
    struct bvhd_reference reference;
    struct bvhd_format format;
    struct bvhd_build build;
};

static uint32_t failures;

static void expect(bool good, const char *name, const char *what)
{
    if (good)
        return;
    printf("%s: differs: %s\n", name, what);
    failures++;
}

/* ---- the batch ---- */

static VkAccelerationStructureGeometryTrianglesDataKHR *triangles(struct request *request)
{
    return &request->geometries[0][0].geometry.triangles;
}

static void set_mesh(struct request *request, uint32_t info, const float *vertices)
{
    VkAccelerationStructureGeometryKHR *geometry = &request->geometries[info][0];
    geometry->geometryType = VK_GEOMETRY_TYPE_TRIANGLES_KHR;
    geometry->geometry.triangles = (VkAccelerationStructureGeometryTrianglesDataKHR){
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_TRIANGLES_DATA_KHR,
        .vertexFormat = VK_FORMAT_R32G32B32_SFLOAT,
        .vertexData.hostAddress = vertices,
        .vertexStride = 12,
        .maxVertex = 14,
        .indexType = VK_INDEX_TYPE_NONE_KHR};
    request->ranges[info][0].primitiveCount = 5;
}

static void set_boxes(struct request *request, uint32_t info, uint32_t geometry)
{
    request->geometries[info][geometry].geometryType = VK_GEOMETRY_TYPE_AABBS_KHR;
    request->geometries[info][geometry].geometry.aabbs = (VkAccelerationStructureGeometryAabbsDataKHR){
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_AABBS_DATA_KHR,
        .data.hostAddress = request->boxes,
        .stride = 24};
    request->ranges[info][geometry].primitiveCount = 4;
}

static void set_instances(struct request *request, uint32_t info)
{
    request->geometries[info][0].geometryType = VK_GEOMETRY_TYPE_INSTANCES_KHR;
    request->geometries[info][0].geometry.instances = (VkAccelerationStructureGeometryInstancesDataKHR){
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_INSTANCES_DATA_KHR,
        .data.hostAddress = request->instances};
    request->ranges[info][0].primitiveCount = INSTANCES;
    request->infos[info].type = VK_ACCELERATION_STRUCTURE_TYPE_TOP_LEVEL_KHR;
}

static void fill(struct request *request)
{
    for (uint32_t i = 0; i < VERTICES * 3; i++)
        request->vertices[i] = (float)(i * i % 23) - 7.5f * (float)(i % 4);
    for (uint32_t i = 0; i < VERTICES; i++)
        request->indices[i] = i * 7 % 15;
    for (uint32_t i = 0; i < 24; i++)
        request->boxes[i] = (float)(i % 6 < 3 ? i : i * 2);
    for (uint32_t i = 0; i < 12; i++)
        request->transform[i] = i % 5 == 0 ? 2 : (float)i / 16;
    for (uint32_t i = 0; i < INSTANCES; i++)
        request->instances[i] = (VkAccelerationStructureInstanceKHR){
            .transform = {{{1, 0.5f, 0, (float)i}, {-0.5f, 1, 0, 2}, {0, 0.25f, 1, -1}}},
            .mask = 255,
            .accelerationStructureReference = 2};
}

/* Info 0 is set to another mesh, with indices. */
static void describe(struct request *request)
{
    memset(request, 0, sizeof *request);
    fill(request);
    for (uint32_t i = 0; i < INFOS; i++) {
        for (uint32_t k = 0; k < 2; k++)
            request->geometries[i][k].sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_KHR;
        request->range_pointers[i] = request->ranges[i];
        request->infos[i] = (VkAccelerationStructureBuildGeometryInfoKHR){
            .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_BUILD_GEOMETRY_INFO_KHR,
            .type = VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR,
            .dstAccelerationStructure = (VkAccelerationStructureKHR)(uintptr_t)(i + 1),
            .geometryCount = 1,
            .pGeometries = request->geometries[i]};
    }
    set_mesh(request, 0, request->vertices);
    triangles(request)->indexType = VK_INDEX_TYPE_UINT32;
    triangles(request)->indexData.hostAddress = request->indices;
    request->ranges[0][0].primitiveCount = 10;
    set_mesh(request, 1, request->vertices + VERTICES);
    set_boxes(request, 2, 0);
    set_instances(request, 3);
    request->build = (struct bvhd_build){.struct_size = sizeof request->build,
                                         .info_count = INFOS,
                                         .infos = request->infos,
                                         .ranges = request->range_pointers,
                                         .quality = BVHD_QUALITY_BALANCED};
}

/* ---- the cases: each changes a batch that is good ---- */

#define CASE(name, change)                                                                                             \
    static void name(struct request *r)                                                                                \
    {                                                                                                                  \
        change;                                                                                                        \
    }

CASE(as_it_is, (void)r)
CASE(short_indices, triangles(r)->indexType = VK_INDEX_TYPE_UINT16)
CASE(no_indices, triangles(r)->indexType = VK_INDEX_TYPE_NONE_KHR; r->ranges[0][0].primitiveCount = 5)
CASE(other_stride, triangles(r)->vertexStride = 4; triangles(r)->maxVertex = 29)
CASE(halves, triangles(r)->vertexFormat = VK_FORMAT_R16G16B16A16_SFLOAT; triangles(r)->vertexStride = 8)
CASE(normalized, triangles(r)->vertexFormat = VK_FORMAT_R8G8B8A8_SNORM; triangles(r)->vertexStride = 4)
CASE(transformed, triangles(r)->transformData.hostAddress = r->transform)
CASE(no_primitives, r->ranges[0][0].primitiveCount = 0)
CASE(no_geometries, r->infos[0].geometryCount = 0)
CASE(inactive, r->vertices[0] = r->vertices[3] = NAN)
CASE(degenerate, memset(r->indices, 0, 12))
CASE(infinite, r->vertices[4] = INFINITY)
CASE(opaque, r->geometries[0][0].flags = VK_GEOMETRY_OPAQUE_BIT_KHR)
CASE(two_geometries, r->infos[0].geometryCount = 2; r->geometries[0][1] = r->geometries[1][0];
     r->ranges[0][1] = r->ranges[1][0])
CASE(equal_infos, r->geometries[0][0] = r->geometries[1][0]; r->ranges[0][0] = r->ranges[1][0])
CASE(fast_triangles, r->build.layout_flags = BVHD_PORTABLE_FAST_TRIANGLES)
CASE(fast, r->build.quality = BVHD_QUALITY_FAST)
CASE(high, r->build.quality = BVHD_QUALITY_HIGH)
CASE(automatic, r->build.quality = BVHD_QUALITY_AUTO; r->build.rays_per_primitive = 1000)
CASE(preferred, r->build.quality = 0; r->infos[0].flags = VK_BUILD_ACCELERATION_STRUCTURE_PREFER_FAST_TRACE_BIT_KHR)
CASE(hint_unused, r->build.rays_per_primitive = 7)

CASE(bad_hint, r->build.quality = BVHD_QUALITY_AUTO; r->build.rays_per_primitive = -1)
CASE(nan_hint, r->build.quality = BVHD_QUALITY_AUTO; r->build.rays_per_primitive = NAN)
CASE(bad_quality, r->build.quality = (enum bvhd_quality)9)
CASE(bad_target, r->build.target = (enum bvhd_target)99)
CASE(bad_layout_flags, r->build.layout_flags = 0xff0)
CASE(no_format, r->build.target = BVHD_TARGET_LAVAPIPE)
CASE(bad_variant, r->format = ((struct bvhd_format){sizeof r->format, BVHD_TARGET_LAVAPIPE, 77, {1}, {2}});
     r->build.format = &r->format)
CASE(bad_type, r->infos[0].type = VK_ACCELERATION_STRUCTURE_TYPE_GENERIC_KHR)
CASE(unknown_type, r->infos[0].type = (VkAccelerationStructureTypeKHR)9)
CASE(bad_stype, r->infos[0].sType = VK_STRUCTURE_TYPE_APPLICATION_INFO)
CASE(bad_flags, r->infos[0].flags = 3 << 2)
CASE(unknown_flags, r->infos[0].flags = 1 << 20)
CASE(update, r->infos[0].mode = VK_BUILD_ACCELERATION_STRUCTURE_MODE_UPDATE_KHR)
CASE(no_pointers, r->infos[0].pGeometries = NULL)
CASE(no_ranges, r->range_pointers[0] = NULL)
CASE(bad_geometry, r->geometries[0][0].geometryType = (VkGeometryTypeKHR)7)
CASE(bad_geometry_flags, r->geometries[0][0].flags = 64)
CASE(mixed, r->infos[0].geometryCount = 2; set_boxes(r, 0, 1))
CASE(no_vertices, triangles(r)->vertexData.hostAddress = NULL)
CASE(no_index_data, triangles(r)->indexData.hostAddress = NULL)
CASE(bad_vertex_format, triangles(r)->vertexFormat = VK_FORMAT_BC1_RGB_UNORM_BLOCK)
CASE(bad_stride, triangles(r)->vertexStride = 13)
CASE(bad_index_type, triangles(r)->indexType = (VkIndexType)5)
CASE(bad_index, r->indices[17] = 15)
CASE(bad_offset, r->ranges[0][0].primitiveOffset = 2)
CASE(bad_first_vertex, r->ranges[0][0].firstVertex = 0xffffffff)
CASE(too_many, r->ranges[0][0].primitiveCount = 1u << 29; triangles(r)->indexType = VK_INDEX_TYPE_NONE_KHR;
     triangles(r)->vertexStride = 0)
CASE(bad_matrix, r->transform[0] = NAN; triangles(r)->transformData.hostAddress = r->transform)
CASE(bad_transform_offset, triangles(r)->transformData.hostAddress = r->transform; r->ranges[0][0].transformOffset = 8)
CASE(bad_box, r->boxes[3] = r->boxes[0] - 1)
CASE(bad_box_stride, r->geometries[2][0].geometry.aabbs.stride = 20)
CASE(bad_instance_flags, r->instances[3].flags = 0xc)
CASE(singular, memset(r->instances[2].transform.matrix, 0, 48))
CASE(unknown_bottom, r->instances[4].accelerationStructureReference = 77)
CASE(instances_below, r->infos[3].type = VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR)
CASE(bottom_fails, r->ranges[1][0].primitiveOffset = 1)
CASE(same_destination, r->infos[0].dstAccelerationStructure = r->infos[2].dstAccelerationStructure)
CASE(unknown_key, r->reference.handle = 5; r->reference.has_key = 1; r->instances[1].accelerationStructureReference = 5)
CASE(bad_reference, r->reference.handle = 5; r->reference.bounds[0] = NAN)

#define ENTRY(name)                                                                                                    \
    {                                                                                                                  \
#name, name                                                                                                    \
    }

static const struct {
    const char *name;
    void (*change)(struct request *request);
} cases[] = {
    ENTRY(as_it_is),
    ENTRY(short_indices),
    ENTRY(no_indices),
    ENTRY(other_stride),
    ENTRY(halves),
    ENTRY(normalized),
    ENTRY(transformed),
    ENTRY(no_primitives),
    ENTRY(no_geometries),
    ENTRY(inactive),
    ENTRY(degenerate),
    ENTRY(infinite),
    ENTRY(opaque),
    ENTRY(two_geometries),
    ENTRY(equal_infos),
    ENTRY(fast_triangles),
    ENTRY(fast),
    ENTRY(high),
    ENTRY(automatic),
    ENTRY(preferred),
    ENTRY(hint_unused),
    ENTRY(bad_hint),
    ENTRY(nan_hint),
    ENTRY(bad_quality),
    ENTRY(bad_target),
    ENTRY(bad_layout_flags),
    ENTRY(no_format),
    ENTRY(bad_variant),
    ENTRY(bad_type),
    ENTRY(unknown_type),
    ENTRY(bad_stype),
    ENTRY(bad_flags),
    ENTRY(unknown_flags),
    ENTRY(update),
    ENTRY(no_pointers),
    ENTRY(no_ranges),
    ENTRY(bad_geometry),
    ENTRY(bad_geometry_flags),
    ENTRY(mixed),
    ENTRY(no_vertices),
    ENTRY(no_index_data),
    ENTRY(bad_vertex_format),
    ENTRY(bad_stride),
    ENTRY(bad_index_type),
    ENTRY(bad_index),
    ENTRY(bad_offset),
    ENTRY(bad_first_vertex),
    ENTRY(too_many),
    ENTRY(bad_matrix),
    ENTRY(bad_transform_offset),
    ENTRY(bad_box),
    ENTRY(bad_box_stride),
    ENTRY(bad_instance_flags),
    ENTRY(singular),
    ENTRY(unknown_bottom),
    ENTRY(instances_below),
    ENTRY(bottom_fails),
    ENTRY(same_destination),
    ENTRY(unknown_key),
    ENTRY(bad_reference),
};

enum { CASES = sizeof cases / sizeof cases[0], GOOD = 21 };

/* ---- the comparison ---- */

/* A client's answer to a case: a batch, or the error of the submission. */
struct outcome {
    struct bvhd_batch *batch;
    struct bvhd_error error;
};

static struct outcome submit(struct bvhd_client *client, uint32_t number)
{
    struct request *request = malloc(sizeof *request);
    struct outcome outcome = {.error = {.status = BVHD_OK}};
    if (!request)
        exit(1);
    describe(request);
    cases[number].change(request);
    if (request->reference.handle) {
        request->build.references = &request->reference;
        request->build.reference_count = 1;
    }
    if (bvhd_batch_submit(client, &request->build, &outcome.batch, &outcome.error) == BVHD_OK)
        bvhd_batch_wait(outcome.batch, -1);
    free(request);
    return outcome;
}

static bool same_error(const struct bvhd_error *a, const struct bvhd_error *b)
{
    bool same =
        a->status == b->status && a->vuid == b->vuid && !strcmp(a->where, b->where) && !strcmp(a->text, b->text);
    if (!same)
        printf("%s: %s: %s\n%s: %s: %s\n", bvhd_status_name(a->status), a->where, a->text, bvhd_status_name(b->status),
               b->where, b->text);
    return same;
}

/* Whether both were built for this request. An equal structure may be joined or found, depending on the time. */
static bool same_origin(enum bvhd_origin a, enum bvhd_origin b)
{
    return (a == BVHD_ORIGIN_BUILT) == (b == BVHD_ORIGIN_BUILT);
}

static void compare_results(const char *name, const struct bvhd_result *a, const struct bvhd_result *b)
{
    expect(same_error(&a->error, &b->error), name, "error");
    if (a->error.status != BVHD_OK || b->error.status != BVHD_OK)
        return;
    expect(!memcmp(&a->key, &b->key, sizeof a->key), name, "key");
    expect(a->size == b->size && !memcmp(a->data, b->data, a->size), name, "bytes");
    expect(same_origin(a->origin, b->origin), name, "origin");
    expect(a->primitives == b->primitives && a->triangles == b->triangles && a->instances == b->instances, name,
           "primitives");
    expect(a->inactive == b->inactive && a->degenerate == b->degenerate && a->skipped == b->skipped, name,
           "inactive primitives");
    expect(a->refs == b->refs && a->depth == b->depth && a->sah == b->sah, name, "statistics");
    expect(a->peak_bytes == b->peak_bytes, name, "peak_bytes");
    expect(!strcmp(a->method, b->method), name, "method");
    expect(!memcmp(a->bounds, b->bounds, sizeof a->bounds), name, "bounds");
    expect(!memcmp(a->slabs, b->slabs, sizeof a->slabs), name, "slabs");
    expect(a->target == b->target && a->quality == b->quality, name, "target and quality");
    expect(a->decay == b->decay && a->refits == b->refits, name, "decay and refits");
}

static void compare(uint32_t number, const struct outcome *a, const struct outcome *b)
{
    const char *name = cases[number].name;
    bool good = a->error.status == BVHD_OK;
    expect(same_error(&a->error, &b->error), name, "error of the call");
    expect(!a->batch == !b->batch, name, "whether there is a batch");
    for (uint32_t i = 0; a->batch && b->batch && i < INFOS; i++) {
        const struct bvhd_result *result = bvhd_batch_result(a->batch, i);
        good = good && result->error.status == BVHD_OK;
        compare_results(name, result, bvhd_batch_result(b->batch, i));
    }
    expect(good == (number < GOOD), name, number < GOOD ? "it fails" : "it does not fail");
}

static struct bvhd_client *make_client(const char *socket, enum bvhd_local local)
{
    struct bvhd_client_options options = {.struct_size = sizeof options, .socket_path = socket, .local = local};
    struct bvhd_client *client = NULL;
    if (bvhd_client_create(&options, &client, NULL) != BVHD_OK)
        exit(1);
    return client;
}

/* ---- updates ---- */

enum { STEPS = 3, OTHER = 10 };

/* Changes everything that an update may change. */
static void move(struct request *request, uint32_t step)
{
    for (uint32_t i = 0; i < VERTICES * 3; i++)
        request->vertices[i] += (float)(i * (step + 3) % 11) - 5;
    for (uint32_t i = 0; i < 24; i++)
        request->boxes[i] += (float)step * (i % 6 < 3 ? -1 : 1);
    for (uint32_t i = 0; i < INSTANCES; i++) {
        request->instances[i].transform.matrix[1][3] += (float)(i * step);
        request->instances[i].mask = 15 + step;
    }
}

/*
 * Describes updates of the results of a batch that built all infos with ALLOW_UPDATE: in place, or from other numbers
 * to those that the infos have. The top level, info 3, names what info 1 makes.
 */
static void describe_update(struct request *request, struct bvhd_batch *sources, bool in_place,
                            struct bvhd_reference references[INFOS])
{
    for (uint32_t i = 0; i < INFOS; i++) {
        uint64_t handle = i + 1 + (in_place ? 0 : OTHER);
        request->infos[i].mode = VK_BUILD_ACCELERATION_STRUCTURE_MODE_UPDATE_KHR;
        request->infos[i].srcAccelerationStructure = (VkAccelerationStructureKHR)(uintptr_t)handle;
        references[i] =
            (struct bvhd_reference){.handle = handle, .has_key = 1, .key = bvhd_batch_result(sources, i)->key};
    }
    request->build.references = references;
    request->build.reference_count = INFOS;
}

static struct bvhd_batch *run(struct bvhd_client *client, const struct request *request)
{
    struct bvhd_batch *batch = NULL;
    struct bvhd_error error;
    if (bvhd_batch_submit(client, &request->build, &batch, &error) != BVHD_OK) {
        printf("submit: %s: %s\n", error.where, error.text);
        exit(1);
    }
    bvhd_batch_wait(batch, -1);
    return batch;
}

/* The formats of which a chain of updates has its structures. */
struct chain {
    const char *name;
    enum bvhd_target target;
    uint32_t variant; /* of a native target */
};

static const struct chain chains[] = {
    {"portable", BVHD_TARGET_PORTABLE, 0},
    {"lavapipe", BVHD_TARGET_LAVAPIPE, LAVAPIPE_PLAIN},
    {"lavapipe, compacted", BVHD_TARGET_LAVAPIPE, LAVAPIPE_COMPACTED},
};

static void compare_updates(const struct chain *chain, struct bvhd_batch *const batches[2], uint32_t refits)
{
    const char *name = chain->name;
    for (uint32_t i = 0; i < INFOS; i++) {
        const struct bvhd_result *a = bvhd_batch_result(batches[0], i), *b = bvhd_batch_result(batches[1], i);
        compare_results(name, a, b);
        expect(a->error.status == BVHD_OK, name, a->error.text);
        expect(a->refits == refits && (a->decay > 0) == (refits > 0), name, "it is no update, or no build");
        expect(a->target == chain->target, name, "the target is another one");
    }
}

/* Each update has other bytes than its source. */
static void compare_moves(const struct chain *chain, struct bvhd_batch *source, struct bvhd_batch *update)
{
    for (uint32_t i = 0; i < INFOS; i++) {
        const struct bvhd_result *a = bvhd_batch_result(source, i), *b = bvhd_batch_result(update, i);
        expect(a->size != b->size || memcmp(a->data, b->data, a->size) != 0, chain->name, "an update changes nothing");
    }
}

static void describe_chain(struct request *request, const struct chain *chain)
{
    describe(request);
    request->build.target = chain->target;
    request->format = (struct bvhd_format){sizeof request->format, chain->target, chain->variant, {1}, {2}};
    if (chain->target != BVHD_TARGET_PORTABLE)
        request->build.format = &request->format;
}

/* A chain of updates; the last one goes to other numbers. Each batch is destroyed before the next but one begins. */
static void compare_chain(struct bvhd_client *const clients[2], struct request *request, const struct chain *chain)
{
    struct bvhd_batch *batches[2], *last[2];
    struct bvhd_reference references[INFOS];
    describe_chain(request, chain);
    for (uint32_t i = 0; i < INFOS; i++)
        request->infos[i].flags = VK_BUILD_ACCELERATION_STRUCTURE_ALLOW_UPDATE_BIT_KHR;
    for (int k = 0; k < 2; k++)
        batches[k] = run(clients[k], request);
    compare_updates(chain, batches, 0);
    for (uint32_t step = 1; step <= STEPS; step++) {
        move(request, step);
        for (int k = 0; k < 2; k++) {
            last[k] = batches[k];
            describe_update(request, last[k], step < STEPS, references);
            batches[k] = run(clients[k], request);
        }
        compare_updates(chain, batches, step);
        compare_moves(chain, last[0], batches[0]);
        for (int k = 0; k < 2; k++)
            bvhd_batch_destroy(last[k]);
    }
    for (int k = 0; k < 2; k++)
        bvhd_batch_destroy(batches[k]);
}

/* What is wrong with an update of info 0, and what info 0 was built from. */
struct wrong_update {
    const char *name;
    enum bvhd_status status;
    void (*change)(struct request *request, struct bvhd_reference *reference);
};

#define WRONG(name, statement)                                                                                         \
    static void name(struct request *request, struct bvhd_reference *reference)                                        \
    {                                                                                                                  \
        (void)request, (void)reference;                                                                                \
        statement;                                                                                                     \
    }

WRONG(lost_source, reference->key.bytes[3] ^= 1)
WRONG(no_source, request->infos[0].srcAccelerationStructure = VK_NULL_HANDLE)
WRONG(unnamed_source, reference->handle++)
WRONG(keyless_source, reference->has_key = 0; reference->bounds[3] = 1)
WRONG(source_is_made, request->infos[0].srcAccelerationStructure = (VkAccelerationStructureKHR)2)
WRONG(other_flags, request->infos[0].flags |= VK_BUILD_ACCELERATION_STRUCTURE_ALLOW_COMPACTION_BIT_KHR)
WRONG(no_flags, request->infos[0].flags = 0)
WRONG(other_count, request->ranges[0][0].primitiveCount--)
WRONG(other_indices, request->indices[2]++)
WRONG(goes_inactive, request->vertices[0] = NAN; request->vertices[21] = NAN)
WRONG(other_layout, request->build.layout_flags = BVHD_PORTABLE_FAST_TRIANGLES)

static const struct wrong_update wrong_updates[] = {
    {"lost_source", BVHD_SOURCE_LOST, lost_source},
    {"no_source", BVHD_INVALID, no_source},
    {"unnamed_source", BVHD_INVALID, unnamed_source},
    {"keyless_source", BVHD_INVALID, keyless_source},
    {"source_is_made", BVHD_INVALID, source_is_made},
    {"other_flags", BVHD_INVALID, other_flags},
    {"no_flags", BVHD_INVALID, no_flags},
    {"other_count", BVHD_INVALID, other_count},
    {"other_indices", BVHD_INVALID, other_indices},
    {"goes_inactive", BVHD_INVALID, goes_inactive},
    {"other_layout", BVHD_INVALID, other_layout},
};

/* `flags` are those of the source; 0: nothing may update it. */
static void compare_wrong_update(struct bvhd_client *const clients[2], struct request *request, uint32_t flags,
                                 const struct wrong_update *wrong)
{
    struct bvhd_batch *source, *batches[2];
    for (int k = 0; k < 2; k++) {
        struct bvhd_reference reference;
        describe(request);
        request->infos[0].flags = flags;
        source = run(clients[k], request);
        request->infos[0].flags = VK_BUILD_ACCELERATION_STRUCTURE_ALLOW_UPDATE_BIT_KHR;
        request->infos[0].mode = VK_BUILD_ACCELERATION_STRUCTURE_MODE_UPDATE_KHR;
        request->infos[0].srcAccelerationStructure = (VkAccelerationStructureKHR)7;
        reference = (struct bvhd_reference){.handle = 7, .has_key = 1, .key = bvhd_batch_result(source, 0)->key};
        request->build.references = &reference;
        request->build.reference_count = 1;
        wrong->change(request, &reference);
        batches[k] = run(clients[k], request);
        bvhd_batch_destroy(source);
    }
    const struct bvhd_result *results[2] = {bvhd_batch_result(batches[0], 0), bvhd_batch_result(batches[1], 0)};
    compare_results(wrong->name, results[0], results[1]);
    expect(results[0]->error.status == wrong->status, wrong->name, results[0]->error.text);
    expect(bvhd_batch_result(batches[0], 2)->error.status == BVHD_OK, wrong->name, "another item fails");
    for (int k = 0; k < 2; k++)
        bvhd_batch_destroy(batches[k]);
}

WRONG(not_updatable, (void)0)

static void compare_all_updates(struct bvhd_client *const clients[2])
{
    static const struct wrong_update plain = {"not_updatable", BVHD_INVALID, not_updatable};
    struct request *request = malloc(sizeof *request);
    if (!request)
        exit(1);
    for (size_t i = 0; i < sizeof chains / sizeof *chains; i++)
        compare_chain(clients, request, &chains[i]);
    for (size_t i = 0; i < sizeof wrong_updates / sizeof *wrong_updates; i++)
        compare_wrong_update(clients, request, VK_BUILD_ACCELERATION_STRUCTURE_ALLOW_UPDATE_BIT_KHR, &wrong_updates[i]);
    compare_wrong_update(clients, request, 0, &plain);
    free(request);
}

int main(int argc, char **argv)
{
    static const char *const one_thread[] = {"--workers", "1", NULL}; /* as the builds here: peaks depend on it */
    static struct outcome outcomes[CASES][2];
    struct service_process service;
    if (argc != 2)
        return 2;
    service_process_start(&service, argv[1], one_thread);
    struct bvhd_client *clients[2] = {make_client(service.socket, BVHD_LOCAL_NEVER),
                                      make_client(NULL, BVHD_LOCAL_ALWAYS)};
    for (uint32_t i = 0; i < CASES; i++) { /* batches are kept, as the daemon keeps results */
        for (int k = 0; k < 2; k++)
            outcomes[i][k] = submit(clients[k], i);
        compare(i, &outcomes[i][0], &outcomes[i][1]);
    }
    for (uint32_t i = 0; i < 2 * CASES; i++)
        bvhd_batch_destroy(outcomes[i / 2][i % 2].batch);
    compare_all_updates(clients);
    for (int k = 0; k < 2; k++)
        bvhd_client_destroy(clients[k]);
    printf("%d cases, %u differences\n", (int)CASES, failures);
    return service_process_stop(&service) && failures == 0 ? 0 : 1;
}
