/* SPDX-License-Identifier: Apache-2.0 */
/* status.h - functions that fill errors. The types are public: bvhd/status.h. */
#ifndef BVHD_STATUS_H
#define BVHD_STATUS_H

#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include "bvhd/status.h"

/*
 * Fills *error and returns `status`, so that a function can end with `return bvhd_error_set(...)`. `where` is copied
 * and cut to fit. The text is in printf style, and control characters become spaces. `where` and the arguments may be
 * strings of *error itself, so that an error can be extended with more words. `error` may be NULL: then only the status
 * is returned.
 */
enum bvhd_status bvhd_error_set(struct bvhd_error *error, enum bvhd_status status, const char *where,
                                const char *format, ...) __attribute__((format(printf, 4, 5)));

/* Works like bvhd_error_set with BVHD_INVALID, and names the Vulkan rule that is broken. */
enum bvhd_status bvhd_error_rule(struct bvhd_error *error, enum bvhd_vuid vuid, const char *where, const char *format,
                                 ...) __attribute__((format(printf, 4, 5)));

/* Works like bvhd_error_set with BVHD_NO_MEMORY. */
enum bvhd_status bvhd_error_no_memory(struct bvhd_error *error, const char *where, const char *format, ...)
    __attribute__((format(printf, 3, 4)));

/* The place in errors of a deadline. */
#define BVHD_ERROR_DEADLINE "deadline"

/* Fills the error of a structure that has no result within `ms` milliseconds, its deadline: BVHD_CANCELLED. */
enum bvhd_status bvhd_error_deadline(struct bvhd_error *error, uint32_t ms);

#endif
