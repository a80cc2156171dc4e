/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_local_builds.c - tests clients that build in the program's own process: results and their order, keys, limits of
 * time, cancelling, event loops.
 */
#include "tests/support/unit.h"

#include <poll.h>
#include <pthread.h>
#include <signal.h>
#include <unistd.h>

#include "builder/update/batch.h"
#include "client/vulkan_input.h"
#include "tests/support/client/local_bed.h"

/* Checks a result against a build that uses neither a client nor its library. */
static void expect_built(const struct bvhd_result *result, const struct terrain *mesh)
{
    struct memory memory;
    struct vulkan_input *input = NULL;
    struct build_options options = {.quality = QUALITY_FAST, .target = TARGET_PORTABLE};
    struct bvhd_error error;
    struct batch_item item;
    struct limits limits = limits_default();
    memory_init(&memory, UINT64_MAX);
    struct build_context context = {.memory = &memory, .parallel = &parallel_serial};
    assert_int_equal(vulkan_input_create(&mesh->info, 1, &mesh->ranges, NULL, 0, &options, &input, &error), BVHD_OK);
    assert_int_equal(batch_build(vulkan_input_entries(input), 1, &limits, &context, &item, &error), BVHD_OK);
    assert_int_equal(item.status, BVHD_OK);
    assert_int_equal(result->size, item.size);
    assert_memory_equal(result->data, item.blob, item.size);
    assert_memory_equal(&result->key, &item.key, sizeof item.key);
    assert_memory_equal(result->bounds, &item.summary.bounds, sizeof result->bounds);
    assert_memory_equal(result->slabs, &item.summary.slabs, sizeof result->slabs);
    assert_int_equal(result->triangles, item.summary.triangles);
    assert_int_equal(result->depth, item.summary.depth);
    assert_true(result->sah == item.summary.sah);
    assert_string_equal(result->method, item.summary.method);
    assert_int_equal(result->quality, BVHD_QUALITY_FAST);
    assert_int_equal(result->target, BVHD_TARGET_PORTABLE);
    assert_true(result->peak_bytes > 0 && result->original_build_ms > 0);
    batch_finish(&item, 1, &memory);
    vulkan_input_destroy(input);
}

/* Submit builds nothing, wait builds everything; equal structures are built once. */
static void test_result(void **state)
{
    (void)state;
    struct local_bed bed;
    for (uint32_t threads = 0; threads <= 2; threads += 2) {
        local_bed_start(&bed, threads);
        struct bvhd_batch *batch = local_bed_submit(bed.client, bed.meshes, 3, BVHD_PRIORITY_NORMAL);
        assert_true(bvhd_batch_is_copied(batch));
        if (threads == 0) {
            bvhd_client_dispatch(bed.client);
            assert_int_equal(local_bed_status(batch, 0), BVHD_PENDING);
        }
        struct bvhd_batch *same = local_bed_submit(bed.client, bed.meshes + 2, 1, BVHD_PRIORITY_NORMAL);
        assert_int_equal(bvhd_batch_wait(same, -1), BVHD_OK);
        assert_int_equal(bvhd_batch_wait(batch, -1), BVHD_OK);
        local_bed_expect_ok(batch);
        for (uint32_t i = 0; i < 3; i++)
            expect_built(bvhd_batch_result(batch, i), &bed.meshes[i]);
        expect_built(bvhd_batch_result(same, 0), &bed.meshes[2]);
        assert_int_equal(bvhd_batch_result(batch, 0)->origin, BVHD_ORIGIN_BUILT);
        assert_ptr_equal(bvhd_batch_result(same, 0)->blob, bvhd_batch_result(batch, 2)->blob);
        enum bvhd_origin origins[] = {bvhd_batch_result(batch, 2)->origin, bvhd_batch_result(same, 0)->origin};
        assert_true((origins[0] == BVHD_ORIGIN_BUILT) != (origins[1] == BVHD_ORIGIN_BUILT));
        bvhd_batch_destroy(batch);
        bvhd_batch_destroy(same);
        local_bed_stop(&bed);
    }
}

