/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_dependency.c - tests that top levels wait for bottom levels of their own batch and for bounds that are looked up
 * by key, and that they fail with those, against a daemon that answers step by step.
 */
#include "tests/support/unit.h"

#include "builder/format/portable.h"
#include "builder/format/serialized.h"
#include "client/reference.h"
#include "proto/wire/rows.h"
#include "tests/support/client/client_bed.h"

enum { INSTANCES = 6 };

/* A batch of bottom levels 0 .. count - 2 and a top level, the last info, whose instances are `instances`. */
struct scene {
    struct client_bed bed;
    VkAccelerationStructureInstanceKHR instances[INSTANCES];
    struct bvhd_reference references[4];
};

static VkAccelerationStructureInstanceKHR instance_of(uint64_t handle)
{
    return (VkAccelerationStructureInstanceKHR){.transform = {{{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}}},
                                                .mask = 255,
                                                .accelerationStructureReference = handle};
}

/* Makes info `index` a top level over the scene's instances, which name the destinations 1 .. INSTANCES. */
static void make_top(struct scene *scene, uint32_t index)
{
    struct bed_build *asked = scene->bed.asked;
    for (uint32_t i = 0; i < INSTANCES; i++)
        scene->instances[i] = instance_of(i + 1);
    asked->geometries[index].geometryType = VK_GEOMETRY_TYPE_INSTANCES_KHR;
    asked->geometries[index].geometry.instances = (VkAccelerationStructureGeometryInstancesDataKHR){
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_INSTANCES_DATA_KHR,
        .data.hostAddress = scene->instances};
    asked->ranges[index].primitiveCount = INSTANCES;
    asked->infos[index].type = VK_ACCELERATION_STRUCTURE_TYPE_TOP_LEVEL_KHR;
}

/* Describes `count` infos, of which the one at `top` is a top level whose instances name `bottoms` of the others. */
static void describe(struct scene *scene, uint32_t count, uint32_t top)
{
    bed_describe(scene->bed.asked, count, 1);
    make_top(scene, top);
    uint32_t used = 0;
    for (uint32_t i = 0; i < count; i++)
        for (uint32_t named = used; i != top && named < INSTANCES; named = INSTANCES)
            scene->instances[used++].accelerationStructureReference = i + 1;
    while (used < INSTANCES)
        scene->instances[used++].accelerationStructureReference = 0;
}

static struct bvhd_batch *submit(struct scene *scene)
{
    struct bvhd_batch *batch = NULL;
    struct bvhd_error error = {.status = BVHD_OK};
    if (bvhd_batch_submit(scene->bed.client, &scene->bed.asked->build, &batch, &error) != BVHD_OK)
        fail_msg("submit: %s: %s", error.where, error.text);
    assert_true(bvhd_batch_is_copied(batch));
    return batch;
}

/* Receives a BUILD of `count` items, says that they are prepared, and returns the frame. */
static struct frame take_build(struct scene *scene, uint32_t count)
{
    struct frame frame;
    assert_true(fake_expect(&scene->bed.fake, FRAME_BUILD, &frame));
    struct control_build *build = fake_build(&scene->bed.fake, &frame);
    assert_int_equal(build->item_count, count);
    fake_free(&scene->bed.fake, build);
    fake_send_prepared(&scene->bed.fake, frame.header.request, 0, count);
    return frame;
}

static struct reference_row reference_in(const struct frame *frame, uint32_t slot)
{
    struct reference_row row;
    memcpy(&row, frame->inline_bytes.data + ROWS_GEOMETRY_LEAST + slot * sizeof row, sizeof row);
    return row;
}

static void start(struct scene *scene)
{
    memset(scene, 0, sizeof *scene);
    bed_start(&scene->bed);
    assert_true(bed_connect(&scene->bed));
}

