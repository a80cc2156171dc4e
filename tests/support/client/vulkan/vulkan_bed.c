/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/support/client/vulkan/vulkan_bed.h"
#include "tests/support/builder/builders.h"

#include <stdio.h>
#include <stdlib.h>

enum { HANDLE = 0x1000, RECORD = 64 };

static void must(bool condition, const char *what, const struct bvhd_error *error)
{
    if (condition)
        return;
    fprintf(stderr, "vulkan bed: %s: %s %s\n", what, error ? error->where : "", error ? error->text : "");
    abort();
}

static void build_row(struct vulkan_bed *bed, struct build_input *input, uint32_t row)
{
    struct bvhd_error error = {0};
    struct limits limits = limits_default();
    struct build_context context = {.memory = &bed->memory, .parallel = &parallel_serial};
    struct batch_item *item = &bed->items[row];
    input->geometry_count = 1;
    input->options = (struct build_options){
        .target = bed->options.target, .device = bed->options.device, .builder = builders_turn(row)};
    must(batch_build(input, 1, &limits, &context, item, &error) == BVHD_OK, "batch", &error);
    must(item->status == BVHD_OK, "build", &item->error);
    bed->blobs[row] = (struct bvhd_vulkan_bytes){item->blob, item->size};
}

static void write_triangles(uint32_t bottom, uint32_t count, float (*triangles)[3][3])
{
    float z = (float)bottom / 64;
    const float square[2][3][3] = {{{0, 0, z}, {1, 0, z}, {1, 1, z}}, {{0, 0, z}, {1, 1, z}, {0, 1, z}}};
    memcpy(triangles, square, sizeof square);
    for (uint32_t i = 2; i < count; i++) {
        float below = -10 - (float)i;
        const float small[3][3] = {{0, 0, below}, {0.5f, 0, below}, {0, 0.5f, below}};
        memcpy(triangles[i], small, sizeof small);
    }
}

/* Makes a sphere around each corner of these triangles. */
static void build_spheres(struct vulkan_bed *bed, uint32_t row, uint32_t count, float (*triangles)[3][3])
{
    static const float radius = 0.25f;
    const struct geometry geometry = {
        .type = GEOMETRY_SPHERES,
        .flags = GEOMETRY_OPAQUE,
        .spheres = {.vertex_format = VK_FORMAT_R32G32B32_SFLOAT,
                    .radius_format = VK_FORMAT_R32_SFLOAT,
                    .index_type = INDEX_NONE,
                    .vertex_stride = 12,
                    .vertices = {(const unsigned char *)triangles, count * sizeof *triangles},
                    .radii = {(const unsigned char *)&radius, sizeof radius}},
        .range.primitive_count = 3 * count,
    };
    struct build_input input = {.type = STRUCTURE_BOTTOM, .geometries = &geometry};
    build_row(bed, &input, row);
}

static void build_triangles(struct vulkan_bed *bed, uint32_t row, uint32_t count, float (*triangles)[3][3])
{
    const struct geometry geometry = {
        .type = GEOMETRY_TRIANGLES,
        .flags = GEOMETRY_OPAQUE,
        .triangles = {.vertex_format = VK_FORMAT_R32G32B32_SFLOAT,
                      .max_vertex = 3 * count - 1,
                      .vertex_stride = 12,
                      .index_type = INDEX_NONE,
                      .vertices = {(const unsigned char *)triangles, count * sizeof *triangles}},
        .range.primitive_count = count,
    };
    struct build_input input = {.type = STRUCTURE_BOTTOM, .geometries = &geometry};
    build_row(bed, &input, row);
}

static void build_bottom(struct vulkan_bed *bed, uint32_t row)
{
    uint32_t count = bed->options.triangles;
    bool is_round = bed->options.has_spheres && row + 1 == bed->options.bottoms;
    float(*triangles)[3][3] = calloc(count, sizeof *triangles);
    must(triangles, "no memory", NULL);
    write_triangles(row, count, triangles);
    (is_round ? build_spheres : build_triangles)(bed, row, count, triangles);
    free(triangles);
}

