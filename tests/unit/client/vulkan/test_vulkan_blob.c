/* SPDX-License-Identifier: Apache-2.0 */
/* test_vulkan_blob.c - tests what is read from a structure's header, and how references are written into its bytes. */
#include "tests/support/unit.h"

#include "builder/format/lavapipe.h"
#include "builder/format/portable.h"
#include "tests/support/client/vulkan/vulkan_bed.h"
#include "client/vulkan/vulkan_blob.h"

static const struct device_format native_device = {"driver uuid 1234", "driver uuid 1234", LAVAPIPE_PLAIN};

static struct vulkan_bed_options options_of(enum target target)
{
    struct vulkan_bed_options options = {.target = target, .bottoms = 3, .instances = 7, .triangles = 9};
    if (target == TARGET_LAVAPIPE)
        options.device = native_device;
    return options;
}

static struct bytes copy_of(const struct bvhd_vulkan_bytes *blob)
{
    unsigned char *data = aligned_alloc(64, bytes_align(blob->size, 64));
    memcpy(data, blob->data, blob->size);
    return (struct bytes){data, blob->size};
}

static void heads_say_what_it_is(void **state)
{
    (void)state;
    for (int target = TARGET_PORTABLE; target <= TARGET_LAVAPIPE; target++) {
        struct vulkan_bed bed;
        const struct vulkan_bed_options options = options_of((enum target)target);
        vulkan_bed_init(&bed, &options);
        for (uint32_t i = 0; i < bed.count; i++) {
            struct vulkan_blob blob;
            struct bvhd_error error = {0};
            bool is_top = i == bed.count - 1;
            assert_int_equal(vulkan_blob_read((struct bytes){bed.blobs[i].data, bed.blobs[i].size}, &blob, &error),
                             BVHD_OK);
            assert_int_equal(blob.target, target);
            assert_int_equal(blob.type, is_top ? VK_ACCELERATION_STRUCTURE_TYPE_TOP_LEVEL_KHR
                                               : VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR);
            assert_int_equal(blob.reference_count, is_top ? 3 : 0);
            assert_int_equal(blob.header.handle_count, !is_top ? 0 : target == TARGET_PORTABLE ? 3 : 7);
            assert_int_equal(blob.record_count, is_top && target == TARGET_PORTABLE ? 7 : 0);
            assert_int_equal(blob.body.size, blob.header.deserialized_size);
            assert_ptr_equal(blob.body.data + blob.body.size, blob.bytes.data + blob.bytes.size);
        }
        vulkan_bed_finish(&bed);
    }
}

static void requirements_are_vulkans(void **state)
{
    (void)state;
    for (int target = TARGET_PORTABLE; target <= TARGET_LAVAPIPE; target++) {
        struct vulkan_bed bed;
        struct vulkan_blob blob;
        struct bvhd_vulkan_device device = {.limits.storage_alignment = 16};
        const struct vulkan_bed_options options = options_of((enum target)target);
        vulkan_bed_init(&bed, &options);
        assert_int_equal(vulkan_blob_read((struct bytes){bed.blobs[3].data, bed.blobs[3].size}, &blob, NULL), BVHD_OK);
        struct bvhd_vulkan_requirements needed = vulkan_blob_requirements(&blob, &device);
        assert_int_equal(needed.storage_size, blob.header.deserialized_size);
        assert_int_equal(needed.reference_count, 3);
        if (target == TARGET_LAVAPIPE) {
            assert_int_equal(needed.staging_size, bed.blobs[3].size);
            assert_int_equal(needed.staging_alignment, 256);
            assert_int_equal(needed.storage_alignment, 256);
            assert_true(needed.staging_usage & VK_BUFFER_USAGE_SHADER_DEVICE_ADDRESS_BIT);
            assert_true(needed.storage_usage & VK_BUFFER_USAGE_ACCELERATION_STRUCTURE_STORAGE_BIT_KHR);
        } else {
            assert_int_equal(needed.staging_size, blob.header.deserialized_size);
            assert_int_equal(needed.storage_alignment, 64);
            assert_false(needed.storage_usage & VK_BUFFER_USAGE_SHADER_DEVICE_ADDRESS_BIT);
            device.has_addresses = true;
            device.limits.storage_alignment = 256;
            needed = vulkan_blob_requirements(&blob, &device);
            assert_int_equal(needed.storage_alignment, 256);
            assert_true(needed.storage_usage & VK_BUFFER_USAGE_SHADER_DEVICE_ADDRESS_BIT);
        }
        vulkan_bed_finish(&bed);
    }
}

