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

/* What the directory held before and holds now. */
struct cache_report {
    const char *directory; /* owned */
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

static enum bvhd_status act_on_directory(const struct options *options, struct memory *memory,
                                         struct cache_report *report, struct bvhd_error *error)
{
    char *directory;
    enum bvhd_status status = cache_place_find(options, memory, &directory, error);
    if (status == BVHD_OK && !directory)
        status = bvhd_error_set(error, BVHD_INVALID, "cache",
                                "neither --cache nor $XDG_CACHE_HOME nor $HOME names its directory");
    if (status != BVHD_OK)
        return status;
    report->directory = directory;
    return open_and_act(options, memory, report, error);
}

static struct store_state state_of(const struct bvhd_cache_state *state)
{
    return (struct store_state){.entries = state->entries, .bytes = state->bytes};
}

/* Has a daemon do it, which forgets the results in its memory, too, when all are removed. */
static enum bvhd_status act_by_daemon(const struct options *options, struct bvhd_client *client, struct memory *memory,
                                      struct cache_report *report, struct bvhd_error *error)
{
    static const enum bvhd_cache_action actions[] = {
        [CACHE_SHOW] = BVHD_CACHE_SHOW, [CACHE_TRIM] = BVHD_CACHE_TRIM, [CACHE_CLEAR] = BVHD_CACHE_CLEAR};
    struct bvhd_cache_state *before = NULL, *after = NULL;
    enum bvhd_status status = bvhd_client_cache(client, BVHD_CACHE_SHOW, 0, -1, &before, error);
    if (status == BVHD_OK && !*before->directory)
        status = bvhd_error_set(error, BVHD_UNSUPPORTED, "cache", "this daemon keeps nothing on disk");
    if (status == BVHD_OK)
        status = bvhd_client_cache(client, actions[options->cache_action], options->disk_cache_size, -1, &after, error);
    if (status == BVHD_OK && !(report->directory = files_copy_text(memory, after->directory)))
        status = bvhd_error_no_memory(error, "cache", "no memory for the name of its directory");
    if (status == BVHD_OK) {
        report->before = state_of(before);
        report->after = state_of(after);
    }
    bvhd_cache_state_destroy(before);
    bvhd_cache_state_destroy(after);
    return status;
}

/*
 * Connects to the daemon that is to do it: the one on a socket that is named, else the user's own if it runs. Without
 * one, connect->client stays NULL.
 */
static enum bvhd_status find_daemon(const struct options *options, struct memory *memory, struct connect *ret_connect,
                                    struct bvhd_error *error)
{
    bool is_named = connect_named_socket(options);
    if (options->cache || (!is_named && getenv("BVHD_CACHE")))
        return BVHD_OK;
    enum bvhd_status status = connect_find(options, memory, ret_connect, error);
    if (is_named || (status != BVHD_OK && status != BVHD_UNAVAILABLE))
        return status;
    if (status == BVHD_OK && !ret_connect->is_private) {
        connect_close(ret_connect);
        *ret_connect = (struct connect){0};
    }
    return BVHD_OK;
}

enum exit_code command_cache(const struct options *options)
{
    struct memory memory;
    struct connect connect = {0};
    struct cache_report report = {.directory = NULL};
    struct bvhd_error error;
    memory_init(&memory, UINT64_MAX);
    enum bvhd_status status = find_daemon(options, &memory, &connect, &error);
    if (status == BVHD_OK)
        status = connect.client ? act_by_daemon(options, connect.client, &memory, &report, &error)
                                : act_on_directory(options, &memory, &report, &error);
    enum exit_code code;
    if (status != BVHD_OK)
        code = report_failure(options->json, "cache", &error);
    else if (options->json)
        code = print_json(options, &report, &memory) ? EXIT_DONE : EXIT_FAILED;
    else
        code = print_text(options, &report) ? EXIT_DONE : EXIT_FAILED;
    memory_free(&memory, (void *)(uintptr_t)report.directory);
    connect_close(&connect);
    return code;
}
