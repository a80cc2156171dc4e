/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_client_absence.c - tests clients that use a daemon if there is one: when they build in the program's own process
 * instead, when they wait, and what they do not build.
 */
#include "tests/support/unit.h"

#include <poll.h>
#include <sys/stat.h>
#include <unistd.h>

#include "client/address.h"
#include "tests/support/client/client_bed.h"

enum { LONG_MS = 60000 }; /* a time that no test waits for */

/* Starts a client that builds here if no daemon answers within `connect_ms`. */
static void start(struct client_bed *bed, uint32_t connect_ms, uint32_t threads)
{
    struct bvhd_client_options options = {.connect_timeout_ms = connect_ms, .local_threads = threads};
    bed_options(bed, &options);
}

static void expect_built_here(struct bvhd_batch *batch)
{
    const struct bvhd_result *result = bvhd_batch_result(batch, 0);
    if (result->error.status != BVHD_OK)
        fail_msg("%s: %s", result->error.where, result->error.text);
    assert_string_equal(result->method, "none"); /* all triangles are degenerate; the fake daemon says "binned" */
}

/* Nobody listens on the socket that was named: builds begin at once, and calls that need a daemon wait for one. */
static void test_nobody(void **state)
{
    (void)state;
    struct client_bed bed;
    start(&bed, LONG_MS, 0);
    fake_close_listener(&bed.fake);
    double begin = bed_now();
    struct bvhd_batch *batch = bed_submit(&bed, 1, 1);
    assert_int_equal(bvhd_batch_wait(batch, -1), BVHD_OK);
    assert_true(bed_now() - begin < LONG_MS / 2);
    expect_built_here(batch);
    fake_open_listener(&bed.fake);
    fake_serve(&bed.fake);
    struct bvhd_batch *later = bed_submit(&bed, 2, 2);
    assert_int_equal(bvhd_batch_wait(later, -1), BVHD_OK);
    assert_int_equal(bvhd_batch_result(later, 1)->size, 2); /* by the daemon */
    struct bvhd_key key = bvhd_batch_result(batch, 0)->key;
    struct bvhd_batch *fetched;
    assert_int_equal(bvhd_batch_fetch(bed.client, 1, &key, &fetched, NULL), BVHD_OK);
    assert_true(bvhd_batch_is_done(fetched)); /* what was built here is found here */
    expect_built_here(fetched);
    fake_serve_end(&bed.fake);
    bvhd_batch_destroy(fetched);
    bvhd_batch_destroy(later);
    bed_end(&bed, batch);
}

/* The call that asks for a daemon keeps its timeout. */
static void test_connect(void **state)
{
    (void)state;
    struct client_bed bed;
    struct bvhd_error error;
    start(&bed, BED_CONNECT_MS, 0);
    fake_close_listener(&bed.fake);
    double begin = bed_now();
    assert_int_equal(bvhd_client_connect(bed.client, &error), BVHD_UNAVAILABLE);
    assert_in_range((int)(bed_now() - begin), BED_CONNECT_MS - 1, BED_LATE_MS);
    assert_string_equal(error.where, bed.fake.path);
    assert_true(bed_stop(&bed));
}

/* Items that are under way when the connection is lost fail; later submissions are built in this process. */
static void test_lost(void **state)
{
    (void)state;
    struct client_bed bed;
    uint64_t request;
    start(&bed, LONG_MS, 0);
    assert_true(bed_connect(&bed));
    struct bvhd_batch *batch = bed_ask(&bed, &request);
    fake_close_listener(&bed.fake);
    fake_hang_up(&bed.fake);
    assert_int_equal(bed_outcome(batch), BVHD_UNAVAILABLE);
    struct bvhd_batch *later = bed_submit(&bed, 1, 1);
    assert_int_equal(bvhd_batch_wait(later, -1), BVHD_OK);
    expect_built_here(later);
    bvhd_batch_destroy(batch);
    bvhd_batch_destroy(later);
    assert_true(bed_stop(&bed));
}

/* A daemon that accepts and says nothing is waited for as long as any other. */
static void test_silent(void **state)
{
    (void)state;
    struct client_bed bed;
    start(&bed, BED_CONNECT_MS, 0);
    double begin = bed_now();
    struct bvhd_batch *batch = bed_submit(&bed, 1, 1);
    assert_true(bvhd_batch_is_copied(batch));
    assert_int_equal(bvhd_batch_wait(batch, 20), BVHD_PENDING);
    assert_int_equal(bvhd_batch_wait(batch, -1), BVHD_OK);
    assert_true(bed_now() - begin >= BED_CONNECT_MS - 1);
    expect_built_here(batch);
    bed_end(&bed, batch);
}

