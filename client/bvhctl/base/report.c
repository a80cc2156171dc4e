/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/base/report.h"

#include <errno.h>
#include <stdio.h>
#include <string.h>

#include "client/bvhctl/base/interrupt.h"
#include "client/bvhctl/base/progress.h"

static enum report_volume current_volume = REPORT_RESULTS;

void report_set_volume(enum report_volume volume)
{
    current_volume = volume;
}

enum report_volume report_volume(void)
{
    return current_volume;
}

/* Replaces control characters, so that names cannot break a line in two. */
static void print_clean(const char *text)
{
    char line[2048];
    size_t size = strlen(text);
    size = size < sizeof line ? size : sizeof line - 1;
    for (size_t i = 0; i < size; i++) {
        unsigned char character = (unsigned char)text[i];
        line[i] = character < 0x20 || character == 0x7f ? '?' : text[i];
    }
    line[size] = '\0';
    progress_make_room();
    fprintf(stderr, "bvhctl: %s\n", line);
}

void report_line(const char *what, const struct bvhd_error *error)
{
    const char *where = error->where[0] ? error->where : "-";
    char line[2048];
    if (error->vuid != BVHD_VUID_NONE)
        snprintf(line, sizeof line, "%s: %s: %s (%s)", what, where, bvhd_vuid_string(error->vuid), error->text);
    else
        snprintf(line, sizeof line, "%s: %s: %s", what, where, error->text);
    print_clean(line);
}

static void print_text(const char *what, const char *format, va_list arguments)
{
    char text[1024], line[2048];
    vsnprintf(text, sizeof text, format, arguments);
    snprintf(line, sizeof line, "%s: %s", what, text);
    print_clean(line);
}

void report_note(const char *what, const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    if (current_volume >= REPORT_RESULTS)
        print_text(what, format, arguments);
    va_end(arguments);
}

void report_finding(const char *what, const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    print_text(what, format, arguments);
    va_end(arguments);
}

void report_detail(const char *what, const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    if (current_volume >= REPORT_ALL)
        print_text(what, format, arguments);
    va_end(arguments);
}

void report_members(struct json *json, const struct bvhd_error *error)
{
    json_text(json, "status", bvhd_status_name(error->status));
    json_text(json, "vuid", bvhd_vuid_string(error->vuid));
    json_text(json, "where", error->where);
    json_text(json, "text", error->text);
}

static enum exit_code exit_code_of(enum bvhd_status status)
{
    return status == BVHD_UNAVAILABLE ? EXIT_NO_DAEMON : EXIT_FAILED;
}

void report_failure_json(const struct bvhd_error *error)
{
    struct memory memory;
    struct json json;
    memory_init(&memory, UINT64_MAX);
    json_init(&json, &memory, false);
    json_object(&json, NULL);
    json_integer(&json, "schema", 1);
    json_object(&json, "error");
    report_members(&json, error);
    json_object_end(&json);
    json_object_end(&json);
    report_print(&json);
    json_finish(&json);
}

enum exit_code report_failure(bool as_json, const char *what, const struct bvhd_error *error)
{
    report_line(what, error);
    if (as_json)
        report_failure_json(error);
    return exit_code_of(error->status);
}

bool report_flush(void)
{
    errno = 0;
    bool ok = fflush(stdout) == 0 && !ferror(stdout);
    if (!ok)
        report_finding("output", "stdout: %s", strerror(errno ? errno : EIO));
    return ok;
}

bool report_print(struct json *json)
{
    json_newline(json);
    if (json->failed) {
        report_finding("output", "stdout: no memory for the JSON text");
        return false;
    }
    interrupt_output_begins();
    fwrite(json->data, 1, json->size, stdout);
    return report_flush();
}
