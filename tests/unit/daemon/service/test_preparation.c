/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_preparation.c - tests the way from a payload to its canonical copy and key: every kind, promised memory, wrong
 * payloads.
 */
#include "tests/support/unit.h"

#include <fcntl.h>
#include <sys/mman.h>
#include <unistd.h>

#include "builder/update/batch.h"
#include "tests/support/builder/inputs.h"
#include "daemon/service/preparation.h"
#include "builder/input/prepare.h"
#include "tests/support/builder/random_input.h"
#include "proto/base/vertex_element.h"
#include "proto/wire/rows.h"

static struct memory memory;
static struct limits limits;

static int set_up(void **state)
{
    (void)state;
    memory_init(&memory, UINT64_MAX);
    limits = limits_default();
    return 0;
}

static int tear_down(void **state)
{
    (void)state;
    assert_int_equal(atomic_load(&memory.live), 0);
    return 0;
}

static struct control_item item_of(const struct build_input *input, uint64_t size)
{
    return (struct control_item){
        .type = input->type,
        .flags = input->flags,
        .quality = input->options.quality,
        .target = input->options.target,
        .layout_flags = input->options.layout_flags,
        .rays_per_primitive = input->options.rays_per_primitive,
        .geometry_count = input->geometry_count,
        .geometry_size = rows_geometry_size(input),
        .reference_count = input->reference_count,
        .reference_size = ROWS_REFERENCE_SIZE,
        .payload_size = size,
    };
}

/* Creates a preparation whose payload is a copy of the first `cut` bytes of the payload of `input`. */
static struct preparation *create_cut(const struct build_input *input, uint64_t cut)
{
    uint64_t size;
    struct payload *payload;
    assert_true(rows_payload_size(input, &size));
    unsigned char *bytes = aligned_alloc(16, bytes_align(size + 1, 16));
    assert_non_null(bytes);
    rows_write(input, bytes);
    size = cut < size ? cut : size;
    assert_int_equal(payload_copy((struct bytes){bytes, size}, &memory, &payload, NULL), BVHD_OK);
    free(bytes);
    struct control_item item = item_of(input, size);
    const struct preparation_source source = {.payload = payload, .size = size};
    struct preparation *preparation = preparation_create(&item, 3, &source, &memory);
    assert_non_null(preparation);
    preparation->limits = &limits;
    preparation->promised = UINT64_MAX;
    return preparation;
}

static struct preparation *create(const struct build_input *input)
{
    return create_cut(input, UINT64_MAX);
}

static void run(struct preparation *preparation)
{
    atomic_bool cancel = false;
    preparation_run(preparation, &parallel_serial, &cancel);
}

/* The key is equal to that of the same input built in process. */
static void check_key(const struct preparation *preparation, const struct build_input *input)
{
    struct batch_item item;
    const struct build_context context = {.memory = &memory, .parallel = &parallel_serial};
    struct build_input balanced = *input;
    balanced.options.quality = QUALITY_BALANCED;
    assert_int_equal(batch_build(&balanced, 1, &limits, &context, &item, NULL), BVHD_OK);
    assert_int_equal(preparation->status, BVHD_OK);
    assert_memory_equal(&preparation->entry.key, &item.key, sizeof item.key);
    batch_finish(&item, 1, &memory);
}

static void (*const makers[])(struct test_input *) = {inputs_triangles, inputs_aabbs, inputs_instances, inputs_spheres,
                                                      inputs_swept_spheres};

static void test_each_kind(void **state)
{
    (void)state;
    for (size_t i = 0; i < sizeof makers / sizeof *makers; i++) {
        struct test_input test;
        makers[i](&test);
        struct preparation *preparation = create(&test.input);
        run(preparation);
        check_key(preparation, &test.input);
        assert_null(preparation->source.payload);
        preparation_destroy(preparation);
    }
}