/* A fetch finds the results that a batch of the client holds, and nothing else. */
static void test_fetch(void **state)
{
    (void)state;
    struct local_bed bed;
    local_bed_start(&bed, 0);
    struct bvhd_batch *batch = local_bed_submit(bed.client, bed.meshes, 2, BVHD_PRIORITY_NORMAL), *fetched, *again;
    assert_int_equal(bvhd_batch_wait(batch, -1), BVHD_OK);
    struct bvhd_key keys[3] = {bvhd_batch_result(batch, 1)->key, {{7}}, bvhd_batch_result(batch, 0)->key};
    assert_int_equal(bvhd_batch_fetch(bed.client, 3, keys, &fetched, NULL), BVHD_OK);
    assert_true(bvhd_batch_is_done(fetched));
    assert_int_equal(bvhd_batch_result(fetched, 0)->origin, BVHD_ORIGIN_MEMORY);
    expect_built(bvhd_batch_result(fetched, 0), &bed.meshes[1]);
    assert_int_equal(local_bed_status(fetched, 1), BVHD_NOT_FOUND);
    assert_string_equal(bvhd_batch_result(fetched, 1)->error.where, "keys[1]");
    struct bvhd_blob *blob = bvhd_blob_ref(bvhd_batch_result(fetched, 2)->blob);
    bvhd_batch_destroy(batch);
    assert_int_equal(bvhd_batch_fetch(bed.client, 3, keys, &again, NULL), BVHD_OK);
    assert_int_equal(local_bed_status(again, 0), BVHD_OK);
    assert_string_equal(bvhd_batch_result(again, 0)->method, bvhd_batch_result(fetched, 0)->method);
    bvhd_batch_destroy(fetched);
    bvhd_batch_destroy(again);
    assert_int_equal(bvhd_batch_fetch(bed.client, 3, keys, &again, NULL), BVHD_OK);
    for (uint32_t i = 0; i < 3; i++)
        assert_int_equal(local_bed_status(again, i), BVHD_NOT_FOUND);
    bvhd_batch_destroy(again);
    assert_int_equal(((const char *)bvhd_blob_data(blob))[0], ((const char *)bvhd_blob_data(blob))[0]);
    bvhd_blob_unref(blob);
    local_bed_stop(&bed);
}

/* A limit ends a wait between structures. Each wait builds at least one: of the highest priority, then of its batch. */
static void test_order(void **state)
{
    (void)state;
    struct local_bed bed;
    local_bed_start(&bed, 0);
    struct bvhd_batch *low = local_bed_submit(bed.client, bed.meshes, 1, BVHD_PRIORITY_LOW);
    struct bvhd_batch *older = local_bed_submit(bed.client, bed.meshes + 1, 1, BVHD_PRIORITY_NORMAL);
    struct bvhd_batch *newer = local_bed_submit(bed.client, bed.meshes + 2, 2, BVHD_PRIORITY_NORMAL);
    struct bvhd_batch *high = local_bed_submit(bed.client, bed.meshes + 4, 1, BVHD_PRIORITY_HIGH);
    assert_int_equal(bvhd_batch_wait(newer, 0), BVHD_PENDING);
    assert_true(bvhd_batch_is_done(high));
    assert_int_equal(bvhd_batch_wait(newer, 0), BVHD_PENDING);
    assert_int_equal(local_bed_status(newer, 0), BVHD_OK);
    assert_int_equal(bvhd_batch_wait(newer, 0), BVHD_OK);
    assert_false(bvhd_batch_is_done(older));
    assert_int_equal(bvhd_batch_wait(low, 0), BVHD_PENDING);
    assert_true(bvhd_batch_is_done(older));
    assert_int_equal(bvhd_batch_wait(low, -1), BVHD_OK);
    bvhd_batch_destroy(low);
    bvhd_batch_destroy(older);
    bvhd_batch_destroy(newer);
    bvhd_batch_destroy(high);
    local_bed_stop(&bed);
}