/* An empty native structure may be of either level. */
static void empty_native_structures_are_generic(void **state)
{
    (void)state;
    unsigned char data[SERIALIZED_HANDLES + LAVAPIPE_HEADER + sizeof(struct lavapipe_box)] = {0};
    struct lavapipe_box root = {.children = {LAVAPIPE_NONE, LAVAPIPE_NONE}};
    struct serialized_header header = {.serialized_size = sizeof data,
                                       .deserialized_size = sizeof data - SERIALIZED_HANDLES};
    struct vulkan_blob blob;
    serialized_write(data, &header);
    memcpy(data + SERIALIZED_HANDLES + LAVAPIPE_HEADER, &root, sizeof root);
    assert_int_equal(vulkan_blob_read((struct bytes){data, sizeof data}, &blob, NULL), BVHD_OK);
    assert_int_equal(blob.type, VK_ACCELERATION_STRUCTURE_TYPE_GENERIC_KHR);
    data[SERIALIZED_HANDLES + LAVAPIPE_HEADER + offsetof(struct lavapipe_box, children)] = 0;
    assert_int_equal(vulkan_blob_read((struct bytes){data, sizeof data}, &blob, NULL), BVHD_OK);
    assert_int_equal(blob.type, VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR);
}

static void expect(struct bytes bytes, enum bvhd_status wanted, const char *where)
{
    struct vulkan_blob blob;
    struct bvhd_error error = {0};
    assert_int_equal(vulkan_blob_read(bytes, &blob, &error), wanted);
    assert_int_equal(error.status, wanted);
    assert_string_equal(error.where, where);
}

static void sizes_that_are_not_the_heads_are_refused(void **state)
{
    (void)state;
    for (int target = TARGET_PORTABLE; target <= TARGET_LAVAPIPE; target++) {
        struct vulkan_bed bed;
        const struct vulkan_bed_options options = options_of((enum target)target);
        vulkan_bed_init(&bed, &options);
        struct bytes whole = copy_of(&bed.blobs[3]);
        unsigned char *data = malloc(whole.size + 1);
        memcpy(data, whole.data, whole.size);
        for (uint64_t size = 0; size < whole.size; size++)
            expect((struct bytes){data, size}, BVHD_CORRUPT,
                   size < SERIALIZED_HANDLES ? "header" : "header.serializedSize");
        expect((struct bytes){data, whole.size + 1}, BVHD_CORRUPT, "header.serializedSize");
        expect((struct bytes){NULL, 0}, BVHD_INVALID, "data");
        bytes_put64(data + 40, bytes_get64(whole.data + 40) - 1);
        expect((struct bytes){data, whole.size}, target == TARGET_PORTABLE ? BVHD_CORRUPT : BVHD_INCOMPATIBLE,
               "header.deserializedSize");
        free(data);
        free((void *)(uintptr_t)whole.data);
        vulkan_bed_finish(&bed);
    }
}

static void heads_that_lie_are_refused(void **state)
{
    (void)state;
    struct vulkan_bed bed;
    const struct vulkan_bed_options options = options_of(TARGET_PORTABLE);
    vulkan_bed_init(&bed, &options);
    struct bytes blob = copy_of(&bed.blobs[3]);
    unsigned char *data = (unsigned char *)(uintptr_t)blob.data;
    struct portable_header header;
    uint64_t body = blob.size - bytes_get64(data + 40);
    memcpy(&header, data + body, sizeof header);

    data[31] = PORTABLE_NEWEST + 1;
    expect(blob, BVHD_INCOMPATIBLE, "header.compatibilityUUID");
    data[31] = 1;
    bytes_put64(data + SERIALIZED_HANDLES + 8, 0);
    expect(blob, BVHD_CORRUPT, "header.handles[1]");
    bytes_put64(data + SERIALIZED_HANDLES + 8, UINT64_C(1) << 32);
    expect(blob, BVHD_CORRUPT, "header.handles[1]");
    bytes_put64(data + SERIALIZED_HANDLES + 8, 2);
    bytes_put64(data + 48, UINT64_MAX);
    expect(blob, BVHD_INCOMPATIBLE, "header.handleCount");
    bytes_put64(data + 48, blob.size);
    expect(blob, BVHD_CORRUPT, "header.handleCount");
    bytes_put64(data + 48, 3);
    header.record_count = UINT32_MAX;
    memcpy(data + body, &header, sizeof header);
    expect(blob, BVHD_CORRUPT, "body.recordOffset");
    header.record_count = 7;
    header.record_offset = UINT64_MAX - 15;
    memcpy(data + body, &header, sizeof header);
    expect(blob, BVHD_CORRUPT, "body.recordOffset");
    header.record_offset = header.body_size - (uint64_t)7 * 128 + 8;
    memcpy(data + body, &header, sizeof header);
    expect(blob, BVHD_CORRUPT, "body.recordOffset");
    free(data);
    vulkan_bed_finish(&bed);
}

