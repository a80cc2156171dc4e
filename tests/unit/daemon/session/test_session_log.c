/* SPDX-License-Identifier: Apache-2.0 */
/* test_session_log.c - tests what is said of requests: who was refused and why, how long items took, and why. */
#include "tests/support/unit.h"

#include "tests/support/daemon/capture_log.h"
#include "tests/support/daemon/session_world.h"

enum { WAIT_MS = 30 };

static struct session_world world;
static char text[CAPTURE_SIZE];

static int tear_down(void **state)
{
    (void)state;
    world_finish(&world);
    return 0;
}

static void begin(uint64_t slow_ms, uint32_t max_queue)
{
    struct service_options options = world_options();
    options.slow_ms = slow_ms;
    options.max_queue = max_queue;
    world_init(&world, &options);
}

static void expect(const char *part)
{
    if (!strstr(text, part))
        fail_msg("not in the log: %s\nthe log: %s", part, text);
}

/* Returns the number after "NAME=". */
static double number(const char *name)
{
    char start[64];
    snprintf(start, sizeof start, " %s=", name);
    const char *at = strstr(text, start);
    if (!at)
        fail_msg("not in the log: %s\nthe log: %s", start, text);
    return at ? strtod(at + strlen(start), NULL) : 0;
}

static uint32_t lines_of(const char *event)
{
    uint32_t count = 0;
    for (const char *at = text; (at = strstr(at, event)); at++)
        count++;
    return count;
}

static void refusals_name_the_client_and_the_reason(void **state)
{
    (void)state;
    begin(0, 1);
    struct world_client *first = world_join_as(&world, 1234), *second = world_join_as(&world, 4321);
    struct world_mesh mesh;
    world_mesh_init(&mesh, 10, 1);
    struct world_gate *gates[] = {world_shut(&world), world_shut(&world)};
    world_build_mesh(first, 1, &mesh);
    struct capture capture = capture_begin();
    for (uint64_t i = 0; i < 100; i++)
        world_build_mesh(second, 77 + i, &mesh);
    capture_end(&capture, text);
    assert_non_null(world_find(second, FRAME_BUSY, 77, 0));
    expect(" level=info event=request_refused connection=2 uid=4321 pid=4711 request=77 status=BUSY why=\"");
    expect("queue");
    assert_true(lines_of("event=request_refused") < 100); /* one a second */
    for (int i = 0; i < 2; i++)
        world_open(gates[i]);
    world_settle(&world);
    world_mesh_finish(&mesh);
}

/* Checks that the line's reason is what took most of the time. */
static void check_reason(void)
{
    static const struct {
        const char *name, *reason;
    } shares[] = {
        {"memory_ms", "why=\"it waited for memory"},         {"threads_ms", "why=\"it waited for threads"},
        {"prepare_ms", "why=\"its geometry took long"},      {"build_ms", "why=\"its build took long"},
        {"disk_ms", "why=\"its result was long looked for"}, {"repeated_ms", "why=\"its build ran short"},
        {"other_ms", "why=\"the daemon was busy"},
    };
    size_t most = 0;
    for (size_t i = 1; i < sizeof shares / sizeof *shares; i++)
        if (number(shares[i].name) > number(shares[most].name))
            most = i;
    expect(shares[most].reason);
}

static void slow_items_say_why(void **state)
{
    (void)state;
    begin(WAIT_MS, 100);
    struct world_client *first = world_join(&world), *second = world_join(&world);
    struct world_mesh mesh;
    world_mesh_init(&mesh, 100, 1);
    struct world_gate *gates[] = {world_shut(&world), world_shut(&world)};
    struct capture capture = capture_begin();
    world_build_mesh(first, 7, &mesh);
    world_build_mesh(second, 8, &mesh);
    usleep(WAIT_MS * 1000);
    for (int i = 0; i < 2; i++)
        world_open(gates[i]);
    const struct control_result *result = world_await_result(first, 7, 0)->result;
    world_await_result(second, 8, 0);
    capture_end(&capture, text);
    char key[KEY_TEXT_SIZE], part[64];
    key_to_text(&result->key, key);
    snprintf(part, sizeof part, " item=0 key=%.8s ", key);
    expect(part);
    expect(" event=slow_build connection=");
    expect(" status=OK origin=");
    assert_int_equal(number("primitives"), 100);
    assert_true(number("threads_ms") + number("other_ms") >= WAIT_MS / 2);
    double sum = number("memory_ms") + number("threads_ms") + number("prepare_ms") + number("disk_ms") +
                 number("build_ms") + number("repeated_ms") + number("other_ms");
    assert_true(sum >= number("ms") - 1 && sum <= number("ms") + 1);
    check_reason();
    world_settle(&world);
    world_mesh_finish(&mesh);
}

static void details_name_the_request_of_each_key(void **state)
{
    (void)state;
    begin(0, 100);
    struct world_client *client = world_join(&world);
    struct world_mesh mesh;
    world_mesh_init(&mesh, 10, 1);
    log_set_level(LOG_DEBUG);
    struct capture capture = capture_begin();
    world_build_mesh(client, 9, &mesh);
    const struct control_result *result = world_await_result(client, 9, 0)->result;
    world_settle(&world);
    capture_end(&capture, text);
    log_set_level(LOG_INFO);
    char key[KEY_TEXT_SIZE], part[128];
    key_to_text(&result->key, key);
    snprintf(part, sizeof part, " event=item_done connection=1 uid=1000 pid=4711 request=9 item=0 key=%.8s ", key);
    expect(part);
    expect(" status=OK origin=built ms=");
    expect(" event=request_done connection=1 uid=1000 pid=4711 request=9 kind=build items=1 ms=");
    snprintf(part, sizeof part, " event=build_done key=%.8s ", key);
    expect(part);
    world_mesh_finish(&mesh);
}

static void quick_items_say_nothing_but_count(void **state)
{
    (void)state;
    begin(0, 100);
    struct world_client *client = world_join(&world);
    struct world_mesh mesh;
    world_mesh_init(&mesh, 100, 1);
    struct capture capture = capture_begin();
    world_build_mesh(client, 1, &mesh);
    const struct control_result *result = world_await_result(client, 1, 0)->result;
    world_get(client, 2, &result->key, 1);
    world_settle(&world);
    world_get(client, 3, &(struct key){{0}}, 1); /* is not found */
    world_settle(&world);
    capture_end(&capture, text);
    assert_int_equal(lines_of("event="), 0);
    struct counters counters = world_counters(&world);
    assert_int_equal(counters.latency_total_items, 2);
    assert_int_equal(counters.latency_waiting_items, 2);
    assert_int_equal(counters.latency_prepare_items, 1);
    assert_int_equal(counters.latency_build_items, 1);
    double total = result->queued_ms + result->prepare_ms + result->build_ms;
    assert_true((double)counters.latency_total_max_us >= total * 1000 - 1);
    assert_true((double)counters.latency_build_max_us <= result->build_ms * 1000);
    assert_true(counters.latency_total_p50_us <= counters.latency_total_p99_us);
    world_mesh_finish(&mesh);
}

#define TEST(name) cmocka_unit_test_teardown(name, tear_down)

int main(void)
{
    const struct CMUnitTest tests[] = {
        TEST(refusals_name_the_client_and_the_reason),
        TEST(slow_items_say_why),
        TEST(details_name_the_request_of_each_key),
        TEST(quick_items_say_nothing_but_count),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
