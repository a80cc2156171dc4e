/* SPDX-License-Identifier: Apache-2.0 */
/*
 * json.h - writes JSON: each call appends a value to a growing text.
 *
 * `key` is the member's name inside an object, and NULL inside an array or at the top. When there is no memory,
 * `failed` becomes true and stays so: the caller checks it once, at the end. Texts come from files and can be any
 * bytes: sequences that are not UTF-8 are replaced. Numbers that are not finite become null.
 */
#ifndef BVHCTL_JSON_H
#define BVHCTL_JSON_H

#include <stdbool.h>
#include <stdint.h>

#include "proto/base/memory.h"

struct json {
    struct memory *memory;
    char *data; /* not terminated */
    uint64_t size, capacity;
    unsigned depth;
    bool lines; /* one value a line, indented; else all in one line */
    bool empty; /* the innermost object or array has no value yet */
    bool failed; /* there was no memory: the text is not complete */
};

void json_init(struct json *json, struct memory *memory, bool lines);
/* NULL-safe, idempotent. */
void json_finish(struct json *json);

void json_object(struct json *json, const char *key);
void json_object_end(struct json *json);
void json_array(struct json *json, const char *key);
void json_array_end(struct json *json);
void json_text(struct json *json, const char *key, const char *value);
void json_integer(struct json *json, const char *key, uint64_t value);
/* Writes the shortest decimal that reads back as the same double. */
void json_number(struct json *json, const char *key, double value);
/*
 * Writes a decimal that reads back as the same float, with the fewest digits or, rarely, one more. It is many times as
 * fast as json_number.
 */
void json_float(struct json *json, const char *key, float value);
/* Writes an array of floats, in one line. */
void json_floats(struct json *json, const char *key, const float *values, unsigned count);
void json_bool(struct json *json, const char *key, bool value);
void json_null(struct json *json, const char *key);
/* Appends the values of another text to the array that is open. Both texts were begun with the same `lines`. */
void json_append(struct json *json, const struct json *values);
/*
 * Returns a copy of a text in which sequences that are not UTF-8 are replaced as in JSON. The caller frees it with
 * memory_free. NULL when there is no memory.
 */
char *json_clean_text(struct memory *memory, const char *text);
/* Ends the text with a newline. */
void json_newline(struct json *json);

#endif
