/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/support/scene/ply_file.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static void put(struct ply_file *file, const void *data, size_t size)
{
    if (size > sizeof file->bytes - file->size)
        abort();
    memcpy(file->bytes + file->size, data, size);
    file->size += size;
}

static void put_text(struct ply_file *file, const char *text)
{
    put(file, text, strlen(text));
}

void ply_file_line(struct ply_file *file, const char *text, ...)
{
    char line[256];
    va_list arguments;
    va_start(arguments, text);
    vsnprintf(line, sizeof line, text, arguments);
    va_end(arguments);
    put_text(file, line);
    put_text(file, file->line_end);
}

void ply_file_begin(struct ply_file *file, int format, const char *line_end)
{
    static const char *const names[] = {"ascii", "binary_little_endian", "binary_big_endian"};
    file->size = 0;
    file->format = format;
    file->line_end = line_end;
    file->is_in_row = false;
    ply_file_line(file, "ply");
    ply_file_line(file, "format %s 1.0", names[format]);
}

/* Puts the low `size` bytes of a number. */
static void put_bits(struct ply_file *file, uint64_t bits, int size)
{
    for (int i = 0; i < size; i++) {
        unsigned char byte = (unsigned char)(bits >> 8 * (file->format == 1 ? i : size - 1 - i));
        put(file, &byte, 1);
    }
}

static int integer_size(const char *type)
{
    if (!strcmp(type, "char") || !strcmp(type, "uchar") || !strcmp(type, "int8") || !strcmp(type, "uint8"))
        return 1;
    if (!strcmp(type, "short") || !strcmp(type, "ushort") || !strcmp(type, "int16") || !strcmp(type, "uint16"))
        return 2;
    return !strcmp(type, "int64") || !strcmp(type, "uint64") ? 8 : 4;
}

void ply_file_number(struct ply_file *file, const char *type, double number)
{
    char text[64];
    float single = (float)number;
    uint32_t bits32;
    uint64_t bits64;
    memcpy(&bits32, &single, sizeof bits32);
    memcpy(&bits64, &number, sizeof bits64);
    if (file->format == 0) {
        snprintf(text, sizeof text, "%s%.17g", file->is_in_row ? " " : "", number);
        put_text(file, text);
        file->is_in_row = true;
    } else if (!strncmp(type, "float", 5) && strcmp(type, "float64") != 0) {
        put_bits(file, bits32, 4);
    } else if (!strcmp(type, "double") || !strcmp(type, "float64")) {
        put_bits(file, bits64, 8);
    } else {
        put_bits(file, (uint64_t)(int64_t)number, integer_size(type));
    }
}

void ply_file_numbers(struct ply_file *file, const char *type, const double *numbers, int count)
{
    for (int i = 0; i < count; i++)
        ply_file_number(file, type, numbers[i]);
}

void ply_file_list(struct ply_file *file, const char *count_type, const char *type, const double *numbers, int count)
{
    ply_file_number(file, count_type, count);
    ply_file_numbers(file, type, numbers, count);
}

void ply_file_end_row(struct ply_file *file)
{
    if (file->format == 0)
        put_text(file, file->line_end);
    file->is_in_row = false;
}

/* The vertices of all samples: a cube's, and some around it. */
enum { VERTICES = 12 };

static const double vertices[VERTICES][3] = {{0, 0, 0}, {2, 0, 0}, {2, 2, 0}, {0, 2, 0}, {0, 0, 2}, {2, 0, 2},
                                             {2, 2, 2}, {0, 2, 2}, {1, 1, 0}, {5, 1, 0}, {1, 6, 0}, {-3, -4, -7}};

static const struct ply_expected all_vertices = {.vertices = VERTICES, .min = {-3, -4, -7}, .max = {5, 6, 2}};

static void put_vertices(struct ply_file *file, const char *type)
{
    for (int i = 0; i < VERTICES; i++) {
        ply_file_numbers(file, type, vertices[i], 3);
        ply_file_end_row(file);
    }
}

static void declare_vertices(struct ply_file *file, const char *type)
{
    ply_file_line(file, "element vertex %d", VERTICES);
    for (const char *axis = "xyz"; *axis; axis++)
        ply_file_line(file, "property %s %c", type, *axis);
}

static void put_face(struct ply_file *file, const char *count_type, const char *type, const double *corners, int count)
{
    ply_file_list(file, count_type, type, corners, count);
    ply_file_end_row(file);
}

/* Triangles as most files have them. */
static void make_plain(struct ply_file *file, struct ply_expected *expected)
{
    static const double faces[3][3] = {{0, 1, 2}, {0, 2, 3}, {4, 5, 11}};
    declare_vertices(file, "float");
    ply_file_line(file, "element face 3");
    ply_file_line(file, "property list uchar int vertex_indices");
    ply_file_line(file, "end_header");
    put_vertices(file, "float");
    for (int i = 0; i < 3; i++)
        put_face(file, "uchar", "int", faces[i], 3);
    expected->triangles = 3;
}

