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

static const char replacement[] = "\xef\xbf\xbd"; /* U+FFFD */

/* Returns the number of bytes at the start of a text that are written as they are. */
static size_t plain_length(const unsigned char *text)
{
    const unsigned char *at = text;
    for (;;) {
        if (*at < 0x20 || *at == 0x7f || *at == '"' || *at == '\\')
            return (size_t)(at - text);
        unsigned length = utf8_length(at);
        if (length == 0)
            return (size_t)(at - text);
        at += length;
    }
}

static void append_quoted(struct json *json, const char *text)
{
    const unsigned char *at = (const unsigned char *)text;
    append(json, "\"", 1);
    for (;;) {
        size_t plain = plain_length(at);
        append(json, (const char *)at, plain);
        at += plain;
        if (!*at)
            break;
        char quoted[2] = {'\\', (char)*at};
        if (*at == '"' || *at == '\\')
            append(json, quoted, 2);
        else if (*at < 0x20 || *at == 0x7f)
            append_control(json, *at);
        else
            append_word(json, replacement);
        at++;
    }
    append(json, "\"", 1);
}

char *json_clean_text(struct memory *memory, const char *text)
{
    char *clean = memory_alloc(memory, strlen(text) * (sizeof replacement - 1) + 1), *end = clean;
    if (!clean)
        return NULL;
    for (const unsigned char *at = (const unsigned char *)text; *at;) {
        unsigned length = utf8_length(at);
        memcpy(end, length ? (const char *)at : replacement, length ? length : sizeof replacement - 1);
        end += length ? length : sizeof replacement - 1;
        at += length ? length : 1;
    }
    *end = '\0';
    return clean;
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

enum { FLOAT_TEXT = 32, EXACT_POWERS = 23 };

/* Powers of ten that are doubles. */
static const double powers[EXACT_POWERS] = {1e0,  1e1,  1e2,  1e3,  1e4,  1e5,  1e6,  1e7,  1e8,  1e9,  1e10, 1e11,
                                            1e12, 1e13, 1e14, 1e15, 1e16, 1e17, 1e18, 1e19, 1e20, 1e21, 1e22};

/*
 * Finds the fewest digits, 6 to 9, that read back as `value`, which is positive: value is about digits * 10^-shift. The
 * difference is computed in double, 2^-29 times as exactly as a float is spaced, and has to stay that far from where
 * another float would be nearer. Returns false for values out of range.
 */
static bool find_digits(float value, uint64_t *ret_digits, int *ret_shift)
{
    double exact = (double)value, half = (exact - (double)nextafterf(value, 0)) / 2 * 0.9999999;
    int exponent = (int)floor(log10(exact));
    for (int count = 6; count <= 9; count++) {
        int shift = count - 1 - exponent;
        if (shift <= -EXACT_POWERS || shift >= EXACT_POWERS)
            return false;
        double scaled = shift >= 0 ? exact * powers[shift] : exact / powers[-shift];
        uint64_t digits = (uint64_t)rint(scaled);
        double back = shift >= 0 ? (double)digits / powers[shift] : (double)digits * powers[-shift];
        if (fabs(back - exact) <= half) {
            *ret_digits = digits;
            *ret_shift = shift;
            return true;
        }
    }
    return false;
}

/* Writes digits * 10^-shift, without zeros at the end of the fraction. */
static void format_fixed(uint64_t digits, int shift, bool is_negative, char text[FLOAT_TEXT])
{
    char reversed[FLOAT_TEXT];
    int size = 0;
    for (; shift > 0 && digits % 10 == 0; shift--)
        digits /= 10;
    for (int i = 0; digits || i <= shift; i++) {
        if (i == shift && shift > 0)
            reversed[size++] = '.';
        reversed[size++] = (char)('0' + digits % 10);
        digits /= 10;
    }
    if (is_negative)
        reversed[size++] = '-';
    for (int i = 0; i < size; i++)
        text[i] = reversed[size - 1 - i];
    text[size] = '\0';
}

static void format_any(float value, char text[FLOAT_TEXT])
{
    for (int digits = 1; digits <= 9; digits++) {
        snprintf(text, FLOAT_TEXT, "%.*g", digits, (double)value);
        if (strtof(text, NULL) == value)
            return;
    }
}

void json_float(struct json *json, const char *key, float value)
{
    char text[FLOAT_TEXT];
    uint64_t digits;
    int shift;
    float size = fabsf(value);
    if (!isfinite(value)) {
        json_null(json, key);
        return;
    }
    if (size == 0)
        strcpy(text, signbit(value) ? "-0" : "0");
    else if (size >= 1e-4f && size < 1e9f && find_digits(size, &digits, &shift) && shift >= 0)
        format_fixed(digits, shift, value < 0, text);
    else
        format_any(value, text);
    begin_value(json, key);
    append_word(json, text);
}

void json_floats(struct json *json, const char *key, const float *values, unsigned count)
{
    bool lines = json->lines;
    json_array(json, key);
    json->lines = false;
    for (unsigned i = 0; i < count; i++)
        json_float(json, NULL, values[i]);
    json_array_end(json);
    json->lines = lines;
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
    if (!json->empty)
        append_word(json, ",");
    else if (json->lines && json->depth && values->data[0] != '\n')
        next_line(json);
    json->empty = false;
    append(json, values->data, values->size);
}

void json_newline(struct json *json)
{
    append_word(json, "\n");
}
