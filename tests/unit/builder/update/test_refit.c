/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_refit.c - tests that an update keeps the tree and fits its boxes: it is no build, does not depend on threads,
 * tells its decay, and leaves nothing behind when it fails. tests/integration/random_inputs traces rays through
 * updates.
 */
#include "tests/support/unit.h"

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
    NATIVE,
    NATIVE_COMPACTED,
    NATIVE_AABBS,
    NATIVE_TOP,
    KINDS
};

/* The geometry of all kinds, and its request. */
struct world {
    float vertices[VERTICES][3];
    float radii[VERTICES];
    uint32_t indices[TRIANGLES][3];
    uint32_t strands[SWEPT_SPHERES]; /* the rows of the sheet as chains */
    float corners[TRIANGLES][3][3];
    float boxes[BOXES][6];
    unsigned char instances[INSTANCES][64];
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

static bool is_native(enum kind kind)
{
    return kind >= NATIVE;
}

/* Twists a sheet around the y axis; `amount` 0 is the frame that is built. */
static void place_vertices(struct world *world, double amount)
{
    for (uint32_t i = 0; i < VERTICES; i++) {
        const double x = (double)(i % SIDE) / SIDE - 0.5, y = (double)(i / SIDE) / SIDE - 0.5,
                     z = 0.1 * sin(9 * x) * cos(7 * y), angle = amount * y;
        world->vertices[i][0] = (float)(x * cos(angle) + z * sin(angle) + 0.25 * amount);
        world->vertices[i][1] = (float)y;
        world->vertices[i][2] = (float)(z * cos(angle) - x * sin(angle));
        world->radii[i] = (float)(0.004 * (1 + 0.9 * sin(i + amount)));
    }
    world->radii[VERTICES - 1] = NAN;
    for (uint32_t i = 0; i < TRIANGLES; i++)
        for (int k = 0; k < 3; k++)
            memcpy(world->corners[i][k], world->vertices[world->indices[i][k]], 12);
}

static void place_boxes(struct world *world, double amount)
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

static void place_instances(struct world *world, double amount)
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

static void place(struct world *world, double amount)
{
    place_vertices(world, amount);
    place_boxes(world, amount);
    place_instances(world, amount);
}

static struct geometry_spheres ends(const struct world *world)
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
static void set_round_geometry(struct world *world, enum kind kind)
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

static struct geometry mesh_geometry(const struct world *world)
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

static void set_geometry(struct world *world, enum kind kind)
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
}

static struct world *world_of(enum kind kind)
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
    set_geometry(world, kind);
    world->input.type = kind == TOP || kind == NATIVE_TOP ? STRUCTURE_TOP : STRUCTURE_BOTTOM;
    world->input.flags = BUILD_ALLOW_UPDATE;
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

static struct canonical canonical_of(const struct world *world)
{
    const struct limits limits = limits_default();
    struct canonical canonical;
    struct bvhd_error error;
    if (prepare(&world->input, 0, &limits, &serial, &canonical, &error) != BVHD_OK)
        fail_msg("%s: %s", error.where, error.text);
    return canonical;
}

/* Builds, and makes the record. */
static struct built build_world(const struct world *world)
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

