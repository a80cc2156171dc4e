/* SPDX-License-Identifier: Apache-2.0 */
/*
 * glb.h - writes a GLB with an animation: the lists of its JSON that follow from its arrays, and the arrays. The caller
 * writes the other members to `json`, each with a comma behind it.
 *
 * For test programs only: without memory, they print a message and end.
 */
#ifndef BVHD_GLB_H
#define BVHD_GLB_H

#include <stdio.h>

#include "tests/support/scene/mesh.h"

enum { GLB_LISTS = 6 };
enum glb_component { GLB_UINT8 = 5121, GLB_UINT32 = 5125, GLB_FLOAT = 5126 };

struct glb {
    FILE *json, *bin, *views, *accessors, *channels, *samplers;
    char *texts[GLB_LISTS]; /* of these, in their order */
    size_t sizes[GLB_LISTS];
    int accessor_count, sampler_count;
};

void glb_init(struct glb *glb);

/* Appends an array, as a view and an accessor. Returns the number of the accessor. */
int glb_put(struct glb *glb, const void *data, size_t size, enum glb_component component, uint64_t count,
            const char *type);
int glb_put_positions(struct glb *glb, const struct mesh *mesh);
int glb_put_indices(struct glb *glb, const struct mesh *mesh);

/* Appends a channel with a sampler of its own, whose times and values are accessors. */
void glb_put_channel(struct glb *glb, int node, const char *path, const char *interpolation, int times, int values);

/* Writes the file, with an animation of all channels, and frees everything. Returns 0, or -1 with errno set. */
int glb_write(struct glb *glb, const char *animation, const char *path);

#endif
