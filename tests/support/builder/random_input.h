/* SPDX-License-Identifier: Apache-2.0 */
/*
 * random_input.h - random correct requests, and what they mean by a decoding of their own: nothing here is shared with
 * the builder.
 *
 * Buffers are of exactly the size that the request reaches, so that a read beyond shows under a sanitizer. For test
 * programs only: without memory they end.
 */
#ifndef BVHD_RANDOM_INPUT_H
#define BVHD_RANDOM_INPUT_H

#include "proto/base/geometry.h"
#include "tests/support/random.h"

enum { RANDOM_INPUT_GEOMETRIES = 5, RANDOM_INPUT_BUFFERS = 3 * RANDOM_INPUT_GEOMETRIES + 8 };

/* What a geometry means. */
struct random_meaning {
    uint32_t count;
    float (*corners)[3][3]; /* triangles: `count`, transformed; NULL for boxes */
    float (*boxes)[6]; /* boxes: `count` */
    bool moved; /* corners went through a transform, so their last bit is not sure */
};

struct random_input {
    struct build_input input;
    struct geometry geometries[RANDOM_INPUT_GEOMETRIES];
    struct random_meaning meanings[RANDOM_INPUT_GEOMETRIES];
    void *buffers[RANDOM_INPUT_BUFFERS];
    uint64_t sizes[RANDOM_INPUT_BUFFERS];
    uint32_t buffer_count;
};

/*
 * A bottom level of triangles or of boxes, 0 .. `most` primitives in up to five geometries. *ret_input must not be
 * copied.
 */
void random_input_bottom(struct random_input *ret_input, struct random *random, uint32_t most);
/* Likewise, with triangles for certain. */
void random_input_triangles(struct random_input *ret_input, struct random *random, uint32_t most);
void random_input_finish(struct random_input *input);

/* Another random block of the input's own. */
void *random_input_buffer(struct random_input *input, uint64_t size);

/* Random build flags, quality and layout options that are allowed together. */
void random_input_options(struct build_input *input, struct random *random);

/* A whole number in [0, count). */
uint32_t random_below(struct random *random, uint32_t count);
bool random_chance(struct random *random, double probability);

#endif
