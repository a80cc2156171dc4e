/* SPDX-License-Identifier: Apache-2.0 */
/* test_options.c - tests the parser of the command line. */
#include "tests/support/unit.h"

#include "client/bvhctl/base/options.h"
#include "client/bvhctl/base/report.h"

enum { MOST_WORDS = 16 };

/* Splits a command line at blanks and parses it; the words live until the next call. */
static enum bvhd_status parse(const char *line, struct options *ret_options, struct bvhd_error *error)
{
    static char text[512], *words[MOST_WORDS + 1];
    int count = 0;
    snprintf(text, sizeof text, "%s", line);
    for (char *word = strtok(text, " "); word; word = strtok(NULL, " ")) {
        assert_true(count < MOST_WORDS);
        words[count++] = word;
    }
    words[count] = NULL;
    *error = (struct bvhd_error){0};
    return options_parse(count, words, ret_options, error);
}

static struct options parse_good(const char *line)
{
    struct options options;
    struct bvhd_error error;
    if (parse(line, &options, &error) != BVHD_OK)
        fail_msg("%s: %s: %s", line, error.where, error.text);
    return options;
}

static void expect_bad(const char *line, const char *where)
{
    struct options options;
    struct bvhd_error error;
    if (parse(line, &options, &error) == BVHD_OK)
        fail_msg("accepted: %s", line);
    assert_int_equal(error.status, BVHD_INVALID);
    assert_string_equal(error.where, where);
    assert_true(*error.text);
}

static void expect_words(const char *line, const char *words)
{
    struct options options;
    struct bvhd_error error;
    assert_int_equal(parse(line, &options, &error), BVHD_INVALID);
    if (!strstr(error.text, words))
        fail_msg("%s: '%s' does not say '%s'", line, error.text, words);
}

/* The error about an unknown name lists all names that are allowed, without truncation. */
static void test_choices(void **state)
{
    (void)state;
    expect_words("bvhctl build a -o b --quality best", "'best' is none of: fast, balanced, high, auto");
    expect_words("bvhctl build a -o b --target radv", "'radv' is none of: portable, lavapipe");
    expect_words("bvhctl build a -o b --flags low-memory,bogus,", "'bogus' is none of: allow-update, ");
    expect_words("bvhctl build a -o b --flags allow-", ", allow-data-access");
    expect_words("bvhctl build a -o b --flags ,", "'' is none of: ");
    expect_words("bvhctl build a -o b --quality aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa",
                 "'aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa' is");
}

static void test_build(void **state)
{
    (void)state;
    struct options options =
        parse_good("bvhctl --local build a.ply b.obj -o out --quality fast --flags allow-update,low-memory "
                   "--layout fast-triangles --threads 3");
    assert_int_equal(options.command, COMMAND_BUILD);
    assert_true(options.local);
    assert_int_equal(options.operand_count, 2);
    assert_string_equal(options.operands[1], "b.obj");
    assert_string_equal(options.output, "out");
    assert_int_equal(options.build.quality, QUALITY_FAST);
    assert_int_equal(options.build.layout_flags, PORTABLE_FAST_TRIANGLES);
    assert_int_equal(options.build_flags, BUILD_ALLOW_UPDATE | BUILD_LOW_MEMORY);
    assert_int_equal(options.threads, 3);
}

static void test_defaults(void **state)
{
    (void)state;
    struct options options = parse_good("bvhctl build a -o b");
    assert_false(options.local);
    assert_false(options.json);
    assert_null(options.socket);
    assert_int_equal(options.build.quality, QUALITY_UNSPECIFIED);
    assert_int_equal(options.build.target, TARGET_PORTABLE);
    assert_int_equal(options.geometry_flags, GEOMETRY_OPAQUE);
    assert_int_equal(options.threads, 0);
    assert_true(options.memory == UINT64_MAX);
    assert_int_equal(options.connect_timeout_ms, 5000);
}