/* The place of a top level in its batch does not matter. */
static void test_one_batch(void **state)
{
    (void)state;
    for (uint32_t top = 0; top < 4; top++) {
        struct scene scene;
        start(&scene);
        struct fake_daemon *fake = &scene.bed.fake;
        describe(&scene, 4, top);
        struct bvhd_batch *batch = submit(&scene);
        memset(scene.instances, 0xff, sizeof scene.instances); /* they have been copied */
        struct frame frame = take_build(&scene, 3);
        uint64_t request = frame.header.request;
        fake_send_result(fake, request, 0, 10);
        fake_send_result(fake, request, 2, 10);
        while (bed_status(batch, top == 3 ? 2 : 3) == BVHD_PENDING)
            bvhd_client_dispatch(scene.bed.client);
        assert_true(fake_is_quiet(fake));
        fake_send_result(fake, request, 1, 10);
        while (bed_status(batch, top < 2 ? 2 : 1) == BVHD_PENDING)
            bvhd_client_dispatch(scene.bed.client);
        frame = take_build(&scene, 1);
        for (uint32_t slot = 0; slot < 3; slot++) {
            struct reference_row row = reference_in(&frame, slot);
            assert_int_equal(row.handle, slot + 1 + (slot >= top));
            assert_int_equal(row.has_key, 1);
            assert_int_equal(row.key[31], 0xab);
            assert_true(row.bounds[0] == 1 && row.bounds[5] == 6);
        }
        fake_send_result(fake, frame.header.request, 0, 20);
        assert_true(bed_finish(&scene.bed, batch));
        assert_int_equal(bvhd_batch_result(batch, top)->size, 20);
        bvhd_batch_destroy(batch);
        assert_true(bed_stop(&scene.bed));
    }
}

/* Blocked items do not hold up the others, however many frames those need. */
static void test_many(void **state)
{
    (void)state;
    struct scene scene;
    memset(&scene, 0, sizeof scene);
    bed_start(&scene.bed);
    fake_serve(&scene.bed.fake);
    describe(&scene, 900, 0);
    struct bvhd_batch *batch = submit(&scene);
    assert_int_equal(bvhd_batch_wait(batch, 20000), BVHD_OK);
    for (uint32_t i = 0; i < 900; i++)
        assert_int_equal(bed_status(batch, i), BVHD_OK);
    bvhd_batch_destroy(batch);
    fake_serve_end(&scene.bed.fake);
    assert_true(bed_stop(&scene.bed));
}

/* A bottom level that fails takes its top level with it, and the error names both. */
static void test_failed_bottom(void **state)
{
    (void)state;
    struct scene scene;
    start(&scene);
    struct fake_daemon *fake = &scene.bed.fake;
    describe(&scene, 4, 3);
    struct bvhd_batch *batch = submit(&scene);
    uint64_t request = take_build(&scene, 3).header.request;
    fake_send_result(fake, request, 0, 10);
    fake_send_failed(fake, request, 1, BVHD_TOO_LARGE, "infos[1].geometryCount");
    while (bed_status(batch, 3) == BVHD_PENDING)
        bvhd_client_dispatch(scene.bed.client);
    const struct bvhd_error *error = &bvhd_batch_result(batch, 3)->error;
    assert_int_equal(error->status, BVHD_TOO_LARGE);
    assert_string_equal(error->where, "infos[3].geometries[0].instances");
    assert_non_null(strstr(error->text, "infos[1] builds a structure that instances name, and failed: "
                                        "infos[1].geometryCount: as the test wants it"));
    assert_int_equal(bed_status(batch, 2), BVHD_PENDING);
    fake_send_result(fake, request, 2, 10);
    assert_true(bed_finish(&scene.bed, batch));
    assert_int_equal(bed_status(batch, 2), BVHD_OK);
    bvhd_batch_destroy(batch);
    /* One that breaks a rule is not even requested. */
    describe(&scene, 2, 1);
    scene.bed.asked->infos[0].sType = 0;
    batch = submit(&scene);
    assert_true(bvhd_batch_is_done(batch));
    assert_int_equal(bed_status(batch, 1), BVHD_INVALID);
    assert_non_null(strstr(bvhd_batch_result(batch, 1)->error.text, "infos[0].sType"));
    bvhd_batch_destroy(batch);
    assert_true(bed_stop(&scene.bed));
}

