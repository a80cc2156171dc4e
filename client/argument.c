/* SPDX-License-Identifier: Apache-2.0 */
#include "client/argument.h"

#include <string.h>

#include <bvhd/bvhd.h>

#include "proto/base/place.h"

/* No struct grows by more: a larger size is a field that was not set. */
enum { MAX_GROWTH = 1024 };

enum bvhd_status argument_check_all(const struct argument *arguments, struct bvhd_error *error)
{
    for (; arguments->name; arguments++)
        if (!arguments->value)
            return bvhd_error_set(error, BVHD_INVALID, arguments->name, "%s is NULL", arguments->name);
    return BVHD_OK;
}

enum bvhd_status argument_check_time(float time, struct bvhd_error *error)
{
    if (time >= 0 && time <= 1)
        return BVHD_OK;
    return bvhd_error_set(error, BVHD_INVALID, "time", "%g is not in 0 .. 1", (double)time);
}

enum bvhd_status argument_check_size(const void *sized, size_t least, size_t known, const char *name, const char *type,
                                     struct bvhd_error *error)
{
    size_t size;
    memcpy(&size, sized, sizeof size);
    if (size < least || size > known + MAX_GROWTH)
        return bvhd_error_set(error, BVHD_INVALID, place("%s.struct_size", name).text,
                              "struct_size is %zu, not sizeof(struct %s), which is %zu", size, type, known);
    for (size_t at = known; at < size; at++)
        if (((const unsigned char *)sized)[at] != 0)
            return bvhd_error_set(error, BVHD_UNSUPPORTED, place("%s.struct_size", name).text,
                                  "a field behind byte %zu is set, which version %s of the library does not know",
                                  known, bvhd_version());
    return BVHD_OK;
}
