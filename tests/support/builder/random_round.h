/* SPDX-License-Identifier: Apache-2.0 */
/*
 * random_round.h - what random spheres and random linear swept spheres have in common: arrays of centres, radii and
 * indices. For test programs only.
 */
#ifndef BVHD_RANDOM_ROUND_H
#define BVHD_RANDOM_ROUND_H

#include "tests/support/builder/random_kind.h"

/* How indices name the vertices of primitives. */
enum random_naming {
    RANDOM_EVERY, /* without indices: all vertices in order */
    RANDOM_LIST, /* one index for each vertex of a primitive */
    RANDOM_SUCCESSIVE, /* one index for two vertices, of which the second is the next one */
};

/* What a kind of round primitives says about one geometry. */
struct random_round {
    uint32_t count; /* primitives */
    uint32_t per_primitive; /* vertices */
    enum random_naming naming;
    bool has_caps; /* at the ends of chains */
};

/*
 * Makes the arrays of a geometry, whose type has been set, and its meaning: clouds and chains at any magnitude, some of
 * them with radii of 0 and 1e30, spheres inside their neighbours, cones that are almost flat, and values that are no
 * numbers.
 */
void random_round_make(struct random_input *input, uint32_t index, const struct random_round *round,
                       struct random *random);

/* The functions of struct random_kind. */
void random_round_move(struct random_input *input, uint32_t index, struct random *random);
struct random_fields random_round_fields(struct geometry *geometry);
void random_round_blank(struct geometry *geometry, struct bytes bytes);

#endif