static void test_cancel(void **state)
{
    (void)state;
    struct scene scene;
    start(&scene);
    describe(&scene, 3, 2);
    struct bvhd_batch *batch = submit(&scene);
    uint64_t request = take_build(&scene, 2).header.request;
    bvhd_batch_cancel_item(batch, 0);
    assert_int_equal(bed_status(batch, 0), BVHD_CANCELLED);
    assert_int_equal(bed_status(batch, 1), BVHD_PENDING);
    assert_int_equal(bed_status(batch, 2), BVHD_CANCELLED);
    fake_send_result(&scene.bed.fake, request, 1, 10);
    assert_true(bed_finish(&scene.bed, batch));
    bvhd_batch_destroy(batch);
    /* The top level alone, the whole batch, and a batch that is destroyed. */
    for (int way = 0; way < 3; way++) {
        describe(&scene, 3, 2);
        batch = submit(&scene);
        if (way == 0) {
            bvhd_batch_cancel_item(batch, 2);
            assert_int_equal(bed_status(batch, 2), BVHD_CANCELLED);
            assert_int_equal(bed_status(batch, 0), BVHD_PENDING);
        } else if (way == 1) {
            bvhd_batch_cancel(batch);
            assert_true(bvhd_batch_is_done(batch));
            assert_int_equal(bed_status(batch, 2), BVHD_CANCELLED);
        }
        bvhd_batch_destroy(batch);
    }
    assert_true(bed_stop(&scene.bed));
}

/* A daemon that is lost between bottom and top levels fails the top level. */
static void test_lost(void **state)
{
    (void)state;
    struct scene scene;
    start(&scene);
    describe(&scene, 3, 0);
    struct bvhd_batch *batch = submit(&scene);
    uint64_t request = take_build(&scene, 2).header.request;
    fake_send_result(&scene.bed.fake, request, 0, 10);
    fake_hang_up(&scene.bed.fake);
    assert_true(bed_finish(&scene.bed, batch));
    assert_int_equal(bed_status(batch, 0), BVHD_UNAVAILABLE);
    assert_int_equal(bed_status(batch, 1), BVHD_OK);
    assert_int_equal(bed_status(batch, 2), BVHD_UNAVAILABLE);
    bvhd_batch_destroy(batch);
    assert_true(bed_stop(&scene.bed));
}

/* Describes a top level alone, over two references by key without bounds and one with them. */
static void describe_keys(struct scene *scene)
{
    bed_describe(scene->bed.asked, 1, 1);
    make_top(scene, 0);
    scene->bed.asked->infos[0].dstAccelerationStructure = VK_NULL_HANDLE;
    for (uint32_t i = 0; i < 4; i++)
        scene->references[i] = (struct bvhd_reference){.handle = i + 1, .has_key = 1, .key = {{(uint8_t)(i + 1)}}};
    scene->references[1].bounds[3] = 1;
    for (uint32_t i = 4; i < INSTANCES; i++)
        scene->instances[i] = instance_of(0);
    scene->instances[3] = instance_of(1); /* so that nothing names references[3] */
    scene->bed.asked->build.references = scene->references;
    scene->bed.asked->build.reference_count = 4;
}