/* Polygons, before their vertices, which are doubles: a convex quad, a concave quad, a pentagon, a concave octagon. */
static void make_polygons(struct ply_file *file, struct ply_expected *expected)
{
    static const double quad[] = {0, 1, 2, 3}, dart[] = {1, 2, 3, 8}, pentagon[] = {0, 1, 9, 10, 3},
                        octagon[] = {0, 1, 9, 8, 10, 3, 7, 4};
    ply_file_line(file, "element face 4");
    ply_file_line(file, "property uint8 red");
    ply_file_line(file, "property list uint16 uint32 vertex_index");
    declare_vertices(file, "double");
    ply_file_line(file, "end_header");
    const struct {
        const double *corners;
        int count;
    } faces[] = {{quad, 4}, {dart, 4}, {pentagon, 5}, {octagon, 8}};
    for (int i = 0; i < 4; i++) {
        ply_file_number(file, "uint8", 200);
        put_face(file, "uint16", "uint32", faces[i].corners, faces[i].count);
    }
    put_vertices(file, "double");
    expected->triangles = 2 + 2 + 3 + 6;
}

/* Elements and properties that a reader has to skip, and coordinates in another order and of another type. */
static void make_crowded(struct ply_file *file, struct ply_expected *expected)
{
    static const double face[] = {9, 10, 11}, weights[] = {0.5, 0.25, 0.125};
    ply_file_line(file, "comment made by a test");
    ply_file_line(file, "obj_info num_cols 512");
    ply_file_line(file, "element camera 1");
    ply_file_line(file, "property list uchar float view");
    ply_file_line(file, "property double focus");
    ply_file_line(file, "element vertex %d", VERTICES);
    ply_file_line(file, "property short z");
    ply_file_line(file, "property list uchar float weights");
    ply_file_line(file, "property short x");
    ply_file_line(file, "property int16 y");
    ply_file_line(file, "element edge 2");
    ply_file_line(file, "property int vertex1");
    ply_file_line(file, "property int vertex2");
    ply_file_line(file, "element face 1");
    ply_file_line(file, "property list char ushort vertex_indices");
    ply_file_line(file, "property list uchar float texcoord");
    ply_file_line(file, "end_header");
    ply_file_list(file, "uchar", "float", weights, 3);
    ply_file_number(file, "double", 35);
    ply_file_end_row(file);
    for (int i = 0; i < VERTICES; i++) {
        ply_file_number(file, "short", vertices[i][2]);
        ply_file_list(file, "uchar", "float", weights, i % 4);
        ply_file_number(file, "short", vertices[i][0]);
        ply_file_number(file, "short", vertices[i][1]);
        ply_file_end_row(file);
    }
    for (int i = 0; i < 2; i++) {
        ply_file_numbers(file, "int", face, 2);
        ply_file_end_row(file);
    }
    ply_file_list(file, "char", "ushort", face, 3);
    ply_file_list(file, "uchar", "float", weights, 2);
    ply_file_end_row(file);
    expected->triangles = 1;
    expected->unknown_rows = 3;
}

static void make_strips(struct ply_file *file, struct ply_expected *expected)
{
    static const double strips[] = {0, 1, 2, 3, 4, -1, 5, 6, -1, 7, 8, 9, -1, -1, 10};
    declare_vertices(file, "float64");
    ply_file_line(file, "element tristrips 2");
    ply_file_line(file, "property list int int vertex_indices");
    ply_file_line(file, "end_header");
    put_vertices(file, "float64");
    put_face(file, "int", "int", strips, 0);
    put_face(file, "int", "int", strips, 15);
    expected->triangles = 4;
    expected->lines = 1;
    expected->points = 1;
    expected->empty_faces = 1;
}

/* Faces that are no triangles, beside one. */
static void make_scraps(struct ply_file *file, struct ply_expected *expected)
{
    static const double corners[] = {2, 5, 8};
    declare_vertices(file, "int8");
    ply_file_line(file, "element face 7");
    ply_file_line(file, "property list uint8 int8 vertex_indices");
    ply_file_line(file, "end_header");
    put_vertices(file, "int8");
    for (int i = 0; i < 7; i++)
        put_face(file, "uint8", "int8", corners, i == 6 ? 3 : i / 2);
    expected->triangles = 1;
    expected->empty_faces = expected->points = expected->lines = 2;
}

/* Lines that end as on other systems, strips and faces in one file, and an element without rows or properties. */
static void make_mixed(struct ply_file *file, struct ply_expected *expected)
{
    static const double face[] = {0, 5, 6}, strip[] = {8, 9, 10, 11};
    declare_vertices(file, "int32");
    ply_file_line(file, "element nothing 0");
    ply_file_line(file, "property float x");
    ply_file_line(file, "element empty 1000000000");
    ply_file_line(file, "element tristrips 1");
    ply_file_line(file, "property list uint uint vertex_indices");
    ply_file_line(file, "element face 1");
    ply_file_line(file, "property list ushort float vertex_indices");
    ply_file_line(file, "end_header");
    put_vertices(file, "int32");
    put_face(file, "uint", "uint", strip, 4);
    put_face(file, "ushort", "float", face, 3);
    expected->triangles = 3;
    expected->unknown_rows = 1000000000;
}

void ply_file_sample(uint32_t index, struct ply_file *ret_file, struct ply_expected *ret_expected)
{
    static void (*const makers[])(struct ply_file *, struct ply_expected *) = {make_plain,  make_polygons, make_crowded,
                                                                               make_strips, make_scraps,   make_mixed};
    static const char *const line_ends[] = {"\n", "\n", "\r\n", "\n", "\r", "\r\n"};
    uint32_t maker = index / PLY_FILE_FORMATS;
    *ret_expected = all_vertices;
    ply_file_begin(ret_file, (int)(index % PLY_FILE_FORMATS), line_ends[maker]);
    makers[maker](ret_file, ret_expected);
}