static void references_have_to_be_there(void **state)
{
    (void)state;
    struct vulkan_bed bed;
    struct vulkan_blob blob;
    struct bvhd_error error;
    const struct vulkan_bed_options options = options_of(TARGET_LAVAPIPE);
    const uint64_t references[3] = {10, 20, 0};
    vulkan_bed_init(&bed, &options);
    assert_int_equal(vulkan_blob_read((struct bytes){bed.blobs[3].data, bed.blobs[3].size}, &blob, NULL), BVHD_OK);
    assert_int_equal(vulkan_blob_check_references(&blob, references, 3, UINT64_MAX, &error), BVHD_OK);
    assert_int_equal(vulkan_blob_check_references(&blob, references, 3, 0, &error), BVHD_INVALID);
    assert_string_equal(error.where, "references[2]");
    assert_int_equal(vulkan_blob_check_references(&blob, references, 2, UINT64_MAX, &error), BVHD_INVALID);
    assert_int_equal(vulkan_blob_check_references(&blob, NULL, 3, UINT64_MAX, &error), BVHD_INVALID);
    vulkan_bed_finish(&bed);
}

/* However the body is cut, the bytes are the same; only the locations differ from the file's. */
static void portions_of_portable_bodies_fit_together(void **state)
{
    (void)state;
    struct vulkan_bed bed;
    struct vulkan_blob blob;
    const struct vulkan_bed_options options = options_of(TARGET_PORTABLE);
    const uint64_t references[3] = {64, UINT64_C(0x123456789a), 1024};
    vulkan_bed_init(&bed, &options);
    assert_int_equal(vulkan_blob_read((struct bytes){bed.blobs[3].data, bed.blobs[3].size}, &blob, NULL), BVHD_OK);
    unsigned char *expected = malloc(blob.body.size), *got = malloc(blob.body.size);
    memcpy(expected, blob.body.data, blob.body.size);
    for (uint32_t i = 0; i < blob.record_count; i++) {
        unsigned char *record = expected + blob.record_offset + (uint64_t)128 * i;
        bytes_put64(record + 112, references[bytes_get32(record + 104) % 3]);
    }
    for (uint64_t portion = 64; portion <= blob.body.size + 64; portion += 64) {
        memset(got, 0xaa, blob.body.size);
        for (uint64_t begin = 0; begin < blob.body.size; begin += portion) {
            uint64_t end = begin + portion < blob.body.size ? begin + portion : blob.body.size;
            unsigned char *part = malloc(end - begin + 8);
            bytes_put64(part + (end - begin), UINT64_C(0xaaaaaaaaaaaaaaaa)); /* nothing is written behind the portion */
            assert_int_equal(vulkan_blob_fill_portable(&blob, references, begin, end, part, NULL), BVHD_OK);
            assert_true(bytes_get64(part + (end - begin)) == UINT64_C(0xaaaaaaaaaaaaaaaa));
            memcpy(got + begin, part, end - begin);
            free(part);
        }
        assert_memory_equal(got, expected, blob.body.size);
    }
    free(expected);
    free(got);
    vulkan_bed_finish(&bed);
}

/* A body of a top level of motion instances; only what a loader reads of it is there. */
static struct bytes moving_top(uint32_t count)
{
    const uint32_t handles = 3, record_offset = 192;
    const uint64_t body = portable_body_offset(handles), body_size = record_offset + (uint64_t)160 * count;
    unsigned char *data = calloc(1, body + body_size);
    struct serialized_header header = {
        .serialized_size = body + body_size, .deserialized_size = body_size, .handle_count = handles};
    struct portable_header top = {.magic = PORTABLE_MAGIC,
                                  .version = 2,
                                  .content = PORTABLE_MOVING_INSTANCES,
                                  .record_count = count,
                                  .record_offset = record_offset,
                                  .body_size = body_size};
    memcpy(header.driver_uuid, portable_driver_uuid, sizeof header.driver_uuid);
    portable_compatibility_uuid(2, header.compatibility_uuid);
    serialized_write(data, &header);
    for (uint32_t i = 0; i < handles; i++)
        bytes_put64(data + SERIALIZED_HANDLES + (uint64_t)8 * i, handles - i);
    memcpy(data + body, &top, sizeof top);
    for (uint32_t i = 0; i < count; i++)
        bytes_put32(data + body + record_offset + (uint64_t)160 * i + 16, i % handles);
    return (struct bytes){data, body + body_size};
}

