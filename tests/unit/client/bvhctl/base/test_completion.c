/* SPDX-License-Identifier: Apache-2.0 */
/* test_completion.c - tests that completion knows all options and their values, and offers what may follow. */
#include "tests/support/unit.h"

#include <unistd.h>

#include "client/bvhctl/base/completion.h"
#include "client/bvhctl/base/options.h"

enum { MOST_WORDS = 16 };

static bool wants_devices;

/* Completes the last word of the line, and returns what is printed, with the descriptions left out. */
static const char *complete(const char *line)
{
    static char text[512], printed[8192], *words[MOST_WORDS];
    int count = 0, stdout_copy = dup(STDOUT_FILENO);
    FILE *file = tmpfile();
    snprintf(text, sizeof text, "%s", line);
    for (char *at = text; at; words[count++] = strsep(&at, " "))
        assert_true(count < MOST_WORDS);
    fflush(stdout);
    dup2(fileno(file), STDOUT_FILENO);
    wants_devices = completion_print(count, words);
    if (wants_devices)
        completion_offer(count, words, "llvmpipe", "a device");
    fflush(stdout);
    dup2(stdout_copy, STDOUT_FILENO);
    close(stdout_copy);
    rewind(file);
    char got[512];
    *printed = '\0';
    while (fgets(got, sizeof got, file)) {
        got[strcspn(got, "\t\n")] = '\0';
        strcat(strcat(printed, *printed ? "|" : ""), got);
    }
    fclose(file);
    return printed;
}

static void expect(const char *line, const char *candidates)
{
    const char *printed = complete(line);
    if (strcmp(printed, candidates) != 0)
        fail_msg("'%s' is completed by '%s', not '%s'", line, printed, candidates);
}

/* Somebody who adds an option has to say what its values are. */
static void test_no_drift(void **state)
{
    (void)state;
    for (const struct option_row *row = option_rows; row->name; row++) {
        if (row->argument && !completion_of(row))
            fail_msg("completion.c does not say what the values of --%s are", row->name);
        if (!row->argument && completion_of(row))
            fail_msg("completion.c has values for --%s, which takes none", row->name);
    }
}

/* The help lists the names that are offered. */
static void test_help_has_names(void **state)
{
    (void)state;
    for (const struct option_row *row = option_rows; row->name; row++) {
        const struct completion_row *values = row->argument ? completion_of(row) : NULL;
        for (const struct name_value *name = values ? values->names : NULL; name && name->name; name++)
            if (!strstr(row->help, name->name))
                fail_msg("the help of --%s does not mention %s", row->name, name->name);
    }
}

/* Each name that is offered for a build is accepted by the parser. */
static void test_accepted(void **state)
{
    (void)state;
    for (const struct option_row *row = option_rows; row->name; row++) {
        const struct completion_row *values = row->argument && row->commands & ON_BUILD ? completion_of(row) : NULL;
        for (const struct name_value *name = values ? values->names : NULL; name && name->name; name++) {
            char program[] = "bvhctl", command[] = "build", scene[] = "a", output[] = "-ob", option[64];
            char *words[] = {program, command, scene, output, option, NULL};
            struct options options;
            struct bvhd_error error;
            snprintf(option, sizeof option, "--%s=%s", row->name, name->name);
            if (options_parse(5, words, &options, &error) != BVHD_OK)
                fail_msg("%s: %s", option, error.text);
        }
    }
}

static void test_commands(void **state)
{
    (void)state;
    expect("b", "build");
    expect("p", "ping|probe");
    expect("--socket s p", "ping|probe");
    expect("--socket = s p", "ping|probe");
    expect("--json -q st", "stats|stop");
    assert_non_null(strstr(complete(""), "build|update|check|"));
    expect("fly ", "");
}

static void test_options(void **state)
{
    (void)state;
    expect("--v", "--verbose|--version");
    expect("check --fl", "--flip-order");
    expect("check d s --ti", "--time");
    expect("ping --fl", "");
    expect("build -- --ti", ":files *.gltf *.glb *.ply *.obj *.stl *.fbx *.dae *.3ds *.blend *.off *.x3d *.usd *.3mf");
}

static void test_values(void **state)
{
    (void)state;
    expect("build --target ", "portable|lavapipe");
    expect("build --target l", "lavapipe");
    expect("build --target=l", "--target=lavapipe");
    expect("build --target = l", "lavapipe");
    expect("build --target =", "portable|lavapipe");
    expect("build --quality h", "high");
    expect("build --flags allow-update,prefer-fast-t", "allow-update,prefer-fast-trace");
    expect("build --flags=low-memory,allow-d", "--flags=low-memory,allow-data-access");
    expect("build --geometry-flags n", "no-duplicate-any-hit|none");
    expect("build --layout ", "fast-triangles");
    expect("trace d --up ", "auto|x|y|z");
    expect("check --rays ", "");
}

static void test_files(void **state)
{
    (void)state;
    expect("check ", ":files *.bvhd");
    assert_non_null(strstr(complete("check d "), ":files *.gltf *.glb *.ply"));
    expect("check d s ", "");
    expect("trace d -o ", ":files *.png");
    expect("probe -o ", ":files *.probe");
    expect("build --probe ", ":files *.probe");
    expect("--socket ", ":files ");
    expect("get ", "");
}

static void test_devices(void **state)
{
    (void)state;
    expect("trace d --device ", "cpu|auto|llvmpipe");
    assert_true(wants_devices);
    expect("probe --device=l", "--device=llvmpipe");
    expect("probe --device ", "auto|llvmpipe");
    expect("trace d --up ", "auto|x|y|z");
    assert_false(wants_devices);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_no_drift), cmocka_unit_test(test_help_has_names), cmocka_unit_test(test_accepted),
        cmocka_unit_test(test_commands), cmocka_unit_test(test_options),        cmocka_unit_test(test_values),
        cmocka_unit_test(test_files),    cmocka_unit_test(test_devices),
    };
    return cmocka_run_group_tests_name("completion", tests, NULL, NULL);
}