static void test_targets(void **state)
{
    (void)state;
    struct options options = parse_good("bvhctl build a -o b --target lavapipe");
    assert_int_equal(options.build.target, TARGET_LAVAPIPE);
    assert_null(options.probe);
    options = parse_good("bvhctl build a -o b --probe p --target lavapipe");
    assert_int_equal(options.build.target, TARGET_LAVAPIPE);
    assert_string_equal(options.probe, "p");
    assert_int_equal(parse_good("bvhctl build a -o b --probe p").build.target, 0);
    assert_int_equal(parse_good("bvhctl build a -o b --target portable --layout fast-triangles").build.target,
                     TARGET_PORTABLE);
    expect_bad("bvhctl build a -o b --target portable --probe p", "--probe");
    expect_bad("bvhctl build a -o b --probe=", "--probe");
    expect_bad("bvhctl build a -o b --probe p --layout fast-triangles", "--layout");
    expect_bad("bvhctl build a -o b --target lavapipe --layout fast-triangles", "--layout");
}

static void test_options_anywhere(void **state)
{
    (void)state;
    struct options options = parse_good("bvhctl build a --json -o b --local c");
    assert_true(options.json && options.local);
    assert_int_equal(options.operand_count, 2);
    assert_string_equal(options.operands[1], "c");
    options = parse_good("bvhctl --json --socket s build -o b -- -x");
    assert_true(options.json);
    assert_string_equal(options.socket, "s");
    assert_string_equal(options.operands[0], "-x");
    options = parse_good("bvhctl --local update a b --threads 3 --cache d");
    assert_true(options.local && options.command == COMMAND_UPDATE && options.threads == 3);
}

static void test_other_commands(void **state)
{
    (void)state;
    struct options options = parse_good("bvhctl check dir scene --rays 77 --seed 18446744073709551615 --flip-order");
    assert_int_equal(options.command, COMMAND_CHECK);
    assert_null(options.scene);
    assert_string_equal(parse_good("bvhctl build a -o b --scene night").scene, "night");
    assert_string_equal(parse_good("bvhctl check a b --scene 1").scene, "1");
    assert_string_equal(parse_good("bvhctl trace a --device cpu -o p.png --scene 1").scene, "1");
    expect_bad("bvhctl inspect a --scene 1", "--scene");
    options = parse_good("bvhctl check dir scene --rays 77 --seed 18446744073709551615 --flip-order");
    assert_true(options.rays == 77 && options.seed == UINT64_MAX && options.flip_order);
    options = parse_good("bvhctl trace dir --device cpu -o p.png --size 64x48 --up z");
    assert_int_equal(options.command, COMMAND_TRACE);
    assert_true(options.width == 64 && options.height == 48);
    assert_string_equal(options.up, "z");
    assert_false(options.view.has_eye || options.view.has_look_at || options.view.fov > 0 || options.view.turn);
    options = parse_good("bvhctl trace d s.glb --device cpu -o p --eye -1,2.5,3e2 --look-at 0,0,-7 --fov 30 --turn 12");
    assert_true(options.view.has_eye && options.view.eye[0] == -1 && options.view.eye[1] == 2.5);
    assert_true(options.view.eye[2] == 300 && options.view.has_look_at && options.view.look_at[2] == -7);
    assert_true(options.view.fov == 30 && options.view.turn == 12 && options.operand_count == 2);
    options = parse_good("bvhctl inspect x.as --memory 3M");
    assert_int_equal(options.command, COMMAND_INSPECT);
    assert_int_equal(options.memory, 3 << 20);
}

static void test_service(void **state)
{
    (void)state;
    struct options options = parse_good("bvhctl --connect-timeout 2.5 get 0123 -o f.as --json");
    assert_int_equal(options.command, COMMAND_GET);
    assert_int_equal(options.connect_timeout_ms, 2500);
    assert_string_equal(options.operands[0], "0123");
    assert_string_equal(options.output, "f.as");
    options = parse_good("bvhctl stats --socket s --connect-timeout 0");
    assert_int_equal(options.command, COMMAND_STATS);
    assert_string_equal(options.socket, "s");
    assert_int_equal(options.connect_timeout_ms, 1); /* 0 would be the library's default */
    assert_int_equal(parse_good("bvhctl ping").command, COMMAND_PING);
    assert_int_equal(parse_good("bvhctl clients").command, COMMAND_CLIENTS);
    assert_false(parse_good("bvhctl clients").all);
    assert_true(parse_good("bvhctl clients --all --json").all);
    options = parse_good("bvhctl top");
    assert_int_equal(options.command, COMMAND_TOP);
    assert_int_equal(options.count, 0);
    assert_true(options.interval == 2);
    options = parse_good("bvhctl top --count 3 --interval 0.5");
    assert_int_equal(options.count, 3);
    assert_true(options.interval == 0.5);
    assert_int_equal(parse_good("bvhctl build a -o b --connect-timeout 86400").connect_timeout_ms, 86400000);
}