/* Payloads that do not fit into the pool wait in the caller's memory, or get a memfd of their own. */
static void test_small_pool(void **state)
{
    (void)state;
    for (uint64_t size = 16 << 10; size <= 128 << 10; size *= 8) {
        struct local_bed bed;
        local_bed_start_with(&bed, (struct bvhd_client_options){.local = BVHD_LOCAL_ALWAYS, .pool_size = size});
        struct bvhd_batch *batch = local_bed_submit(bed.client, bed.meshes, LOCAL_BED_MESHES, BVHD_PRIORITY_NORMAL);
        assert_int_equal(bvhd_batch_wait_copied(batch, -1), BVHD_OK);
        assert_true(bvhd_batch_is_copied(batch));
        assert_int_equal(bvhd_batch_wait(batch, -1), BVHD_OK);
        local_bed_expect_ok(batch);
        for (uint32_t i = 0; i < LOCAL_BED_MESHES; i++)
            expect_built(bvhd_batch_result(batch, i), &bed.meshes[i]);
        bvhd_batch_destroy(batch);
        local_bed_stop(&bed);
    }
}

/* Makes a mesh whose build takes much longer than the time until it is cancelled. */
static void init_long(struct terrain *mesh)
{
    terrain_init(mesh, 300000, 99);
}

/* A build that is cancelled, or whose batch is destroyed, ends the wait of the thread that builds it. */
static void test_cancel(void **state)
{
    (void)state;
    for (uint32_t threads = 0; threads <= 1; threads++) {
        struct local_bed bed;
        struct terrain mesh;
        struct local_bed_waiting waiting;
        local_bed_start(&bed, threads);
        init_long(&mesh);
        struct bvhd_batch *batch = local_bed_submit_long(bed.client, &mesh, BVHD_PRIORITY_NORMAL, 0);
        local_bed_start_waiting(&waiting, batch);
        usleep(20000);
        bvhd_batch_cancel(batch);
        assert_int_equal(local_bed_status(batch, 0), BVHD_CANCELLED);
        pthread_join(waiting.thread, NULL);
        bvhd_batch_destroy(batch);
        batch = local_bed_submit(bed.client, bed.meshes, 2, BVHD_PRIORITY_NORMAL);
        bvhd_batch_cancel_item(batch, 0);
        assert_int_equal(bvhd_batch_wait(batch, -1), BVHD_OK);
        assert_int_equal(local_bed_status(batch, 1), BVHD_OK);
        assert_true(threads > 0 || local_bed_status(batch, 0) == BVHD_CANCELLED);
        bvhd_batch_destroy(batch);
        terrain_finish(&mesh);
        local_bed_stop(&bed);
    }
}

/* A batch is destroyed while a thread that waits for another one builds it, or while a thread of the client does. */
static void test_destroy(void **state)
{
    (void)state;
    for (uint32_t threads = 0; threads <= 1; threads++) {
        struct local_bed bed;
        struct terrain mesh;
        struct local_bed_waiting waiting;
        local_bed_start(&bed, threads);
        init_long(&mesh);
        struct bvhd_batch *batch = local_bed_submit(bed.client, bed.meshes, 1, BVHD_PRIORITY_LOW);
        struct bvhd_batch *urgent = local_bed_submit_long(bed.client, &mesh, BVHD_PRIORITY_HIGH, 0);
        local_bed_start_waiting(&waiting, batch);
        usleep(20000);
        bvhd_batch_destroy(urgent);
        pthread_join(waiting.thread, NULL);
        local_bed_expect_ok(batch);
        bvhd_batch_destroy(batch);
        terrain_finish(&mesh);
        init_long(&mesh);
        urgent = local_bed_submit_long(bed.client, &mesh, BVHD_PRIORITY_NORMAL, 0);
        usleep(threads > 0 ? 20000 : 0);
        bvhd_batch_destroy(urgent);
        terrain_finish(&mesh);
        local_bed_stop(&bed); /* while the thread still leaves the build */
    }
}