/* Hints that lead to the same quality have the same key. */
static void test_hints(void **state)
{
    (void)state;
    struct key keys[3];
    for (int i = 0; i < 3; i++) {
        struct test_input test;
        inputs_triangles(&test);
        test.input.options.quality = i == 2 ? QUALITY_FAST : QUALITY_AUTO;
        test.input.options.rays_per_primitive = i == 1 ? 0.001f : 0.002f;
        struct preparation *preparation = create(&test.input);
        run(preparation);
        assert_int_equal(preparation->status, BVHD_OK);
        assert_int_equal(preparation->entry.options.quality, QUALITY_FAST);
        keys[i] = preparation->entry.key;
        preparation_destroy(preparation);
    }
    assert_true(key_equal(&keys[0], &keys[1]) && key_equal(&keys[0], &keys[2]));
}

/* It stops after reading the rows, holds only its payload, and succeeds when it is promised what it needs. */
static void test_it_asks_for_what_it_needs(void **state)
{
    (void)state;
    struct test_input test;
    inputs_aabbs(&test);
    test.geometries[0].aabbs.stride = 0;
    test.geometries[0].range.primitive_count = 1000000; /* 24 MB of boxes in 24 bytes */
    test.boxes[0][0] = test.boxes[0][3] = 1;
    struct preparation *preparation = create(&test.input);
    preparation->promised = preparation_guess(&preparation->asked);
    run(preparation);
    assert_true(preparation->needed > 24000000 && preparation->needed < 40000000);
    assert_int_equal(atomic_load(&preparation->memory.live), 0);
    assert_true(atomic_load(&preparation->memory.peak) <= preparation->promised);
    assert_non_null(preparation->source.payload);
    preparation->promised = preparation->needed;
    run(preparation);
    assert_int_equal(preparation->needed, 0);
    assert_int_equal(preparation->status, BVHD_OK);
    assert_int_equal(preparation->entry.canonical.primitive_count, 1000000);
    assert_true(atomic_load(&preparation->memory.peak) <= preparation->promised);
    preparation_destroy(preparation);
}

static void check_bound(const struct build_input *input)
{
    struct preparation *preparation = create(input);
    uint64_t bound = preparation_bound(input);
    preparation->promised = bound;
    run(preparation);
    assert_int_equal(preparation->needed, 0);
    if (atomic_load(&preparation->memory.peak) > bound)
        fail_msg("a bound of %llu, a peak of %llu", (unsigned long long)bound,
                 (unsigned long long)atomic_load(&preparation->memory.peak));
    preparation_destroy(preparation);
}

static void test_bounds_hold(void **state)
{
    (void)state;
    struct random random = {42};
    for (int i = 0; i < 300; i++) {
        struct random_input input;
        random_input_bottom(&input, &random, i < 250 ? 300 : 20000);
        random_input_options(&input.input, &random);
        check_bound(&input.input);
        random_input_finish(&input);
    }
}

/* The indices are more than the room that small copies have when they are moved. */
enum { ENDS = 5000, SWEPT = 1 << 20 };

/* Makes linear swept spheres: bit 0: successive; 1: of neighbours; 2: 16-bit indices. Random pairs are gathered. */
static struct geometry make_swept(int variant, const float (*vertices)[4], uint32_t *indices)
{
    const bool near = variant & 2, narrow = variant & 4;
    for (uint32_t i = 0; i < 2 * SWEPT; i++) {
        const uint32_t value = near ? (i / 2 + i % 2) % (ENDS - 1) : i * 2654435761u % (ENDS - 1);
        if (narrow)
            ((uint16_t *)(void *)indices)[i] = (uint16_t)value;
        else
            indices[i] = value;
    }
    struct geometry geometry = {.type = GEOMETRY_SWEPT_SPHERES, .range = {.primitive_count = SWEPT}};
    geometry.swept_spheres.indexing_mode = variant & 1 ? SWEPT_SUCCESSIVE : SWEPT_LIST;
    geometry.swept_spheres.ends = (struct geometry_spheres){
        .vertex_format = 106,
        .radius_format = RADIUS_FLOAT32,
        .index_type = narrow ? INDEX_UINT16 : INDEX_UINT32,
        .vertex_stride = sizeof *vertices,
        .radius_stride = sizeof *vertices,
        .index_stride = narrow ? 2 : 4,
        .vertices = {(const unsigned char *)vertices, ENDS * sizeof *vertices},
        .radii = {(const unsigned char *)&vertices[0][3], ENDS * sizeof *vertices - 3 * sizeof(float)},
        .indices = {(const unsigned char *)indices, 2 * SWEPT * sizeof *indices},
    };
    return geometry;
}

