/* SPDX-License-Identifier: Apache-2.0 */
/* gltf_round.h - the points and lines of the primitives of glTF, and their radii. */
#ifndef BVHCTL_GLTF_ROUND_H
#define BVHCTL_GLTF_ROUND_H

#include "client/bvhctl/scene/gltf_json.h"

/* The modes of primitives, as in the file. */
enum gltf_mode {
    GLTF_POINTS,
    GLTF_LINES,
    GLTF_LINE_LOOP,
    GLTF_LINE_STRIP,
    GLTF_TRIANGLE_LIST,
    GLTF_TRIANGLE_STRIP,
    GLTF_TRIANGLE_FAN
};

/* Returns how many points or lines a primitive of so many corners draws. */
uint32_t gltf_round_count(enum gltf_mode mode, uint32_t corners);

/*
 * Makes the indices of points or lines: one or two a primitive. `corners` are the vertices of the corners; NULL: corner
 * i is vertex i.
 */
void gltf_round_place(enum gltf_mode mode, const uint32_t *corners, uint32_t corner_count, uint32_t *ret_indices);

/*
 * Reads the radii of mesh->vertex_count vertices to mesh->radii: the attribute _RADIUS, else half of _WIDTH, else
 * `fallback` for all. Radii that are not finite or are negative are refused.
 */
enum bvhd_status gltf_round_read_radii(struct gltf_file *file, const struct gltf_value *primitive, float fallback,
                                       struct import_mesh *mesh);

#endif
