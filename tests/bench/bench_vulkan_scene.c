/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/bench/bench_vulkan_scene.h"

#include <stdio.h>
#include <string.h>

#include "builder/build.h"
#include "proto/base/clock.h"
#include "builder/input/outline.h"
#include "builder/input/prepare.h"
#include "tests/support/random.h"

static enum bvhd_status no_memory(struct bvhd_error *error)
{
    return bvhd_error_no_memory(error, "scene", "no memory");
}

/* ---- Recovering the input ---- */

/* Triangles that are in no leaf cannot be hit; they come back without area. */
static void collect_triangles(const struct portable_view *view, struct bench_mesh *mesh)
{
    memset(mesh->indices, 0, (size_t)12 * mesh->triangle_count);
    for (uint32_t row = 0; row < view->header->record_count; row++) {
        if (view->header->content == PORTABLE_TRIANGLES) {
            const struct portable_triangle *triangle = (const struct portable_triangle *)view->records + row;
            uint32_t primitive = triangle->id & PORTABLE_ID_MASK;
            const float *corners[3] = {triangle->v0, triangle->v1, triangle->v2};
            for (uint32_t k = 0; k < 3; k++) {
                memcpy(mesh->positions + 9 * (size_t)primitive + 3 * k, corners[k], 12);
                mesh->indices[3 * (size_t)primitive + k] = 3 * primitive + k;
            }
        } else {
            const struct portable_indexed_triangle *triangle =
                (const struct portable_indexed_triangle *)view->records + row;
            memcpy(mesh->indices + 3 * (size_t)(triangle->id & PORTABLE_ID_MASK), triangle->vertices, 12);
        }
    }
}

static enum bvhd_status collect_mesh(const struct portable_view *view, struct memory *memory, struct bench_mesh *mesh,
                                     struct bvhd_error *error)
{
    bool indexed = view->header->content == PORTABLE_INDEXED_TRIANGLES;
    if (!indexed && view->header->content != PORTABLE_TRIANGLES)
        return bvhd_error_set(error, BVHD_UNSUPPORTED, "scene", "only triangles can be measured");
    mesh->triangle_count = view->header->primitive_count;
    mesh->vertex_count = indexed ? view->header->vertex_count : 3 * mesh->triangle_count;
    mesh->positions = memory_array(memory, (uint64_t)mesh->vertex_count + 1, 12);
    mesh->indices = memory_array(memory, (uint64_t)mesh->triangle_count + 1, 12);
    if (!mesh->positions || !mesh->indices)
        return no_memory(error);
    memset(mesh->positions, 0, 12 * ((size_t)mesh->vertex_count + 1));
    if (indexed)
        memcpy(mesh->positions, view->vertices, (size_t)12 * mesh->vertex_count);
    collect_triangles(view, mesh);
    return BVHD_OK;
}

static void shuffle(uint32_t *indices, uint32_t count, struct random *random)
{
    for (uint32_t i = count; i > 1; i--) {
        uint32_t other = (uint32_t)(random_next(random) % i), kept[3];
        memcpy(kept, indices + 3 * (size_t)(i - 1), 12);
        memcpy(indices + 3 * (size_t)(i - 1), indices + 3 * (size_t)other, 12);
        memcpy(indices + 3 * (size_t)other, kept, 12);
    }
}

static enum bvhd_status prepare_input(const struct build_input *input, struct memory *memory,
                                      const struct parallel *parallel, struct canonical *ret_canonical,
                                      struct bvhd_error *error)
{
    struct limits limits = limits_default();
    struct build_context context = {.memory = memory, .parallel = parallel};
    return prepare(input, 0, &limits, &context, ret_canonical, error);
}

