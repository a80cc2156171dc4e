/* SPDX-License-Identifier: Apache-2.0 */
/* test_triangle_micromap.c - tests how triangles name those of micromaps: the rules, the copies and what is built. */
#include "tests/support/unit.h"

#include "builder/format/portable_micromap.h"
#include "builder/build.h"
#include "tests/support/builder/prepare_bed.h"
#include "tests/support/builder/random_micromap.h"
#include "tests/support/builder/test_scene.h"

enum { COUNT = 5, HANDLE = 77 };

/* Three triangles with indices of 16 bits, and the micromap that they name. */
struct subject {
    struct test_input test;
    struct random_micromap micromap;
    uint16_t indices[3];
    struct micromap_usage usages[2];
};

static struct subject s;

/* The micromap's triangles: mixed, all opaque, mixed, all transparent in one byte, mixed. */
static int make_micromap(void **state)
{
    static struct micromap_triangle triangles[COUNT] = {
        {0, 1, MICRO_4_STATE}, {1, 2, MICRO_4_STATE}, {5, 3, MICRO_2_STATE}, {13, 0, MICRO_2_STATE}, {0, 1, 2}};
    static unsigned char states[16] = {0xe4, 0x55, 0x55, 0x55, 0x55, 0xff, 1, 2, 3, 4, 5, 6, 7, 0xfe, 0, 0};
    static const struct micromap_usage usages[4] = {{2, 1, 2}, {1, 2, 2}, {1, 3, 1}, {1, 0, 1}};
    struct test_input test;
    struct canonical canonical;
    struct limits limits = limits_default();
    struct build_stats stats;
    struct bvhd_error error;
    unsigned char *blob;
    (void)state;
    validate_micromaps = true;
    inputs_start(&test, STRUCTURE_MICROMAP, 1);
    test.geometries[0] =
        (struct geometry){.type = GEOMETRY_MICROMAP,
                          .micromap = {.usages = {(const unsigned char *)usages, sizeof usages},
                                       .states = {states, sizeof states},
                                       .triangles = {(const unsigned char *)triangles, sizeof triangles},
                                       .stride = 8},
                          .range.primitive_count = COUNT};
    assert_int_equal(prepare(&test.input, 2, &limits, &bed_context, &canonical, &error), BVHD_OK);
    assert_int_equal(build(&canonical, &test.input.options, &bed_context, &blob, &stats, &error), BVHD_OK);
    static unsigned char kept[1024] __attribute__((aligned(64)));
    assert_true(stats.sizes.total <= sizeof kept);
    memcpy(kept, blob, stats.sizes.total);
    memory_free(&bed_memory, blob);
    prepare_finish(&canonical, &bed_memory);
    s.micromap.blob = (struct bytes){kept, stats.sizes.total};
    s.micromap.key = (struct key){{1, 2, 3}};
    return 0;
}

static void start(void)
{
    static const uint16_t indices[3] = {1, 0xfffe, 0};
    static const struct micromap_usage usages[2] = {{1, 2, 2}, {1, 1, 2}};
    inputs_triangles(&s.test);
    memcpy(s.indices, indices, sizeof indices);
    memcpy(s.usages, usages, sizeof usages);
    s.test.references[0] = random_micromap_reference(&s.micromap, HANDLE);
    s.test.input.references = s.test.references;
    s.test.input.reference_count = 1;
    s.test.geometries[1].triangles.micromap =
        (struct triangle_micromap){.is_given = 1,
                                   .index_type = INDEX_UINT16,
                                   .indices = {(const unsigned char *)s.indices, sizeof s.indices},
                                   .stride = 2,
                                   .has_usages = 1,
                                   .usages = {(const unsigned char *)s.usages, sizeof s.usages},
                                   .micromap = HANDLE};
}

static struct triangle_micromap *attached(void)
{
    return &s.test.geometries[1].triangles.micromap;
}

