/* SPDX-License-Identifier: Apache-2.0 */
/*
 * random_input.h - random valid requests and their meaning, which is decoded independently: no code is shared with the
 * builder.
 *
 * Buffers have exactly the size that the request reaches, so that a sanitizer detects a read beyond it. For test
 * programs only: without memory they end.
 */
#ifndef BVHD_RANDOM_INPUT_H
#define BVHD_RANDOM_INPUT_H

#include "proto/base/geometry.h"
#include "tests/support/random.h"

enum { RANDOM_INPUT_GEOMETRIES = 5, RANDOM_INPUT_BUFFERS = 3 * RANDOM_INPUT_GEOMETRIES + 8 };

/* The meaning of one geometry. */
struct random_meaning {
    uint32_t count;
    float (*corners)[3][3]; /* triangles: `count` of them, transformed; NULL for boxes */
    float (*boxes)[6]; /* boxes: `count` of them */
    bool moved; /* the corners were transformed, so that their last bit is uncertain */
};

struct random_kind;
struct random_plan;

struct random_input {
    struct build_input input;
    const struct random_kind *kind; /* of all its geometries */
    struct geometry geometries[RANDOM_INPUT_GEOMETRIES];
    struct random_meaning meanings[RANDOM_INPUT_GEOMETRIES];
    struct random_plan
        *plans[RANDOM_INPUT_GEOMETRIES]; /* how the kind has made them; NULL if nothing is left to know */
    void *buffers[RANDOM_INPUT_BUFFERS];
    uint64_t sizes[RANDOM_INPUT_BUFFERS];
    uint32_t buffer_count;
};

/*
 * Makes a bottom level of triangles or of boxes, with 0 .. `most` primitives in up to five geometries. *ret_input must
 * not be copied.
 */
void random_input_bottom(struct random_input *ret_input, struct random *random, uint32_t most);
/* Does the same, always with triangles. */
void random_input_triangles(struct random_input *ret_input, struct random *random, uint32_t most);
void random_input_finish(struct random_input *input);

/*
 * Moves what was made, as an update may: gives vertices the positions of others, boxes the places of others, and
 * transforms other values. Nearly always each primitive stays active or inactive. The meanings move along. `request` is
 * a struct random_input, whose type random_update.h does not know.
 */
void random_input_move(void *request, struct random *random);

/* Allocates another random block that the input owns. */
void *random_input_buffer(struct random_input *input, uint64_t size);

/* Allocates a block of zeros, which the caller frees. */
void *random_input_zeroed(size_t count, size_t size);

/* Makes random build flags, quality and layout options in a valid combination. */
void random_input_options(struct build_input *input, struct random *random);

/* Returns a whole number in [0, count). */
uint32_t random_below(struct random *random, uint32_t count);
bool random_chance(struct random *random, double probability);

#endif