static enum bvhd_status open_bottom(struct bench_scene *scene, uint32_t row, const struct bench_scene_options *options,
                                    const struct parallel *parallel, struct bvhd_error *error)
{
    const struct portable_view *view = bench_scene_bottom(scene, row);
    struct bench_mesh *mesh = &scene->meshes[row];
    struct random random = {options->seed + row};
    uint32_t count = view->header->geometry_count;
    struct geometry *geometries = memory_array(scene->memory, (uint64_t)count + 1, sizeof *geometries);
    if (!geometries)
        return no_memory(error);
    enum bvhd_status status = collect_mesh(view, scene->memory, mesh, error);
    for (uint32_t i = 0; i < count && status == BVHD_OK; i++) {
        const struct portable_geometry *from = &view->geometries[i];
        uint32_t *indices = mesh->indices + 3 * (size_t)from->first_primitive;
        if (options->is_shuffled)
            shuffle(indices, from->primitive_count, &random);
        geometries[i] = (struct geometry){
            .type = GEOMETRY_TRIANGLES,
            .flags = from->flags,
            .triangles = {.vertex_format = VK_FORMAT_R32G32B32_SFLOAT,
                          .max_vertex = mesh->vertex_count,
                          .vertex_stride = 12,
                          .index_type = INDEX_UINT32,
                          .vertices = {(unsigned char *)mesh->positions, 12 * ((uint64_t)mesh->vertex_count + 1)},
                          .indices = {(unsigned char *)indices, (uint64_t)12 * from->primitive_count}},
            .range.primitive_count = from->primitive_count};
    }
    struct build_input input = {.type = STRUCTURE_BOTTOM,
                                .flags = BUILD_PREFER_FAST_TRACE | BUILD_ALLOW_COMPACTION,
                                .geometry_count = count,
                                .geometries = geometries,
                                .options.target = TARGET_PORTABLE};
    if (status == BVHD_OK)
        status = prepare_input(&input, scene->memory, parallel, &scene->bottoms[row], error);
    memory_free(scene->memory, geometries);
    scene->triangle_count += mesh->triangle_count;
    return status;
}

/*
 * Collects the instances in the order of the request. Instances that the tree leaves out come back without a reference.
 */
static void collect_instances(const struct portable_view *view, VkAccelerationStructureInstanceKHR *records)
{
    const struct portable_instance *rows = view->records;
    memset(records, 0, ((size_t)view->header->primitive_count + 1) * sizeof *records);
    for (uint32_t i = 0; i < view->header->record_count; i++) {
        VkAccelerationStructureInstanceKHR *record = &records[rows[i].instance];
        memcpy(&record->transform, rows[i].object_to_world, sizeof record->transform);
        record->instanceCustomIndex = rows[i].custom_and_mask & 0xffffff;
        record->mask = rows[i].custom_and_mask >> 24;
        record->instanceShaderBindingTableRecordOffset = rows[i].sbt_and_flags & 0xffffff;
        record->flags = rows[i].sbt_and_flags >> 24;
        record->accelerationStructureReference = (uint64_t)rows[i].handle + 1;
    }
}

static void describe_reference(const struct bench_scene *scene, uint32_t row, const struct parallel *parallel,
                               struct reference *reference)
{
    const struct build_context context = {.memory = scene->memory, .parallel = parallel};
    const struct portable_header *header = bench_scene_bottom(scene, row)->header;
    uint64_t name = (uint64_t)row + 1;
    *reference = (struct reference){.kind = REFERENCE_BLAS, .handle = name, .has_key = true};
    memcpy(&reference->key, &name, sizeof name);
    memcpy(&reference->bounds, header->bounds, sizeof reference->bounds);
    outline_find(&scene->bottoms[row], &context, &reference->slabs);
}

static enum bvhd_status open_top(struct bench_scene *scene, const struct parallel *parallel, struct bvhd_error *error)
{
    const struct portable_view *view = bench_scene_top(scene);
    uint32_t count = view->header->primitive_count, references = scene->given.bottom_count;
    VkAccelerationStructureInstanceKHR *records = memory_array(scene->memory, (uint64_t)count + 1, sizeof *records);
    struct reference *table = memory_array(scene->memory, (uint64_t)references + 1, sizeof *table);
    enum bvhd_status status = records && table ? BVHD_OK : no_memory(error);
    if (status == BVHD_OK) {
        collect_instances(view, records);
        for (uint32_t i = 0; i < references; i++)
            describe_reference(scene, i, parallel, &table[i]);
        struct geometry geometry = {.type = GEOMETRY_INSTANCES,
                                    .instances = {{(unsigned char *)records, (uint64_t)count * sizeof *records}},
                                    .range.primitive_count = count};
        struct build_input input = {.type = STRUCTURE_TOP,
                                    .flags = BUILD_PREFER_FAST_TRACE,
                                    .geometry_count = 1,
                                    .geometries = &geometry,
                                    .reference_count = references,
                                    .references = table,
                                    .options.target = TARGET_PORTABLE};
        status = prepare_input(&input, scene->memory, parallel, &scene->top, error);
    }
    memory_free(scene->memory, table);
    memory_free(scene->memory, records);
    return status;
}