static void expect_indices(uint32_t a, uint32_t b, uint32_t c)
{
    struct canonical canonical = bed_make(&s.test);
    const struct canonical_geometry *geometry = &canonical.geometries[1];
    assert_true(geometry->has_micromaps && !canonical.geometries[0].has_micromaps);
    assert_int_equal(geometry->micromap_indices[0], a);
    assert_int_equal(geometry->micromap_indices[1], b);
    assert_int_equal(geometry->micromap_indices[2], c);
    assert_int_equal(geometry->micromap, canonical.reference_count);
    if (canonical.reference_count > 0) {
        assert_int_equal(canonical.references[0].kind, REFERENCE_MICROMAP);
        assert_int_equal(canonical.references[0].triangle_count, COUNT);
        assert_memory_equal(&canonical.references[0].key, &s.micromap.key, sizeof s.micromap.key);
    }
    bed_finish(&canonical);
}

static void whole_triangles_become_special(void **state)
{
    (void)state;
    start();
    expect_indices(MICROMAP_FULLY_OPAQUE, MICROMAP_FULLY_OPAQUE, 0);
    s.test.input.flags = BUILD_ALLOW_DISABLE_MICROMAPS;
    expect_indices(MICROMAP_FULLY_OPAQUE, MICROMAP_FULLY_OPAQUE, 0);
    s.test.input.flags = BUILD_ALLOW_MICROMAP_UPDATE;
    expect_indices(1, MICROMAP_FULLY_OPAQUE, 0);
    s.test.input.flags = BUILD_ALLOW_MICROMAP_DATA_UPDATE;
    expect_indices(1, MICROMAP_FULLY_OPAQUE, 0);
    s.test.input.flags = 0;
    attached()->has_usages = 0;
    attached()->index_type = INDEX_NONE;
    attached()->indices = (struct bytes){NULL, 0};
    attached()->base_triangle = 2;
    expect_indices(2, MICROMAP_FULLY_TRANSPARENT, 4);
}

/* -5 is none of the special values; the sum of index and base wraps. */
static void indices_have_widths(void **state)
{
    (void)state;
    start();
    attached()->has_usages = 0;
    attached()->base_triangle = UINT32_MAX - 0xfffa; /* 0xfffb + base is 0 */
    s.indices[0] = 0xfffb;
    s.indices[1] = 0xfffc;
    s.indices[2] = 0xffff;
    expect_indices(0, MICROMAP_FULLY_UNKNOWN_OPAQUE, MICROMAP_FULLY_TRANSPARENT);
    unsigned char bytes[3] = {0xfd, 0xfb, 0xff};
    attached()->index_type = INDEX_UINT8;
    attached()->stride = 1;
    attached()->indices = (struct bytes){bytes, 3};
    attached()->base_triangle = 2 - 0xfbu;
    expect_indices(MICROMAP_FULLY_UNKNOWN_TRANSPARENT, 2, MICROMAP_FULLY_TRANSPARENT);
    uint32_t words[3] = {UINT32_MAX - 4, 0xfffe, UINT32_MAX - 1};
    attached()->index_type = INDEX_UINT32;
    attached()->stride = 4;
    attached()->indices = (struct bytes){(const unsigned char *)words, 12};
    attached()->base_triangle = 9;
    words[1] = UINT32_MAX - 6;
    expect_indices(4, 2, MICROMAP_FULLY_OPAQUE);
    attached()->stride = 0;
    expect_indices(4, 4, 4);
}

static void no_micromap_needs_special_indices(void **state)
{
    (void)state;
    start();
    s.indices[0] = s.indices[2] = 0xfffd;
    attached()->micromap = 0;
    attached()->usages.size = 0;
    s.test.input.reference_count = 0;
    expect_indices(MICROMAP_FULLY_UNKNOWN_TRANSPARENT, MICROMAP_FULLY_OPAQUE, MICROMAP_FULLY_UNKNOWN_TRANSPARENT);
    s.indices[2] = 0;
    bed_refuse(&s.test, BVHD_INVALID, "", "infos[2].geometries[1].triangles.micromap.indices[2]");
}

