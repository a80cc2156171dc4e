/* SPDX-License-Identifier: Apache-2.0 */
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/stat.h>

#include "builder/store/generation.h"
#include "builder/store/store.h"
#include "client/bvhctl/base/files.h"
#include "client/bvhctl/base/progress.h"
#include "client/bvhctl/commands.h"
#include "client/bvhctl/service/cache_place.h"
#include "client/bvhctl/service/connect.h"

/* Results on disk. */
struct content {
    uint64_t entries, bytes;
};

struct cache_report {
    char *directory; /* owned */
    struct content before, after;
    bool is_daemon; /* a daemon has done it, which keeps results in memory, too */
    uint64_t memory_entries, memory_bytes;
};

static uint64_t less(uint64_t a, uint64_t b)
{
    return a > b ? a - b : 0;
}

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
        json_integer(&json, "removed_entries", less(report->before.entries, report->after.entries));
        json_integer(&json, "removed_bytes", less(report->before.bytes, report->after.bytes));
    }
    if (report->is_daemon) {
        json_integer(&json, "memory_entries", report->memory_entries);
        json_integer(&json, "memory_bytes", report->memory_bytes);
    }
    json_object_end(&json);
    bool ok = report_print(&json);
    json_finish(&json);
    return ok;
}

static void print_line(const char *where, const char *what, uint64_t entries, uint64_t bytes)
{
    printf("%s: %s%llu result%s, %.1f MB\n", where, what, (unsigned long long)entries, entries == 1 ? "" : "s",
           (double)bytes / 1e6);
}

static bool print_text(const struct options *options, const struct cache_report *report)
{
    const char *directory = report->directory;
    const struct content *before = &report->before, *after = &report->after;
    if (report_volume() < REPORT_RESULTS)
        return true;
    if (options->cache_action != CACHE_SHOW)
        print_line(directory, "removed ", less(before->entries, after->entries), less(before->bytes, after->bytes));
    print_line(directory, "", after->entries, after->bytes);
    if (report->is_daemon)
        print_line("in the daemon's memory", "", report->memory_entries, report->memory_bytes);
    return report_flush();
}

static enum bvhd_status act(const struct options *options, struct store *store, struct cache_report *report,
                            struct bvhd_error *error)
{
    enum bvhd_status status = store_scan(store, error);
    struct store_state state = store_state(store);
    report->before = (struct content){state.entries, state.bytes};
    if (status == BVHD_OK && options->cache_action == CACHE_TRIM)
        status = store_trim_to(store, options->disk_cache_size, error);
    else if (status == BVHD_OK && options->cache_action == CACHE_CLEAR)
        status = store_clear(store, error);
    state = store_state(store);
    report->after = (struct content){state.entries, state.bytes};
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

static enum bvhd_status use_directory(const struct options *options, struct memory *memory, struct cache_report *report,
                                      struct bvhd_error *error)
{
    enum bvhd_status status = cache_place_find(options, memory, &report->directory, error);
    if (status == BVHD_OK && !report->directory)
        status = bvhd_error_set(error, BVHD_INVALID, "cache",
                                "neither --cache nor $XDG_CACHE_HOME nor $HOME names its directory");
    return status == BVHD_OK ? open_and_act(options, memory, report, error) : status;
}

/* Removing many files takes longer than an answer otherwise. */
enum { PATIENCE_MS = 600000 };

static enum bvhd_status use_daemon(const struct options *options, struct bvhd_client *client, struct memory *memory,
                                   struct cache_report *report, struct bvhd_error *error)
{
    static const enum bvhd_cache_action actions[] = {
        [CACHE_SHOW] = BVHD_CACHE_SHOW, [CACHE_TRIM] = BVHD_CACHE_TRIM, [CACHE_CLEAR] = BVHD_CACHE_CLEAR};
    struct bvhd_cache_state *before = NULL, *after = NULL;
    enum bvhd_status status =
        bvhd_client_cache(client, BVHD_CACHE_SHOW, 0, (int)options->connect_timeout_ms, &before, error);
    if (status == BVHD_OK && !*before->directory)
        status = bvhd_error_set(error, BVHD_UNSUPPORTED, "cache", "this daemon keeps nothing on disk");
    if (status == BVHD_OK)
        status = bvhd_client_cache(client, actions[options->cache_action], options->disk_cache_size, PATIENCE_MS,
                                   &after, error);
    if (status == BVHD_OK && !(report->directory = files_copy_text(memory, after->directory)))
        status = bvhd_error_no_memory(error, "cache", "no memory for the name of its directory");
    if (status == BVHD_OK) {
        report->before = (struct content){before->entries, before->bytes};
        report->after = (struct content){after->entries, after->bytes};
        report->is_daemon = true;
        report->memory_entries = after->memory_entries;
        report->memory_bytes = after->memory_bytes;
    }
    bvhd_cache_state_destroy(before);
    bvhd_cache_state_destroy(after);
    return status;
}

/*
 * Finds who does it: the daemon on a socket that is named, else the user's own one if it runs, else this process with
 * the directory, in particular with one that is named.
 */
static enum bvhd_status find_and_act(const struct options *options, struct memory *memory, struct cache_report *report,
                                     struct bvhd_error *error)
{
    struct connect connect = {0};
    const bool is_named = connect_named_socket(options);
    if (options->cache || options->local || (!is_named && getenv("BVHD_CACHE")))
        return use_directory(options, memory, report, error);
    enum bvhd_status status = connect_find(options, memory, &connect, error);
    if (status == BVHD_OK && (is_named || connect.is_private))
        status = use_daemon(options, connect.client, memory, report, error);
    else if (!is_named && (status == BVHD_OK || status == BVHD_UNAVAILABLE))
        status = use_directory(options, memory, report, error);
    connect_close(&connect);
    return status;
}

enum exit_code command_cache(const struct options *options)
{
    struct memory memory;
    struct bvhd_error error;
    struct cache_report report = {0};
    memory_init(&memory, UINT64_MAX);
    enum bvhd_status status = find_and_act(options, &memory, &report, &error);
    enum exit_code code;
    if (status != BVHD_OK)
        code = report_failure(options->json, "cache", &error);
    else if (options->json)
        code = print_json(options, &report, &memory) ? EXIT_DONE : EXIT_FAILED;
    else
        code = print_text(options, &report) ? EXIT_DONE : EXIT_FAILED;
    memory_free(&memory, report.directory);
    return code;
}
