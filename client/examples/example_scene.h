/* SPDX-License-Identifier: Apache-2.0 */
/*
 * example_scene.h - a small scene that the service builds: a square, a triangle, and a top level over two instances of
 * each.
 */
#ifndef EXAMPLE_SCENE_H
#define EXAMPLE_SCENE_H

#include <bvhd/bvhd.h>

enum { EXAMPLE_BOTTOMS = 2, EXAMPLE_BLOBS = EXAMPLE_BOTTOMS + 1 };

/* The scene's structures, as the service has built them. */
struct example_build {
    struct bvhd_client *client;
    struct bvhd_batch *bottoms, *top;
    const struct bvhd_result *results[EXAMPLE_BLOBS]; /* the rows of the top level, followed by the top level itself */
};

/*
 * Builds the scene and waits. `format` is NULL for the portable target. Failures end the program. The results live
 * until example_build_end.
 */
void example_build(struct example_build *build, const struct bvhd_format *format);
void example_build_end(struct example_build *build);

/* Ends the program unless the status is BVHD_OK. */
void example_must(enum bvhd_status status, const struct bvhd_error *error);

#endif
