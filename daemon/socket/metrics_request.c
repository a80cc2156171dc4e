/* SPDX-License-Identifier: Apache-2.0 */
#include "daemon/socket/metrics_request.h"

#include <stdbool.h>
#include <string.h>

static const char method[] = "GET ", path[] = "/metrics";

static bool is_complete(const char *bytes, size_t size)
{
    return memmem(bytes, size, "\r\n\r\n", 4) || memmem(bytes, size, "\n\n", 2);
}

static bool starts_with(const char *bytes, size_t size, const char *start, size_t length)
{
    return size >= length && !memcmp(bytes, start, length);
}

enum metrics_verdict metrics_request_read(const char *bytes, size_t size)
{
    const size_t first = sizeof method - 1, second = sizeof path - 1;
    if (!is_complete(bytes, size))
        return size < METRICS_REQUEST ? METRICS_INCOMPLETE : METRICS_TOO_LONG;
    if (!starts_with(bytes, size, method, first))
        return METRICS_NOT_ALLOWED;
    if (!starts_with(bytes + first, size - first, path, second))
        return METRICS_NOT_FOUND;
    char next = bytes[first + second]; /* there is one: the request has an end */
    return next == ' ' || next == '?' ? METRICS_FOUND : METRICS_NOT_FOUND;
}
