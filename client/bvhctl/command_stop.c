/* SPDX-License-Identifier: Apache-2.0 */
#include <stdio.h>
#include <unistd.h>

#include "client/bvhctl/base/files.h"
#include "client/bvhctl/base/progress.h"
#include "client/bvhctl/commands.h"
#include "client/bvhctl/service/connect.h"
#include "client/bvhctl/service/daemon_end.h"
#include "client/bvhctl/service/private_daemon.h"
#include "proto/base/clock.h"

/* A daemon may take 20 seconds to finish what is under way, unless it is told otherwise. */
enum { PATIENCE_MS = 30000 };

/* Finds the socket of the private daemon. The caller frees it. */
static enum bvhd_status find_private(struct memory *memory, char **ret_socket, struct bvhd_error *error)
{
    struct private_place place;
    enum bvhd_status status = private_daemon_place(memory, &place, error);
    if (status != BVHD_OK)
        return status;
    bool answers = place.is_safe && connect_answers(place.socket);
    if (!answers && connect_answers(connect_system_socket))
        status = bvhd_error_set(error, BVHD_UNAVAILABLE, place.socket,
                                "no private daemon to stop; for the one on %s: sudo systemctl stop bvhd.socket "
                                "bvhd.service",
                                connect_system_socket);
    else if (!answers)
        status = bvhd_error_set(error, BVHD_UNAVAILABLE, place.socket, "no private daemon to stop");
    else if (!(*ret_socket = files_copy_text(memory, place.socket)))
        status = bvhd_error_no_memory(error, place.socket, "no memory for its name");
    private_place_finish(&place, memory);
    return status;
}

static bool print(const struct options *options, const char *socket, pid_t process, double ms, struct memory *memory)
{
    struct json json;
    if (!options->json) {
        if (report_volume() >= REPORT_RESULTS)
            printf("%s: the daemon, process %d, has ended after %.0f ms\n", socket, (int)process, ms);
        return report_flush();
    }
    json_init(&json, memory, false);
    json_object(&json, NULL);
    json_integer(&json, "schema", 1);
    json_text(&json, "socket", socket);
    json_integer(&json, "process", (uint64_t)process);
    json_number(&json, "ms", ms);
    json_object_end(&json);
    bool ok = report_print(&json);
    json_finish(&json);
    return ok;
}

/* Ends the daemon on the socket that is named, or else the private one. */
static enum bvhd_status stop(const struct options *options, struct memory *memory, char **ret_socket,
                             pid_t *ret_process, struct bvhd_error *error)
{
    const char *named = connect_named_socket(options);
    enum bvhd_status status = BVHD_OK;
    if (!named)
        status = find_private(memory, ret_socket, error);
    else if (!(*ret_socket = files_copy_text(memory, named)))
        status = bvhd_error_no_memory(error, named, "no memory for its name");
    if (status != BVHD_OK)
        return status;
    struct progress progress = {0};
    progress_begin(&progress, "stopping", *ret_socket);
    status = daemon_end(*ret_socket, PATIENCE_MS, ret_process, error);
    progress_end(&progress);
    return status;
}

enum exit_code command_stop(const struct options *options)
{
    struct memory memory;
    struct bvhd_error error;
    char *socket = NULL;
    pid_t process;
    double start = clock_ms();
    memory_init(&memory, UINT64_MAX);
    enum bvhd_status status = stop(options, &memory, &socket, &process, &error);
    enum exit_code code = EXIT_DONE;
    if (status != BVHD_OK)
        code = report_failure(options->json, "stop", &error);
    else if (!print(options, socket, process, clock_ms() - start, &memory))
        code = EXIT_FAILED;
    memory_free(&memory, socket);
    return code;
}
