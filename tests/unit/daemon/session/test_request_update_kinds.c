/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_request_update_kinds.c - tests updates of each kind of structure through a session, from sources in memory and
 * on disk: the bytes are those of an update without a service.
 */
#include "tests/support/unit.h"

#include <ftw.h>

#include "tests/support/builder/inputs.h"
#include "tests/support/daemon/update_request.h"

static struct session_world world;
static char directory[] = "/tmp/bvhd-update-XXXXXX";

static void start(void)
{
    struct service_options options = world_options();
    options.disk_directory = directory;
    world_init(&world, &options);
}

static int set_up(void **state)
{
    (void)state;
    assert_non_null(mkdtemp(strcpy(directory, "/tmp/bvhd-update-XXXXXX")));
    start();
    return 0;
}

static int remove_one(const char *path, const struct stat *about, int type, struct FTW *at)
{
    (void)about, (void)type, (void)at;
    return remove(path);
}

static int tear_down(void **state)
{
    (void)state;
    world_finish(&world);
    nftw(directory, remove_one, 8, FTW_DEPTH | FTW_PHYS);
    return 0;
}

static void (*const makers[])(struct test_input *) = {
    inputs_triangles,        inputs_aabbs,           inputs_instances,        inputs_spheres, inputs_swept_spheres,
    inputs_motion_triangles, inputs_mixed_triangles, inputs_motion_instances,
};

enum { KINDS = sizeof makers / sizeof *makers };

static void make(int kind, struct test_input *test)
{
    makers[kind](test);
    test->input.flags |= BUILD_ALLOW_UPDATE;
}

/* Changes everything that may be other than it was, of any kind. */
static void move(struct test_input *test)
{
    for (int k = 0; k < INPUTS_VERTICES; k++) {
        test->vertices[k][k % 4] += 2;
        test->end_vertices[k][(k + 1) % 3] -= 1;
    }
    test->transform[7] += 1;
    test->boxes[0][3] += 1;
    inputs_set_record(test, 0, 55, INSTANCE_FLIP_FACING);
    inputs_set_motion_record(test, 0, MOTION_SRT, 55, 0);
    inputs_set_motion_record(test, 3, MOTION_MATRIX, 77, 0);
}

static void expect_refit(struct world_client *client, const struct build_input *update, const struct key *source,
                         const struct update_made *made)
{
    const struct world_event *event = update_await(client, update_ask(client, update, source));
    if (event->result->error.status != BVHD_OK)
        fail_msg("%s: %s", event->result->error.where, event->result->error.text);
    update_check_same(event, made);
    assert_int_equal(event->result->summary.refits, 1);
    assert_string_equal(event->result->summary.method, "refit");
}

static void test_every_kind(void **state)
{
    (void)state;
    struct world_client *client = world_join(&world);
    struct key keys[KINDS];
    static struct test_input tests[KINDS];
    static struct update_made built[KINDS], updated[KINDS];
    for (int kind = 0; kind < KINDS; kind++) {
        make(kind, &tests[kind]);
        keys[kind] = update_build(client, &tests[kind].input);
        update_make(&tests[kind].input, NULL, &built[kind]);
        move(&tests[kind]);
        const struct build_input update = update_of(&tests[kind].input);
        update_make(&update, &built[kind], &updated[kind]);
        expect_refit(client, &update, &keys[kind], &updated[kind]);
    }
    world_finish(&world);
    start();
    client = world_join(&world);
    for (int kind = 0; kind < KINDS; kind++) {
        const struct build_input update = update_of(&tests[kind].input);
        expect_refit(client, &update, &keys[kind], &updated[kind]);
        update_made_finish(&updated[kind]);
        update_made_finish(&built[kind]);
    }
    assert_int_equal(world_counters(&world).builds_started, 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(test_every_kind, set_up, tear_down),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
