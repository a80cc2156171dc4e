/* SPDX-License-Identifier: Apache-2.0 */
/*
 * refit_world.h - a structure of each kind that updates treat in a way of its own, its geometry at any moment of a
 * movement, and how it is built and updated. For unit tests of updates, which include tests/support/unit.h first.
 */
#ifndef BVHD_TEST_REFIT_WORLD_H
#define BVHD_TEST_REFIT_WORLD_H

#include <math.h>

#include "builder/format/lavapipe.h"
#include "builder/format/portable.h"
#include "builder/format/serialized.h"
#include "builder/input/prepare.h"
#include "builder/update/refit.h"
#include "builder/update/update_rules.h"
#include "builder/workers.h"
#include "tests/support/random.h"

enum {
    SIDE = 70,
    VERTICES = SIDE * SIDE,
    TRIANGLES = 2 * (SIDE - 1) * (SIDE - 1),
    BOXES = 3000,
    INSTANCES = 500,
    SWEPT_SPHERES = SIDE * (SIDE - 1)
};

/* The kinds of structures. Each has its own way from bytes to boxes. */
enum kind {
    INDEXED,
    DROPPED,
    LOOSE,
    FAST,
    AABBS,
    TOP,
    SPHERES,
    DROPPED_SPHERES,
    SWEPT,
    DROPPED_SWEPT,
    MOVING,
    DROPPED_MOVING,
    MIXED,
    MOVING_TOP,
    NATIVE,
    NATIVE_COMPACTED,
    NATIVE_AABBS,
    NATIVE_TOP,
    KINDS
};

/* The geometry of all kinds, and its request. */
struct world {
    float vertices[VERTICES][3], end_vertices[VERTICES][3];
    float radii[VERTICES];
    uint32_t indices[TRIANGLES][3];
    uint32_t strands[SWEPT_SPHERES]; /* the rows of the sheet as chains */
    float corners[TRIANGLES][3][3];
    float boxes[BOXES][6];
    unsigned char instances[INSTANCES][64];
    unsigned char moving_instances[INSTANCES][MOTION_RECORD_STRIDE];
    struct reference references[2];
    struct geometry geometries[2];
    struct build_input input;
};

struct built {
    unsigned char *blob;
    uint64_t size;
    struct build_stats stats;
    struct refit_result result;
    struct record record;
};

static struct memory memory = {.limit = UINT64_MAX, .fail_after = -1};

static inline bool is_native(enum kind kind)
{
    return kind >= NATIVE;
}

/* Twists a sheet around the y axis. */
static inline void place_sheet(float (*vertices)[3], double amount)
{
    for (uint32_t i = 0; i < VERTICES; i++) {
        const double x = (double)(i % SIDE) / SIDE - 0.5, y = (double)(i / SIDE) / SIDE - 0.5,
                     z = 0.1 * sin(9 * x) * cos(7 * y), angle = amount * y;
        vertices[i][0] = (float)(x * cos(angle) + z * sin(angle) + 0.25 * amount);
        vertices[i][1] = (float)y;
        vertices[i][2] = (float)(z * cos(angle) - x * sin(angle));
    }
}

/* `amount` 0 is the frame that is built. What moves twists on from t = 0 to t = 1. */
static inline void place_vertices(struct world *world, double amount)
{
    place_sheet(world->vertices, amount);
    place_sheet(world->end_vertices, 1.25 * amount + 0.3);
    for (uint32_t i = 0; i < VERTICES; i++)
        world->radii[i] = (float)(0.004 * (1 + 0.9 * sin(i + amount)));
    world->radii[VERTICES - 1] = NAN;
    for (uint32_t i = 0; i < TRIANGLES; i++)
        for (int k = 0; k < 3; k++)
            memcpy(world->corners[i][k], world->vertices[world->indices[i][k]], 12);
}

static inline void place_boxes(struct world *world, double amount)
{
    struct random random = {5}, shift = {6};
    for (int i = 0; i < BOXES; i++)
        for (int axis = 0; axis < 3; axis++) {
            const double at = random_between(&random, -1, 1) + amount * random_between(&shift, -1, 1);
            world->boxes[i][axis] = (float)at;
            world->boxes[i][3 + axis] = (float)(at + random_between(&random, 0, 0.05));
        }
    world->boxes[77][0] = NAN;
}