static void test_devices(void **state)
{
    (void)state;
    assert_int_equal(parse_good("bvhctl devices --json").command, COMMAND_DEVICES);
    struct options options = parse_good("bvhctl probe --device llvm -o f");
    assert_int_equal(options.command, COMMAND_PROBE);
    assert_string_equal(options.device, "llvm");
    assert_string_equal(options.output, "f");
    assert_null(parse_good("bvhctl probe -o f").device);
    expect_bad("bvhctl probe --device llvm", "probe");
    expect_bad("bvhctl probe --device= -o f", "--device"); /* an empty text is a part of every name */
    expect_bad("bvhctl trace a --device= -o p", "--device");
    expect_bad("bvhctl trace a -o p", "trace");
    expect_bad("bvhctl devices llvm", "llvm");
    expect_bad("bvhctl devices --device llvm", "--device");
}

static void test_help(void **state)
{
    (void)state;
    assert_int_equal(parse_good("bvhctl --help").help_about, COMMAND_COUNT);
    struct options options = parse_good("bvhctl check --help");
    assert_int_equal(options.command, COMMAND_HELP);
    assert_int_equal(options.help_about, COMMAND_CHECK);
    assert_int_equal(parse_good("bvhctl --version").command, COMMAND_VERSION);
}

static void test_volume(void **state)
{
    (void)state;
    assert_int_equal(parse_good("bvhctl ping").volume, REPORT_RESULTS);
    assert_int_equal(parse_good("bvhctl -q ping").volume, REPORT_ERRORS);
    assert_int_equal(parse_good("bvhctl ping --quiet").volume, REPORT_ERRORS);
    assert_int_equal(parse_good("bvhctl build a -vo b").volume, REPORT_ALL);
    assert_int_equal(parse_good("bvhctl -q check a b --verbose").volume, REPORT_ALL);
    assert_int_equal(parse_good("bvhctl build --version").command, COMMAND_VERSION);
}

static void test_time(void **state)
{
    (void)state;
    assert_true(parse_good("bvhctl check a b").seconds == 0);
    assert_true(parse_good("bvhctl check a b --time 2.5").seconds == 2.5);
    expect_bad("bvhctl check a b --time 0", "--time");
    expect_bad("bvhctl check a b --time soon", "--time");
    expect_bad("bvhctl check a b --time 99999", "--time");
    expect_bad("bvhctl inspect a --time 5", "--time");
}

static void test_shutter(void **state)
{
    (void)state;
    struct view_options view = parse_good("bvhctl trace a --device cpu -o p").view;
    assert_true(view.samples == 0 && !view.has_times);
    view = parse_good("bvhctl trace a --device cpu -o p --samples 64 --times 0.25:0.75").view;
    assert_true(view.samples == 64 && view.has_times && view.times[0] == 0.25f && view.times[1] == 0.75f);
    view = parse_good("bvhctl trace a --device cpu -o p --times 1").view;
    assert_true(view.has_times && view.times[0] == 1 && view.times[1] == 1);
    static const char *const wrong[] = {"",    ":",    "0:",   ":1",    "0:0.5:1", "0.6:0.5", "-0.1:0.5",
                                        "0:2", "soon", "0.5x", "0 : 1", "nan",     "0:nan",   "inf"};
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++) {
        struct view_options untouched = {.times = {-1, -1}};
        struct bvhd_error error = {0};
        assert_int_equal(options_view_times(wrong[i], &untouched, &error), BVHD_INVALID);
        assert_string_equal(error.where, "--times");
        assert_true(!untouched.has_times && untouched.times[0] == -1);
    }
    expect_bad("bvhctl trace a --device cpu -o p --samples 0", "--samples");
    expect_bad("bvhctl trace a --device cpu -o p --samples 1025", "--samples");
    expect_bad("bvhctl trace a --device cpu -o p --samples 4x", "--samples");
    expect_bad("bvhctl check a b --samples 4", "--samples");
}

