/* SPDX-License-Identifier: Apache-2.0 */
/* test_update_micromap.c - tests what updates of triangles with micromaps may change, and what they then are. */
#include "tests/support/unit.h"

#include "builder/format/portable_micromap.h"
#include "builder/update/build_entry.h"
#include "proto/base/validate_shape.h"
#include "tests/support/builder/random_micromap.h"

enum { COUNT = 30, HANDLE = 9 };

static struct memory memory = {.limit = UINT64_MAX, .fail_after = -1};
static const struct build_context context = {.memory = &memory, .parallel = &parallel_serial};

/* A request with one geometry, which updates change. */
struct world {
    float corners[COUNT][3][3];
    struct geometry geometry;
    struct reference reference;
    struct build_input input;
    uint32_t indices[COUNT];
};

/* A structure that was built or updated, with its record. */
struct made {
    struct build_entry entry;
    struct build_made made;
};

static void world_start(struct world *world, struct random *random, const struct random_micromap *micromap,
                        uint32_t flags)
{
    *world = (struct world){.reference = random_micromap_reference(micromap, HANDLE)};
    for (int i = 0; i < COUNT * 9; i++)
        world->corners[i / 9][i / 3 % 3][i % 3] = (float)random_between(random, -1, 1);
    for (uint32_t i = 0; i < COUNT; i++)
        world->indices[i] = i % 5 == 4 ? ~(i / 5 % 4) : i % micromap->count;
    world->geometry = (struct geometry){
        .type = GEOMETRY_TRIANGLES,
        .triangles = {.vertex_format = 106,
                      .max_vertex = 3 * COUNT - 1,
                      .vertex_stride = 12,
                      .index_type = INDEX_NONE,
                      .vertices = {(const unsigned char *)world->corners, sizeof world->corners},
                      .micromap = {.is_given = 1,
                                   .index_type = INDEX_UINT32,
                                   .indices = {(const unsigned char *)world->indices, sizeof world->indices},
                                   .stride = 4,
                                   .micromap = HANDLE}},
        .range.primitive_count = COUNT};
    world->input = (struct build_input){.type = STRUCTURE_BOTTOM,
                                        .flags = BUILD_ALLOW_UPDATE | flags,
                                        .geometry_count = 1,
                                        .geometries = &world->geometry,
                                        .reference_count = 1,
                                        .references = &world->reference,
                                        .options = {.target = TARGET_PORTABLE, .quality = QUALITY_BALANCED}};
}

static enum bvhd_status try_make(struct world *world, const struct made *source, struct made *ret_made,
                                 struct bvhd_error *error)
{
    const struct limits limits = limits_default();
    struct build_entry_source from = {{NULL, 0}, {NULL, 0}};
    world->input.mode = source ? MODE_UPDATE : MODE_BUILD;
    world->input.source = source ? 1 : 0;
    if (source) {
        world->input.source_key = source->entry.key;
        from = (struct build_entry_source){{source->made.blob, source->made.size}, source->entry.record.bytes};
    }
    enum bvhd_status status =
        build_entry_prepare(&world->input, 2, &limits, source ? &from : NULL, &context, &ret_made->entry, error);
    if (status != BVHD_OK)
        return status;
    return build_entry_make(&ret_made->entry, source ? &from : NULL, &context, &ret_made->made, error);
}

static struct made make(struct world *world, const struct made *source)
{
    struct made made;
    struct bvhd_error error = {.status = BVHD_OK};
    if (try_make(world, source, &made, &error) != BVHD_OK)
        fail_msg("%s: %s", error.where, error.text);
    return made;
}

static void finish(struct made *made)
{
    memory_free(&memory, made->made.blob);
    build_entry_finish(&made->entry, &memory);
}

/* Compares the state of every triangle at a few points with that of the request. */
static void check(const struct world *world, const struct made *made, const struct random_micromap *micromap)
{
    struct portable_view view;
    struct portable_micromap_view opened;
    struct bvhd_error error;
    const struct random_attachment asked = {.micromap = micromap, .names = (uint32_t *)(uintptr_t)world->indices};
    assert_int_equal(portable_open((struct bytes){made->made.blob, made->made.size}, &memory, &view, &error), BVHD_OK);
    assert_int_equal(portable_micromap_open(micromap->blob, &opened, &error), BVHD_OK);
    assert_int_equal(view.header->version, PORTABLE_MICROMAP_VERSION);
    assert_int_equal(view.header->micromap_count, 1);
    assert_memory_equal(view.micromaps[0].key, micromap->key.bytes, sizeof view.micromaps[0].key);
    assert_int_equal(view.header->record_count, COUNT);
    for (uint32_t i = 0; i < view.header->record_count; i++) {
        const uint32_t id = ((const struct portable_indexed_triangle *)view.records)[i].id;
        const uint32_t triangle = id & PORTABLE_ID_MASK, index = view.micromap_indices[triangle];
        assert_true(id & PORTABLE_ID_MICROMAP);
        for (int k = 0; k < 9; k++) {
            const float u = 0.03f + 0.1f * (float)k, v = 0.93f - u;
            assert_int_equal(random_attachment_state(&asked, triangle, u, v),
                             index >= MICROMAP_FULLY_UNKNOWN_OPAQUE ? ~index
                                                                    : portable_micromap_state(&opened, index, u, v));
        }
    }
}

static const uint32_t flags[] = {0, BUILD_ALLOW_MICROMAP_UPDATE, BUILD_ALLOW_DISABLE_MICROMAPS,
                                 BUILD_ALLOW_MICROMAP_DATA_UPDATE};