/* Locations are written behind the handle, whichever portion they are in. */
static void motion_instances_get_locations(void **state)
{
    (void)state;
    enum { COUNT = 9 };
    struct vulkan_blob blob;
    const uint64_t references[3] = {64, UINT64_C(0x123456789a), 1024};
    const struct bytes bytes = moving_top(COUNT);
    assert_int_equal(vulkan_blob_read(bytes, &blob, NULL), BVHD_OK);
    assert_int_equal(blob.type, VK_ACCELERATION_STRUCTURE_TYPE_TOP_LEVEL_KHR);
    assert_int_equal(blob.record_count, COUNT);
    unsigned char *expected = malloc(blob.body.size), *got = malloc(blob.body.size);
    memcpy(expected, blob.body.data, blob.body.size);
    for (uint32_t i = 0; i < COUNT; i++)
        bytes_put64(expected + 192 + (uint64_t)160 * i + 24, references[2 - i % 3]);
    for (uint64_t portion = 64; portion <= blob.body.size + 64; portion += 64) {
        memset(got, 0xaa, blob.body.size);
        for (uint64_t begin = 0; begin < blob.body.size; begin += portion) {
            uint64_t end = begin + portion < blob.body.size ? begin + portion : blob.body.size;
            assert_int_equal(vulkan_blob_fill_portable(&blob, references, begin, end, got + begin, NULL), BVHD_OK);
        }
        assert_memory_equal(got, expected, blob.body.size);
    }
    free(expected);
    free(got);
    free((void *)(uintptr_t)bytes.data);
}

static void instances_without_a_handle_are_refused(void **state)
{
    (void)state;
    struct vulkan_bed bed;
    struct vulkan_blob blob;
    struct bvhd_error error;
    const struct vulkan_bed_options options = options_of(TARGET_PORTABLE);
    const uint64_t references[3] = {64, 128, 256};
    vulkan_bed_init(&bed, &options);
    struct bytes bytes = copy_of(&bed.blobs[3]);
    unsigned char *got = malloc(bytes.size);
    assert_int_equal(vulkan_blob_read(bytes, &blob, NULL), BVHD_OK);
    bytes_put32((unsigned char *)(uintptr_t)blob.body.data + blob.record_offset + 4 * 128 + 108, 3);
    assert_int_equal(vulkan_blob_fill_portable(&blob, references, 0, blob.body.size, got, &error), BVHD_CORRUPT);
    free(got);
    free((void *)(uintptr_t)bytes.data);
    vulkan_bed_finish(&bed);
}

static void native_blobs_get_references_for_handles(void **state)
{
    (void)state;
    struct vulkan_bed bed;
    struct vulkan_blob blob;
    const struct vulkan_bed_options options = options_of(TARGET_LAVAPIPE);
    const uint64_t references[3] = {UINT64_C(0xfedcba9876543210), 2, 3};
    vulkan_bed_init(&bed, &options);
    assert_int_equal(vulkan_blob_read((struct bytes){bed.blobs[3].data, bed.blobs[3].size}, &blob, NULL), BVHD_OK);
    unsigned char *got = malloc(bed.blobs[3].size);
    vulkan_blob_fill_native(&blob, references, got);
    for (uint64_t i = 0; i < 7; i++) {
        assert_int_equal(bytes_get64(got + SERIALIZED_HANDLES + 8 * i), references[vulkan_blob_handle(&blob, i) - 1]);
        bytes_put64(got + SERIALIZED_HANDLES + 8 * i, vulkan_blob_handle(&blob, i));
    }
    assert_memory_equal(got, bed.blobs[3].data, bed.blobs[3].size);
    free(got);
    vulkan_bed_finish(&bed);
}

int main(void)
{
    static const struct CMUnitTest tests[] = {
        cmocka_unit_test(heads_say_what_it_is),
        cmocka_unit_test(requirements_are_vulkans),
        cmocka_unit_test(empty_native_structures_are_generic),
        cmocka_unit_test(sizes_that_are_not_the_heads_are_refused),
        cmocka_unit_test(heads_that_lie_are_refused),
        cmocka_unit_test(references_have_to_be_there),
        cmocka_unit_test(portions_of_portable_bodies_fit_together),
        cmocka_unit_test(motion_instances_get_locations),
        cmocka_unit_test(instances_without_a_handle_are_refused),
        cmocka_unit_test(native_blobs_get_references_for_handles),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
