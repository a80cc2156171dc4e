/* SPDX-License-Identifier: Apache-2.0 */
/*
 * scene_source.h - meshes from files, and generated ones by name: those at which builders and traversals fail, and such
 * as people have.
 */
#ifndef BVHD_BENCH_SCENE_SOURCE_H
#define BVHD_BENCH_SCENE_SOURCE_H

#include <stdbool.h>

#include "tests/support/scene/ply.h"

struct scene_source {
    const char *name;
    const char *shows; /* what goes wrong with it, or what it is, a few words */
    bool is_hard; /* something goes wrong with it */
};

/* Generated ones. The table lives as long as the program. */
const struct scene_source *scene_source_all(uint32_t *ret_count);

/*
 * A generated scene of that name, of about `size` triangles (NAME@SEED, NAME@SEED@SIZE: of others), or else a file;
 * freed with ply_free. NULL, and a line on stderr, when there is neither.
 */
struct ply *scene_source_open(const char *name, uint32_t size, uint64_t seed);

#endif
