/* SPDX-License-Identifier: Apache-2.0 */
#include "client/search.h"

#include <stdarg.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

static const char remedy[] = "start bvhd, or build without it (bvhd_client_options.local, bvhctl --local)";

/* Tries one place. A place that nobody named and that cannot be used counts as one on which nobody listens. */
static enum bvhd_status try_place(const struct address *address, const struct address_place *place, uint64_t now,
                                  struct connection **ret_connection, struct bvhd_error *error)
{
    const char *directory = place->own_directory;
    if (directory && !address_is_own(directory) && access(directory, F_OK) == 0)
        return bvhd_error_set(error, BVHD_UNAVAILABLE, place->path, "its directory does not belong to this user alone");
    enum bvhd_status status = connection_create(place->path, now, ret_connection, error);
    return status == BVHD_INVALID && !address->is_named ? BVHD_UNAVAILABLE : status;
}

/* Adds to the error's text, as far as there is room. */
__attribute__((format(printf, 2, 3))) static void append(struct bvhd_error *error, const char *format, ...)
{
    size_t length = strlen(error->text);
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(error->text + length, sizeof error->text - length, format, arguments);
    va_end(arguments);
}

/* Adds the reason why one place is none to those of the places before it. */
static void add_reason(const struct bvhd_error *reason, bool is_first, struct bvhd_error *error)
{
    if (is_first) {
        *error = *reason;
        error->status = BVHD_UNAVAILABLE;
        return;
    }
    append(error, "; %s: %s", reason->where, reason->text);
}

enum bvhd_status search_connect(const struct address *address, uint64_t now, struct connection **ret_connection,
                                struct bvhd_error *error)
{
    struct bvhd_error all = {.status = BVHD_UNAVAILABLE}, reason;
    for (uint32_t i = 0; i < address->count; i++) {
        enum bvhd_status status = try_place(address, &address->places[i], now, ret_connection, &reason);
        if (status != BVHD_UNAVAILABLE) {
            if (status != BVHD_OK)
                *error = reason;
            return status;
        }
        add_reason(&reason, i == 0, &all);
    }
    append(&all, "; %s", remedy);
    *error = all;
    return BVHD_UNAVAILABLE;
}
