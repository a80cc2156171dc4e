/* SPDX-License-Identifier: Apache-2.0 */
/* metrics_request.h - reads a request of HTTP, as far as monitoring needs it: is it GET of /metrics? */
#ifndef BVHD_METRICS_REQUEST_H
#define BVHD_METRICS_REQUEST_H

#include <stddef.h>

enum { METRICS_REQUEST = 4096 }; /* bytes that a request may have */

enum metrics_verdict {
    METRICS_INCOMPLETE, /* more bytes have to come: a request ends with an empty line */
    METRICS_FOUND, /* GET /metrics, with or without a query */
    METRICS_NOT_FOUND, /* another path */
    METRICS_NOT_ALLOWED, /* another method than GET, or no HTTP at all */
    METRICS_TOO_LONG, /* METRICS_REQUEST bytes without an end */
};

/* Judges the bytes that have come so far, any bytes. More bytes change no other verdict than METRICS_INCOMPLETE. */
enum metrics_verdict metrics_request_read(const char *bytes, size_t size);

#endif
