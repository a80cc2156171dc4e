/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_preparation_micromap.c - tests what is promised for opacity micromaps and for triangles that name them, and that
 * a preparation stops for them to be looked up.
 */
#include "tests/support/unit.h"

#include "daemon/service/preparation.h"
#include "proto/base/validate_shape.h"
#include "tests/support/builder/random_micromap.h"

enum { HANDLE = 88, INDEX = 3, VERTICES = 60 };

static struct memory memory, blob_memory;
static struct descriptors descriptors;
static struct blob_account account;
static struct cache *cache;
static struct limits limits;

static int set_up(void **state)
{
    (void)state;
    validate_micromaps = true;
    memory_init(&memory, UINT64_MAX);
    memory_init(&blob_memory, UINT64_MAX);
    descriptors = (struct descriptors){.limit = 1000};
    blob_account_init(&account, &blob_memory, &descriptors);
    cache = cache_create(64 << 20, &blob_memory);
    limits = limits_default();
    return 0;
}

static int tear_down(void **state)
{
    (void)state;
    cache_destroy(cache);
    return memory.live || blob_memory.live ? -1 : 0;
}

/* Creates a preparation of the input. *ret_payload has its payload's bytes, which a test may write. */
static struct preparation *create(const struct build_input *input, unsigned char **ret_payload)
{
    uint64_t size;
    struct payload *payload;
    assert_true(rows_payload_size(input, &size));
    unsigned char *bytes = aligned_alloc(16, bytes_align(size + 1, 16));
    rows_write(input, bytes);
    assert_int_equal(payload_copy((struct bytes){bytes, size}, &memory, &payload, NULL), BVHD_OK);
    free(bytes);
    *ret_payload = (unsigned char *)(uintptr_t)payload_bytes(payload).data;
    const struct control_item item = {.type = input->type,
                                      .flags = input->flags,
                                      .quality = input->options.quality,
                                      .target = TARGET_PORTABLE,
                                      .geometry_count = input->geometry_count,
                                      .geometry_size = rows_geometry_size(input),
                                      .reference_count = input->reference_count,
                                      .reference_size = ROWS_REFERENCE_SIZE,
                                      .payload_size = size};
    const struct preparation_source source = {.payload = payload, .size = size};
    struct preparation *preparation = preparation_create(&item, INDEX, &source, &memory);
    assert_non_null(preparation);
    preparation->limits = &limits;
    return preparation;
}

static void run(struct preparation *preparation, uint64_t promised)
{
    const atomic_bool cancel = false;
    preparation->promised = promised;
    preparation_run(preparation, &parallel_serial, &cancel);
    const uint64_t peak = atomic_load(&preparation->memory.peak);
    if (peak > promised)
        fail_msg("%llu bytes were promised, and %llu taken", (unsigned long long)promised, (unsigned long long)peak);
}

static struct build_input input_of(const struct geometry *geometry, uint32_t type)
{
    return (struct build_input){.type = type,
                                .geometry_count = 1,
                                .geometries = geometry,
                                .options = {.target = TARGET_PORTABLE, .quality = QUALITY_FAST}};
}

/* Prepares a micromap with no more than its bound, which is at most `most` times what is taken. */
static void check_bound(const struct geometry *geometry, double most)
{
    const struct build_input input = input_of(geometry, STRUCTURE_MICROMAP);
    unsigned char *payload;
    struct preparation *preparation = create(&input, &payload);
    const uint64_t bound = preparation_bound(&input);
    run(preparation, bound);
    if (preparation->status != BVHD_OK)
        fail_msg("%s: %s", preparation->error.where, preparation->error.text);
    assert_int_equal(preparation->needed, 0);
    assert_true((double)bound <= most * (double)atomic_load(&preparation->memory.peak));
    const struct canonical *canonical = &preparation->entry.canonical;
    assert_true(preparation_make_bytes(preparation) >= canonical->vertex_count + 8 * canonical->primitive_count);
    preparation_destroy(preparation);
}

static void bounds_of_random_micromaps_hold(void **state)
{
    (void)state;
    static const uint32_t counts[] = {1, 20, 1000, 100000};
    for (uint32_t i = 0; i < 4; i++)
        for (unsigned level = 0; level <= (i < 3 ? 8 : 3); level += 3) {
            struct random random = {10 * i + level};
            struct random_micromap micromap;
            random_micromap_make(&random, counts[i], level, 0, &micromap);
            check_bound(&micromap.geometry, i < 1 ? 60 : 12);
            random_micromap_finish(&micromap);
        }
}

/* States of which each triangle's begin a byte later: few bytes stand for many. */
static void bounds_of_states_that_overlap_hold(void **state)
{
    (void)state;
    enum { LEVEL = 8, BYTES = 1 << 2 * LEVEL >> 2, COUNT = 2000, STATES = BYTES + COUNT };
    static unsigned char states[STATES];
    static struct micromap_triangle triangles[COUNT];
    struct random random = {7};
    for (uint32_t i = 0; i < STATES; i++)
        states[i] = (unsigned char)random_next(&random);
    for (uint32_t i = 0; i < COUNT; i++)
        triangles[i] = (struct micromap_triangle){.offset = i, .level = LEVEL, .format = 2};
    const struct micromap_usage usage = {COUNT, LEVEL, 2};
    const struct geometry geometry = {
        .type = GEOMETRY_MICROMAP,
        .micromap = {.usages = {(const unsigned char *)&usage, sizeof usage},
                     .states = {states, sizeof states},
                     .triangles = {(const unsigned char *)triangles, sizeof triangles},
                     .stride = sizeof triangles[0]},
        .range = {.primitive_count = COUNT},
    };
    assert_true(preparation_bound(&(struct build_input){.geometry_count = 1, .geometries = &geometry}) >
                (uint64_t)BYTES * COUNT);
    check_bound(&geometry, 4);
}

