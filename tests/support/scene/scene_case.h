/* SPDX-License-Identifier: Apache-2.0 */
/*
 * scene_case.h - a table of generated scene files of all formats, each about one feature or one mistake, with what a
 * reader has to make of it. Expected values are written by hand, or follow from how a file is generated; no reader
 * computes them.
 */
#ifndef BVHD_SCENE_CASE_H
#define BVHD_SCENE_CASE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "bvhd/status.h"
#include "client/bvhctl/scene/import_counts.h"

enum { SCENE_CASE_ROOM = 16 * 1024 };

/* The contents that a reader has to find in a file that can be built. */
struct scene_expected {
    uint32_t triangles, instances;
    uint32_t skipped; /* instances */
    float low[3], high[3]; /* of all instances, in world space */
    bool has_spare_vertices; /* the bounds are those of all vertices, also of those without a triangle */
    bool may_lose; /* assimp may not cut all polygons: triangles that are missing are counted as lost */
    struct import_counts counts; /* of everything that is left out */
};

struct scene_case {
    const char *format; /* "glTF", "PLY" or another one that assimp reads */
    char name[80]; /* what it is about */
    char file[40]; /* the name of the file */
    uint8_t bytes[SCENE_CASE_ROOM];
    size_t size;
    const char *second; /* a second file that the first one names; NULL: there is none */
    const char *second_bytes;
    size_t second_size;
    const char *scene; /* to choose; NULL: all */
    const char *at; /* the moment to read it at, in seconds; NULL: it is read at rest */
    const char *until; /* the end of the shutter interval that begins at that moment; NULL: there is none */
    const char *animation; /* to choose; NULL: the first */
    bool is_endless; /* it is refused for the time that it takes, which is seconds under sanitizers */
    enum bvhd_status status; /* if it is not BVHD_OK, the file is refused: */
    const char *text; /* with this as a part of "where: text" */
    struct scene_expected expected;
};

uint32_t scene_case_count(void);

/* Makes case `index`. */
void scene_case_make(uint32_t index, struct scene_case *ret_case);

/*
 * Makes the file of case `index` among those of one format, of those that need no second file. Returns its size, or 0
 * when there are no more.
 */
size_t scene_case_sample(const char *format, uint32_t index, uint8_t ret_bytes[SCENE_CASE_ROOM]);

/* A case that is a text; the table is in scene_case_table.c. */
struct scene_text {
    const char *format, *name, *file;
    const char *text; /* of a .gltf: with ' for " */
    size_t size; /* 0: the text ends with its 0 */
    const char *second, *second_bytes;
    size_t second_size;
    enum bvhd_status status;
    const char *error;
    uint32_t triangles, instances; /* 0 instances: 1 */
    float low[3], high[3];
    bool may_lose, is_endless;
    struct import_counts counts;
};

extern const struct scene_text scene_texts[];
extern const uint32_t scene_text_count;

#endif
