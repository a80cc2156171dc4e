/* SPDX-License-Identifier: Apache-2.0 */
/* broken_input.h - a random request in which something is wrong, or was meant to be. For test programs only. */
#ifndef BVHD_BROKEN_INPUT_H
#define BVHD_BROKEN_INPUT_H

#include "tests/support/builder/random_input.h"

enum { BROKEN_RECORDS = 6, BROKEN_REFERENCES = 3 };

struct broken_input {
    struct build_input input;
    struct random_input base; /* whose geometries are broken in place */
    struct reference references[BROKEN_REFERENCES];
    char what[96]; /* which fields */
};

/*
 * One to three fields of a small bottom or top level. *ret_broken must not be copied. Memory that is named is there,
 * unless its size says less.
 */
void broken_input_init(struct broken_input *ret_broken, struct random *random);
void broken_input_finish(struct broken_input *broken);

#endif