/* Items that wait for the same build do not inherit the cancellation of the one that began it. */
static void test_joined(void **state)
{
    (void)state;
    struct local_bed bed;
    struct terrain mesh;
    struct local_bed_waiting waiting[2];
    local_bed_start(&bed, 0);
    terrain_init(&mesh, 100000, 5);
    for (int i = 0; i < 2; i++) {
        local_bed_start_waiting(&waiting[i], local_bed_submit(bed.client, &mesh, 1, BVHD_PRIORITY_NORMAL));
        usleep(10000);
    }
    bvhd_batch_cancel(waiting[0].batch);
    for (int i = 0; i < 2; i++)
        pthread_join(waiting[i].thread, NULL);
    local_bed_expect_ok(waiting[1].batch);
    expect_built(bvhd_batch_result(waiting[1].batch, 0), &mesh);
    for (int i = 0; i < 2; i++)
        bvhd_batch_destroy(waiting[i].batch);
    terrain_finish(&mesh);
    local_bed_stop(&bed);
}

/* A program with an event loop has to allow threads; then it never builds, and hears of results. */
static void test_event_loop(void **state)
{
    (void)state;
    struct local_bed bed;
    struct local_bed_build request;
    struct bvhd_batch *batch = NULL;
    struct bvhd_error error;
    struct bvhd_key key = {{1}};
    local_bed_start(&bed, 0);
    bvhd_client_descriptor(bed.client);
    local_bed_describe(bed.meshes, 1, &request);
    assert_int_equal(bvhd_batch_submit(bed.client, &request.build, &batch, &error), BVHD_UNSUPPORTED);
    assert_null(batch);
    assert_string_equal(error.where, "options.local_threads");
    assert_non_null(strstr(error.text, "bvhd_client_descriptor"));
    request.infos[0].sType = 0; /* there is nothing to build */
    assert_int_equal(bvhd_batch_submit(bed.client, &request.build, &batch, NULL), BVHD_OK);
    assert_int_equal(local_bed_status(batch, 0), BVHD_INVALID);
    bvhd_batch_destroy(batch);
    assert_int_equal(bvhd_batch_fetch(bed.client, 1, &key, &batch, NULL), BVHD_OK);
    assert_int_equal(local_bed_status(batch, 0), BVHD_NOT_FOUND);
    bvhd_batch_destroy(batch);
    local_bed_stop(&bed);

    local_bed_start(&bed, 2);
    struct pollfd watched = {.fd = bvhd_client_descriptor(bed.client), .events = POLLIN};
    batch = local_bed_submit(bed.client, bed.meshes, LOCAL_BED_MESHES, BVHD_PRIORITY_NORMAL);
    while (!bvhd_batch_is_done(batch)) {
        assert_int_equal(poll(&watched, 1, 60000), 1);
        bvhd_client_dispatch(bed.client);
    }
    local_bed_expect_ok(batch);
    bvhd_batch_destroy(batch);
    local_bed_stop(&bed);
}

/* Counts the threads of this process, and returns in *ret_open how many but this one take SIGINT or SIGTERM. */
static uint32_t count_threads(uint32_t *ret_open)
{
    const unsigned long long wanted = 1ull << (SIGINT - 1) | 1ull << (SIGTERM - 1);
    DIR *folder = opendir("/proc/self/task");
    uint32_t count = 0;
    *ret_open = 0;
    for (const struct dirent *entry; (entry = readdir(folder));) {
        char path[300], line[200];
        unsigned long long blocked = 0;
        if (entry->d_name[0] == '.')
            continue;
        snprintf(path, sizeof path, "/proc/self/task/%s/status", entry->d_name);
        FILE *file = fopen(path, "re");
        while (file && fgets(line, sizeof line, file))
            sscanf(line, "SigBlk: %llx", &blocked);
        if (file)
            fclose(file);
        count++;
        *ret_open += atoi(entry->d_name) != getpid() && (blocked & wanted) != wanted;
    }
    closedir(folder);
    return count;
}

/* The client starts the threads that it is allowed, when there is something to build, and they block signals. */
static void test_threads(void **state)
{
    (void)state;
    uint32_t open, before = count_threads(&open), open_before = open;
    for (uint32_t threads = 0; threads <= 1; threads++) {
        struct local_bed bed;
        local_bed_start(&bed, threads);
        assert_int_equal(count_threads(&open), before);
        struct bvhd_batch *batch = local_bed_submit(bed.client, bed.meshes, 2, BVHD_PRIORITY_NORMAL);
        assert_int_equal(bvhd_batch_wait(batch, -1), BVHD_OK);
        local_bed_expect_ok(batch);
        assert_int_equal(count_threads(&open), before + threads);
        assert_int_equal(open, open_before);
        bvhd_batch_destroy(batch);
        local_bed_stop(&bed);
        while (count_threads(&open) > before) /* a thread that was joined may be listed for a moment */
            usleep(1000);
    }
}