static inline void place_instances(struct world *world, double amount)
{
    struct random random = {7}, shift = {8};
    for (int i = 0; i < INSTANCES; i++) {
        float matrix[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
        for (int axis = 0; axis < 3; axis++)
            matrix[4 * axis + 3] =
                (float)(random_between(&random, -20, 20) + 10 * amount * random_between(&shift, -1, 1));
        const uint64_t handle = i % 50 == 7 ? 0 : 100 + (uint64_t)(i + (int)amount) % 2;
        memset(world->instances[i], 0xff, 64);
        memcpy(world->instances[i], matrix, sizeof matrix);
        memcpy(world->instances[i] + 48, &(uint64_t){UINT64_C(0xff000000)}, 8);
        memcpy(world->instances[i] + 56, &handle, 8);
    }
}

/* Instances go from where they are to another place. With the amount each becomes one of another type. */
static inline void place_moving_instances(struct world *world, double amount)
{
    static const float unit[16] = {1, 0, 0, 0, 1, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0};
    struct random shift = {9};
    for (int i = 0; i < INSTANCES; i++) {
        float numbers[2][16];
        const uint32_t type = (uint32_t)(i + (int)amount) % MOTION_TYPES, count = type == MOTION_SRT ? 16 : 12;
        unsigned char *record = world->moving_instances[i];
        for (int key = 0; key < 2; key++) {
            memcpy(numbers[key], type == MOTION_SRT ? (const void *)unit : world->instances[i], 4 * count);
            for (uint32_t axis = 0; axis < 3; axis++) {
                float *at = &numbers[key][type == MOTION_SRT ? 13 + axis : 4 * axis + 3];
                memcpy(at, world->instances[i] + 16 * axis + 12, sizeof *at);
                *at += (float)(key * random_between(&shift, -1, 1));
            }
        }
        if (type == MOTION_SRT)
            numbers[1][9] = 0.75f; /* a turn round x */
        memset(record, 0xff, MOTION_RECORD_STRIDE);
        memcpy(record, (const uint32_t[2]){type, 0}, MOTION_RECORD_DATA);
        memcpy(record + MOTION_RECORD_DATA, numbers[0], 4 * count);
        memcpy(record + MOTION_RECORD_DATA + 4 * count, numbers[1], type == MOTION_STATIC ? 0 : 4 * count);
        memcpy(record + canonical_record_fields(GEOMETRY_MOVING_INSTANCES, record), world->instances[i] + 48, 16);
    }
}

static inline void place(struct world *world, double amount)
{
    place_vertices(world, amount);
    place_boxes(world, amount);
    place_instances(world, amount);
    place_moving_instances(world, amount);
}

static inline struct geometry_spheres ends(const struct world *world)
{
    return (struct geometry_spheres){
        .vertex_format = 106,
        .radius_format = 100,
        .index_type = INDEX_UINT32,
        .vertex_stride = 12,
        .radius_stride = 4,
        .index_stride = 4,
        .vertices = {(const unsigned char *)world->vertices, sizeof world->vertices},
        .radii = {(const unsigned char *)world->radii, sizeof world->radii},
        .indices = {(const unsigned char *)world->strands, sizeof world->strands},
    };
}

/* Spheres are the vertices, and linear swept spheres are chains of them. The last one is inactive. */
static inline void set_round_geometry(struct world *world, enum kind kind)
{
    struct geometry *first = &world->geometries[0];
    if (kind == SPHERES || kind == DROPPED_SPHERES) {
        *first = (struct geometry){.type = GEOMETRY_SPHERES, .range = {.primitive_count = VERTICES}};
        first->spheres = ends(world);
        first->spheres.index_type = INDEX_NONE;
        first->spheres.indices = (struct bytes){NULL, 0};
    } else {
        *first = (struct geometry){.type = GEOMETRY_SWEPT_SPHERES, .range = {.primitive_count = SWEPT_SPHERES}};
        first->swept_spheres = (struct geometry_swept_spheres){ends(world), SWEPT_SUCCESSIVE, SWEPT_CAPS_CHAINED};
    }
    if (kind == DROPPED_SPHERES || kind == DROPPED_SWEPT) { /* every second one */
        world->geometries[1] = *first;
        world->geometries[1].range.primitive_count = 700;
        world->geometries[1].spheres.index_type = INDEX_UINT32;
        world->geometries[1].spheres.index_stride = 8;
        world->geometries[1].spheres.indices = ends(world).indices;
        world->input.geometry_count = 2;
    }
}

static inline struct geometry mesh_geometry(const struct world *world)
{
    return (struct geometry){
        .type = GEOMETRY_TRIANGLES,
        .triangles = {.vertex_format = 106,
                      .max_vertex = VERTICES - 1,
                      .vertex_stride = 12,
                      .index_type = INDEX_UINT32,
                      .vertices = {(const unsigned char *)world->vertices, sizeof world->vertices},
                      .indices = {(const unsigned char *)world->indices, sizeof world->indices}},
        .range = {.primitive_count = TRIANGLES},
    };
}

/* Of a mixed structure, the second geometry moves. */
static inline void set_moving_geometry(struct world *world, enum kind kind)
{
    world->input.flags |= BUILD_MOTION;
    if (kind == MOVING_TOP) {
        world->geometries[0] = (struct geometry){
            .type = GEOMETRY_MOVING_INSTANCES,
            .instances = {{(const unsigned char *)world->moving_instances, sizeof world->moving_instances}},
            .range = {.primitive_count = INSTANCES}};
        return;
    }
    world->input.geometry_count = kind == MOVING ? 1 : 2;
    if (kind != MOVING) { /* the first geometry is a part of the second one */
        world->geometries[1] = mesh_geometry(world);
        world->geometries[0].range = (struct geometry_range){.primitive_count = 900, .primitive_offset = 12 * 4000};
    }
    for (uint32_t g = kind == MIXED ? 1 : 0; g < world->input.geometry_count; g++) {
        world->geometries[g].type = GEOMETRY_MOVING_TRIANGLES;
        world->geometries[g].triangles.end_vertices =
            (struct bytes){(const unsigned char *)world->end_vertices, sizeof world->end_vertices};
    }
}

static inline void set_geometry(struct world *world, enum kind kind)
{
    struct geometry *first = &world->geometries[0];
    world->input.geometry_count = 1;
    *first = mesh_geometry(world);
    if (kind == DROPPED) { /* only some of the first geometry's vertices are used */
        world->geometries[1] = *first;
        first->range = (struct geometry_range){.primitive_count = 40, .primitive_offset = 12 * 4000};
        world->input.geometry_count = 2;
    }
    if (kind == LOOSE) {
        first->triangles.index_type = INDEX_NONE;
        first->triangles.vertices = (struct bytes){(const unsigned char *)world->corners, sizeof world->corners};
        first->triangles.max_vertex = 3 * TRIANGLES - 1;
    }
    if (kind == AABBS || kind == NATIVE_AABBS)
        *first = (struct geometry){.type = GEOMETRY_AABBS,
                                   .aabbs = {24, {(const unsigned char *)world->boxes, sizeof world->boxes}},
                                   .range = {.primitive_count = BOXES}};
    if (kind == TOP || kind == NATIVE_TOP)
        *first = (struct geometry){.type = GEOMETRY_INSTANCES,
                                   .instances = {{(const unsigned char *)world->instances, sizeof world->instances}},
                                   .range = {.primitive_count = INSTANCES}};
    if (kind >= SPHERES && kind <= DROPPED_SWEPT)
        set_round_geometry(world, kind);
    if (kind >= MOVING && kind <= MOVING_TOP)
        set_moving_geometry(world, kind);
}

static inline struct world *world_of(enum kind kind)
{
    struct world *world = calloc(1, sizeof *world);
    for (uint32_t i = 0; i < TRIANGLES; i++) {
        const uint32_t quad = i / 2, a = quad / (SIDE - 1) * SIDE + quad % (SIDE - 1);
        const uint32_t corners[2][3] = {{a, a + 1, a + SIDE}, {a + 1, a + SIDE + 1, a + SIDE}};
        memcpy(world->indices[i], corners[i % 2], sizeof corners[0]);
    }
    for (uint32_t i = 0; i < SWEPT_SPHERES; i++)
        world->strands[i] = i + i / (SIDE - 1);
    place(world, 0);
    for (int i = 0; i < 2; i++)
        world->references[i] = (struct reference){.kind = REFERENCE_BLAS,
                                                  .handle = 100 + (uint64_t)i,
                                                  .has_key = true,
                                                  .bounds = {{-1, -1, -1}, {1, (float)(i + 1), 1}}};
    world->input.flags = BUILD_ALLOW_UPDATE;
    set_geometry(world, kind);
    world->input.type = kind == TOP || kind == NATIVE_TOP || kind == MOVING_TOP ? STRUCTURE_TOP : STRUCTURE_BOTTOM;
    world->input.geometries = world->geometries;
    world->input.references = world->references;
    world->input.reference_count = world->input.type == STRUCTURE_TOP ? 2 : 0;
    world->input.options = (struct build_options){.quality = QUALITY_BALANCED, .target = TARGET_PORTABLE};
    world->input.options.layout_flags = kind == FAST ? PORTABLE_FAST_TRIANGLES : 0;
    if (is_native(kind)) {
        world->input.options.target = TARGET_LAVAPIPE;
        world->input.options.device.variant = kind == NATIVE_COMPACTED ? LAVAPIPE_COMPACTED : LAVAPIPE_PLAIN;
        world->input.options.device.driver_uuid[3] = 9;
    }
    return world;
}

static const struct build_context serial = {.memory = &memory, .parallel = &parallel_serial};

static inline struct canonical canonical_of(const struct world *world)
{
    const struct limits limits = limits_default();
    struct canonical canonical;
    struct bvhd_error error;
    if (prepare(&world->input, 0, &limits, &serial, &canonical, &error) != BVHD_OK)
        fail_msg("%s: %s", error.where, error.text);
    return canonical;
}

/* Builds, and makes the record. */
static inline struct built build_world(const struct world *world)
{
    struct canonical canonical = canonical_of(world);
    struct built built = {.result = {.decay = 1}};
    struct bvhd_error error;
    if (record_make(&canonical, &world->input.options, &serial, &built.record, &error) != BVHD_OK ||
        build(&canonical, &world->input.options, &serial, &built.blob, &built.stats, &error) != BVHD_OK)
        fail_msg("%s: %s", error.where, error.text);
    built.size = built.stats.sizes.total;
    if (refit_measure((struct bytes){built.blob, built.size}, &built.stats, &serial, &built.record, &error) != BVHD_OK)
        fail_msg("%s: %s", error.where, error.text);
    prepare_finish(&canonical, &memory);
    return built;
}

static inline enum bvhd_status try_update(const struct world *world, const struct built *source,
                                          const struct build_context *context, struct built *ret_built,
                                          struct bvhd_error *error)
{
    struct canonical canonical = canonical_of(world);
    struct built built = {0};
    enum bvhd_status status = record_make(&canonical, &world->input.options, context, &built.record, error);
    if (status == BVHD_OK) {
        const struct refit_request request = {{source->blob, source->size}, &source->record, &canonical, &built.record};
        status = update_rules_check(&source->record, &built.record, 0, error);
        if (status == BVHD_OK)
            status = refit(&request, context, &built.blob, &built.stats, &built.result, error);
        built.size = built.stats.sizes.total;
        if (status != BVHD_OK)
            record_finish(&built.record, context->memory);
    }
    prepare_finish(&canonical, &memory);
    if (status == BVHD_OK)
        *ret_built = built;
    return status;
}

static inline struct built update_world(const struct world *world, const struct built *source)
{
    struct built built;
    struct bvhd_error error;
    if (try_update(world, source, &serial, &built, &error) != BVHD_OK)
        fail_msg("%s: %s", error.where, error.text);
    return built;
}

static inline void built_finish(struct built *built)
{
    record_finish(&built->record, &memory);
    memory_free(&memory, built->blob);
}

static inline void world_finish(struct world *world)
{
    assert_int_equal(memory.live, 0);
    free(world);
}

#endif
