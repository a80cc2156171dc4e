/* SPDX-License-Identifier: Apache-2.0 */
/*
 * fuzz_metrics.c - fuzzes the reader of requests for monitoring: in pieces it judges as it does at once, and it reads
 * nothing beyond what has come.
 */
#include "tests/fuzz/fuzz.h"

#include <string.h>

#include "daemon/socket/metrics_request.h"

/* Reads a copy of the exact size, so that a sanitizer detects a read beyond it. */
static enum metrics_verdict judge(const uint8_t *data, size_t size)
{
    char *copy = malloc(size ? size : 1);
    FUZZ_CHECK(copy);
    memcpy(copy, data, size);
    enum metrics_verdict verdict = metrics_request_read(copy, size);
    free(copy);
    return verdict;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    enum metrics_verdict whole, first = METRICS_INCOMPLETE;
    size = size < METRICS_REQUEST ? size : METRICS_REQUEST;
    size_t step = 1 + size / 64; /* long inputs come in larger pieces */
    whole = judge(data, size);
    for (size_t some = 0; some < size && first == METRICS_INCOMPLETE; some += step)
        first = judge(data, some);
    FUZZ_CHECK(first == METRICS_INCOMPLETE || first == whole);
    FUZZ_CHECK(whole != METRICS_TOO_LONG || size == METRICS_REQUEST);
    FUZZ_CHECK(whole != METRICS_FOUND || (size >= 15 && !memcmp(data, "GET /metrics", 12)));
    return 0;
}

size_t fuzz_sample(uint32_t index, uint8_t *ret_bytes)
{
    static const char *const samples[] = {
        "GET /metrics HTTP/1.1\r\nHost: bvhd\r\nAccept: */*\r\n\r\n",
        "GET /metrics HTTP/1.0\n\n",
        "GET /metrics?a=b HTTP/1.1\r\n\r\n",
        "GET / HTTP/1.1\r\n\r\n",
        "POST /metrics HTTP/1.1\r\nContent-Length: 3\r\n\r\nabc",
        "GET /metrics",
        "\r\n\r\n",
    };
    if (index >= sizeof samples / sizeof *samples)
        return 0;
    size_t size = strlen(samples[index]);
    memcpy(ret_bytes, samples[index], size);
    return size;
}
