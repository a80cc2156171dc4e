/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/service/connections_view.h"

#include <pwd.h>
#include <stdio.h>
#include <stdlib.h>

enum { CELL = 64, MOST_ROWS = 4096 /* of a list (bvhd.h) */ };

struct cell {
    char text[CELL];
};

/* Bytes in at most six characters: "0", "812", "1.2K", "34.5M". */
static struct cell bytes_cell(uint64_t bytes)
{
    static const char units[] = "KMGTPE";
    struct cell cell;
    double number = (double)bytes;
    int unit = -1;
    for (; number >= 999.95; unit++)
        number /= 1000;
    if (unit < 0)
        snprintf(cell.text, sizeof cell.text, "%llu", (unsigned long long)bytes);
    else
        snprintf(cell.text, sizeof cell.text, "%.1f%c", number, units[unit]);
    return cell;
}

/* A time in at most eight characters: "0.42s", "12m05s", "3h20m", "12d04h". */
static struct cell time_cell(uint64_t ms)
{
    struct cell cell;
    unsigned long long seconds = ms / 1000;
    if (seconds < 60)
        snprintf(cell.text, sizeof cell.text, "%.2fs", (double)ms / 1000);
    else if (seconds < 3600)
        snprintf(cell.text, sizeof cell.text, "%llum%02llus", seconds / 60, seconds % 60);
    else if (seconds < 86400)
        snprintf(cell.text, sizeof cell.text, "%lluh%02llum", seconds / 3600, seconds / 60 % 60);
    else
        snprintf(cell.text, sizeof cell.text, "%llud%02lluh", seconds / 86400, seconds / 3600 % 24);
    return cell;
}

/* Cut to fit. What a client calls itself may be any bytes: only those of ASCII are printed. */
static struct cell text_cell(const char *text)
{
    struct cell cell;
    size_t length = 0;
    for (; text[length] && length < sizeof cell.text - 1; length++)
        cell.text[length] = text[length] >= 0x20 && text[length] < 0x7f ? text[length] : '?';
    cell.text[length] = 0;
    return cell;
}

static struct cell user_cell(uint32_t uid)
{
    const struct passwd *user = getpwuid(uid);
    struct cell cell;
    if (user)
        return text_cell(user->pw_name);
    snprintf(cell.text, sizeof cell.text, "%u", uid);
    return cell;
}

static void print_row(const struct bvhd_connection *row)
{
    printf("%8llu  %-10.10s %8d %7s %5u %6u %6u %4u %8s %7s %7s %7s %5u  %s\n", (unsigned long long)row->number,
           user_cell(row->uid).text, (int)row->pid, time_cell(row->connected_ms).text, row->requests, row->items,
           row->waiting, row->threads, time_cell(row->busy_ms).text, bytes_cell(row->memory_bytes).text,
           bytes_cell(row->result_bytes).text, bytes_cell(row->pool_bytes).text, row->descriptors,
           text_cell(row->software).text);
}

/* Returns less than 0 if a is to be above b. */
static int compare(const void *a, const void *b)
{
    const struct bvhd_connection *left = *(const struct bvhd_connection *const *)a;
    const struct bvhd_connection *right = *(const struct bvhd_connection *const *)b;
    const uint64_t lefts[] = {left->threads, left->items, left->memory_bytes + left->result_bytes, left->number};
    const uint64_t rights[] = {right->threads, right->items, right->memory_bytes + right->result_bytes, right->number};
    for (size_t i = 0; i < sizeof lefts / sizeof *lefts; i++)
        if (lefts[i] != rights[i])
            return lefts[i] > rights[i] ? -1 : 1;
    return 0;
}

static void print_rest(const struct bvhd_connections *connections, uint32_t shown)
{
    uint32_t total = bvhd_connections_total(connections), hidden = bvhd_connections_hidden(connections);
    if (total - hidden > shown)
        printf("%u more are not shown\n", total - hidden - shown);
    if (hidden > 0)
        printf("%u of other users are not shown: root and the user whom the daemon runs as may see them\n", hidden);
}

void connections_view_print(const struct bvhd_connections *connections, uint32_t most)
{
    static const struct bvhd_connection *rows[MOST_ROWS];
    uint32_t count = bvhd_connections_count(connections);
    count = count < MOST_ROWS ? count : MOST_ROWS;
    printf("%8s  %-10s %8s %7s %5s %6s %6s %4s %8s %7s %7s %7s %5s  %s\n", "CLIENT", "USER", "PID", "AGE", "REQS",
           "ITEMS", "WAIT", "THR", "TIME", "MEMORY", "RESULTS", "POOL", "FDS", "SOFTWARE");
    for (uint32_t i = 0; i < count; i++)
        rows[i] = bvhd_connections_get(connections, i);
    qsort(rows, count, sizeof *rows, compare);
    uint32_t shown = count < most ? count : most;
    for (uint32_t i = 0; i < shown; i++)
        print_row(rows[i]);
    print_rest(connections, shown);
}

static void write_row(const struct bvhd_connection *row, struct json *json)
{
    json_object(json, NULL);
    json_integer(json, "connection", row->number);
    json_integer(json, "uid", row->uid);
    json_integer(json, "pid", (uint32_t)row->pid);
    json_integer(json, "connected_ms", row->connected_ms);
    json_integer(json, "busy_ms", row->busy_ms);
    json_integer(json, "memory_bytes", row->memory_bytes);
    json_integer(json, "result_bytes", row->result_bytes);
    json_integer(json, "pool_bytes", row->pool_bytes);
    json_integer(json, "requests", row->requests);
    json_integer(json, "items", row->items);
    json_integer(json, "waiting", row->waiting);
    json_integer(json, "threads", row->threads);
    json_integer(json, "descriptors", row->descriptors);
    json_text(json, "software", row->software);
    json_object_end(json);
}

void connections_view_write(const struct bvhd_connections *connections, struct json *json)
{
    json_integer(json, "total", bvhd_connections_total(connections));
    json_integer(json, "hidden", bvhd_connections_hidden(connections));
    json_array(json, "clients");
    for (uint32_t i = 0; i < bvhd_connections_count(connections); i++)
        write_row(bvhd_connections_get(connections, i), json);
    json_array_end(json);
}