/* The bound includes the indices, which are kept until all of them have been read. */
static void test_bounds_of_swept_spheres_hold(void **state)
{
    (void)state;
    float(*vertices)[4] = calloc(ENDS, sizeof *vertices);
    uint32_t *indices = calloc((size_t)2 * SWEPT, sizeof *indices);
    assert_true(vertices && indices);
    for (uint32_t i = 0; i < ENDS; i++)
        vertices[i][0] = vertices[i][3] = (float)(i + 1);
    for (int variant = 0; variant < 16; variant++) {
        struct geometry geometry = make_swept(variant, (const float(*)[4])vertices, indices);
        struct build_input input = {.type = STRUCTURE_BOTTOM,
                                    .flags = variant & 8 ? BUILD_ALLOW_UPDATE : 0,
                                    .geometry_count = 1,
                                    .geometries = &geometry,
                                    .options = {.target = TARGET_PORTABLE}};
        check_bound(&input);
    }
    free(indices);
    free(vertices);
}

/* The input has many instances and references, most of which are referred to. */
static void test_bounds_of_top_levels_hold(void **state)
{
    (void)state;
    enum { RECORDS = 20000, REFERENCES = 5000 };
    struct test_input small;
    inputs_instances(&small);
    uint32_t(*records)[16] = calloc(RECORDS, sizeof *records);
    struct reference *references = calloc(REFERENCES, sizeof *references);
    assert_true(records && references);
    for (uint64_t i = 0; i < REFERENCES; i++) {
        references[i] = small.references[2];
        references[i].handle = i + 1;
        references[i].bounds.max[0] = (float)(i + 1);
    }
    for (uint64_t i = 0; i < RECORDS; i++) {
        uint64_t handle = i % REFERENCES + 1;
        memcpy(records[i], small.records[0], sizeof *records);
        memcpy(records[i] + 14, &handle, sizeof handle);
    }
    for (uint32_t count = 1; count <= RECORDS; count = count * 7 + 3) {
        small.geometries[0].instances.records =
            (struct bytes){(const unsigned char *)records, RECORDS * sizeof *records};
        small.geometries[0].range.primitive_count = count;
        small.input.references = references;
        small.input.reference_count = REFERENCES;
        check_bound(&small.input);
    }
    free(references);
    free(records);
}

/* Each of many geometries takes what its tables take, of whatever kind it is. */
static void test_bounds_of_many_geometries_hold(void **state)
{
    (void)state;
    enum { MANY = 20000 };
    struct geometry *geometries = calloc(MANY, sizeof *geometries);
    assert_non_null(geometries);
    for (size_t maker = 0; maker < sizeof makers / sizeof *makers; maker++) {
        struct test_input test;
        makers[maker](&test);
        if (test.input.type != STRUCTURE_BOTTOM)
            continue;
        for (int i = 0; i < MANY; i++)
            geometries[i] = test.geometries[0];
        test.input.geometries = geometries;
        test.input.geometry_count = MANY;
        for (test.input.flags = 0; test.input.flags <= BUILD_ALLOW_UPDATE; test.input.flags++)
            check_bound(&test.input);
    }
    free(geometries);
}

/* An ordinary payload does not need more than is promised at first. */
static void test_the_guess_suits_ordinary_payloads(void **state)
{
    (void)state;
    for (uint32_t triangles = 1; triangles < 2000000; triangles = triangles * 5) {
        uint32_t vertices = triangles / 2 + 3;
        struct geometry geometry = {
            .type = GEOMETRY_TRIANGLES,
            .triangles = {.max_vertex = vertices - 1,
                          .vertex_stride = 12,
                          .index_type = INDEX_UINT32,
                          .vertex_format = 106,
                          .vertices = {NULL, (uint64_t)vertices * 12},
                          .indices = {NULL, (uint64_t)triangles * 12}},
            .range = {.primitive_count = triangles},
        };
        struct build_input input = {.type = STRUCTURE_BOTTOM, .geometry_count = 1, .geometries = &geometry};
        struct control_item item =
            item_of(&input, ROWS_GEOMETRY_LEAST + (uint64_t)vertices * 12 + (uint64_t)triangles * 12);
        assert_true(preparation_bound(&input) <= preparation_guess(&item));
    }
}