/* There is no daemon to talk to. */
static void test_calls(void **state)
{
    (void)state;
    struct local_bed bed;
    struct bvhd_error error;
    struct bvhd_counters *counters;
    local_bed_start(&bed, 0);
    assert_int_equal(bvhd_client_connect(bed.client, &error), BVHD_UNAVAILABLE);
    assert_string_equal(error.where, "options.local");
    assert_int_equal(bvhd_client_ping(bed.client, -1, NULL, NULL), BVHD_UNAVAILABLE);
    assert_int_equal(bvhd_client_counters(bed.client, -1, &counters, NULL), BVHD_UNAVAILABLE);
    local_bed_stop(&bed);
    struct bvhd_client_options options = {.struct_size = sizeof options, .local = (enum bvhd_local)3};
    struct bvhd_client *client = NULL;
    assert_int_equal(bvhd_client_create(&options, &client, &error), BVHD_INVALID);
    assert_string_equal(error.where, "options.local");
    options.struct_size = offsetof(struct bvhd_client_options, local); /* of a program that does not know the field */
    assert_int_equal(bvhd_client_create(&options, &client, &error), BVHD_OK);
    bvhd_client_destroy(client);
    options.struct_size--;
    assert_int_equal(bvhd_client_create(&options, &client, &error), BVHD_INVALID);
}

enum { THREADS = 6, ROUNDS = 25 };

/* One of several threads that do everything at the same time. */
struct worker {
    struct local_bed *bed;
    pthread_t thread;
    unsigned seed;
    bool failed;
};

static void work_once(struct worker *worker)
{
    struct local_bed *bed = worker->bed;
    uint32_t first = (uint32_t)rand_r(&worker->seed) % LOCAL_BED_MESHES;
    uint32_t count = 1 + (uint32_t)rand_r(&worker->seed) % (LOCAL_BED_MESHES - first);
    enum bvhd_priority priority = (enum bvhd_priority)(rand_r(&worker->seed) % 3 - 1);
    struct bvhd_batch *batch = local_bed_submit(bed->client, bed->meshes + first, count, priority), *fetched;
    int what = rand_r(&worker->seed) % 8;
    if (what == 0)
        bvhd_batch_cancel(batch);
    if (what == 1)
        bvhd_batch_cancel_item(batch, 0);
    if (what == 2)
        bvhd_client_dispatch(bed->client);
    if (what == 3)
        bvhd_batch_wait(batch, 1);
    else
        worker->failed = worker->failed || bvhd_batch_wait(batch, -1) != BVHD_OK;
    const struct bvhd_result *result = bvhd_batch_result(batch, count - 1);
    if (what > 3) {
        worker->failed = worker->failed || result->error.status != BVHD_OK;
        bvhd_batch_fetch(bed->client, 1, &result->key, &fetched, NULL);
        worker->failed = worker->failed || bvhd_batch_result(fetched, 0)->error.status != BVHD_OK;
        bvhd_batch_destroy(what == 4 ? batch : fetched);
        bvhd_batch_destroy(what == 4 ? fetched : batch);
    } else {
        bvhd_batch_destroy(batch);
    }
}

static void *work(void *argument)
{
    for (int i = 0; i < ROUNDS; i++)
        work_once(argument);
    return NULL;
}

/* Threads submit, wait, cancel, fetch and destroy at the same time, while none or two threads of the client build. */
static void test_many_threads(void **state)
{
    (void)state;
    for (uint32_t threads = 0; threads <= 2; threads += 2) {
        struct local_bed bed;
        struct worker workers[THREADS];
        local_bed_start_with(&bed, (struct bvhd_client_options){
                                       .local = BVHD_LOCAL_ALWAYS, .local_threads = threads, .pool_size = 256 << 10});
        for (uint32_t i = 0; i < THREADS; i++) {
            workers[i] = (struct worker){.bed = &bed, .seed = i + 1};
            assert_int_equal(pthread_create(&workers[i].thread, NULL, work, &workers[i]), 0);
        }
        for (uint32_t i = 0; i < THREADS; i++) {
            pthread_join(workers[i].thread, NULL);
            assert_false(workers[i].failed);
        }
        local_bed_stop(&bed);
    }
}

