/* SPDX-License-Identifier: Apache-2.0 */
/* test_command_trace.c - tests `bvhctl trace` with tracers that are right, wrong or lost. */
#include "tests/support/unit.h"

#include <fcntl.h>
#include <math.h>
#include <sys/stat.h>
#include <unistd.h>

#include "client/bvhctl/command_trace.h"
#include "client/bvhctl/base/files.h"
#include "client/bvhctl/scene/manifest.h"
#include "tests/support/client/bvhctl/test_world.h"

static const char manifest[] = "{\"schema\":1,\"structures\":["
                               "{\"file\":\"0.as\",\"type\":\"blas\",\"scene\":\"world\",\"name\":\"ground\","
                               "\"target\":\"portable\",\"geometries\":[{}]},"
                               "{\"file\":\"1.as\",\"type\":\"blas\",\"scene\":\"world\",\"name\":\"cube\",\"target\":"
                               "\"portable\",\"geometries\":[{}]},"
                               "{\"file\":\"2.as\",\"type\":\"tlas\",\"scene\":\"world\",\"name\":\"world\",\"target\":"
                               "\"portable\",\"geometries\":[],"
                               "\"handles\":[\"0.as\",\"1.as\"]}]}";

static char directory[64], picture[96], text[96];

static void write_file(const char *name, const void *data, uint64_t size, struct memory *memory)
{
    char path[128];
    snprintf(path, sizeof path, "%s/%s", directory, name);
    assert_int_equal(files_write(path, (struct bytes){data, size}, memory, NULL, NULL), BVHD_OK);
}

/* Makes a directory with the world's structures. */
static int enter_scratch(void **state)
{
    (void)state;
    struct test_world world;
    strcpy(directory, "/tmp/bvhd-test-trace-XXXXXX");
    if (!mkdtemp(directory))
        return -1;
    snprintf(picture, sizeof picture, "%s/picture.png", directory);
    snprintf(text, sizeof text, "%s/text", directory);
    test_world_init(&world, 1);
    for (int i = 0; i < TEST_WORLD_FILES; i++)
        write_file((const char *[]){"0.as", "1.as", "2.as"}[i], world.assembly.items[i].data,
                   world.assembly.items[i].size, &world.local.memory);
    write_file(MANIFEST_NAME, manifest, sizeof manifest - 1, &world.local.memory);
    test_world_finish(&world);
    return 0;
}

static int leave_scratch(void **state)
{
    (void)state;
    char command[128];
    snprintf(command, sizeof command, "rm -rf '%s'", directory);
    return system(command);
}

/* ---- tracers with wrong answers ---- */

struct liar {
    struct tracer tracer; /* its first member */
    struct tracer *honest;
    void (*change)(uint64_t ray, struct tracer_hit *hit);
    uint64_t waves, fail_at; /* waves so far; the wave that fails, from 1 */
    struct memory *memory;
};

static void (*change_hit)(uint64_t ray, struct tracer_hit *hit);
static uint64_t fail_at;

static enum bvhd_status trace_and_lie(struct tracer *tracer, const struct ray *rays, uint64_t count,
                                      struct tracer_hit *ret_hits, double *ret_seconds, struct bvhd_error *error)
{
    struct liar *liar = (struct liar *)tracer;
    if (++liar->waves == fail_at)
        return bvhd_error_set(error, BVHD_UNAVAILABLE, "vkQueueSubmit", "the device is lost");
    enum bvhd_status status = liar->honest->trace(liar->honest, rays, count, ret_hits, ret_seconds, error);
    for (uint64_t i = 0; i < count && status == BVHD_OK; i++)
        change_hit(i, &ret_hits[i]);
    return status;
}

static void destroy_liar(struct tracer *tracer)
{
    struct liar *liar = (struct liar *)tracer;
    tracer_destroy(liar->honest);
    memory_free(liar->memory, liar);
}

static enum bvhd_status choose_liar(const char *device, const struct structures *structures,
                                    const struct parallel *parallel, struct memory *memory,
                                    struct tracer_choice *ret_choice, struct bvhd_error *error)
{
    struct liar *liar = memory_alloc(memory, sizeof *liar);
    assert_non_null(liar);
    *liar = (struct liar){.tracer = {device, structures->target, trace_and_lie, destroy_liar}, .memory = memory};
    enum bvhd_status status = tracer_cpu_create(structures, parallel, memory, &liar->honest, error);
    if (status == BVHD_OK)
        *ret_choice = (struct tracer_choice){.tracer = &liar->tracer};
    return status;
}

static void lie_not(uint64_t ray, struct tracer_hit *hit)
{
    (void)ray;
    (void)hit;
}

static void lie_rarely(uint64_t ray, struct tracer_hit *hit)
{
    if (ray == 700)
        *hit = isinf(hit->t) ? (struct tracer_hit){.t = 1, .instance = 1} : tracer_miss;
}

