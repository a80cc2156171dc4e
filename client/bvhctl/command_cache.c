/* SPDX-License-Identifier: Apache-2.0 */
#include <errno.h>
#include <stdio.h>
#include <sys/stat.h>

#include "builder/store/generation.h"
#include "builder/store/store.h"
#include "client/bvhctl/base/progress.h"
#include "client/bvhctl/commands.h"
#include "client/bvhctl/service/cache_place.h"

/* What the directory held before and holds now. */
struct cache_report {
    const char *directory;
    struct store_state before, after;
};

static bool print_json(const struct options *options, const struct cache_report *report, struct memory *memory)
{
    struct json json;
    json_init(&json, memory, false);
    json_object(&json, NULL);
    json_integer(&json, "schema", 1);
    json_text(&json, "directory", report->directory);
    json_integer(&json, "entries", report->after.entries);
    json_integer(&json, "bytes", report->after.bytes);
    if (options->cache_action != CACHE_SHOW) {
        json_integer(&json, "removed_entries", report->before.entries - report->after.entries);
        json_integer(&json, "removed_bytes", report->before.bytes - report->after.bytes);
    }
    json_object_end(&json);
    bool ok = report_print(&json);
    json_finish(&json);
    return ok;
}

static const char *plural(uint64_t count)
{
    return count == 1 ? "" : "s";
}

static bool print_text(const struct options *options, const struct cache_report *report)
{
    uint64_t entries = report->after.entries, removed = report->before.entries - entries;
    if (report_volume() < REPORT_RESULTS)
        return true;
    if (options->cache_action != CACHE_SHOW)
        printf("%s: removed %llu result%s of %.1f MB\n", report->directory, (unsigned long long)removed,
               plural(removed), (double)(report->before.bytes - report->after.bytes) / 1e6);
    printf("%s: %llu result%s, %.1f MB\n", report->directory, (unsigned long long)entries, plural(entries),
           (double)report->after.bytes / 1e6);
    return report_flush();
}

static enum bvhd_status act(const struct options *options, struct store *store, struct cache_report *report,
                            struct bvhd_error *error)
{
    enum bvhd_status status = store_scan(store, error);
    report->before = store_state(store);
    if (status == BVHD_OK && options->cache_action == CACHE_TRIM)
        status = store_trim_to(store, options->disk_cache_size, error);
    else if (status == BVHD_OK && options->cache_action == CACHE_CLEAR)
        status = store_clear(store, error);
    report->after = store_state(store);
    return status;
}

/* A directory that is missing is empty, and is not made. */
static enum bvhd_status open_and_act(const struct options *options, struct memory *memory, struct cache_report *report,
                                     struct bvhd_error *error)
{
    struct stat about;
    struct store *store = NULL;
    struct progress progress = {0};
    const struct store_options place = {
        .directory = report->directory, .generation = store_generation(), .budget = options->disk_cache_size};
    if (stat(report->directory, &about) != 0 && errno == ENOENT)
        return BVHD_OK;
    enum bvhd_status status = store_open(&place, memory, &store, error);
    if (status != BVHD_OK)
        return status;
    progress_begin(&progress, options_command_name(COMMAND_CACHE), report->directory);
    status = act(options, store, report, error);
    progress_end(&progress);
    store_close(store);
    return status;
}

enum exit_code command_cache(const struct options *options)
{
    struct memory memory;
    struct bvhd_error error;
    char *directory = NULL;
    memory_init(&memory, UINT64_MAX);
    enum bvhd_status status = cache_place_find(options, &memory, &directory, &error);
    if (status == BVHD_OK && !directory)
        status = bvhd_error_set(&error, BVHD_INVALID, "cache",
                                "neither --cache nor $XDG_CACHE_HOME nor $HOME names its directory");
    struct cache_report report = {.directory = directory};
    if (status == BVHD_OK)
        status = open_and_act(options, &memory, &report, &error);
    enum exit_code code;
    if (status != BVHD_OK)
        code = report_failure(options->json, "cache", &error);
    else if (options->json)
        code = print_json(options, &report, &memory) ? EXIT_DONE : EXIT_FAILED;
    else
        code = print_text(options, &report) ? EXIT_DONE : EXIT_FAILED;
    memory_free(&memory, directory);
    return code;
}
