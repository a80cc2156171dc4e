/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/scene/ply_source.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "proto/base/bytes.h"

size_t ply_type_size(enum ply_type type)
{
    static const unsigned char sizes[PLY_TYPES] = {1, 1, 2, 2, 4, 4, 8, 8, 4, 8};
    return sizes[type];
}

void ply_source_init(struct ply_source *source, FILE *file, uint64_t size)
{
    source->file = file;
    source->size = size;
    source->format = PLY_ASCII;
    source->begin = 0;
    source->at = source->end = 0;
    source->line = 1;
    source->is_bad_value = false;
    source->buffer[0] = '\0';
}

uint64_t ply_source_tell(const struct ply_source *source)
{
    return source->begin + source->at;
}

uint64_t ply_source_left(const struct ply_source *source)
{
    uint64_t place = ply_source_tell(source);
    return place < source->size ? source->size - place : 0;
}

bool ply_source_seek(struct ply_source *source, uint64_t place, uint64_t line)
{
    source->is_bad_value = false;
    if (place > source->size || fseeko(source->file, (off_t)place, SEEK_SET) != 0)
        return false;
    source->begin = place;
    source->at = source->end = 0;
    source->line = line;
    source->buffer[0] = '\0';
    return true;
}

/* Reads more of the file until `wanted` bytes are in the buffer. Returns false when the file has fewer. */
static bool fill(struct ply_source *source, size_t wanted)
{
    size_t kept = source->end - source->at;
    if (kept >= wanted)
        return true;
    memmove(source->buffer, source->buffer + source->at, kept);
    source->begin += source->at;
    source->at = 0;
    source->end = kept + fread(source->buffer + kept, 1, PLY_BUFFER - kept, source->file);
    source->buffer[source->end] = '\0';
    return source->end >= wanted;
}

const unsigned char *ply_source_take(struct ply_source *source, size_t size)
{
    source->is_bad_value = false;
    if (!fill(source, size))
        return NULL;
    source->at += size;
    return source->buffer + source->at - size;
}

bool ply_source_skip(struct ply_source *source, uint64_t size)
{
    source->is_bad_value = false;
    if (size > ply_source_left(source))
        return false;
    if (size > source->end - source->at)
        return ply_source_seek(source, ply_source_tell(source) + size, source->line);
    source->at += (size_t)size;
    return true;
}

int ply_source_peek(struct ply_source *source)
{
    return fill(source, 1) ? source->buffer[source->at] : -1;
}

static bool is_blank(unsigned char character)
{
    return character == ' ' || character == '\t' || character == '\v' || character == '\f';
}

static bool is_space(unsigned char character)
{
    return is_blank(character) || character == '\n' || character == '\r';
}

/* Takes the end of a line, which is "\n", "\r\n" or "\r". */
static void take_line_end(struct ply_source *source)
{
    int character = source->buffer[source->at++];
    if (character == '\r' && ply_source_peek(source) == '\n')
        source->at++;
    source->line++;
}

/* Finds the next number in an ASCII file, with its end in the buffer. */
static bool find_token(struct ply_source *source, size_t *ret_length)
{
    source->is_bad_value = false;
    for (;;) {
        int next = ply_source_peek(source);
        if (next < 0)
            return false;
        if (next == '\n' || next == '\r')
            take_line_end(source);
        else if (is_blank((unsigned char)next))
            source->at++;
        else
            break;
    }
    if (source->end - source->at <= PLY_TOKEN_MAX)
        fill(source, PLY_TOKEN_MAX + 1);
    size_t length = 0, room = source->end - source->at;
    while (length < room && length <= PLY_TOKEN_MAX && !is_space(source->buffer[source->at + length]))
        length++;
    source->is_bad_value = length > PLY_TOKEN_MAX;
    *ret_length = length;
    return !source->is_bad_value;
}

/* Parses digits with an optional minus. Returns false for anything else and for more than 18 digits. */
static bool parse_integer(const unsigned char *text, size_t length, double *ret_number)
{
    size_t at = text[0] == '-';
    int64_t number = 0;
    if (length == at || length > at + 18)
        return false;
    for (; at < length; at++) {
        if (text[at] < '0' || text[at] > '9')
            return false;
        number = number * 10 + (text[at] - '0');
    }
    *ret_number = text[0] == '-' ? -(double)number : (double)number;
    return true;
}