/* Triangles that name a micromap. */
struct named {
    struct random_micromap micromap;
    struct random_attachment attachment;
    struct geometry geometry;
    struct reference reference;
    struct build_input input;
    float vertices[VERTICES][3];
    uint32_t *indices;
};

static void make_named(struct named *named, uint32_t triangles, uint32_t count, unsigned level)
{
    struct random random = {count};
    for (uint32_t i = 0; i < VERTICES; i++)
        for (int k = 0; k < 3; k++)
            named->vertices[i][k] = (float)(random_next(&random) % 1000);
    named->indices = malloc(triangles * UINT64_C(12));
    for (uint32_t i = 0; i < 3 * triangles; i++)
        named->indices[i] = (uint32_t)(random_next(&random) % VERTICES);
    named->geometry =
        (struct geometry){.type = GEOMETRY_TRIANGLES,
                          .triangles = {.vertex_format = 106,
                                        .max_vertex = VERTICES - 1,
                                        .vertex_stride = 12,
                                        .index_type = INDEX_UINT32,
                                        .vertices = {(unsigned char *)named->vertices, sizeof named->vertices},
                                        .indices = {(unsigned char *)named->indices, triangles * UINT64_C(12)}},
                          .range = {.primitive_count = triangles}};
    random_micromap_make(&random, count, level, 0, &named->micromap);
    random_micromap_attach(&random, &named->micromap, HANDLE, &named->geometry, &named->attachment);
    named->reference = random_micromap_reference(&named->micromap, HANDLE);
    named->input = input_of(&named->geometry, STRUCTURE_BOTTOM);
    named->input.references = &named->reference;
    named->input.reference_count = 1;
}

static void finish_named(struct named *named)
{
    random_attachment_finish(&named->attachment);
    random_micromap_finish(&named->micromap);
    free(named->indices);
}

/* Puts the micromap into the cache, and nowhere else. */
static void keep_micromap(const struct random_micromap *micromap)
{
    struct blob_writer writer;
    struct blob *blob = NULL;
    blob_writer_init(&writer, &account);
    unsigned char *bytes = writer.output.allocate(&writer.output, micromap->blob.size);
    assert_non_null(bytes);
    memcpy(bytes, micromap->blob.data, micromap->blob.size);
    assert_int_equal(blob_writer_finish(&writer, &blob, NULL), BVHD_OK);
    blob->key = micromap->key;
    cache_put(cache, blob);
    blob_unref(blob);
}

/* It lists the micromaps, asks for what it needs when they have been found, and then goes on. */
static void it_stops_for_micromaps(void **state)
{
    (void)state;
    /* Copies stay below 4 MiB: larger ones are remapped when they grow, but not under the address sanitizer. */
    static const struct {
        uint32_t triangles, count;
        unsigned level;
    } cases[] = {{1, 1, 0}, {100, 1000, 6}, {50000, 10, 2}, {200000, 1, 0}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct named named;
        unsigned char *payload;
        make_named(&named, cases[i].triangles, cases[i].count, cases[i].level);
        keep_micromap(&named.micromap);
        struct preparation *preparation = create(&named.input, &payload);
        const uint64_t bound = preparation_bound(&named.input), guess = preparation_guess(&preparation->asked);
        run(preparation, guess);
        assert_true(preparation->names_micromaps && preparation->source.payload);
        assert_int_equal(preparation->needed, 0);
        assert_int_equal(atomic_load(&preparation->memory.live), 0);
        micromap_sources_look_up(&preparation->micromaps, cache);
        run(preparation, bound);
        assert_false(preparation->names_micromaps);
        assert_int_equal(preparation->needed, bound + 2 * named.micromap.blob.size);
        assert_non_null(preparation->source.payload);
        micromap_sources_keep(&preparation->micromaps, cache);
        preparation_account(preparation, &memory);
        micromap_sources_look_up(&preparation->micromaps, cache);
        run(preparation, preparation->needed);
        if (preparation->status != BVHD_OK)
            fail_msg("%s: %s", preparation->error.where, preparation->error.text);
        assert_true(preparation->needed == 0 && !preparation->names_micromaps);
        assert_null(preparation->source.payload);
        assert_int_equal(preparation->entry.canonical.reference_count, 1);
        preparation_destroy(preparation);
        finish_named(&named);
    }
}

/* A client that changes the key after it has been listed gets what it would get if nobody had the micromap. */
static void rows_may_change_meanwhile(void **state)
{
    (void)state;
    struct named named;
    unsigned char *payload;
    make_named(&named, 10, 100, 2);
    keep_micromap(&named.micromap);
    struct preparation *preparation = create(&named.input, &payload);
    run(preparation, 1 << 20);
    assert_true(preparation->names_micromaps);
    micromap_sources_look_up(&preparation->micromaps, cache);
    payload[rows_geometry_size(&named.input) + offsetof(struct reference_row, key)] ^= 1;
    run(preparation, 1 << 20);
    assert_int_equal(preparation->status, BVHD_NOT_FOUND);
    assert_string_equal(preparation->error.where, "infos[3].references[0]");
    assert_null(preparation->source.payload);
    preparation_destroy(preparation);
    finish_named(&named);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(bounds_of_random_micromaps_hold, set_up, tear_down),
        cmocka_unit_test_setup_teardown(bounds_of_states_that_overlap_hold, set_up, tear_down),
        cmocka_unit_test_setup_teardown(it_stops_for_micromaps, set_up, tear_down),
        cmocka_unit_test_setup_teardown(rows_may_change_meanwhile, set_up, tear_down),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