static enum bvhd_status try_update(const struct world *world, const struct built *source,
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

static struct built update_world(const struct world *world, const struct built *source)
{
    struct built built;
    struct bvhd_error error;
    if (try_update(world, source, &serial, &built, &error) != BVHD_OK)
        fail_msg("%s: %s", error.where, error.text);
    return built;
}

static void built_finish(struct built *built)
{
    record_finish(&built->record, &memory);
    memory_free(&memory, built->blob);
}

static void world_finish(struct world *world)
{
    assert_int_equal(memory.live, 0);
    free(world);
}

/* An update with the same geometry gives the same bytes: the boxes are those that the build made. */
static void equal_geometry_gives_equal_bytes(void **state)
{
    (void)state;
    for (enum kind kind = INDEXED; kind < KINDS; kind++) {
        struct world *world = world_of(kind);
        struct built source = build_world(world), updated = update_world(world, &source);
        assert_int_equal(updated.size, source.size);
        for (uint64_t i = 0; i < source.size; i++)
            if (updated.blob[i] != source.blob[i])
                fail_msg("kind %d: byte %llu is %d instead of %d", (int)kind, (unsigned long long)i, updated.blob[i],
                         source.blob[i]);
        assert_true(updated.result.decay == 1);
        assert_int_equal(updated.result.refits, 1);
        assert_memory_equal(&updated.stats.bounds, &source.stats.bounds, sizeof source.stats.bounds);
        assert_memory_equal(&updated.stats.slabs, &source.stats.slabs, sizeof source.stats.slabs);
        assert_int_equal(updated.stats.triangles, source.stats.triangles);
        assert_int_equal(updated.stats.instances, source.stats.instances);
        assert_int_equal(updated.stats.inactive, source.stats.inactive);
        assert_int_equal(updated.stats.refs, source.stats.refs);
        assert_string_equal(updated.stats.method, "refit");
        assert_int_equal(updated.stats.quality, QUALITY_BALANCED);
        built_finish(&updated);
        built_finish(&source);
        world_finish(world);
    }
}

static struct portable_view open_portable(const struct built *built)
{
    struct portable_view view;
    struct bvhd_error error;
    if (portable_open((struct bytes){built->blob, built->size}, &memory, &view, &error) != BVHD_OK)
        fail_msg("%s: %s", error.where, error.text);
    return view;
}

static struct lavapipe_view open_native(const struct built *built)
{
    struct lavapipe_view view;
    struct bvhd_error error;
    if (lavapipe_open_any((struct bytes){built->blob, built->size}, &memory, &view, &error) != BVHD_OK)
        fail_msg("%s: %s", error.where, error.text);
    return view;
}

/* The fields of nodes that say what is where. A rebuild for other geometry has others. */
static void same_topology(const struct built *source, const struct built *updated)
{
    const struct portable_view a = open_portable(source), b = open_portable(updated);
    assert_int_equal(a.header->node_count, b.header->node_count);
    for (uint32_t i = 0; i < a.header->node_count; i++) {
        assert_int_equal(a.nodes[i].first_child, b.nodes[i].first_child);
        assert_int_equal(a.nodes[i].first_record, b.nodes[i].first_record);
        assert_int_equal(a.nodes[i].inner_mask, b.nodes[i].inner_mask);
        assert_memory_equal(a.nodes[i].meta, b.nodes[i].meta, 8);
    }
    if (a.header->content == PORTABLE_INDEXED_TRIANGLES)
        assert_memory_equal(a.records, b.records, 16 * (size_t)a.header->record_count);
    if (a.header->content == PORTABLE_SPHERES || a.header->content == PORTABLE_SWEPT_SPHERES)
        assert_memory_equal(a.records, b.records, sizeof(struct portable_round) * a.header->record_count);
}

static void same_references(const struct built *source, const struct built *updated)
{
    const struct lavapipe_view a = open_native(source), b = open_native(updated);
    assert_int_equal(a.body_size, b.body_size);
    assert_int_equal(a.levels, b.levels);
    for (uint32_t at = LAVAPIPE_HEADER; at < a.leaf_offset; at += sizeof(struct lavapipe_box)) {
        const struct lavapipe_box first = lavapipe_box_at(&a, at), second = lavapipe_box_at(&b, at);
        assert_memory_equal(first.children, second.children, sizeof first.children);
    }
}

static void updates_are_refits(void **state)
{
    (void)state;
    for (enum kind kind = INDEXED; kind < KINDS; kind++) {
        struct world *world = world_of(kind);
        struct built source = build_world(world);
        place(world, 6);
        struct built updated = update_world(world, &source), rebuilt = build_world(world);
        if (is_native(kind))
            same_references(&source, &updated);
        else
            same_topology(&source, &updated);
        assert_true(updated.size != rebuilt.size || memcmp(updated.blob, rebuilt.blob, updated.size) != 0);
        assert_memory_equal(&updated.stats.bounds, &rebuilt.stats.bounds, sizeof rebuilt.stats.bounds);
        assert_true(updated.result.decay > 1.05); /* rows turn as a whole, so that strands decay the least */
        built_finish(&rebuilt);
        built_finish(&updated);
        built_finish(&source);
        world_finish(world);
    }
}

/* The decay of a chain is that against the build, and going back undoes it. */
static void chains_count_and_compare_with_the_build(void **state)
{
    (void)state;
    for (enum kind kind = INDEXED; kind < KINDS; kind++) {
        struct world *world = world_of(kind);
        struct built source = build_world(world), last = source;
        for (uint32_t step = 1; step <= 3; step++) {
            place(world, step == 3 ? 0 : 3 * step);
            struct built next = update_world(world, &last);
            assert_int_equal(next.result.refits, step);
            assert_int_equal(next.record.header->refits, step);
            assert_true(next.record.header->cost == source.record.header->cost);
            assert_true((next.result.decay == 1) == (step == 3));
            if (step > 1)
                built_finish(&last);
            last = next;
        }
        assert_int_equal(last.size, source.size);
        assert_memory_equal(last.blob, source.blob, source.size);
        built_finish(&last);
        built_finish(&source);
        world_finish(world);
    }
}

static void threads_do_not_matter(void **state)
{
    struct workers *workers;
    (void)state;
    assert_int_equal(workers_create(5, &workers, NULL), BVHD_OK);
    const struct build_context threads = {.memory = &memory, .parallel = workers_parallel(workers)};
    for (enum kind kind = INDEXED; kind < KINDS; kind++) {
        struct world *world = world_of(kind);
        struct built source = build_world(world), other;
        place(world, 2);
        struct built updated = update_world(world, &source);
        assert_int_equal(try_update(world, &source, &threads, &other, NULL), BVHD_OK);
        assert_int_equal(other.size, updated.size);
        assert_memory_equal(other.blob, updated.blob, updated.size);
        assert_true(other.result.decay == updated.result.decay);
        assert_memory_equal(other.record.bytes.data, updated.record.bytes.data, updated.record.bytes.size);
        built_finish(&other);
        built_finish(&updated);
        built_finish(&source);
        world_finish(world);
    }
    workers_destroy(workers);
}

static void failures_leave_nothing(void **state)
{
    (void)state;
    for (enum kind kind = INDEXED; kind < KINDS; kind++) {
        struct world *world = world_of(kind);
        struct built source = build_world(world), updated;
        struct bvhd_error error;
        const uint64_t live = memory.live;
        struct memory tight;
        enum bvhd_status status = BVHD_NO_MEMORY;
        for (int64_t after = 0; status != BVHD_OK; after++) {
            memory_init_within(&tight, &memory, UINT64_MAX);
            tight.fail_after = after;
            const struct build_context context = {.memory = &tight, .parallel = &parallel_serial};
            status = try_update(world, &source, &context, &updated, &error);
            assert_true(status == BVHD_OK || (status == BVHD_NO_MEMORY && tight.live == 0));
            assert_true(after < 20);
        }
        record_finish(&updated.record, &tight);
        memory_free(&tight, updated.blob);
        atomic_bool cancel = true;
        const struct build_context context = {.memory = &memory, .parallel = &parallel_serial, .cancel = &cancel};
        assert_int_equal(try_update(world, &source, &context, &updated, &error), BVHD_CANCELLED);
        assert_int_equal(memory.live, live);
        built_finish(&source);
        world_finish(world);
    }
}

/* Changes one byte of the source. The result is a status, and what is made of it can be opened or is told apart. */
static void foreign_sources_are_safe(void **state)
{
    (void)state;
    for (enum kind kind = INDEXED; kind < KINDS; kind++) {
        struct random random = {4711};
        struct world *world = world_of(kind);
        struct built source = build_world(world), updated;
        uint32_t refused = 0;
        for (int round = 0; round < 60; round++) {
            const uint64_t at = round < 30 ? random_next(&random) % 400 : random_next(&random) % source.size;
            const unsigned char before = source.blob[at];
            struct bvhd_error error = {.where = "", .text = ""};
            source.blob[at] ^= (unsigned char)(1 + random_next(&random) % 255);
            enum bvhd_status status = try_update(world, &source, &serial, &updated, &error);
            source.blob[at] = before;
            if (status == BVHD_OK) {
                built_finish(&updated);
                continue;
            }
            refused++;
            assert_true(status == BVHD_CORRUPT || status == BVHD_INCOMPATIBLE);
            assert_true(error.where[0] && error.text[0]);
        }
        assert_true(refused > 5);
        for (uint64_t size = 0; size < source.size; size += 1 + size / 3) {
            struct built cut = source;
            struct bvhd_error error;
            cut.size = size;
            assert_int_equal(try_update(world, &cut, &serial, &updated, &error), BVHD_CORRUPT);
        }
        built_finish(&source);
        world_finish(world);
    }
}

/* Boxes whose minimum is above their maximum give a tree a negative cost, which no build does. */
static void inverted_boxes_have_no_cost(void **state)
{
    (void)state;
    struct world *world = world_of(INDEXED);
    struct built source = build_world(world);
    struct bvhd_error error;
    const uint64_t body = bytes_align(SERIALIZED_HANDLES, PORTABLE_BODY_ALIGNMENT);
    const struct portable_header *header = (const void *)(source.blob + body);
    struct portable_node *nodes = (void *)(source.blob + body + header->node_offset);
    for (uint32_t i = 0; i < header->node_count; i++)
        for (int slot = 0; slot < 8; slot++) {
            const uint8_t lo = nodes[i].lo[0][slot];
            nodes[i].lo[0][slot] = nodes[i].hi[0][slot];
            nodes[i].hi[0][slot] = lo;
            nodes[i].hi[1][slot] = nodes[i].lo[1][slot];
        }
    assert_int_equal(
        refit_measure((struct bytes){source.blob, source.size}, &source.stats, &serial, &source.record, &error),
        BVHD_CORRUPT);
    assert_string_equal(error.where, "nodes");
    built_finish(&source);
    world_finish(world);
}

/* Structures without any primitive that a ray can hit stay so. */
static void empty_structures_stay_empty(void **state)
{
    (void)state;
    for (enum kind kind = INDEXED; kind < KINDS; kind++) {
        struct world *world = world_of(kind);
        for (int i = 0; i < VERTICES; i++)
            world->vertices[i][0] = NAN;
        for (int i = 0; i < TRIANGLES; i++)
            world->corners[i][1][0] = NAN;
        for (int i = 0; i < BOXES; i++)
            world->boxes[i][0] = NAN;
        for (int i = 0; i < INSTANCES; i++)
            memset(world->instances[i] + 56, 0, 8);
        struct built source = build_world(world);
        world->vertices[0][1] = 7;
        struct built updated = update_world(world, &source);
        assert_true(updated.result.decay == 1);
        assert_int_equal(updated.stats.refs, 0);
        assert_int_equal(updated.size, source.size);
        if (is_native(kind))
            open_native(&updated);
        else
            open_portable(&updated);
        built_finish(&updated);
        built_finish(&source);
        world_finish(world);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(equal_geometry_gives_equal_bytes),
        cmocka_unit_test(updates_are_refits),
        cmocka_unit_test(chains_count_and_compare_with_the_build),
        cmocka_unit_test(threads_do_not_matter),
        cmocka_unit_test(failures_leave_nothing),
        cmocka_unit_test(foreign_sources_are_safe),
        cmocka_unit_test(inverted_boxes_have_no_cost),
        cmocka_unit_test(empty_structures_stay_empty),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