#define EXT "VUID-VkAccelerationStructureTrianglesOpacityMicromapEXT-"
#define KHR "VUID-VkAccelerationStructureTrianglesOpacityMicromapKHR-"
#define CALL "VUID-vkBuildAccelerationStructuresKHR-"
#define PLACE "infos[2].geometries[1].triangles.micromap."
#define REFUSE(change, status, vuid, where)                                                                            \
    do {                                                                                                               \
        start();                                                                                                       \
        struct canonical canonical_ = bed_make(&s.test);                                                               \
        bed_finish(&canonical_);                                                                                       \
        change;                                                                                                        \
        bed_refuse(&s.test, status, vuid, where);                                                                      \
    } while (0)

/* Makes the KHR form of it without indices. */
static void use_khr_none(void)
{
    attached()->has_usages = 0;
    attached()->index_type = INDEX_NONE;
    attached()->indices.data = NULL;
}

static void every_rule_is_named(void **state)
{
    (void)state;
    REFUSE(attached()->indices.data = NULL, BVHD_INVALID, CALL "pInfos-11821", PLACE "indexBuffer");
    REFUSE(attached()->indices.size--, BVHD_INVALID, CALL "pInfos-11821", PLACE "indexBuffer");
    REFUSE(attached()->index_type = INDEX_NONE, BVHD_INVALID, CALL "pInfos-10892", PLACE "indexBuffer");
    REFUSE(attached()->has_usages = 0;
           attached()->indices.data = NULL, BVHD_INVALID, KHR "indexBuffer-11572", PLACE "indexBuffer");
    REFUSE(attached()->has_usages = 0;
           attached()->index_type = INDEX_NONE, BVHD_INVALID, KHR "indexBuffer-11571", PLACE "indexBuffer");
    REFUSE(use_khr_none(); attached()->micromap = 0, BVHD_INVALID, KHR "micromap-11579", PLACE "micromap");
    REFUSE(use_khr_none(); attached()->has_usages = 1; attached()->micromap = 0, BVHD_INVALID, "", PLACE "micromap");
    REFUSE(use_khr_none(); attached()->base_triangle = 3, BVHD_INVALID, KHR "geometry-11576", PLACE "indices[2]");
    REFUSE(attached()->micromap = 1, BVHD_INVALID, EXT "micromap-parameter", PLACE "micromap");
    REFUSE(attached()->has_usages = 0;
           attached()->micromap = 1, BVHD_INVALID, KHR "micromap-parameter", PLACE "micromap");
    REFUSE(s.indices[2] = COUNT, BVHD_INVALID, "", PLACE "indices[2]");
    REFUSE(attached()->base_triangle = COUNT - 1, BVHD_INVALID, "", PLACE "indices[0]");
    REFUSE(s.usages[0].count = 2, BVHD_INVALID, "", PLACE "usageCounts");
    REFUSE(s.usages[0].format = 3, BVHD_INVALID, "VUID-VkMicromapUsageEXT-format-07519", PLACE "usageCounts[0]");
    REFUSE(s.indices[1] = 2, BVHD_INVALID, "", PLACE "usageCounts");
    REFUSE(s.test.references[0].kind = REFERENCE_BLAS, BVHD_UNSUPPORTED, "", "infos[2].references[0]");
    REFUSE(s.test.references[0].has_key = false, BVHD_INVALID, "", "infos[2].references[0]");
    REFUSE(s.test.references[0].blob.data = NULL, BVHD_NOT_FOUND, "", "infos[2].references[0]");
    REFUSE(s.test.references[0].blob.size--, BVHD_CORRUPT, "", "body.bodySize");
}

static void native_layouts_have_no_micromaps(void **state)
{
    (void)state;
    start();
    s.test.input.options.target = TARGET_LAVAPIPE;
    s.test.input.options.device.variant = 1;
    bed_refuse(&s.test, BVHD_UNSUPPORTED, "", "infos[2].geometries[1].triangles.micromap");
    attached()->is_given = 0;
    struct canonical canonical = bed_make(&s.test);
    bed_finish(&canonical);
}