/*
 * Leaves out a top level of one instance. Its transform is lost with it: the scene becomes the mesh in its own space.
 */
static enum bvhd_status leave_out_top(struct bench_scene *scene, struct bvhd_error *error)
{
    struct structures *given = &scene->given;
    if (!given->has_top || bench_scene_top(scene)->header->primitive_count != 1)
        return BVHD_OK;
    structures_separate(given);
    structures_close_file(&given->files[--given->file_count], given->memory);
    given->has_top = false;
    return structures_join(given, error);
}

static enum bvhd_status take_apart(struct bench_scene *scene, const struct bench_scene_options *options,
                                   const struct parallel *parallel, struct bvhd_error *error)
{
    uint32_t count = scene->given.bottom_count;
    enum bvhd_status status = BVHD_OK;
    if (scene->given.target != TARGET_PORTABLE)
        return bvhd_error_set(error, BVHD_UNSUPPORTED, options->directory,
                              "a directory of the portable target is needed");
    for (uint32_t i = 0; i < scene->given.file_count; i++)
        if (scene->given.files[i].structure.moves)
            return bvhd_error_set(error, BVHD_UNSUPPORTED, options->directory, "what moves is not measured here");
    scene->bottoms = memory_array(scene->memory, (uint64_t)count + 1, sizeof *scene->bottoms);
    scene->meshes = memory_array(scene->memory, (uint64_t)count + 1, sizeof *scene->meshes);
    if (!scene->bottoms || !scene->meshes)
        return no_memory(error);
    memset(scene->bottoms, 0, (size_t)count * sizeof *scene->bottoms);
    memset(scene->meshes, 0, (size_t)count * sizeof *scene->meshes);
    for (uint32_t row = 0; row < count && status == BVHD_OK; row++)
        status = open_bottom(scene, row, options, parallel, error);
    if (status == BVHD_OK && scene->given.has_top)
        status = open_top(scene, parallel, error);
    return status;
}

enum bvhd_status bench_scene_open(const struct bench_scene_options *options, struct memory *memory,
                                  const struct parallel *parallel, struct bench_scene *ret_scene,
                                  struct bvhd_error *error)
{
    struct bench_scene scene = {.memory = memory};
    enum bvhd_status status = structures_open(options->directory, NULL, memory, &scene.given, error);
    if (status != BVHD_OK)
        return status;
    if (options->is_bottom)
        status = leave_out_top(&scene, error);
    if (status == BVHD_OK)
        status = take_apart(&scene, options, parallel, error);
    if (status != BVHD_OK)
        bench_scene_close(&scene);
    else
        *ret_scene = scene;
    return status;
}

void bench_scene_close(struct bench_scene *scene)
{
    for (uint32_t i = 0; i < scene->given.bottom_count; i++) {
        if (scene->bottoms)
            prepare_finish(&scene->bottoms[i], scene->memory);
        if (scene->meshes) {
            memory_free(scene->memory, scene->meshes[i].positions);
            memory_free(scene->memory, scene->meshes[i].indices);
        }
    }
    prepare_finish(&scene->top, scene->memory);
    memory_free(scene->memory, scene->bottoms);
    memory_free(scene->memory, scene->meshes);
    structures_close(&scene->given);
}

/* ---- Building it again ---- */

static enum bvhd_status build_file(const struct canonical *canonical, const struct build_options *options,
                                   const struct build_context *context, struct structure_file *file,
                                   struct bvhd_error *error)
{
    struct build_stats stats;
    enum bvhd_status status = build(canonical, options, context, &file->data, &stats, error);
    if (status != BVHD_OK)
        return status;
    file->size = stats.sizes.total;
    status = structure_open((struct bytes){file->data, file->size}, context->memory, &file->structure, error);
    if (status != BVHD_OK) {
        memory_free(context->memory, file->data);
        file->data = NULL;
    }
    return status;
}

/*
 * The rows of a top level that was prepared again are those of the given one, because both are in the order in which
 * instances name them.
 */
