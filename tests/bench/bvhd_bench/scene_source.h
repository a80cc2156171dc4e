/* SPDX-License-Identifier: Apache-2.0 */
/*
 * scene_source.h - opens meshes from files, and generated ones by name: scenes on which builders and traversals fail,
 * and scenes like those that people make.
 */
#ifndef BVHD_BENCH_SCENE_SOURCE_H
#define BVHD_BENCH_SCENE_SOURCE_H

#include <stdbool.h>

#include "tests/support/scene/ply.h"

struct scene_source {
    const char *name;
    const char *shows; /* what goes wrong with the scene, or what it is, in a few words */
    bool is_hard; /* something goes wrong with it in some methods */
};

/* Returns the table of generated scenes. It lives as long as the program. */
const struct scene_source *scene_source_all(uint32_t *ret_count);

/*
 * Opens the generated scene of that name with about `size` triangles, or else a file. NAME@SEED and NAME@SEED@SIZE
 * override `seed` and `size`. The caller frees the result with ply_free. Returns NULL, with a line on stderr, when
 * there is neither a scene nor a file of that name.
 */
struct ply *scene_source_open(const char *name, uint32_t size, uint64_t seed);

#endif