static void write_instances(const struct vulkan_bed *bed, unsigned char *records)
{
    for (uint32_t i = 0; i < bed->options.instances; i++, records += RECORD) {
        const float transform[12] = {1, 0, 0, 2 * (float)i, 0, 1, 0, 0, 0, 0, 1, (float)(i % 5)};
        memcpy(records, transform, sizeof transform);
        bytes_put32(records + 48, (i & 0xffffff) | UINT32_C(0xff000000));
        bytes_put32(records + 52, 0);
        bytes_put64(records + 56, HANDLE + vulkan_bed_bottom(bed, i));
    }
}

static void build_top(struct vulkan_bed *bed)
{
    uint32_t bottoms = bed->options.bottoms, count = bed->options.instances;
    struct reference *references = calloc(bottoms, sizeof *references);
    unsigned char *records = calloc(count, RECORD);
    must(references && records, "no memory", NULL);
    for (uint32_t i = 0; i < bottoms; i++)
        references[i] = (struct reference){.kind = REFERENCE_BLAS,
                                           .handle = HANDLE + i,
                                           .has_key = true,
                                           .key = bed->items[i].key,
                                           .bounds = bed->items[i].summary.bounds};
    write_instances(bed, records);
    const struct geometry geometry = {.type = GEOMETRY_INSTANCES,
                                      .instances.records = {records, (uint64_t)RECORD * count},
                                      .range.primitive_count = count};
    struct build_input input = {
        .type = STRUCTURE_TOP, .geometries = &geometry, .reference_count = bottoms, .references = references};
    build_row(bed, &input, bottoms);
    free(references);
    free(records);
}

void vulkan_bed_init(struct vulkan_bed *bed, const struct vulkan_bed_options *options)
{
    *bed = (struct vulkan_bed){.options = *options, .count = options->bottoms + (options->instances > 0)};
    memory_init(&bed->memory, UINT64_MAX);
    bed->items = calloc(bed->count, sizeof *bed->items);
    bed->blobs = calloc(bed->count, sizeof *bed->blobs);
    must(bed->items && bed->blobs, "no memory", NULL);
    for (uint32_t i = 0; i < options->bottoms; i++)
        build_bottom(bed, i);
    if (options->instances > 0)
        build_top(bed);
    for (uint32_t i = options->named; i > 0 && i < options->bottoms; i++)
        bed->blobs[i] = (struct bvhd_vulkan_bytes){NULL, 0};
}

void vulkan_bed_finish(struct vulkan_bed *bed)
{
    batch_finish(bed->items, bed->count, &bed->memory);
    free(bed->items);
    free(bed->blobs);
}

uint32_t vulkan_bed_bottom(const struct vulkan_bed *bed, uint32_t instance)
{
    return instance % (bed->options.named ? bed->options.named : bed->options.bottoms);
}

struct ray vulkan_bed_ray(const struct vulkan_bed *bed, uint32_t instance, float *ret_t)
{
    uint32_t bottom = bed->options.instances > 0 ? vulkan_bed_bottom(bed, instance) : bed->options.bottoms - 1;
    struct ray ray = {
        .origin = {2 * (float)instance + 0.75f, 0.25f, 100}, .direction = {0, 0, -1}, .tmax = 1000, .cull_mask = 0xff};
    *ret_t = 100 - (float)(instance % 5) - (float)bottom / 64;
    return ray;
}

struct bvhd_format vulkan_bed_format(const struct device_format *device)
{
    struct bvhd_format format = {
        .struct_size = sizeof format, .target = BVHD_TARGET_LAVAPIPE, .variant = device->variant};
    memcpy(format.driver_uuid, device->driver_uuid, sizeof format.driver_uuid);
    memcpy(format.compatibility_uuid, device->compatibility_uuid, sizeof format.compatibility_uuid);
    return format;
}
