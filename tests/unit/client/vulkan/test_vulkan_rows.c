/* SPDX-License-Identifier: Apache-2.0 */
/* test_vulkan_rows.c - tests that references get the rows that a built structure has. */
#include "tests/support/unit.h"

#include <float.h>

#include "builder/update/batch.h"
#include "client/library.h"
#include "builder/format/portable.h"
#include "tests/support/random.h"
#include <bvhd/bvhd_vulkan.h>

enum { REFERENCES = 40, INSTANCES = 200 };

static uint32_t random_below(struct random *random, uint32_t limit)
{
    return (uint32_t)(random_next(random) % limit);
}

/* A request with references in any order. Some are equal except for their handles, some are not used. */
struct request {
    struct bvhd_reference references[REFERENCES];
    VkAccelerationStructureInstanceKHR instances[INSTANCES];
    uint32_t reference_count, instance_count;
};

static void make_request(struct random *random, struct request *request)
{
    memset(request, 0, sizeof *request);
    request->reference_count = 1 + random_below(random, REFERENCES);
    request->instance_count = 1 + random_below(random, INSTANCES);
    for (uint32_t i = 0; i < request->reference_count; i++) {
        struct bvhd_reference *reference = &request->references[i];
        reference->handle = UINT64_C(0x100000000) * (1 + random_below(random, 1000)) + i;
        reference->has_key = (int)random_below(random, 2);
        reference->key.bytes[0] = (uint8_t)random_below(random, 20); /* ignored without has_key */
        bool is_empty = random_below(random, 4) == 0;
        for (int axis = 0; axis < 3; axis++) {
            reference->bounds[axis] = is_empty ? FLT_MAX : -1;
            reference->bounds[3 + axis] = is_empty ? -FLT_MAX : (float)(1 + random_below(random, 2));
        }
    }
    for (uint32_t i = 0; i < request->instance_count; i++) {
        VkAccelerationStructureInstanceKHR *instance = &request->instances[i];
        for (int axis = 0; axis < 3; axis++)
            instance->transform.matrix[axis][axis] = 1;
        instance->mask = 0xff;
        if (random_below(random, 5) > 0)
            instance->accelerationStructureReference =
                request->references[random_below(random, request->reference_count)].handle;
    }
}

/* Builds the request, and compares the rows with the handle of each instance. */
static void check_against_build(const struct request *request)
{
    struct reference references[REFERENCES];
    struct memory memory;
    struct bvhd_error error = {0};
    struct batch_item item;
    struct portable_view view;
    uint32_t rows[REFERENCES], row_count = 0;
    memory_init(&memory, UINT64_MAX);
    for (uint32_t i = 0; i < request->reference_count; i++) {
        references[i] = (struct reference){
            .kind = REFERENCE_BLAS, .handle = request->references[i].handle, .has_key = request->references[i].has_key};
        memcpy(&references[i].key, &request->references[i].key, sizeof references[i].key);
        memcpy(&references[i].bounds, request->references[i].bounds, sizeof references[i].bounds);
    }
    const struct geometry geometry = {
        .type = GEOMETRY_INSTANCES,
        .instances.records = {(const unsigned char *)request->instances, (uint64_t)64 * request->instance_count},
        .range.primitive_count = request->instance_count};
    const struct build_input input = {.type = STRUCTURE_TOP,
                                      .geometry_count = 1,
                                      .geometries = &geometry,
                                      .reference_count = request->reference_count,
                                      .references = references,
                                      .options.target = TARGET_PORTABLE};
    const struct limits limits = limits_default();
    const struct build_context context = {.memory = &memory, .parallel = &parallel_serial};
    assert_int_equal(batch_build(&input, 1, &limits, &context, &item, &error), BVHD_OK);
    assert_int_equal(item.status, BVHD_OK);
    assert_int_equal(portable_open((struct bytes){item.blob, item.size}, &memory, &view, &error), BVHD_OK);

    assert_int_equal(bvhd_vulkan_rows(request->references, request->reference_count, request->instances,
                                      request->instance_count, rows, &row_count, &error),
                     BVHD_OK);
    assert_int_equal(row_count, view.handle_count);
    const struct portable_instance *records = view.records;
    for (uint32_t r = 0; r < view.header->record_count; r++) {
        uint64_t handle = request->instances[records[r].instance].accelerationStructureReference;
        uint32_t reference = 0;
        while (request->references[reference].handle != handle)
            reference++;
        assert_int_equal(rows[reference] + 1, bytes_get64(view.handles + 8 * (uint64_t)records[r].handle));
    }
    batch_finish(&item, 1, &memory);
}

static void rows_are_those_of_what_is_built(void **state)
{
    (void)state;
    struct random random = {11};
    struct request request;
    for (int i = 0; i < 300; i++) {
        make_request(&random, &request);
        check_against_build(&request);
    }
    assert_int_equal(library_memory.live, 0);
}

static void what_is_not_named_has_no_row(void **state)
{
    (void)state;
    static const struct bvhd_reference references[3] = {
        {.handle = 5}, {.handle = 3, .has_key = 1}, {.handle = 9, .has_key = 1, .key = {{1}}}};
    VkAccelerationStructureInstanceKHR instances[3] = {
        {.mask = 1}, {.accelerationStructureReference = 9}, {.accelerationStructureReference = 5}};
    uint32_t rows[3], count = 7;
    assert_int_equal(bvhd_vulkan_rows(references, 3, instances, 3, rows, &count, NULL), BVHD_OK);
    assert_int_equal(count, 2);
    assert_int_equal(rows[0], 1);
    assert_int_equal(rows[1], UINT32_MAX);
    assert_int_equal(rows[2], 0);
    assert_int_equal(bvhd_vulkan_rows(references, 3, instances, 1, rows, &count, NULL), BVHD_OK);
    assert_int_equal(count, 0);
    assert_int_equal(bvhd_vulkan_rows(NULL, 0, NULL, 0, NULL, &count, NULL), BVHD_OK);
}

static void unknown_names_are_refused(void **state)
{
    (void)state;
    static const struct bvhd_reference references[1] = {{.handle = 5}};
    const VkAccelerationStructureInstanceKHR instances[2] = {{.accelerationStructureReference = 5},
                                                             {.accelerationStructureReference = 6}};
    struct bvhd_error error;
    uint32_t rows[1] = {77}, count = 77;
    assert_int_equal(bvhd_vulkan_rows(references, 1, instances, 2, rows, &count, &error), BVHD_INVALID);
    assert_string_equal(error.where, "instances[1]");
    for (int64_t n = 0; n < 2; n++) {
        library_memory.fail_after = n;
        assert_int_equal(bvhd_vulkan_rows(references, 1, instances, 1, rows, &count, &error), BVHD_NO_MEMORY);
    }
    assert_int_equal(library_memory.live, 0);
    assert_true(rows[0] == 77 && count == 77);
    assert_int_equal(bvhd_vulkan_rows(references, 1, instances, 1, rows, &count, &error), BVHD_OK);
}

int main(void)
{
    static const struct CMUnitTest tests[] = {
        cmocka_unit_test(rows_are_those_of_what_is_built),
        cmocka_unit_test(what_is_not_named_has_no_row),
        cmocka_unit_test(unknown_names_are_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
