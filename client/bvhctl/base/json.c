/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/base/json.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "proto/base/utf8.h"

void json_init(struct json *json, struct memory *memory, bool lines)
{
    *json = (struct json){.memory = memory, .lines = lines, .empty = true};
}

void json_finish(struct json *json)
{
    if (!json)
        return;
    memory_free(json->memory, json->data);
    json->data = NULL;
    json->size = json->capacity = 0;
}

static bool reserve(struct json *json, uint64_t size)
{
    if (json->failed)
        return false;
    if (json->capacity - json->size >= size)
        return true;
    uint64_t capacity = json->capacity * 2 + size + 256;
    char *data = memory_resize(json->memory, json->data, capacity);
    if (!data) {
        json->failed = true;
        return false;
    }
    json->data = data;
    json->capacity = capacity;
    return true;
}

static void append(struct json *json, const char *text, size_t size)
{
    if (!reserve(json, size))
        return;
    memcpy(json->data + json->size, text, size);
    json->size += size;
}

static void append_word(struct json *json, const char *text)
{
    append(json, text, strlen(text));
}

static void append_control(struct json *json, unsigned char character)
{
    char escape[8];
    snprintf(escape, sizeof escape, "\\u%04x", character);
    append_word(json, escape);
}

static void append_quoted(struct json *json, const char *text)
{
    append_word(json, "\"");
    for (const unsigned char *at = (const unsigned char *)text; *at;) {
        unsigned length = utf8_length(at);
        if (*at == '"' || *at == '\\')
            append_word(json, "\\");
        if (*at < 0x20 || *at == 0x7f)
            append_control(json, *at);
        else if (length)
            append(json, (const char *)at, length);
        else
            append_word(json, "\xef\xbf\xbd"); /* U+FFFD, the replacement character */
        at += length ? length : 1;
    }
    append_word(json, "\"");
}

static void next_line(struct json *json)
{
    append_word(json, "\n");
    for (unsigned i = 0; i < json->depth; i++)
        append_word(json, "  ");
}

static void begin_value(struct json *json, const char *key)
{
    if (!json->empty)
        append_word(json, ",");
    if (json->lines && json->depth)
        next_line(json);
    json->empty = false;
    if (key) {
        append_quoted(json, key);
        append_word(json, json->lines ? ": " : ":");
    }
}

static void open_group(struct json *json, const char *key, const char *bracket)
{
    begin_value(json, key);
    append_word(json, bracket);
    json->depth++;
    json->empty = true;
}

static void close_group(struct json *json, const char *bracket)
{
    json->depth--;
    if (json->lines && !json->empty)
        next_line(json);
    append_word(json, bracket);
    json->empty = false;
}

void json_object(struct json *json, const char *key)
{
    open_group(json, key, "{");
}

void json_object_end(struct json *json)
{
    close_group(json, "}");
}

void json_array(struct json *json, const char *key)
{
    open_group(json, key, "[");
}

void json_array_end(struct json *json)
{
    close_group(json, "]");
}

void json_text(struct json *json, const char *key, const char *value)
{
    begin_value(json, key);
    append_quoted(json, value);
}

void json_integer(struct json *json, const char *key, uint64_t value)
{
    char text[32];
    snprintf(text, sizeof text, "%llu", (unsigned long long)value);
    begin_value(json, key);
    append_word(json, text);
}

void json_number(struct json *json, const char *key, double value)
{
    if (!isfinite(value)) {
        json_null(json, key);
        return;
    }
    char text[40];
    for (int digits = 15; digits <= 17; digits++) {
        snprintf(text, sizeof text, "%.*g", digits, value);
        if (strtod(text, NULL) == value)
            break;
    }
    begin_value(json, key);
    append_word(json, text);
}

void json_bool(struct json *json, const char *key, bool value)
{
    begin_value(json, key);
    append_word(json, value ? "true" : "false");
}

void json_null(struct json *json, const char *key)
{
    begin_value(json, key);
    append_word(json, "null");
}

void json_append(struct json *json, const struct json *values)
{
    json->failed |= values->failed;
    if (values->size == 0)
        return;
    begin_value(json, NULL);
    append(json, values->data, values->size);
}

void json_newline(struct json *json)
{
    append_word(json, "\n");
}
