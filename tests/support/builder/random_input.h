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

#include "client/bvhctl/oracle/oracle.h"
#include "proto/base/geometry.h"
#include "tests/support/random.h"

enum { RANDOM_INPUT_GEOMETRIES = 5, RANDOM_INPUT_BUFFERS = 4 * RANDOM_INPUT_GEOMETRIES + 8 };

/*
 * Which kinds of geometry requests have: triangles and boxes, spheres and linear swept spheres, what moves (motion
 * triangles, and motion instances over all kinds), or all of them.
 */
enum random_choice { RANDOM_FLAT, RANDOM_ROUND, RANDOM_MOTION, RANDOM_ALL };

const char *random_choice_name(enum random_choice choice);
/* Returns false if there is none of this name. */
bool random_choice_from_name(const char *name, enum random_choice *ret_choice);

/* The meaning of one geometry: `count` primitives. */
struct random_meaning {
    uint32_t count;
    enum oracle_shape shape; /* of all but boxes */
    float (*corners)[3][3]; /* triangles, transformed; NULL for other kinds */
    float (*end_corners)[3][3]; /* motion triangles: at time 1, while `corners` are at time 0; NULL for other kinds */
    float (*boxes)[6]; /* boxes; NULL for other kinds */
    /* spheres, and two ends for each linear swept sphere, which has ORACLE_CAP_ bits; NULL for other kinds */
    float (*centres)[3];
    float *radii;
    uint8_t *caps;
    bool moved; /* the corners were computed with, so that their last bit is uncertain */
};

struct random_kind;
struct random_plan;

struct random_input {
    struct build_input input;
    bool is_calm; /* its sizes differ little, as in requests of all kinds */
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
 * Makes a bottom level of one of these kinds, with 0 .. `most` primitives in up to five geometries. *ret_input must not
 * be copied.
 */
void random_input_bottom_of(struct random_input *ret_input, struct random *random, uint32_t most,
                            enum random_choice choice);
/* Does the same, with flat kinds. */
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

/*
 * Makes the mesh that the oracle knows of a geometry, which must not be of boxes. It lives as long as the meaning, and
 * is in no instance.
 */
struct oracle_mesh random_input_mesh(const struct random_input *input, uint32_t geometry);

/* Returns whether a geometry moves: the flag MOTION alone is no motion. */
bool random_input_moves(const struct random_input *input);

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