static void test_the_guess_suits_meshes_without_indices_and_top_levels(void **state)
{
    (void)state;
    for (uint32_t count = 1; count < 2000000; count = count * 5) {
        struct geometry triangles = {
            .type = GEOMETRY_TRIANGLES,
            .triangles = {.max_vertex = 3 * count - 1,
                          .vertex_stride = 12,
                          .index_type = INDEX_NONE,
                          .vertex_format = 106,
                          .vertices = {NULL, (uint64_t)count * 36}},
            .range = {.primitive_count = count},
        };
        struct geometry instances = {.type = GEOMETRY_INSTANCES, .range = {.primitive_count = count}};
        struct build_input bottom = {.type = STRUCTURE_BOTTOM, .geometry_count = 1, .geometries = &triangles};
        struct build_input top = {
            .type = STRUCTURE_TOP, .geometry_count = 1, .geometries = &instances, .reference_count = count / 10 + 1};
        struct control_item bottom_item = item_of(&bottom, ROWS_GEOMETRY_LEAST + (uint64_t)count * 36);
        struct control_item top_item = item_of(
            &top, ROWS_GEOMETRY_LEAST + (uint64_t)top.reference_count * ROWS_REFERENCE_SIZE + (uint64_t)count * 64);
        assert_true(preparation_bound(&bottom) <= preparation_guess(&bottom_item));
        assert_true(preparation_bound(&top) <= preparation_guess(&top_item));
    }
}

static void test_hostile_counts_are_no_large_guess(void **state)
{
    (void)state;
    struct control_item item = {.payload_size = 1000, .geometry_count = UINT32_MAX, .reference_count = UINT32_MAX};
    assert_true(preparation_guess(&item) < 100000);
    item.payload_size = UINT64_MAX;
    assert_int_equal(preparation_guess(&item), UINT64_MAX);
    struct geometry geometries[2] = {{.type = GEOMETRY_AABBS, .range = {.primitive_count = UINT32_MAX}},
                                     {.type = GEOMETRY_TRIANGLES, .range = {.primitive_count = UINT32_MAX}}};
    geometries[1].triangles = (struct geometry_triangles){
        .max_vertex = UINT32_MAX, .vertex_stride = 1, .index_type = INDEX_UINT32, .vertices = {NULL, UINT64_MAX}};
    struct build_input input = {.geometry_count = 2, .geometries = geometries};
    assert_true(preparation_bound(&input) > UINT64_C(150) << 30);
    assert_true(preparation_bound(&input) < UINT64_C(250) << 30);
}

static void test_truncated_payloads(void **state)
{
    (void)state;
    for (size_t i = 0; i < sizeof makers / sizeof *makers; i++) {
        struct test_input test;
        uint64_t size;
        makers[i](&test);
        assert_true(rows_payload_size(&test.input, &size));
        for (uint64_t cut = 0; cut < size; cut++) {
            struct preparation *preparation = create_cut(&test.input, cut);
            run(preparation);
            if (preparation->status == BVHD_OK) /* only padding was cut off */
                check_key(preparation, &test.input);
            else
                assert_memory_equal(preparation->error.where, "infos[3]", 8);
            assert_true(preparation->status == BVHD_OK ? cut + ROWS_ALIGNMENT > size
                                                       : preparation->entry.canonical.owned == NULL);
            preparation_destroy(preparation);
        }
    }
}