enum { FLAGS = sizeof flags / sizeof *flags };

static void equal_requests_give_equal_bytes(void **state)
{
    (void)state;
    struct random random = {5};
    struct random_micromap micromap;
    random_micromap_make(&random, 12, 4, 0, &micromap);
    for (int f = 0; f < FLAGS; f++) {
        struct world world;
        world_start(&world, &random, &micromap, flags[f]);
        struct made source = make(&world, NULL), updated = make(&world, &source);
        check(&world, &source, &micromap);
        assert_int_equal(updated.made.size, source.made.size);
        assert_memory_equal(updated.made.blob, source.made.blob, source.made.size);
        world.corners[3][1][2] += 1;
        finish(&updated);
        updated = make(&world, &source);
        check(&world, &updated, &micromap);
        finish(&updated);
        finish(&source);
    }
    assert_int_equal(memory.live, 0);
    random_micromap_finish(&micromap);
}

static void expect(struct world *world, const struct made *source, const char *where)
{
    struct made made;
    struct bvhd_error error = {.status = BVHD_OK};
    if (where) {
        assert_int_equal(try_make(world, source, &made, &error), BVHD_INVALID);
        assert_string_equal(error.where, where);
        return;
    }
    if (try_make(world, source, &made, &error) != BVHD_OK)
        fail_msg("%s: %s", error.where, error.text);
    finish(&made);
}

#define PLACE "infos[2].geometries[0].triangles.micromap"

/* Each flag allows other changes; the presence of a micromap never changes. */
static void flags_decide_what_may_change(void **state)
{
    (void)state;
    struct random random = {6};
    struct random_micromap micromap, other;
    random_micromap_make(&random, 12, 4, 0, &micromap);
    random_micromap_make(&random, 40, 4, 0, &other);
    for (int f = 0; f < FLAGS; f++) {
        const bool any = flags[f] == BUILD_ALLOW_MICROMAP_UPDATE, data = flags[f] == BUILD_ALLOW_MICROMAP_DATA_UPDATE;
        struct world world;
        world_start(&world, &random, &micromap, flags[f]);
        struct made source = make(&world, NULL);
        struct triangle_micromap *attached = &world.geometry.triangles.micromap;

        attached->is_given = 0;
        expect(&world, &source, PLACE);
        attached->is_given = 1;
        world.indices[4] = world.indices[9] = MICROMAP_FULLY_UNKNOWN_OPAQUE; /* other special indices */
        expect(&world, &source, any || data ? NULL : PLACE ".indexBuffer");
        world.indices[0] = MICROMAP_FULLY_OPAQUE;
        expect(&world, &source, any ? NULL : PLACE ".indexBuffer");
        for (uint32_t i = 0; i < COUNT; i++)
            world.indices[i] = ~(i % 4);
        attached->micromap = 0;
        expect(&world, &source, PLACE);
        attached->micromap = HANDLE;
        finish(&source);

        world_start(&world, &random, &micromap, flags[f]);
        source = make(&world, NULL);
        world.reference.key.bytes[7] ^= 1; /* the same shapes under another name */
        expect(&world, &source, any || data ? NULL : PLACE ".micromap");
        world.reference = random_micromap_reference(&other, HANDLE);
        expect(&world, &source, any ? NULL : data ? PLACE ".indexBuffer" : PLACE ".micromap");
        if (any) {
            for (uint32_t i = 0; i < COUNT; i++)
                world.indices[i] = (7 * i) % 40;
            struct made updated = make(&world, &source);
            check(&world, &updated, &other);
            finish(&updated);
        }
        finish(&source);
    }
    assert_int_equal(memory.live, 0);
    random_micromap_finish(&micromap);
    random_micromap_finish(&other);
}

static void damaged_records_are_refused(void **state)
{
    (void)state;
    struct random random = {7};
    struct random_micromap micromap;
    struct world world;
    struct record record;
    struct bvhd_error error;
    random_micromap_make(&random, 12, 4, 0, &micromap);
    world_start(&world, &random, &micromap, 0);
    struct made source = make(&world, NULL);
    struct record_header *header = source.entry.record.owned;
    struct record_micromap *row = (void *)((struct record_geometry *)(void *)(header + 1) + 1);
    const struct bytes bytes = source.entry.record.bytes;
    assert_int_equal(record_open(bytes, &record, &error), BVHD_OK);
    assert_int_equal(record.micromaps[0].attachment, RECORD_MICROMAP);
    row->attachment = 3;
    assert_int_equal(record_open(bytes, &record, &error), BVHD_CORRUPT);
    assert_string_equal(error.where, "record.micromaps[0]");
    row->attachment = RECORD_NO_MICROMAP;
    assert_int_equal(record_open(bytes, &record, &error), BVHD_CORRUPT);
    memset(row, 0, sizeof *row);
    assert_int_equal(record_open(bytes, &record, &error), BVHD_CORRUPT);
    assert_string_equal(error.where, "record.version");
    row->attachment = RECORD_SPECIAL_ONLY;
    row->reserved = 1;
    assert_int_equal(record_open(bytes, &record, &error), BVHD_CORRUPT);
    row->reserved = 0;
    header->version = 1;
    assert_int_equal(record_open(bytes, &record, &error), BVHD_CORRUPT);
    assert_string_equal(error.where, "record.size");
    finish(&source);
    random_micromap_finish(&micromap);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(equal_requests_give_equal_bytes),
        cmocka_unit_test(flags_decide_what_may_change),
        cmocka_unit_test(damaged_records_are_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
