/* SPDX-License-Identifier: Apache-2.0 */
/* place.h - formats paths for bvhd_error.where in place: place("infos[%u].geometries[%u].flags", i, j).text */
#ifndef BVHD_PLACE_H
#define BVHD_PLACE_H

#include <stdarg.h>
#include <stdio.h>

#include "proto/base/status.h"

struct place {
    char text[BVHD_WHERE_SIZE];
};

__attribute__((format(printf, 1, 2))) static inline struct place place(const char *format, ...)
{
    struct place result;
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(result.text, sizeof result.text, format, arguments);
    va_end(arguments);
    return result;
}

#endif