/* Sends the result of a GET: the bytes of an empty structure with this content and this number of handles. */
static void send_structure(struct scene *scene, uint64_t request, uint32_t item, uint32_t content, uint64_t handles)
{
    static _Alignas(64) unsigned char bytes[64 + 64 + sizeof(struct portable_header)];
    struct serialized_header header = {.serialized_size = sizeof bytes, .handle_count = handles};
    struct portable_header body = {.content = content};
    memcpy(header.driver_uuid, portable_driver_uuid, sizeof header.driver_uuid);
    serialized_write(bytes, &header);
    memcpy(bytes + 64, &body, sizeof body);
    struct control_result result = {.item = item, .size = sizeof bytes, .origin = ORIGIN_MEMORY};
    result.summary = (struct summary){.method = "none", .bounds = {{-1, -2, -3}, {4, 5, 6}}};
    result.summary.slabs.max[SLABS_COUNT - 1] = 7;
    memset(&result.key, 0xcd, sizeof result.key);
    fake_send_result_with(&scene->bed.fake, request, &result, (struct bytes){bytes, sizeof bytes}, -1);
}

static uint64_t take_get(struct scene *scene)
{
    struct frame frame;
    struct control_get *get;
    assert_true(fake_expect(&scene->bed.fake, FRAME_GET, &frame));
    assert_int_equal(control_unpack_get(frame.control, &scene->bed.fake.peer.memory, &get, NULL), BVHD_OK);
    assert_int_equal(get->key_count, 2);
    assert_int_equal(get->keys[0].bytes[0], 1);
    assert_int_equal(get->keys[1].bytes[0], 3);
    fake_free(&scene->bed.fake, get);
    return frame.header.request;
}

static void test_lookup(void **state)
{
    (void)state;
    struct scene scene;
    start(&scene);
    describe_keys(&scene);
    struct bvhd_batch *batch = submit(&scene);
    uint64_t request = take_get(&scene);
    send_structure(&scene, request, 1, PORTABLE_AABBS, 0);
    send_structure(&scene, request, 0, PORTABLE_MOVING_TRIANGLES, 0);
    bvhd_client_dispatch(scene.bed.client);
    struct frame frame = take_build(&scene, 1);
    for (uint32_t slot = 0; slot < 3; slot++) {
        struct reference_row row = reference_in(&frame, slot);
        assert_int_equal(row.handle, slot + 1);
        assert_int_equal(row.key[0], slot == 1 ? 2 : 0xcd);
        assert_true(row.bounds[0] == (slot == 1 ? 0 : -1));
        assert_true(row.slabs[19] == (slot == 1 ? 0 : 7));
        assert_int_equal(row.moves, slot == 0);
    }
    fake_send_result(&scene.bed.fake, frame.header.request, 0, 20);
    assert_true(bed_finish(&scene.bed, batch));
    assert_int_equal(bed_outcome(batch), BVHD_OK);
    bvhd_batch_destroy(batch);
    assert_true(bed_stop(&scene.bed));
}

/* How the bounds of references[2] are not found. */
static void answer_lookup(struct scene *scene, uint64_t request, int way)
{
    if (way == 0)
        fake_send_failed(&scene->bed.fake, request, 1, BVHD_NOT_FOUND, "keys[1]");
    else if (way == 1)
        send_structure(scene, request, 1, PORTABLE_INSTANCES, 0);
    else if (way == 2)
        send_structure(scene, request, 1, PORTABLE_INSTANCES, 1);
    else
        fake_send_result(&scene->bed.fake, request, 1, 50);
}

static void test_failed_lookup(void **state)
{
    (void)state;
    static const struct {
        enum bvhd_status status;
        const char *text;
    } ways[4] = {
        {BVHD_NOT_FOUND, "infos[0] names this reference, whose bounds are not given: the service has no structure"},
        {BVHD_INVALID, "the structure is a top level, not a bottom level"},
        {BVHD_INVALID, "the structure is a top level, not a bottom level"},
        {BVHD_CORRUPT, ""},
    };
    for (int way = 0; way < 4; way++) {
        struct scene scene;
        start(&scene);
        describe_keys(&scene);
        struct bvhd_batch *batch = submit(&scene);
        answer_lookup(&scene, take_get(&scene), way);
        assert_true(bed_finish(&scene.bed, batch));
        const struct bvhd_error *error = &bvhd_batch_result(batch, 0)->error;
        assert_int_equal(error->status, ways[way].status);
        assert_string_equal(error->where, "build.references[2].key");
        assert_non_null(strstr(error->text, ways[way].text));
        bvhd_batch_destroy(batch); /* the other lookup is still under way */
        assert_true(bed_stop(&scene.bed));
    }
}