static void test_stop(void **state)
{
    (void)state;
    assert_int_equal(parse_good("bvhctl stop").command, COMMAND_STOP);
    assert_string_equal(parse_good("bvhctl --socket s stop").socket, "s");
    expect_bad("bvhctl stop --local", "--local");
    expect_bad("bvhctl stop now", "now");
}

static void test_bad_lines(void **state)
{
    (void)state;
    expect_bad("bvhctl", "bvhctl");
    expect_bad("bvhctl frobnicate", "frobnicate");
    expect_bad("bvhctl --frobnicate", "--frobnicate");
    expect_bad("bvhctl get key", "get");
    expect_bad("bvhctl build -o out", "build");
    expect_bad("bvhctl build a", "build");
    expect_bad("bvhctl build a -o", "-o");
    expect_bad("bvhctl build a -o b --seed 1", "--seed");
    expect_bad("bvhctl --local build a -o b --socket s", "--socket");
    expect_bad("bvhctl check dir", "check");
    expect_bad("bvhctl check dir scene more", "more");
    expect_bad("bvhctl trace dir -o p.png", "trace");
    expect_bad("bvhctl inspect", "inspect");
    expect_bad("bvhctl get 0123", "get");
    expect_bad("bvhctl get -o f", "get");
    expect_bad("bvhctl get 0123 4567 -o f", "4567");
    expect_bad("bvhctl get 0123 -o f --memory 5M", "--memory");
    expect_bad("bvhctl --local stats", "--local");
    expect_bad("bvhctl ping --local", "--local");
    expect_bad("bvhctl --local ping --socket s", "--socket");
    expect_bad("bvhctl stats all", "all");
    expect_bad("bvhctl stats --all", "--all");
    expect_bad("bvhctl clients me", "me");
    expect_bad("bvhctl top --count 0", "--count");
    expect_bad("bvhctl top --interval 0", "--interval");
    expect_bad("bvhctl build a -o b --at soon", "--at");
    expect_bad("bvhctl build a -o b --at inf", "--at");
    expect_bad("bvhctl build a -o b --at 1s", "--at");
    expect_bad("bvhctl build a -o b --shutter 1", "--shutter");
    expect_bad("bvhctl build a -o b --shutter 1:1", "--shutter");
    expect_bad("bvhctl build a -o b --shutter 2:1", "--shutter");
    expect_bad("bvhctl build a -o b --shutter 0:inf", "--shutter");
    expect_bad("bvhctl build a -o b --shutter nan:1", "--shutter");
    expect_bad("bvhctl build a -o b --shutter -1e308:1e308", "--shutter");
    expect_bad("bvhctl build a -o b --shutter 0:1s", "--shutter");
    expect_bad("bvhctl build a -o b --shutter 0:1:2", "--shutter");
    expect_bad("bvhctl build a -o b --shutter 0:1 --at 1", "--shutter");
    expect_bad("bvhctl update a b --shutter 0:1 --frames 0:1:1", "--shutter");
    expect_bad("bvhctl check a b --shutter 0:1", "--shutter");
    expect_bad("bvhctl update a b --frames 0:1", "--frames");
    expect_bad("bvhctl update a b --frames 1:0:1", "--frames");
    expect_bad("bvhctl update a b --frames 0:1:0", "--frames");
    expect_bad("bvhctl update a b --frames 0:1e9:1", "--frames");
    expect_bad("bvhctl update a b --frames 0:inf:1", "--frames");
    expect_bad("bvhctl update a b --frames 0:1:1 --at 1", "--frames");
    expect_bad("bvhctl update a b --decay 0", "--decay");
    expect_bad("bvhctl update a b --decay nan", "--decay");
    expect_bad("bvhctl copy a.as", "copy");
    expect_bad("bvhctl query a.as b.as", "b.as");
    expect_bad("bvhctl top --interval x", "--interval");
    expect_bad("bvhctl stats -o f", "-o");
    expect_bad("bvhctl check a b --connect-timeout 5", "--connect-timeout");
}