static void test_broken_rules_come_before_bounds(void **state)
{
    (void)state;
    struct test_input test;
    inputs_aabbs(&test);
    test.geometries[0].range.primitive_count = UINT32_MAX;
    test.geometries[0].aabbs.stride = 0;
    struct preparation *preparation = create(&test.input);
    preparation->promised = 100000;
    run(preparation);
    assert_int_equal(preparation->needed, 0);
    assert_int_equal(preparation->error.vuid, BVHD_VUID_03794);
    preparation_destroy(preparation);
}

static void test_a_cancelled_one_stops(void **state)
{
    (void)state;
    struct test_input test;
    atomic_bool cancel = true;
    inputs_triangles(&test);
    struct preparation *preparation = create(&test.input);
    preparation_run(preparation, &parallel_serial, &cancel);
    assert_true(preparation->status == BVHD_CANCELLED || preparation->status == BVHD_OK);
    assert_null(preparation->source.payload);
    preparation_destroy(preparation);
}

static void test_failing_allocations(void **state)
{
    (void)state;
    for (size_t i = 0; i < sizeof makers / sizeof *makers; i++) {
        struct test_input test;
        enum bvhd_status status = BVHD_NO_MEMORY;
        makers[i](&test);
        int64_t after = 0;
        for (; status != BVHD_OK; after++) {
            struct preparation *preparation = create(&test.input);
            atomic_store(&memory.fail_after, after);
            run(preparation);
            atomic_store(&memory.fail_after, -1);
            status = preparation->status;
            assert_true(status == BVHD_OK || status == BVHD_NO_MEMORY);
            assert_int_equal(atomic_load(&preparation->memory.live) > 0, status == BVHD_OK);
            preparation_destroy(preparation);
        }
        assert_true(after > 3);
    }
}

/* ---- attachments ---- */

static struct descriptors descriptors;
static struct descriptor_share *share;

static int make_file(const void *bytes, uint64_t size, unsigned seals)
{
    int descriptor = memfd_create("attachment", MFD_CLOEXEC | MFD_ALLOW_SEALING);
    assert_true(descriptor >= 0);
    assert_int_equal(write(descriptor, bytes, size), size);
    assert_int_equal(fcntl(descriptor, F_ADD_SEALS, seals), 0);
    assert_true(descriptors_take(&descriptors, 1, 0));
    descriptor_share_add(share, 1);
    return descriptor;
}

enum { ALL_SEALS = F_SEAL_SHRINK | F_SEAL_GROW | F_SEAL_WRITE | F_SEAL_SEAL };

static struct attachment *attach(int descriptor, uint64_t size)
{
    const struct payload_file file = {descriptor, size, 1 << 20, "memfds[1]", &memory, share};
    return attachment_create(&file);
}

static bool is_closed(int descriptor)
{
    return fcntl(descriptor, F_GETFD) < 0;
}

/* Another thread closes descriptors of clients, so this may take a moment. */
static bool is_closed_soon(int descriptor)
{
    for (int i = 0; i < 5000 && !is_closed(descriptor); i++)
        usleep(1000);
    return is_closed(descriptor);
}

static void test_attachments_open_once(void **state)
{
    (void)state;
    uint32_t before = descriptors_left(&descriptors);
    int descriptor = make_file("contents", 8, ALL_SEALS);
    struct attachment *attachment = attach(descriptor, 8);
    struct payload *first, *second;
    struct bvhd_error error;
    assert_int_equal(descriptors_left(&descriptors), before - 1);
    assert_false(is_closed(descriptor));
    assert_int_equal(attachment_open(attachment, &first, &error), BVHD_OK);
    assert_true(is_closed_soon(descriptor));
    assert_int_equal(descriptors_left(&descriptors), before);
    assert_int_equal(attachment_open(attachment_ref(attachment), &second, &error), BVHD_OK);
    assert_ptr_equal(first, second);
    assert_memory_equal(payload_bytes(first).data, "contents", 8);
    attachment_unref(attachment);
    assert_memory_equal(payload_bytes(first).data, "contents", 8);
    attachment_unref(attachment);
}

