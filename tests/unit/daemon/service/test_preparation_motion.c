/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_preparation_motion.c - tests that what moves is prepared and built within the memory that is promised for it:
 * vertices of two times, and records of motion instances.
 */
#include "tests/support/unit.h"

#include "builder/update/batch.h"
#include "daemon/service/preparation.h"
#include "proto/base/request_limits.h"
#include "proto/wire/rows.h"
#include "tests/support/random.h"

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

static struct control_item item_of(const struct build_input *input)
{
    struct control_item item = {.type = input->type,
                                .flags = input->flags,
                                .quality = input->options.quality,
                                .target = input->options.target,
                                .geometry_count = input->geometry_count,
                                .geometry_size = rows_geometry_size(input),
                                .reference_count = input->reference_count,
                                .reference_size = ROWS_REFERENCE_SIZE};
    assert_true(rows_payload_size(input, &item.payload_size));
    return item;
}

/* A request of moving things in random order, and what it is made of. */
struct moving {
    struct build_input input;
    struct geometry geometries[2];
    struct reference reference;
    float *start, *end;
    uint32_t *indices;
    unsigned char *records;
};

static void start(struct moving *moving, uint32_t type, uint32_t geometry_count)
{
    memset(moving, 0, sizeof *moving);
    moving->input = (struct build_input){.type = type,
                                         .flags = BUILD_MOTION,
                                         .options = {.target = TARGET_PORTABLE},
                                         .geometry_count = geometry_count,
                                         .geometries = moving->geometries};
}

/* Makes small triangles that move far, of which each has corners of its own. `still`: a tenth of them do not move. */
static void make_triangles(struct moving *moving, uint32_t count, bool indexed, bool still)
{
    struct random random = {count};
    start(moving, STRUCTURE_BOTTOM, still ? 2 : 1);
    moving->start = calloc(9 * (size_t)count, sizeof(float));
    moving->end = calloc(9 * (size_t)count, sizeof(float));
    moving->indices = calloc(3 * (size_t)count, sizeof(uint32_t));
    for (uint32_t i = 0; i < 9 * count; i++) {
        moving->start[i] = (float)(random_next(&random) % 1000) + (float)(random_next(&random) % 100) / 1000.0f;
        moving->end[i] = moving->start[i] + (float)(random_next(&random) % 100);
    }
    for (uint32_t i = 0; i < 3 * count; i++)
        moving->indices[i] = i;
    struct geometry geometry = {.type = GEOMETRY_MOVING_TRIANGLES,
                                .triangles = {.vertex_format = 106,
                                              .max_vertex = 3 * count - 1,
                                              .vertex_stride = 12,
                                              .index_type = indexed ? INDEX_UINT32 : INDEX_NONE,
                                              .vertices = {(unsigned char *)moving->start, 36 * (uint64_t)count},
                                              .end_vertices = {(unsigned char *)moving->end, 36 * (uint64_t)count}},
                                .range = {.primitive_count = count}};
    if (indexed)
        geometry.triangles.indices = (struct bytes){(unsigned char *)moving->indices, 12 * (uint64_t)count};
    moving->geometries[0] = geometry;
    geometry.type = GEOMETRY_TRIANGLES;
    geometry.triangles.end_vertices = (struct bytes){NULL, 0};
    geometry.range.primitive_count = count / 10;
    geometry.triangles.max_vertex = count / 10 * 3 - 1;
    moving->geometries[1] = geometry;
}

/* Makes instances of all three types in turn. */
static void make_instances(struct moving *moving, uint32_t count)
{
    static const float matrix[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0},
                       srt[16] = {1, 0, 0, 0, 1, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0};
    static const struct {
        size_t end, behind; /* where the numbers of t = 1 are, and what follows the numbers */
    } types[MOTION_TYPES] = {{8, 56}, {56, 104}, {72, 136}};
    struct random random = {count};
    start(moving, STRUCTURE_TOP, 1);
    moving->records = calloc(count, MOTION_RECORD_STRIDE);
    for (uint32_t i = 0; i < count; i++) {
        unsigned char *record = moving->records + (size_t)i * MOTION_RECORD_STRIDE;
        const uint32_t type = i % MOTION_TYPES;
        const bool is_srt = type == MOTION_SRT;
        float numbers[16];
        memcpy(numbers, is_srt ? srt : matrix, is_srt ? sizeof srt : sizeof matrix);
        numbers[is_srt ? 13 : 3] = (float)(random_next(&random) % 1000);
        numbers[is_srt ? 14 : 7] = (float)(random_next(&random) % 1000);
        bytes_put32(record, type);
        memcpy(record + 8, numbers, is_srt ? sizeof srt : sizeof matrix);
        numbers[is_srt ? 13 : 3] += 10;
        memcpy(record + types[type].end, numbers, is_srt ? sizeof srt : sizeof matrix);
        bytes_put32(record + types[type].behind, 0xff000000);
        bytes_put64(record + types[type].behind + 8, 7);
    }
    moving->reference =
        (struct reference){.kind = REFERENCE_BLAS, .handle = 7, .has_key = true, .bounds = {{-1, -1, -1}, {1, 1, 1}}};
    moving->input.references = &moving->reference;
    moving->input.reference_count = 1;
    moving->geometries[0] = (struct geometry){
        .type = GEOMETRY_MOVING_INSTANCES,
        .instances = {{moving->records, (uint64_t)count * MOTION_RECORD_STRIDE}},
        .range = {.primitive_count = count},
    };
}

