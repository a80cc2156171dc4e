/* SPDX-License-Identifier: Apache-2.0 */
/*
 * import_counts.h - numbers of things in a scene file that are left out, or not as they should be, by kind. Each kind
 * has a name for JSON and a text for messages.
 */
#ifndef BVHCTL_IMPORT_COUNTS_H
#define BVHCTL_IMPORT_COUNTS_H

#include <stdbool.h>
#include <stdint.h>

struct import_counts {
    uint64_t points, lines; /* faces with one or two corners */
    uint64_t skins, morphs; /* meshes with bones, morph targets */
    uint64_t animations; /* the scene is built as it is without them */
    uint64_t channels; /* of the animation that is read, for properties that only extensions know */
    uint64_t incomplete; /* lists, strips and fans whose last corners make no triangle, or no line */
    uint64_t positionless; /* primitives without positions */
    uint64_t meshes; /* that no node has */
    uint64_t nodes; /* with a mesh, but in no scene */
    uint64_t scenes; /* that the reader of the file does not read */
    uint64_t extensions; /* that are used and not known */
    uint64_t bounds; /* arrays of positions that do not have the bounds which the file says */
    uint64_t empty_faces; /* faces without a corner */
    uint64_t fanned; /* polygons that cross themselves: a part of them is a fan, whose triangles may overlap */
    uint64_t lost; /* triangles that assimp did not make of polygons: sum of (corners - 2), less those that it made */
    uint64_t unknown_rows; /* rows of elements of a PLY file that are neither vertices nor faces */
    uint64_t unknown_lines; /* lines of the header of a PLY file that are not understood */
    uint64_t unknown_chunks; /* of a GLB, that are neither JSON nor the first BIN */
    uint64_t unmoved; /* meshes of points or lines whose vertices move in the shutter interval */
    uint64_t extra_bytes; /* after the rows that the header of a PLY file describes, or after the length of a GLB */
};

enum { IMPORT_COUNT_KINDS = 21 };

/* Kinds 0 to 3 are points, lines, skins and morphs. */
struct import_count_kind {
    const char *name; /* of the member of struct import_counts */
    const char *one, *many; /* follows the number in a message: 1, or more */
    const char *option; /* of bvhctl build, by which it is read; NULL: there is none */
};

extern const struct import_count_kind import_count_kinds[IMPORT_COUNT_KINDS];

uint64_t import_counts_get(const struct import_counts *counts, int kind);

bool import_counts_any(const struct import_counts *counts);

/* Adds the numbers that meshes have: of faces, primitives, positions, bones and morph targets. */
void import_counts_add_mesh(struct import_counts *sum, const struct import_counts *mesh);

#endif
