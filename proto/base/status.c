/* SPDX-License-Identifier: Apache-2.0 */
#include "proto/base/status.h"

#include <stdio.h>
#include <string.h>

static const char *const names[BVHD_STATUS_COUNT] = {
    [BVHD_OK] = "OK",
    [BVHD_INVALID] = "INVALID",
    [BVHD_UNSUPPORTED] = "UNSUPPORTED",
    [BVHD_TOO_LARGE] = "TOO_LARGE",
    [BVHD_NO_MEMORY] = "NO_MEMORY",
    [BVHD_CANCELLED] = "CANCELLED",
    [BVHD_CORRUPT] = "CORRUPT",
    [BVHD_NOT_FOUND] = "NOT_FOUND",
    [BVHD_BUSY] = "BUSY",
    [BVHD_UNAVAILABLE] = "UNAVAILABLE",
    [BVHD_INCOMPATIBLE] = "INCOMPATIBLE",
    [BVHD_IO] = "IO",
    [BVHD_INTERNAL] = "INTERNAL",
    [BVHD_PENDING] = "PENDING",
    [BVHD_SOURCE_LOST] = "SOURCE_LOST",
};

const char *bvhd_status_name(enum bvhd_status status)
{
    return (unsigned)status < BVHD_STATUS_COUNT ? names[status] : "UNKNOWN";
}

/* File names and clients' texts end up in errors, and an error is printed as one line. */
static void blank_control_characters(char *text)
{
    for (; *text; text++)
        if ((unsigned char)*text < 0x20 || *text == 0x7f)
            *text = ' ';
}

/* Fills a local value first, because `where` and the arguments may be strings of the same *error. */
__attribute__((format(printf, 5, 0))) static void fill(struct bvhd_error *error, enum bvhd_status status,
                                                       enum bvhd_vuid vuid, const char *where, const char *format,
                                                       va_list arguments)
{
    struct bvhd_error filled = {.status = status, .vuid = vuid};
    snprintf(filled.where, sizeof filled.where, "%s", where ? where : "");
    if (vsnprintf(filled.text, sizeof filled.text, format, arguments) < 0)
        filled.text[0] = '\0';
    blank_control_characters(filled.where);
    blank_control_characters(filled.text);
    *error = filled;
}

enum bvhd_status bvhd_error_set(struct bvhd_error *error, enum bvhd_status status, const char *where,
                                const char *format, ...)
{
    if (error) {
        va_list arguments;
        va_start(arguments, format);
        fill(error, status, BVHD_VUID_NONE, where, format, arguments);
        va_end(arguments);
    }
    return status;
}

enum bvhd_status bvhd_error_rule(struct bvhd_error *error, enum bvhd_vuid vuid, const char *where, const char *format,
                                 ...)
{
    if (error) {
        va_list arguments;
        va_start(arguments, format);
        fill(error, BVHD_INVALID, vuid, where, format, arguments);
        va_end(arguments);
    }
    return BVHD_INVALID;
}

enum bvhd_status bvhd_error_no_memory(struct bvhd_error *error, const char *where, const char *format, ...)
{
    if (error) {
        va_list arguments;
        va_start(arguments, format);
        fill(error, BVHD_NO_MEMORY, BVHD_VUID_NONE, where, format, arguments);
        va_end(arguments);
    }
    return BVHD_NO_MEMORY;
}

enum bvhd_status bvhd_error_deadline(struct bvhd_error *error, uint32_t ms)
{
    return bvhd_error_set(error, BVHD_CANCELLED, BVHD_ERROR_DEADLINE,
                          "no result within %u ms, the deadline of the request", ms);
}