static void failures_hold_nothing(void **state)
{
    (void)state;
    struct canonical canonical;
    struct bvhd_error error;
    int64_t fail = 0;
    start();
    for (;; fail++) {
        bed_memory.fail_after = fail;
        if (bed_try(&s.test, &canonical, &error) == BVHD_OK)
            break;
        assert_int_equal(error.status, BVHD_NO_MEMORY);
        assert_int_equal(bed_memory.live, 0);
    }
    bed_memory.fail_after = -1;
    assert_true(fail >= 6);
    bed_finish(&canonical);
}

/* A block from elsewhere, in which one word is changed. */
static void reason(const struct canonical *made, uint64_t at, uint32_t value, const char *where)
{
    static unsigned char block[2048] __attribute__((aligned(16)));
    struct canonical canonical;
    struct bvhd_error error = {.status = BVHD_OK};
    assert_true(made->size <= sizeof block);
    memcpy(block, made->bytes, made->size);
    bytes_put32(block + at, value);
    const struct bytes bytes = {block, made->size};
    assert_int_equal(prepare_open(bytes, &bed_memory, &canonical, &error), where ? BVHD_CORRUPT : BVHD_OK);
    if (where)
        assert_string_equal(error.where, where);
    else
        prepare_finish(&canonical, &bed_memory);
}

static void copies_from_elsewhere_are_checked(void **state)
{
    (void)state;
    start();
    struct canonical made = bed_make(&s.test);
    const uint64_t row = 64 + 64, head = bytes_get64(made.bytes + row + 56), table = made.size - 144;
    assert_int_equal(bytes_get32(made.bytes + 4), CANONICAL_VERSION_MICROMAP);
    reason(&made, 4, CANONICAL_VERSION_MICROMAP, NULL);
    reason(&made, 4, CANONICAL_VERSION, "version");
    reason(&made, row + 56, (uint32_t)head + 16, "geometries[1].micromapOffset");
    reason(&made, row + 56, 0, "version");
    reason(&made, row - 8, (uint32_t)head, "geometries[1].micromapOffset"); /* the first one has it */
    reason(&made, head, 0, "geometries[1].micromap.indices[2]");
    reason(&made, head, 2, "geometries[1].micromap.reference");
    reason(&made, head + 4, 1, "geometries[1].micromap.reserved");
    reason(&made, head + 8, 1, "geometries[1].micromap.reserved"); /* the checksum of another flag */
    reason(&made, head + 16, COUNT, "geometries[1].micromap.indices[0]");
    reason(&made, head + 16, COUNT - 1, NULL);
    reason(&made, head + 16, MICROMAP_FULLY_UNKNOWN_OPAQUE - 1, "geometries[1].micromap.indices[0]");
    reason(&made, head + 28, 1, "geometries[1].padding");
    reason(&made, table, REFERENCE_BLAS, "references[0]");
    reason(&made, table + 4, 0, "geometries[1].micromap.indices[2]");
    reason(&made, table + 8 + 32, 0, "references[0]"); /* a micromap has no bounds */
    bed_finish(&made);
}

/* ---- Random ones, from the request to the bytes ---- */

static uint32_t record_id(const struct portable_view *view, uint32_t i)
{
    return view->header->content == PORTABLE_TRIANGLES
               ? ((const struct portable_triangle *)view->records)[i].id
               : ((const struct portable_indexed_triangle *)view->records)[i].id;
}

/* Compares the state of one record's triangle at a point with that of the request. */
static void check_record(const struct portable_view *view, uint32_t id, const struct random_attachment *attachments,
                         const struct portable_micromap_view *micromap, float u, float v)
{
    const uint32_t primitive = id & PORTABLE_ID_MASK, g = portable_geometry_of(view, primitive);
    const uint32_t triangle = primitive - view->geometries[g].first_primitive;
    if (!attachments[g].names) {
        assert_false(id & PORTABLE_ID_MICROMAP);
        return;
    }
    const enum micro_state want = random_attachment_state(&attachments[g], triangle, u, v);
    const uint32_t index = view->micromap_indices[primitive];
    if (!(id & PORTABLE_ID_MICROMAP)) {
        assert_true(want == MICRO_OPAQUE && (id & PORTABLE_ID_OPAQUE) && index == 0);
        return;
    }
    if (index >= MICROMAP_FULLY_UNKNOWN_OPAQUE) {
        assert_int_equal(want, ~index);
        return;
    }
    assert_int_equal(view->geometries[g].micromap, 1);
    assert_int_equal(want, portable_micromap_state(micromap, index, u, v));
}