static void lie_always(uint64_t ray, struct tracer_hit *hit)
{
    hit->t = ray % 2 ? 1e-3f : NAN;
}

/* ---- calls of the command ---- */

/* Runs the command, and returns what it printed to stdout and stderr. */
static enum exit_code run_trace(tracer_chooser choose, const char *output, char *ret_text, size_t size)
{
    char *operands[] = {directory};
    struct options options = {.command = COMMAND_TRACE,
                              .json = true,
                              .operands = operands,
                              .operand_count = 1,
                              .output = output,
                              .threads = 2,
                              .memory = UINT64_MAX,
                              .device = "cpu",
                              .width = 64,
                              .height = 36,
                              .up = "auto"};
    fflush(stdout);
    int before[2] = {dup(1), dup(2)}, file = open(text, O_RDWR | O_CREAT | O_TRUNC, 0600);
    assert_true(before[0] >= 0 && before[1] >= 0 && file >= 0 && dup2(file, 1) == 1 && dup2(file, 2) == 2);
    enum exit_code code = command_trace_by(&options, choose);
    fflush(stdout);
    assert_true(dup2(before[0], 1) == 1 && dup2(before[1], 2) == 2);
    ssize_t count = pread(file, ret_text, size - 1, 0);
    assert_true(count >= 0);
    ret_text[count] = 0;
    close(before[0]);
    close(before[1]);
    close(file);
    return code;
}

static double number_of(const char *json, const char *name)
{
    char key[32];
    snprintf(key, sizeof key, "\"%s\":", name);
    const char *at = strstr(json, key);
    assert_non_null(at);
    return strtod(at + strlen(key), NULL);
}

static bool has_picture(void)
{
    struct stat status;
    return stat(picture, &status) == 0 && status.st_size > 100;
}

static void test_cpu(void **state)
{
    (void)state;
    char out[4096];
    assert_int_equal(run_trace(tracer_choose, picture, out, sizeof out), EXIT_DONE);
    assert_non_null(strstr(out, "\"device\":\"cpu\",\"target\":\"portable\",\"scene\":\"world\""));
    assert_true(number_of(out, "rays") > 4 * 64 * 36 && number_of(out, "mrays_s") > 0 && number_of(out, "wall_ms") > 0);
    assert_true(number_of(out, "checked") == 1024 && number_of(out, "mismatches") == 0);
    assert_true(number_of(out, "judged") == 1024 && number_of(out, "unjudged") == 0 && number_of(out, "wrong") == 0);
    assert_true(has_picture());
    unlink(picture);
}

/* A correct device gives the CPU's picture, and all its rays, including the compared ones, are counted. */
static void test_honest_device(void **state)
{
    (void)state;
    char out[4096];
    change_hit = lie_not;
    fail_at = 0;
    assert_int_equal(run_trace(choose_liar, picture, out, sizeof out), EXIT_DONE);
    assert_true(number_of(out, "checked") == number_of(out, "rays"));
    assert_true(number_of(out, "differ") == 0 && number_of(out, "mismatches") == 0 && number_of(out, "uncertain") == 0);
    assert_true(has_picture());
    unlink(picture);
}

static void test_liars_are_found(void **state)
{
    (void)state;
    char out[4096];
    fail_at = 0;
    change_hit = lie_rarely;
    assert_int_equal(run_trace(choose_liar, picture, out, sizeof out), EXIT_WRONG);
    double mismatches = number_of(out, "mismatches");
    assert_true(mismatches >= 1 && mismatches <= 12 && number_of(out, "differ") >= mismatches);
    assert_true(number_of(out, "wrong") == mismatches);
    assert_true(number_of(out, "judged") == number_of(out, "differ") && number_of(out, "unjudged") == 0);
    assert_true(has_picture());
    unlink(picture);
    change_hit = lie_always;
    assert_int_equal(run_trace(choose_liar, picture, out, sizeof out), EXIT_WRONG);
    assert_true(number_of(out, "mismatches") > number_of(out, "checked") / 2);
    unlink(picture);
}

/* A lost device gives no picture, not the exit code of a missing daemon, one error line and one JSON object. */
static void test_lost_device(void **state)
{
    (void)state;
    char out[4096];
    change_hit = lie_not;
    for (fail_at = 1; fail_at <= 3; fail_at++) {
        assert_int_equal(run_trace(choose_liar, picture, out, sizeof out), EXIT_FAILED);
        assert_non_null(strstr(out, "bvhctl: trace: vkQueueSubmit: the device is lost\n"));
        assert_non_null(strstr(out, "\"error\""));
        assert_false(has_picture());
    }
    fail_at = 0;
    assert_int_equal(run_trace(choose_liar, "/nowhere/picture.png", out, sizeof out), EXIT_FAILED);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_cpu),
        cmocka_unit_test(test_honest_device),
        cmocka_unit_test(test_liars_are_found),
        cmocka_unit_test(test_lost_device),
    };
    return cmocka_run_group_tests_name("command_trace", tests, enter_scratch, leave_scratch);
}