/* Batches with lookups may be cancelled and destroyed before and after these are sent. */
static void test_cancelled_lookup(void **state)
{
    (void)state;
    for (int way = 0; way < 4; way++) {
        struct scene scene;
        memset(&scene, 0, sizeof scene);
        bed_start(&scene.bed);
        if (way > 1)
            assert_true(bed_connect(&scene.bed));
        describe_keys(&scene);
        struct bvhd_batch *batch = submit(&scene);
        if (way % 2 == 0) {
            bvhd_batch_cancel(batch);
            assert_int_equal(bed_outcome(batch), BVHD_CANCELLED);
        }
        bvhd_batch_destroy(batch);
        assert_true(bed_stop(&scene.bed));
    }
}

/* Every allocation fails once: it ends with errors or results, and nothing stays allocated. */
static void test_failing_allocations(void **state)
{
    (void)state;
    struct scene scene;
    int64_t fails = 0;
    bool succeeded = false;
    memset(&scene, 0, sizeof scene);
    bed_start(&scene.bed);
    fake_serve(&scene.bed.fake);
    for (; !succeeded; fails++) {
        struct bvhd_batch *batch = NULL;
        describe(&scene, 3, 1);
        scene.instances[2] = instance_of(9);
        scene.references[0] = (struct bvhd_reference){.handle = 9, .has_key = 1};
        scene.bed.asked->build.references = scene.references;
        scene.bed.asked->build.reference_count = 1;
        assert_int_equal(bvhd_client_connect(scene.bed.client, NULL), BVHD_OK);
        library_memory.fail_after = fails;
        enum bvhd_status status = bvhd_batch_submit(scene.bed.client, &scene.bed.asked->build, &batch, NULL);
        if (status == BVHD_OK)
            status = bvhd_batch_wait(batch, 10000);
        succeeded = library_memory.fail_after >= 0;
        library_memory.fail_after = -1;
        if (succeeded) {
            assert_int_equal(bed_status(batch, 0), BVHD_OK);
            assert_int_equal(bed_status(batch, 1), BVHD_NOT_FOUND);
        }
        bvhd_batch_destroy(batch);
        assert_int_equal(bvhd_client_ping(scene.bed.client, 10000, NULL, NULL), BVHD_OK);
    }
    assert_in_range(fails, 15, 500);
    fake_serve_end(&scene.bed.fake);
    assert_true(bed_stop(&scene.bed));
}

static void test_from_result(void **state)
{
    (void)state;
    unsigned char bytes[256] = {0};
    struct serialized_header header = {.serialized_size = sizeof bytes};
    struct bvhd_reference reference = {.handle = 77};
    struct bvhd_result result = {.data = bytes, .size = sizeof bytes, .key = {{5}}, .bounds = {1, 2, 3, 4, 5, 6}};
    result.slabs[10] = 9;
    result.moves = 1;
    serialized_write(bytes, &header);
    assert_int_equal(bvhd_reference_from_result(&result, 3, &reference), BVHD_OK);
    assert_true(reference.moves == 1 && reference_convert(&reference).moves && reference_take(&result, 3).moves);
    assert_true(reference.handle == 3 && reference.has_key == 1 && reference.key.bytes[0] == 5);
    assert_true(reference.bounds[5] == 6 && reference.slabs[10] == 9);
    assert_int_equal(bvhd_reference_from_result(&result, 0, &reference), BVHD_INVALID);
    assert_int_equal(bvhd_reference_from_result(NULL, 1, &reference), BVHD_INVALID);
    assert_int_equal(bvhd_reference_from_result(&result, 1, NULL), BVHD_INVALID);
    result.error.status = BVHD_PENDING;
    assert_int_equal(bvhd_reference_from_result(&result, 1, &reference), BVHD_PENDING);
    result.error.status = BVHD_OK;
    header.handle_count = 1;
    serialized_write(bytes, &header);
    assert_int_equal(bvhd_reference_from_result(&result, 1, &reference), BVHD_INVALID);
    result.size--;
    assert_int_equal(bvhd_reference_from_result(&result, 1, &reference), BVHD_CORRUPT);
    assert_int_equal(reference.handle, 3);
}