static void test_bad_values(void **state)
{
    (void)state;
    expect_bad("bvhctl build a -o b --quality best", "--quality");
    expect_bad("bvhctl build a -o b --target radv", "--target");
    expect_bad("bvhctl build a -o b --flags allow-update,bogus", "--flags");
    expect_bad("bvhctl build a -o b --threads 0", "--threads");
    expect_bad("bvhctl build a -o b --threads 1x", "--threads");
    expect_bad("bvhctl build a -o b --threads -1", "--threads");
    expect_bad("bvhctl build a -o b --threads 99999999999999999999", "--threads");
    expect_bad("bvhctl build a -o b --memory 99999999999999999G", "--memory");
    expect_bad("bvhctl build a -o b --rays nan", "--rays");
    expect_bad("bvhctl build a -o b --rays -3", "--rays");
    expect_bad("bvhctl check a b --rays 0.5", "--rays");
    expect_bad("bvhctl check a b --rays 0", "--rays");
    expect_bad("bvhctl trace a --device cpu -o p --size 10", "--size");
    expect_bad("bvhctl trace a --device cpu -o p --size 0x10", "--size");
    expect_bad("bvhctl trace a --device cpu -o p --size 10x10x10", "--size");
    expect_bad("bvhctl trace a --device cpu -o p --size 99999x2", "--size");
    expect_bad("bvhctl trace a --device cpu -o p --up w", "--up");
    expect_bad("bvhctl trace a --device cpu -o p --eye 1,2", "--eye");
    expect_bad("bvhctl trace a --device cpu -o p --eye 1,2,3,4", "--eye");
    expect_bad("bvhctl trace a --device cpu -o p --eye 1,nan,3", "--eye");
    expect_bad("bvhctl trace a --device cpu -o p --look-at 1,inf,3", "--look-at");
    expect_bad("bvhctl trace a --device cpu -o p --look-at here", "--look-at");
    expect_bad("bvhctl trace a --device cpu -o p --fov 0", "--fov");
    expect_bad("bvhctl trace a --device cpu -o p --fov 180", "--fov");
    expect_bad("bvhctl trace a --device cpu -o p --fov 30deg", "--fov");
    expect_bad("bvhctl trace a --device cpu -o p --turn 0", "--turn");
    expect_bad("bvhctl check a b --eye 1,2,3", "--eye");
    expect_bad("bvhctl ping --connect-timeout -1", "--connect-timeout");
    expect_bad("bvhctl ping --connect-timeout nan", "--connect-timeout");
    expect_bad("bvhctl ping --connect-timeout 5s", "--connect-timeout");
    expect_bad("bvhctl ping --connect-timeout 86401", "--connect-timeout");
}

static void test_want_json(void **state)
{
    (void)state;
    char program[] = "bvhctl", json[] = "--json", end[] = "--", *words[] = {program, end, json, NULL};
    assert_false(options_want_json(3, words));
    words[1] = json;
    assert_true(options_want_json(3, words));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_build),
        cmocka_unit_test(test_choices),
        cmocka_unit_test(test_defaults),
        cmocka_unit_test(test_targets),
        cmocka_unit_test(test_options_anywhere),
        cmocka_unit_test(test_other_commands),
        cmocka_unit_test(test_devices),
        cmocka_unit_test(test_help),
        cmocka_unit_test(test_bad_lines),
        cmocka_unit_test(test_bad_values),
        cmocka_unit_test(test_want_json),
        cmocka_unit_test(test_service),
        cmocka_unit_test(test_shutter),
        cmocka_unit_test(test_stop),
        cmocka_unit_test(test_time),
        cmocka_unit_test(test_volume),
    };
    return cmocka_run_group_tests_name("options", tests, NULL, NULL);
}
