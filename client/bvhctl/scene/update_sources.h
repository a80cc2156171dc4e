/* SPDX-License-Identifier: Apache-2.0 */
/*
 * update_sources.h - the keys of the structures that an update starts from: those of a manifest at first, and then
 * those of the frame before.
 */
#ifndef BVHCTL_UPDATE_SOURCES_H
#define BVHCTL_UPDATE_SOURCES_H

#include "client/bvhctl/scene/manifest.h"

struct update_sources {
    struct assembly_source *items; /* one for each bottom level of the scene, and then one for the top level */
    struct assembly_source *aligned; /* those of update_sources_align */
    uint32_t bottom_count;
    struct memory *memory;
};

void update_sources_init(struct update_sources *sources, struct memory *memory);

/* Accepts zeroed sources. */
void update_sources_finish(struct update_sources *sources);

/*
 * Finds the structures of a built scene, whose only top level the manifest lists: the bottom levels in their order, or
 * by the nodes where equal ones share a file. `path` is that of the manifest's directory or container. BVHD_INVALID if
 * it was built from a scene with other bottom levels.
 */
enum bvhd_status update_sources_find(struct update_sources *sources, const struct manifest *manifest, const char *path,
                                     const struct import *import, struct bvhd_error *error);

/*
 * Fills `aligned`: bottom levels with one file name get one source, because equal files have equal keys only if they
 * have equal sources. BVHD_INVALID if the import has another number of bottom levels than the first one.
 */
enum bvhd_status update_sources_align(struct update_sources *sources, const struct import *import,
                                      const struct file_names *names, struct bvhd_error *error);

/* Makes what an assembly has built the sources of the next one. A structure that failed keeps the one it had. */
void update_sources_take(struct update_sources *sources, const struct assembly *assembly);

#endif