enum bvhd_status bench_scene_build(const struct bench_scene *scene, const struct build_options *options,
                                   const struct build_context *context, struct structures *ret_structures,
                                   struct bvhd_error *error)
{
    uint32_t count = scene->given.bottom_count + scene->given.has_top;
    struct structures structures = {.memory = context->memory, .has_top = scene->given.has_top};
    structures.name = memory_alloc(context->memory, strlen(scene->given.name) + 1);
    structures.files = memory_array(context->memory, (uint64_t)count + 1, sizeof *structures.files);
    enum bvhd_status status = structures.name && structures.files ? BVHD_OK : no_memory(error);
    if (status == BVHD_OK)
        strcpy(structures.name, scene->given.name);
    for (uint32_t i = 0; i < count && status == BVHD_OK; i++) {
        structures.files[i] = (struct structure_file){0};
        status = build_file(i < scene->given.bottom_count ? &scene->bottoms[i] : &scene->top, options, context,
                            &structures.files[i], error);
        structures.file_count += status == BVHD_OK;
    }
    if (status == BVHD_OK)
        status = structures_join(&structures, error);
    if (status != BVHD_OK)
        structures_close(&structures);
    else
        *ret_structures = structures;
    return status;
}

/* ---- The driver's structures ---- */

static enum bvhd_status build_bottom(struct bench_driver *driver, const struct canonical *canonical,
                                     struct driver_structure *ret_structure, struct bvhd_error *error)
{
    struct driver_structure loose;
    enum bvhd_status status = driver_structure_build(driver->gpu, canonical, NULL, driver->memory, &loose, error);
    if (status != BVHD_OK)
        return status;
    status = driver_structure_copy(driver->gpu, &loose, VK_COPY_ACCELERATION_STRUCTURE_MODE_COMPACT_KHR, ret_structure,
                                   error);
    driver_structure_destroy(driver->gpu, &loose);
    if (status == BVHD_OK)
        driver->bytes += ret_structure->size;
    return status;
}

static enum bvhd_status build_top(struct bench_driver *driver, const struct bench_scene *scene,
                                  struct bvhd_error *error)
{
    if (!scene->given.has_top)
        return driver_structure_top_of(driver->gpu, driver->bottoms[0].address, &driver->top, error);
    uint64_t *addresses = memory_array(driver->memory, (uint64_t)driver->bottom_count + 1, sizeof *addresses);
    if (!addresses)
        return no_memory(error);
    for (uint32_t i = 0; i < scene->top.reference_count; i++) {
        uint64_t name;
        memcpy(&name, &scene->top.references[i].key, sizeof name);
        addresses[i] = driver->bottoms[name - 1].address;
    }
    enum bvhd_status status =
        driver_structure_build(driver->gpu, &scene->top, addresses, driver->memory, &driver->top, error);
    memory_free(driver->memory, addresses);
    return status;
}

enum bvhd_status bench_driver_build(struct gpu *gpu, const struct bench_scene *scene, struct memory *memory,
                                    struct bench_driver *ret_driver, struct bvhd_error *error)
{
    struct bench_driver driver = {.gpu = gpu, .memory = memory, .bottom_count = scene->given.bottom_count};
    uint64_t began = clock_ns();
    driver.bottoms = memory_array(memory, (uint64_t)driver.bottom_count + 1, sizeof *driver.bottoms);
    if (!driver.bottoms)
        return no_memory(error);
    memset(driver.bottoms, 0, driver.bottom_count * sizeof *driver.bottoms);
    enum bvhd_status status = BVHD_OK;
    for (uint32_t i = 0; i < driver.bottom_count && status == BVHD_OK; i++)
        status = build_bottom(&driver, &scene->bottoms[i], &driver.bottoms[i], error);
    if (status == BVHD_OK)
        status = build_top(&driver, scene, error);
    if (status != BVHD_OK) {
        bench_driver_destroy(&driver);
        return status;
    }
    driver.bytes += driver.top.size;
    driver.build_ms = (double)(clock_ns() - began) * 1e-6;
    *ret_driver = driver;
    return BVHD_OK;
}

void bench_driver_destroy(struct bench_driver *driver)
{
    driver_structure_destroy(driver->gpu, &driver->top);
    for (uint32_t i = 0; i < driver->bottom_count; i++)
        driver_structure_destroy(driver->gpu, &driver->bottoms[i]);
    memory_free(driver->memory, driver->bottoms);
    *driver = (struct bench_driver){0};
}
