/* SPDX-License-Identifier: Apache-2.0 */
/* status.h - filling errors. What they are is public: bvhd/status.h. */
#ifndef BVHD_STATUS_H
#define BVHD_STATUS_H

#include <stdarg.h>
#include <stddef.h>

#include "bvhd/status.h"

/*
 * Fills *error and returns `status`, so that a function can end with `return bvhd_error_set(...)`. `where` is copied
 * and cut to fit; the text is printf style, and control characters become spaces. Both may come from *error itself, to
 * tell an error again with more words. `error` may be NULL: then only the status is returned.
 */
enum bvhd_status bvhd_error_set(struct bvhd_error *error, enum bvhd_status status, const char *where,
                                const char *format, ...) __attribute__((format(printf, 4, 5)));

/* As bvhd_error_set with BVHD_INVALID and the Vulkan rule that is broken. */
enum bvhd_status bvhd_error_rule(struct bvhd_error *error, enum bvhd_vuid vuid, const char *where, const char *format,
                                 ...) __attribute__((format(printf, 4, 5)));

#endif
