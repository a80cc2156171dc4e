/* SPDX-License-Identifier: Apache-2.0 */
/*
 * ply_source.h - reads the values of a PLY file one after the other, in each of its three formats. Internal to ply.h.
 *
 * The file passes through a buffer of constant size. Functions return false, or NULL, at the end of the file and at a
 * value that is none; then ply_source_problem describes it.
 */
#ifndef BVHCTL_PLY_SOURCE_H
#define BVHCTL_PLY_SOURCE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

enum ply_format { PLY_ASCII, PLY_LITTLE_ENDIAN, PLY_BIG_ENDIAN };

enum ply_type {
    PLY_INT8,
    PLY_UINT8,
    PLY_INT16,
    PLY_UINT16,
    PLY_INT32,
    PLY_UINT32,
    PLY_INT64,
    PLY_UINT64,
    PLY_FLOAT32,
    PLY_FLOAT64,
    PLY_TYPES
};

enum {
    PLY_BUFFER = 1 << 16, /* bytes */
    PLY_TOKEN_MAX = 256, /* characters of a number in an ASCII file */
};

struct ply_source {
    FILE *file;
    enum ply_format format;
    uint64_t size; /* bytes of the file */
    uint64_t begin; /* where buffer[0] is in the file */
    size_t at, end; /* the part of the buffer that is not used yet */
    uint64_t line; /* the line that is read, from 1 */
    bool is_bad_value; /* of the last failure: there was something, but it was not a number */
    unsigned char buffer[PLY_BUFFER + 1]; /* buffer[end] is 0 */
};

/* A number: `single` has the very bits of a float in a binary file, even of a NaN. */
struct ply_value {
    double number;
    float single;
};

/* Starts at the beginning of an open file. The source does not close it. */
void ply_source_init(struct ply_source *source, FILE *file, uint64_t size);

/* Returns the place in the file. */
uint64_t ply_source_tell(const struct ply_source *source);

/* Returns how many bytes the file still has. */
uint64_t ply_source_left(const struct ply_source *source);

/* Continues at a place that ply_source_tell returned, in line `line`. */
bool ply_source_seek(struct ply_source *source, uint64_t place, uint64_t line);

/* Returns the next `size` <= PLY_BUFFER bytes, which are valid until the next call. */
const unsigned char *ply_source_take(struct ply_source *source, size_t size);

/* Goes on by `size` bytes. */
bool ply_source_skip(struct ply_source *source, uint64_t size);

/* Returns the next character without taking it, or -1 at the end. */
int ply_source_peek(struct ply_source *source);

/* Reads a number. */
bool ply_source_value(struct ply_source *source, enum ply_type type, struct ply_value *ret_value);

/* Goes on by `count` numbers, which are not checked. */
bool ply_source_skip_values(struct ply_source *source, enum ply_type type, uint64_t count);

/*
 * Ends a row, which in ASCII files has to be the end of a line: false when more values are in the line. Also skips
 * empty lines and comments before the next row.
 */
bool ply_source_end_row(struct ply_source *source);

/* Decodes a value of a binary file. `bytes` has the size of the type. */
struct ply_value ply_value_of(const unsigned char *bytes, enum ply_type type, enum ply_format format);

/* Returns the bytes of a value in a binary file. */
size_t ply_type_size(enum ply_type type);

#endif