static void test_bad_attachments_tell_everybody(void **state)
{
    (void)state;
    int descriptor = make_file("contents", 8, 0);
    struct attachment *attachment = attach(descriptor, 8);
    struct payload *payload;
    for (int i = 0; i < 2; i++) {
        struct bvhd_error error;
        assert_int_equal(attachment_open(attachment, &payload, &error), BVHD_INVALID);
        assert_string_equal(error.where, "memfds[1]");
    }
    assert_true(is_closed_soon(descriptor));
    attachment_unref(attachment);
    attachment_unref(NULL);
}

static void test_attachments_that_nobody_opens_are_closed(void **state)
{
    (void)state;
    uint32_t before = descriptors_left(&descriptors);
    int descriptor = make_file("contents", 8, ALL_SEALS);
    attachment_unref(attach(descriptor, 8));
    assert_true(is_closed_soon(descriptor));
    assert_int_equal(descriptors_left(&descriptors), before);
    descriptor = make_file("contents", 8, ALL_SEALS);
    atomic_store(&memory.fail_after, 0);
    assert_null(attach(descriptor, 8));
    assert_true(is_closed_soon(descriptor));
    assert_int_equal(descriptors_left(&descriptors), before);
}

#define TEST(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)

/* Hair and points, whose vertices have 16 bytes: successive ends with indices, and spheres without. */
static void test_the_guess_suits_round_primitives(void **state)
{
    (void)state;
    for (uint32_t count = 32; count < 2000000; count = count * 5) {
        const uint64_t ends = count + count / 32, end_bytes = 16 * ends;
        const struct geometry_spheres described = {.vertex_format = 106,
                                                   .radius_format = RADIUS_FLOAT32,
                                                   .index_type = INDEX_NONE,
                                                   .vertex_stride = 16,
                                                   .radius_stride = 16,
                                                   .index_stride = 4,
                                                   .vertices = {NULL, end_bytes},
                                                   .radii = {NULL, end_bytes}};
        struct geometry swept = {.type = GEOMETRY_SWEPT_SPHERES, .range = {.primitive_count = count}};
        struct geometry spheres = {.type = GEOMETRY_SPHERES, .range = {.primitive_count = (uint32_t)ends}};
        spheres.spheres = swept.swept_spheres.ends = described;
        swept.swept_spheres.indexing_mode = SWEPT_SUCCESSIVE;
        swept.swept_spheres.ends.index_type = INDEX_UINT32;
        const struct build_input hair = {.type = STRUCTURE_BOTTOM, .geometry_count = 1, .geometries = &swept},
                                 points = {.type = STRUCTURE_BOTTOM, .geometry_count = 1, .geometries = &spheres};
        struct control_item hair_item = item_of(&hair, ROWS_GEOMETRY_SIZE + end_bytes + (uint64_t)count * 4);
        struct control_item points_item = item_of(&points, ROWS_GEOMETRY_SIZE + end_bytes);
        assert_true(preparation_bound(&hair) <= preparation_guess(&hair_item));
        assert_true(preparation_bound(&points) <= preparation_guess(&points_item));
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        TEST(test_each_kind),
        TEST(test_hints),
        TEST(test_it_asks_for_what_it_needs),
        TEST(test_bounds_hold),
        TEST(test_the_guess_suits_round_primitives),
        TEST(test_bounds_of_swept_spheres_hold),
        TEST(test_bounds_of_many_geometries_hold),
        TEST(test_bounds_of_top_levels_hold),
        TEST(test_the_guess_suits_ordinary_payloads),
        TEST(test_the_guess_suits_meshes_without_indices_and_top_levels),
        TEST(test_hostile_counts_are_no_large_guess),
        TEST(test_truncated_payloads),
        TEST(test_broken_rules_come_before_bounds),
        TEST(test_a_cancelled_one_stops),
        TEST(test_failing_allocations),
        TEST(test_attachments_open_once),
        TEST(test_bad_attachments_tell_everybody),
        TEST(test_attachments_that_nobody_opens_are_closed),
    };
    descriptors_init(&descriptors);
    share = descriptor_share_open(&descriptors, 1000);
    return cmocka_run_group_tests(tests, NULL, NULL);
}
