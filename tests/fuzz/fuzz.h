/* SPDX-License-Identifier: Apache-2.0 */
/*
 * fuzz.h - what a fuzz target is: one function that takes any bytes, and samples to start from. README.md says how they
 * are run.
 */
#ifndef BVHD_FUZZ_H
#define BVHD_FUZZ_H

#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>

enum { FUZZ_ROOM = 16 * 1024 }; /* of a sample */

/* libFuzzer's name. Ends the process when something is wrong, returns 0 otherwise. */
int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

/* Sample number `index`, of at most FUZZ_ROOM bytes; 0 when there are no more. */
size_t fuzz_sample(uint32_t index, uint8_t *ret_bytes);

/* What must hold, in every build. */
#define FUZZ_CHECK(condition)                                                                                          \
    do {                                                                                                               \
        if (!(condition)) {                                                                                            \
            fprintf(stderr, "%s:%d: does not hold: %s\n", __FILE__, __LINE__, #condition);                             \
            abort();                                                                                                   \
        }                                                                                                              \
    } while (0)

#endif