/* Parses what old C libraries of Windows print: "1.#INF", "-1.#IND", "1.#QNAN". */
static bool parse_windows(const char *text, double *ret_number)
{
    bool is_negative = *text == '-';
    text += is_negative;
    if (strncmp(text, "1.#", 3) != 0)
        return false;
    double number = strncmp(text + 3, "INF", 3) == 0 ? (double)INFINITY : (double)NAN;
    *ret_number = is_negative ? -number : number;
    return true;
}

static bool parse_value(const unsigned char *token, size_t length, enum ply_type type, struct ply_value *ret_value)
{
    const char *text = (const char *)token;
    char *end = NULL;
    bool ok = type != PLY_FLOAT32 && parse_integer(token, length, &ret_value->number);
    if (type == PLY_FLOAT32) { /* rounded once, from the text */
        ret_value->single = strtof(text, &end);
        ret_value->number = (double)ret_value->single;
        if (end == text + length)
            return true;
    } else if (!ok) {
        ret_value->number = strtod(text, &end);
        ok = end == text + length;
    }
    ok = ok || parse_windows(text, &ret_value->number);
    ret_value->single = (float)ret_value->number;
    return ok && (type >= PLY_FLOAT32 || trunc(ret_value->number) == ret_value->number);
}

static uint64_t load(const unsigned char *bytes, size_t size, enum ply_format format)
{
    uint64_t bits = 0;
    for (size_t i = 0; i < size; i++)
        bits = bits << 8 | bytes[format == PLY_BIG_ENDIAN ? i : size - 1 - i];
    return bits;
}

struct ply_value ply_value_of(const unsigned char *bytes, enum ply_type type, enum ply_format format)
{
    struct ply_value value;
    uint64_t bits = load(bytes, ply_type_size(type), format);
    uint32_t low = (uint32_t)bits;
    switch (type) {
    case PLY_FLOAT32:
        memcpy(&value.single, &low, sizeof low);
        value.number = (double)value.single;
        return value;
    case PLY_FLOAT64:
        memcpy(&value.number, &bits, sizeof bits);
        break;
    case PLY_INT8:
        value.number = (int8_t)bits;
        break;
    case PLY_INT16:
        value.number = (int16_t)bits;
        break;
    case PLY_INT32:
        value.number = (int32_t)bits;
        break;
    case PLY_INT64:
        value.number = (double)(int64_t)bits;
        break;
    default:
        value.number = (double)bits;
    }
    value.single = (float)value.number;
    return value;
}

bool ply_source_value(struct ply_source *source, enum ply_type type, struct ply_value *ret_value)
{
    size_t length;
    if (source->format != PLY_ASCII) {
        const unsigned char *bytes = ply_source_take(source, ply_type_size(type));
        if (bytes)
            *ret_value = ply_value_of(bytes, type, source->format);
        return bytes != NULL;
    }
    if (!find_token(source, &length))
        return false;
    source->is_bad_value = !parse_value(source->buffer + source->at, length, type, ret_value);
    if (!source->is_bad_value)
        source->at += length;
    return !source->is_bad_value;
}

bool ply_source_skip_values(struct ply_source *source, enum ply_type type, uint64_t count)
{
    if (source->format != PLY_ASCII)
        return count <= ply_source_left(source) / ply_type_size(type) &&
               ply_source_skip(source, count * ply_type_size(type));
    for (; count; count--) {
        size_t length;
        if (!find_token(source, &length))
            return false;
        source->at += length;
    }
    return true;
}

static void skip_line(struct ply_source *source)
{
    int next;
    while ((next = ply_source_peek(source)) >= 0 && next != '\n' && next != '\r')
        source->at++;
}

static bool is_comment(struct ply_source *source)
{
    fill(source, sizeof "comment");
    size_t left = source->end - source->at;
    const unsigned char *text = source->buffer + source->at;
    return (left >= 7 && memcmp(text, "comment", 7) == 0) || (left >= 8 && memcmp(text, "obj_info", 8) == 0);
}

bool ply_source_end_row(struct ply_source *source)
{
    bool is_line_end = false;
    if (source->format != PLY_ASCII)
        return true;
    for (;;) {
        int next = ply_source_peek(source);
        if (next == '\n' || next == '\r')
            take_line_end(source);
        else if (next >= 0 && is_blank((unsigned char)next))
            source->at++;
        else if (is_line_end && next >= 0 && is_comment(source))
            skip_line(source);
        else
            return is_line_end || next < 0;
        is_line_end |= next == '\n' || next == '\r';
    }
}
