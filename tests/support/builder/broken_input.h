/* SPDX-License-Identifier: Apache-2.0 */
/*
 * broken_input.h - a random request in which fields are broken. A change can by chance be valid. For test programs
 * only.
 */
#ifndef BVHD_BROKEN_INPUT_H
#define BVHD_BROKEN_INPUT_H

#include "tests/support/builder/random_input.h"

enum { BROKEN_RECORDS = 6, BROKEN_REFERENCES = 3 };

struct broken_input {
    struct build_input input;
    struct random_input base; /* its geometries are broken in place */
    enum random_choice choice; /* of kinds */
    struct reference references[BROKEN_REFERENCES];
    char what[96]; /* which fields were changed */
};

/*
 * Makes a small bottom level of these kinds, or a top level, and breaks one to three fields. *ret_broken must not be
 * copied. All memory that the request names exists, unless its size states less.
 */
void broken_input_init(struct broken_input *ret_broken, struct random *random, enum random_choice choice);
void broken_input_finish(struct broken_input *broken);

#endif