static void finish(struct moving *moving)
{
    free(moving->start);
    free(moving->end);
    free(moving->indices);
    free(moving->records);
}

/* Prepares the request, with no more memory than its bound says. Returns the preparation. */
static struct preparation *prepare_within_bound(const struct build_input *input)
{
    const struct control_item item = item_of(input);
    struct preparation_source source = {.size = item.payload_size};
    atomic_bool cancel = false;
    unsigned char *bytes = aligned_alloc(16, bytes_align(item.payload_size, 16));
    rows_write(input, bytes);
    assert_int_equal(payload_copy((struct bytes){bytes, item.payload_size}, &memory, &source.payload, NULL), BVHD_OK);
    free(bytes);
    struct preparation *preparation = preparation_create(&item, 0, &source, &memory);
    assert_non_null(preparation);
    preparation->limits = &limits;
    preparation->promised = preparation_bound(input);
    preparation_run(preparation, &parallel_serial, &cancel);
    if (preparation->status != BVHD_OK)
        fail_msg("%s: %s", preparation->error.where, preparation->error.text);
    assert_int_equal(preparation->needed, 0);
    assert_true(atomic_load(&preparation->memory.peak) <= preparation->promised);
    return preparation;
}

/* Builds the request in process, and compares what that takes with the promises: of its two stages, and the first. */
static void check_promises(struct moving *moving, uint64_t most)
{
    const struct build_context context = {.memory = &memory, .parallel = &parallel_serial};
    const struct control_item item = item_of(&moving->input);
    assert_true(preparation_bound(&moving->input) <= preparation_guess(&item));
    for (int quality = QUALITY_FAST; quality <= QUALITY_HIGH; quality++) {
        moving->input.options.quality = (enum build_quality)quality;
        struct preparation *preparation = prepare_within_bound(&moving->input);
        struct batch_item built;
        assert_int_equal(batch_build(&moving->input, 1, &limits, &context, &built, NULL), BVHD_OK);
        assert_int_equal(built.status, BVHD_OK);
        const uint64_t peak = built.summary.peak_bytes, make = preparation_make_bytes(preparation),
                       copy = atomic_load(&preparation->memory.live);
        if (peak > make + copy || make > most * peak)
            fail_msg("quality %d: %llu promised beside %llu, %llu taken", quality, (unsigned long long)make,
                     (unsigned long long)copy, (unsigned long long)peak);
        batch_finish(&built, 1, &memory);
        preparation_destroy(preparation);
    }
    finish(moving);
}

static void promises_suit_motion_triangles(void **state)
{
    (void)state;
    static const uint32_t counts[] = {1500, 40000};
    for (int i = 0; i < 6; i++) {
        struct moving moving;
        make_triangles(&moving, counts[i % 2], i >= 2, i >= 4);
        check_promises(&moving, 3);
    }
}

static void promises_suit_motion_instances(void **state)
{
    (void)state;
    static const uint32_t counts[] = {1500, 20000};
    for (int i = 0; i < 2; i++) {
        struct moving moving;
        make_instances(&moving, counts[i]);
        check_promises(&moving, 3);
    }
}

/* One geometry that moves gives all vertices of the structure a second place. */
static void vertices_that_stand_still_count_twice(void **state)
{
    (void)state;
    struct canonical_geometry geometries[2] = {{.type = GEOMETRY_TRIANGLES}, {.type = GEOMETRY_TRIANGLES}};
    struct preparation preparation = {
        .entry = {
            .options = {.quality = QUALITY_FAST},
            .canonical = {.geometry_count = 2, .geometries = geometries, .primitive_count = 100, .vertex_count = 300}}};
    const uint64_t still = preparation_make_bytes(&preparation);
    assert_int_equal(still, preparation_build_bytes(100, 300 * 12, false, false));
    geometries[1].type = GEOMETRY_MOVING_TRIANGLES;
    assert_int_equal(preparation_make_bytes(&preparation), preparation_build_bytes(100, 300 * 24, false, true));
    assert_true(preparation_make_bytes(&preparation) > still + 300 * 12);
}

#define TEST(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)

int main(void)
{
    const struct CMUnitTest tests[] = {
        TEST(vertices_that_stand_still_count_twice),
        TEST(promises_suit_motion_triangles),
        TEST(promises_suit_motion_instances),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
