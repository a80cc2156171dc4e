/* SPDX-License-Identifier: Apache-2.0 */
/*
 * ply_file.h - writes PLY files in memory, in each format and with any type, to test readers of them; and samples whose
 * triangles are known.
 */
#ifndef BVHD_PLY_FILE_H
#define BVHD_PLY_FILE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum { PLY_FILE_ROOM = 8192, PLY_FILE_FORMATS = 3, PLY_FILE_SAMPLES = 18 };

struct ply_file {
    unsigned char bytes[PLY_FILE_ROOM];
    size_t size;
    int format; /* 0: ASCII, 1: binary little-endian, 2: binary big-endian */
    const char *line_end; /* "\n" unless changed */
    bool is_in_row; /* ASCII: the line has a number already */
};

/* The answer that a reader has to find in a sample. */
struct ply_expected {
    uint32_t vertices, triangles;
    float min[3], max[3]; /* of all vertices */
    uint64_t points, lines, empty_faces, unknown_rows;
};

/* Begins a file with the lines "ply" and "format". */
void ply_file_begin(struct ply_file *file, int format, const char *line_end);

/* Adds a line of the header, in printf style. */
void ply_file_line(struct ply_file *file, const char *text, ...) __attribute__((format(printf, 2, 3)));

/* Adds a number, whose type has a name as in the header. */
void ply_file_number(struct ply_file *file, const char *type, double number);

/* Adds `count` numbers. */
void ply_file_numbers(struct ply_file *file, const char *type, const double *numbers, int count);

/* Adds a list: its length and its numbers. */
void ply_file_list(struct ply_file *file, const char *count_type, const char *type, const double *numbers, int count);

/* Ends a row of an element. */
void ply_file_end_row(struct ply_file *file);

/* Makes sample `index` < PLY_FILE_SAMPLES. Its format is index % 3. */
void ply_file_sample(uint32_t index, struct ply_file *ret_file, struct ply_expected *ret_expected);

#endif
