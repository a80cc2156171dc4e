/* SPDX-License-Identifier: Apache-2.0 */
/*
 * argument.h - refuses what no call of the library accepts: NULL where something is needed, structs of unknown sizes.
 */
#ifndef BVHD_ARGUMENT_H
#define BVHD_ARGUMENT_H

#include <stddef.h>

#include "proto/base/status.h"

/* A pointer that a call needs, and its name. */
struct argument {
    const void *value;
    const char *name;
};

/* Checks pointers, given as {pointer, "name"}, ...: BVHD_INVALID names the first that is NULL. */
#define ARGUMENTS_CHECK(error, ...) argument_check_all((const struct argument[]){__VA_ARGS__, {NULL, NULL}}, error)

/* Checks arguments[...], which end with a name that is NULL. */
enum bvhd_status argument_check_all(const struct argument *arguments, struct bvhd_error *error);

/* Checks a time of rays, which is within 0 .. 1: BVHD_INVALID at the place "time". */
enum bvhd_status argument_check_time(float time, struct bvhd_error *error);

/*
 * Checks a struct that begins with its struct_size: `known` bytes in this version of the library, at least `least` in
 * earlier ones. In a larger struct, of a later version, the fields that this version does not know must be 0, so that
 * nothing is ignored in silence. `name` is the argument's, `type` the struct's. Returns BVHD_INVALID or
 * BVHD_UNSUPPORTED with the place "NAME.struct_size".
 */
enum bvhd_status argument_check_size(const void *sized, size_t least, size_t known, const char *name, const char *type,
                                     struct bvhd_error *error);

#endif