/* An event loop that may not build: at once where nobody listens, and later where a daemon stays silent. */
static void test_event_loop(void **state)
{
    (void)state;
    struct client_bed bed;
    struct bvhd_batch *batch = NULL;
    start(&bed, BED_CONNECT_MS, 0);
    struct pollfd watched = {.fd = bvhd_client_descriptor(bed.client), .events = POLLIN};
    batch = bed_submit(&bed, 1, 1);
    while (!bvhd_batch_is_done(batch)) {
        assert_int_equal(poll(&watched, 1, LONG_MS), 1);
        bvhd_client_dispatch(bed.client);
    }
    assert_int_equal(bed_status(batch, 0), BVHD_UNSUPPORTED);
    assert_string_equal(bvhd_batch_result(batch, 0)->error.where, "options.local_threads");
    bed_end(&bed, batch);

    struct bvhd_error error;
    start(&bed, LONG_MS, 0);
    fake_close_listener(&bed.fake);
    bvhd_client_descriptor(bed.client);
    bed_describe(bed.asked, 1, 1);
    batch = NULL;
    assert_int_equal(bvhd_batch_submit(bed.client, &bed.asked->build, &batch, &error), BVHD_UNSUPPORTED);
    assert_string_equal(error.where, "options.local_threads");
    assert_null(batch);
    assert_true(bed_stop(&bed));
}

/* The same with a thread that builds. */
static void test_event_loop_with_thread(void **state)
{
    (void)state;
    struct client_bed bed;
    start(&bed, LONG_MS, 1);
    fake_close_listener(&bed.fake);
    struct pollfd watched = {.fd = bvhd_client_descriptor(bed.client), .events = POLLIN};
    struct bvhd_batch *batch = bed_submit(&bed, 3, 2);
    while (!bvhd_batch_is_done(batch)) {
        assert_int_equal(poll(&watched, 1, LONG_MS), 1);
        bvhd_client_dispatch(bed.client);
    }
    expect_built_here(batch);
    bed_end(&bed, batch);
}

/* Where no socket was named, the absence of a daemon is known at once, whatever the timeout is. */
static void test_unnamed(void **state)
{
    (void)state;
    if (access(ADDRESS_SYSTEM_SOCKET, F_OK) == 0)
        skip(); /* this machine has a daemon */
    struct client_bed bed;
    struct bvhd_error error;
    struct bvhd_client_options options = {.socket_path = "", .connect_timeout_ms = LONG_MS, .local = BVHD_LOCAL_NEVER};
    unsetenv("BVHD_SOCKET");
    setenv("XDG_RUNTIME_DIR", "/", 1); /* root's, or not this user's */
    setenv("TMPDIR", "/nowhere", 1);
    bed_options(&bed, &options);
    double begin = bed_now();
    struct bvhd_batch *batch = bed_submit(&bed, 1, 1);
    assert_true(bvhd_batch_is_done(batch));
    assert_int_equal(bed_status(batch, 0), BVHD_UNAVAILABLE);
    assert_non_null(strstr(bed_text(batch), "/run/bvhd/bvhd.sock: No such file or directory; start bvhd, or build"));
    assert_int_equal(bvhd_client_connect(bed.client, &error), BVHD_UNAVAILABLE);
    assert_int_equal(bvhd_client_ping(bed.client, -1, NULL, NULL), BVHD_UNAVAILABLE);
    assert_true(bed_now() - begin < LONG_MS / 2);
    bed_end(&bed, batch);
}

/* The user's own daemon is found without XDG_RUNTIME_DIR, where bvhctl starts it, unless others can reach it. */
static void test_own_directory(void **state)
{
    (void)state;
    struct client_bed bed;
    char own[128], link[160];
    struct bvhd_client_options options = {.socket_path = "", .local = BVHD_LOCAL_NEVER};
    fake_start(&bed.fake);
    unsetenv("BVHD_SOCKET");
    unsetenv("XDG_RUNTIME_DIR");
    setenv("TMPDIR", bed.fake.folder, 1);
    snprintf(own, sizeof own, "%s/bvhd-%u", bed.fake.folder, (unsigned)geteuid());
    snprintf(link, sizeof link, "%s/bvhd.sock", own);
    assert_int_equal(mkdir(own, 0700), 0);
    assert_int_equal(symlink(bed.fake.path, link), 0);
    options.struct_size = sizeof options;
    assert_int_equal(bvhd_client_create(&options, &bed.client, NULL), BVHD_OK);
    fake_serve(&bed.fake);
    assert_int_equal(bvhd_client_connect(bed.client, NULL), BVHD_OK);
    bvhd_client_destroy(bed.client);
    assert_int_equal(bvhd_client_create(&options, &bed.client, NULL), BVHD_OK);
    if (access(ADDRESS_SYSTEM_SOCKET, F_OK) != 0) {
        assert_int_equal(chmod(own, 0755), 0);
        assert_int_equal(bvhd_client_connect(bed.client, NULL), BVHD_UNAVAILABLE);
    }
    bvhd_client_destroy(bed.client);
    fake_serve_end(&bed.fake);
    unlink(link);
    rmdir(own);
    fake_stop(&bed.fake);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_nobody),     cmocka_unit_test(test_connect),
        cmocka_unit_test(test_lost),       cmocka_unit_test(test_silent),
        cmocka_unit_test(test_event_loop), cmocka_unit_test(test_event_loop_with_thread),
        cmocka_unit_test(test_unnamed),    cmocka_unit_test(test_own_directory),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