/* Changes one word of the body, and opens it. */
static void spoil(const struct batch_item *item, const void *field, uint32_t value, const char *where)
{
    struct portable_view view;
    struct bvhd_error error = {.status = BVHD_OK};
    uint32_t *word = (uint32_t *)(uintptr_t)field;
    const uint32_t old = *word;
    *word = value;
    assert_int_equal(portable_open((struct bytes){item->blob, item->size}, &bed_memory, &view, &error), BVHD_CORRUPT);
    assert_string_equal(error.where, where);
    *word = old;
}

static void structures_from_elsewhere_are_checked(void **state)
{
    (void)state;
    struct test_scene scene;
    start();
    attached()->has_usages = 0;
    s.indices[1] = 2;
    test_scene_init(&scene);
    scene.flags = BUILD_ALLOW_UPDATE; /* which keeps all in the tree */
    scene.micromaps = s.test.references;
    scene.micromap_count = 1;
    test_scene_add(&scene, s.test.geometries, 2, 0);
    const struct batch_item *item = &scene.items[0];
    const struct portable_view *view = &scene.views[0];
    const struct portable_header *header = view->header;
    const struct portable_indexed_triangle *records = view->records;
    uint32_t plain = 0, named = 0;
    while (records[plain].id & PORTABLE_ID_MICROMAP)
        plain++;
    while ((records[named].id & PORTABLE_ID_MASK) != 3) /* the second triangle of the second geometry */
        named++;
    uint32_t first = 0, explicit = 0;
    while (!(records[first].id & PORTABLE_ID_MICROMAP))
        first++;
    while (!(records[explicit].id & PORTABLE_ID_MICROMAP) || (records[explicit].id & PORTABLE_ID_MASK) == 2)
        explicit ++;
    char plain_place[32], named_place[32], first_place[32], explicit_place[32];
    snprintf(first_place, sizeof first_place, "records[%u]", first);
    snprintf(explicit_place, sizeof explicit_place, "records[%u]", explicit);
    snprintf(plain_place, sizeof plain_place, "records[%u]", plain);
    snprintf(named_place, sizeof named_place, "records[%u]", named);
    spoil(item, &header->micromap_count, 0, "body.micromapCount");
    spoil(item, &header->micromap_count, 2, "body.micromapCount");
    spoil(item, &header->micromap_index_count, 0, "body.micromapIndexCount");
    spoil(item, &header->micromap_index_count, 6, "body.micromapIndexCount");
    spoil(item, &header->micromap_offset, (uint32_t)header->micromap_offset - 16, "body.micromapOffset");
    spoil(item, &header->micromap_offset, (uint32_t)header->micromap_offset + 16, "body.micromapOffset");
    spoil(item, &view->geometries[1].micromap, 2, "geometries[1].micromap");
    spoil(item, &view->geometries[1].micromap, 0, first_place);
    spoil(item, &view->geometries[1].micromap, PORTABLE_NO_MICROMAP, explicit_place);
    spoil(item, &view->micromaps[0].handle, 1, "micromaps[0]");
    spoil(item, &view->micromaps[0].location[1], 1, "micromaps[0]");
    spoil(item, &view->micromaps[0].triangle_count, 2, named_place);
    spoil(item, &view->micromap_indices[3], COUNT, named_place);
    spoil(item, &view->micromap_indices[3], MICROMAP_FULLY_UNKNOWN_OPAQUE - 1, named_place);
    spoil(item, &records[plain].id, records[plain].id | PORTABLE_ID_MICROMAP, plain_place);
    spoil(item, &records[named].id, records[named].id | 0x20000000, named_place);
    test_scene_finish(&scene);
}