/* The bounds of a structure that is a point at the origin are given, and yet become 0 in the description. */
static void test_point_at_origin(void **state)
{
    (void)state;
    static const struct box zero;
    unsigned char bytes[256] = {0};
    struct serialized_header header = {.serialized_size = sizeof bytes};
    struct bvhd_result result = {.data = bytes, .size = sizeof bytes};
    struct bvhd_reference reference = {.handle = 0};
    serialized_write(bytes, &header);
    assert_false(reference_is_bounded(&reference));
    assert_int_equal(bvhd_reference_from_result(&result, 3, &reference), BVHD_OK);
    assert_true(reference_is_bounded(&reference));
    assert_true(reference.bounds[0] == 0 && reference.bounds[5] == 0);
    struct reference converted = reference_convert(&reference);
    assert_memory_equal(&converted.bounds, &zero, sizeof zero);
    reference.bounds[4] = -0.0f; /* any other bounds are taken as they are */
    converted = reference_convert(&reference);
    assert_memory_equal(&converted.bounds, reference.bounds, sizeof zero);
}

/* A structure moves if its content does, whatever else the bytes are. */
static void test_moves(void **state)
{
    (void)state;
    enum { BODY = 64, HANDLES = 3, BODY_BEHIND_HANDLES = 128 };
    _Alignas(64) unsigned char bytes[BODY_BEHIND_HANDLES + sizeof(struct portable_header)];
    for (uint32_t content = 0; content < PORTABLE_CONTENTS + 2; content++) {
        const bool moves = content == PORTABLE_MOVING_TRIANGLES || content == PORTABLE_MOVING_INSTANCES;
        for (uint64_t handles = 0; handles <= HANDLES; handles += HANDLES) {
            const uint32_t body = handles ? BODY_BEHIND_HANDLES : BODY;
            const struct portable_header portable = {.content = content};
            struct serialized_header header = {.handle_count = handles};
            struct bytes structure = {bytes, body + sizeof portable};
            memset(bytes, 0, sizeof bytes);
            header.serialized_size = structure.size;
            memcpy(bytes + body, &portable, sizeof portable);
            serialized_write(bytes, &header);
            assert_false(reference_moves(structure)); /* of another driver */
            memcpy(header.driver_uuid, portable_driver_uuid, sizeof header.driver_uuid);
            serialized_write(bytes, &header);
            assert_true(reference_moves(structure) == moves);
            for (uint64_t size = 0; size < body + sizeof portable; size++) {
                header.serialized_size = structure.size = size;
                serialized_write(bytes, &header);
                assert_false(reference_moves(structure));
            }
        }
    }
    assert_false(reference_moves((struct bytes){NULL, 0}));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_one_batch),
        cmocka_unit_test(test_many),
        cmocka_unit_test(test_failed_bottom),
        cmocka_unit_test(test_cancel),
        cmocka_unit_test(test_lost),
        cmocka_unit_test(test_lookup),
        cmocka_unit_test(test_failed_lookup),
        cmocka_unit_test(test_cancelled_lookup),
        cmocka_unit_test(test_failing_allocations),
        cmocka_unit_test(test_from_result),
        cmocka_unit_test(test_point_at_origin),
        cmocka_unit_test(test_moves),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
