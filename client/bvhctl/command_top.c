/* SPDX-License-Identifier: Apache-2.0 */
/* command_top.c - shows what a daemon does and for whom, again and again. */
#include <stdio.h>
#include <sys/ioctl.h>
#include <time.h>
#include <unistd.h>

#include "client/bvhctl/base/interrupt.h"
#include "client/bvhctl/commands.h"
#include "client/bvhctl/service/connect.h"
#include "client/bvhctl/service/connections_view.h"
#include "client/bvhctl/service/counters_view.h"

/* One look at the service: its counters and its connections. Both are NULL until they have been received. */
struct look {
    struct bvhd_counters *counters;
    struct bvhd_connections *connections;
};

static void look_finish(struct look *look)
{
    bvhd_counters_destroy(look->counters);
    bvhd_connections_destroy(look->connections);
    *look = (struct look){0};
}

static enum bvhd_status take_look(const struct options *options, struct bvhd_client *client, struct look *ret_look,
                                  struct bvhd_error *error)
{
    const int timeout = (int)options->connect_timeout_ms;
    struct look look = {0};
    enum bvhd_status status = bvhd_client_counters(client, timeout, &look.counters, error);
    if (status == BVHD_OK)
        status = bvhd_client_connections(client, 0, timeout, &look.connections, error);
    if (status == BVHD_OK)
        *ret_look = look;
    else
        look_finish(&look);
    return status;
}

enum { OTHER_LINES = 19 /* that are printed beside the rows of clients */, FEWEST_ROWS = 3 };

/* Returns how many clients the terminal has room for; without a terminal all are shown. */
static uint32_t room_for_rows(void)
{
    struct winsize size;
    if (!isatty(STDOUT_FILENO) || ioctl(STDOUT_FILENO, TIOCGWINSZ, &size) != 0 || size.ws_row == 0)
        return UINT32_MAX;
    return size.ws_row > OTHER_LINES + FEWEST_ROWS ? size.ws_row - OTHER_LINES : FEWEST_ROWS;
}

static bool print_page(const struct look *before, const struct look *now)
{
    if (isatty(STDOUT_FILENO))
        printf("\033[H\033[2J");
    counters_view_print(now->counters);
    if (before->counters)
        counters_view_print_rates(before->counters, now->counters);
    printf("\n");
    connections_view_print(now->connections, room_for_rows());
    if (!isatty(STDOUT_FILENO))
        printf("\n");
    return report_flush();
}

static bool print_object(const struct look *now, struct memory *memory)
{
    struct json json;
    json_init(&json, memory, false);
    json_object(&json, NULL);
    json_integer(&json, "schema", 1);
    json_object(&json, "stats");
    counters_view_write(now->counters, &json);
    json_object_end(&json);
    connections_view_write(now->connections, &json);
    json_object_end(&json);
    bool ok = report_print(&json);
    json_finish(&json);
    return ok;
}

static void pause_for(double seconds)
{
    struct timespec left = {.tv_sec = (time_t)seconds, .tv_nsec = (long)((seconds - (double)(time_t)seconds) * 1e9)};
    while (nanosleep(&left, &left) != 0)
        ;
}

/* Looks as often as the options say. *ret_printed: everything has been printed. */
static enum bvhd_status watch(const struct options *options, struct bvhd_client *client, struct memory *memory,
                              bool *ret_printed, struct bvhd_error *error)
{
    struct look before = {0}, now = {0};
    enum bvhd_status status = BVHD_OK;
    bool printed = true;
    for (uint32_t i = 0; printed && (options->count == 0 || i < options->count); i++) {
        if (i > 0)
            pause_for(options->interval);
        status = take_look(options, client, &now, error);
        if (status != BVHD_OK)
            break;
        interrupt_output_begins();
        printed = options->json ? print_object(&now, memory) : print_page(&before, &now);
        look_finish(&before);
        before = now;
    }
    look_finish(&before);
    *ret_printed = printed;
    return status;
}

enum exit_code command_top(const struct options *options)
{
    struct memory memory;
    struct connect connect = {0};
    struct bvhd_error error;
    bool printed = false;
    memory_init(&memory, UINT64_MAX);
    enum bvhd_status status = connect_find(options, &memory, &connect, &error);
    if (status == BVHD_OK)
        status = watch(options, connect.client, &memory, &printed, &error);
    connect_close(&connect);
    if (status != BVHD_OK)
        return report_failure(options->json, "top", &error);
    return printed ? EXIT_DONE : EXIT_FAILED;
}