/* Triangles that are not in the tree are transparent as a whole. */
static void check_absent(const struct portable_view *view, const bool *met, const struct random_attachment *attachments)
{
    for (uint32_t i = 0; i < view->header->primitive_count; i++) {
        const uint32_t g = portable_geometry_of(view, i), triangle = i - view->geometries[g].first_primitive;
        if (met[i])
            continue;
        assert_non_null(attachments[g].names);
        assert_int_equal(random_attachment_state(&attachments[g], triangle, 0.25f, 0.25f), MICRO_TRANSPARENT);
    }
}

enum { GEOMETRIES = 3, MOST = 40 };

static void build_round(struct random *random, uint32_t round)
{
    static float corners[GEOMETRIES][MOST][3][3];
    static const uint32_t flags[] = {0, 0x40, 0x80, 0x100, 0xc0, BUILD_ALLOW_UPDATE, BUILD_PREFER_FAST_BUILD};
    struct random_micromap micromap;
    struct random_attachment attachments[GEOMETRIES] = {{0}};
    struct geometry geometries[GEOMETRIES];
    struct portable_micromap_view opened;
    struct test_scene scene;
    struct bvhd_error error;
    bool met[GEOMETRIES * MOST] = {false};
    random_micromap_make(random, round % 9 * 7, round % 5, 0, &micromap);
    assert_int_equal(portable_micromap_open(micromap.blob, &opened, &error), BVHD_OK);
    for (uint32_t g = 0; g < GEOMETRIES; g++) {
        const uint32_t count = (uint32_t)(random_next(random) % (MOST + 1));
        for (int i = 0; i < MOST * 9; i++)
            corners[g][i / 9][i / 3 % 3][i % 3] = (float)random_between(random, -1, 1);
        geometries[g] = test_scene_triangles((const float(*)[3][3])corners[g], count, g & 1);
        const uint64_t choice = random_next(random) % 4;
        if (choice > 0)
            random_micromap_attach(random, choice > 1 ? &micromap : NULL, HANDLE, &geometries[g], &attachments[g]);
    }
    const struct reference reference = random_micromap_reference(&micromap, HANDLE);
    test_scene_init(&scene);
    scene.flags = flags[round % 7];
    scene.micromaps = &reference;
    scene.micromap_count = 1;
    test_scene_add(&scene, geometries, GEOMETRIES, round & 8 ? PORTABLE_FAST_TRIANGLES : 0);
    const struct portable_view *view = &scene.views[0];
    const bool has = attachments[0].names || attachments[1].names || attachments[2].names;
    assert_int_equal(view->header->version, has ? PORTABLE_MICROMAP_VERSION : 1);
    for (uint32_t i = 0; i < view->header->record_count; i++) {
        const float u = (float)random_between(random, 0, 1), v = (float)random_between(random, 0, 1 - (double)u);
        met[record_id(view, i) & PORTABLE_ID_MASK] = true;
        check_record(view, record_id(view, i), attachments, &opened, u, v);
    }
    check_absent(view, met, attachments);
    for (uint32_t g = 0; g < GEOMETRIES; g++)
        random_attachment_finish(&attachments[g]);
    test_scene_finish(&scene);
    random_micromap_finish(&micromap);
}

static void what_is_built_says_what_was_asked(void **state)
{
    (void)state;
    struct random random = {3};
    for (uint32_t round = 0; round < 400; round++)
        build_round(&random, round);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(whole_triangles_become_special),    cmocka_unit_test(indices_have_widths),
        cmocka_unit_test(no_micromap_needs_special_indices), cmocka_unit_test(every_rule_is_named),
        cmocka_unit_test(copies_from_elsewhere_are_checked), cmocka_unit_test(structures_from_elsewhere_are_checked),
        cmocka_unit_test(native_layouts_have_no_micromaps),  cmocka_unit_test(failures_hold_nothing),
        cmocka_unit_test(what_is_built_says_what_was_asked),
    };
    return cmocka_run_group_tests(tests, make_micromap, NULL);
}
