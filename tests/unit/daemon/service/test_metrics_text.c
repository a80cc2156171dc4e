/* SPDX-License-Identifier: Apache-2.0 */
/* test_metrics_text.c - tests that the text for monitoring has the form of its format, and the counters' values. */
#include "tests/support/unit.h"

#include <stdlib.h>

#include "daemon/service/metrics_text.h"
#include "tests/support/daemon/session_world.h"

static struct session_world world;
static char text[METRICS_TEXT_SIZE + 1];

static int tear_down(void **state)
{
    (void)state;
    world_finish(&world);
    return 0;
}

static void begin(void)
{
    world_init(&world, NULL);
}

static void write_text(void)
{
    struct memory memory;
    uint64_t size;
    memory_init(&memory, UINT64_MAX);
    char *written = metrics_text(world.service, &memory, &size);
    assert_non_null(written);
    assert_true(size < METRICS_TEXT_SIZE);
    memcpy(text, written, size);
    text[size] = 0;
    memory_free(&memory, written);
    assert_int_equal(atomic_load(&memory.live), 0);
}

/* Returns the value of the line that starts with `name` and a space. */
static double value(const char *name)
{
    char start[128];
    snprintf(start, sizeof start, "\n%s ", name);
    const char *at = strstr(text, start);
    if (!at)
        fail_msg("not in the text: %s", name);
    return at ? strtod(at + strlen(start), NULL) : 0;
}

static void every_counter_is_there(void **state)
{
    (void)state;
    begin();
    struct world_client *client = world_join(&world);
    struct world_mesh mesh;
    world_mesh_init(&mesh, 100, 1);
    world_build_mesh(client, 1, &mesh);
    world_settle(&world);
    write_text();
    struct counters counters = world_counters(&world);
    assert_true(value("bvhd_builds_done_total") == 1);
    assert_true(value("bvhd_payload_bytes_total") == (double)mesh.size);
    assert_true(value("bvhd_memory_limit") == (double)counters.memory_limit);
    assert_non_null(strstr(text, "bvhd_info{version=\""));
#define SUM(name) value("bvhd_" #name "_total");
    COUNTERS_OF_SUMS(SUM)
#undef SUM
#define LEVEL(name) value("bvhd_" #name);
    COUNTERS_OF_LEVELS(LEVEL)
#undef LEVEL
    world_mesh_finish(&mesh);
}

static void histograms_grow_up_to_their_count(void **state)
{
    (void)state;
    begin();
    static const uint64_t times[] = {0, 900, 70000, 70000, 3000000, 9000000000};
    uint64_t count = sizeof times / sizeof *times, seen = 0, before = 0;
    for (uint64_t i = 0; i < count; i++)
        latency_add(&world.service->latencies[LATENCY_build], 1, times[i] * 1000);
    write_text();
    assert_true(value("bvhd_latency_seconds_count{stage=\"build\"}") == (double)count);
    assert_true(value("bvhd_latency_seconds_bucket{stage=\"build\",le=\"+Inf\"}") == (double)count);
    assert_true(value("bvhd_latency_seconds_count{stage=\"total\"}") == 0);
    assert_in_range((uint64_t)value("bvhd_latency_seconds_sum{stage=\"build\"}"), 9003, 9004);
    for (const char *at = text; (at = strstr(at, "{stage=\"build\",le=\"")); at++, seen++) {
        double most = strtod(at + strlen("{stage=\"build\",le=\""), NULL);
        uint64_t below = strtoull(strchr(at, '}') + 1, NULL, 10), wanted = 0;
        for (uint64_t i = 0; i < count; i++)
            wanted += (double)times[i] < most * 1e6;
        assert_int_equal(below, wanted);
        assert_true(below >= before);
        before = below;
    }
    assert_true(seen > 10);
}

/* Each line is "# TYPE name kind" or "name value" or "name{labels} value", and every name is declared once, before. */
static void lines_have_the_form_of_the_format(void **state)
{
    (void)state;
    begin();
    write_text();
    char declared[128] = "", line[256], kind[32], name[128], number[64], rest;
    uint32_t lines = 0;
    for (const char *at = text; *at; at = strchr(at, '\n') + 1, lines++) {
        snprintf(line, sizeof line, "%.*s", (int)strcspn(at, "\n"), at);
        if (sscanf(line, "# TYPE %127s %31s%c", declared, kind, &rest) == 2)
            continue;
        assert_int_equal(sscanf(line, "%127[a-z_] %63s%c", name, number, &rest) == 2 ||
                             sscanf(line, "%127[a-z_]{%*[a-z]=\"%*[a-z0-9.]\"} %63s%c", name, number, &rest) == 2 ||
                             sscanf(line, "%127[a-z_]{stage=\"%*[a-z]\",le=\"%*[^\"]\"} %63s%c", name, number, &rest) ==
                                 2,
                         1);
        assert_int_equal(strncmp(name, declared, strlen(declared)), 0);
        char *end;
        strtod(number, &end);
        assert_int_equal(*end, 0);
    }
    assert_true(lines > 200);
}

static void nothing_is_written_without_memory(void **state)
{
    (void)state;
    begin();
    struct memory memory;
    uint64_t size = 7;
    memory_init(&memory, 100);
    assert_null(metrics_text(world.service, &memory, &size));
    assert_int_equal(size, 7);
}

#define TEST(name) cmocka_unit_test_teardown(name, tear_down)

int main(void)
{
    const struct CMUnitTest tests[] = {
        TEST(every_counter_is_there),
        TEST(histograms_grow_up_to_their_count),
        TEST(lines_have_the_form_of_the_format),
        TEST(nothing_is_written_without_memory),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
