/* SPDX-License-Identifier: Apache-2.0 */
/*
 * gltf_case.h - a table of small GLB files, each about one feature or one mistake, with what a reader has to make of
 * it. Expected values are written by hand, not computed by a reader.
 */
#ifndef BVHD_GLTF_CASE_H
#define BVHD_GLTF_CASE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "bvhd/status.h"

/*
 * Texts are JSON with ' in place of ". NULL stands for the default: one scene with one node with one mesh, which is a
 * quad from (0, 0, 0) to (2, 3, 0).
 */
struct gltf_case {
    const char *name;
    const char *primitives; /* of the only mesh */
    const char *accessors, *views; /* more of them, after those that gltf_case.c lists */
    const char *nodes, *scenes, *more; /* `scenes` and `more`: whole members of the file, with commas behind them */
    const char *scene; /* to choose */
    const char *at; /* the moment to read it at, in seconds; NULL: it is read at rest */
    const char *until; /* the end of the shutter interval that begins at that moment; NULL: there is none */
    const char *animation; /* to choose */
    bool is_animated; /* it has the views 23 and following that gltf_case.c lists for animations */
    enum bvhd_status status;
    const char *text; /* of the error: a part of "where: text" */
    uint32_t triangles, instances, bottoms; /* 0: 2, 1 and 1 */
    uint32_t skipped; /* instances */
    float low[3], high[3]; /* over all instances; equal: (0, 0, 0) to (2, 3, 0) */
    float end_low[3], end_high[3]; /* the same at the end of the shutter interval; equal: `low` and `high` */
    uint32_t srts, matrices, moving; /* motions of instances, and meshes of motion triangles */
    float off, vertices_off; /* the greatest distances of instances and of vertices from the animation */
    const char *kind; /* of import_counts.h: the only one that is not 0; NULL: all are */
    uint32_t count;
};

enum { GLTF_CASE_ROOM = 16 * 1024 };

extern const struct gltf_case gltf_cases[];
extern const uint32_t gltf_case_count;

/* Writes the GLB of a case; returns its size. */
size_t gltf_case_make(const struct gltf_case *gltf_case, uint8_t ret_bytes[GLTF_CASE_ROOM]);

/* Writes a GLB from JSON, in which ' stands for ", and from bytes. Returns its size. */
size_t gltf_case_pack(const char *json, const uint8_t *bin, size_t bin_size, uint8_t ret_bytes[GLTF_CASE_ROOM]);

#endif