/* Every allocation fails once, and nothing is left. */
static void test_no_memory(void **state)
{
    (void)state;
    struct local_bed bed;
    bool succeeded = false;
    local_bed_start(&bed, 0);
    bed.meshes[0].range.primitiveCount = 8;
    bed.meshes[1].range.primitiveCount = 20;
    bvhd_batch_destroy(local_bed_submit(bed.client, bed.meshes, 1, BVHD_PRIORITY_NORMAL)); /* the pool exists now */
    for (int64_t fails = 0; !succeeded; fails++) {
        struct local_bed_build request;
        struct bvhd_batch *batch = NULL;
        uint64_t live = library_memory.live;
        local_bed_describe(bed.meshes, 2, &request);
        library_memory.fail_after = fails;
        enum bvhd_status status = bvhd_batch_submit(bed.client, &request.build, &batch, NULL);
        if (status == BVHD_OK) {
            assert_int_equal(bvhd_batch_wait(batch, -1), BVHD_OK);
            succeeded = library_memory.fail_after >= 0;
            for (uint32_t i = 0; i < 2; i++)
                assert_true(local_bed_status(batch, i) == BVHD_OK || local_bed_status(batch, i) == BVHD_NO_MEMORY);
        }
        library_memory.fail_after = -1;
        assert_true(status == BVHD_OK || status == BVHD_NO_MEMORY);
        if (succeeded)
            local_bed_expect_ok(batch);
        bvhd_batch_destroy(batch);
        assert_in_range(library_memory.live, live, live + 4096); /* the table of results may have grown */
    }
    local_bed_stop(&bed);
}

static bool is_mapped(const char *name)
{
    char line[512];
    bool found = false;
    FILE *maps = fopen("/proc/self/maps", "r");
    assert_non_null(maps);
    while (fgets(line, sizeof line, maps))
        found = found || strstr(line, name);
    fclose(maps);
    return found;
}

/* Embree is loaded for the first request that names it, and not before. It has to be the first test of this program. */
static void test_embree(void **state)
{
    (void)state;
    struct local_bed bed;
    struct local_bed_build request;
    struct bvhd_batch *batch;
    for (uint32_t builder = BVHD_BUILDER_OWN; builder <= BVHD_BUILDER_EMBREE; builder++) {
        local_bed_start(&bed, 0);
        local_bed_describe(bed.meshes, 1, &request);
        request.build.builder = (enum bvhd_builder)builder;
        assert_int_equal(bvhd_batch_submit(bed.client, &request.build, &batch, NULL), BVHD_OK);
        assert_int_equal(bvhd_batch_wait(batch, -1), BVHD_OK);
        const struct bvhd_result *result = bvhd_batch_result(batch, 0);
        assert_true(is_mapped("libbvhd_build"));
        if (builder == BVHD_BUILDER_OWN) {
            assert_int_equal(result->error.status, BVHD_OK);
            assert_false(is_mapped("libembree"));
        } else if (result->error.status == BVHD_OK) {
            assert_string_equal(result->method, "embree-low");
            assert_true(is_mapped("libembree"));
        } else {
            assert_int_equal(result->error.status, BVHD_UNSUPPORTED);
            assert_string_equal(result->error.where, "build.builder");
        }
        bvhd_batch_destroy(batch);
        local_bed_stop(&bed);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_embree),       cmocka_unit_test(test_result),     cmocka_unit_test(test_fetch),
        cmocka_unit_test(test_order),        cmocka_unit_test(test_small_pool), cmocka_unit_test(test_cancel),
        cmocka_unit_test(test_destroy),      cmocka_unit_test(test_joined),     cmocka_unit_test(test_event_loop),
        cmocka_unit_test(test_calls),        cmocka_unit_test(test_threads),    cmocka_unit_test(test_no_memory),
        cmocka_unit_test(test_many_threads),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
