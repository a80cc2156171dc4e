/* SPDX-License-Identifier: Apache-2.0 */
/*
 * fuzz.h - the interface of a fuzz target: one function that takes any bytes, and samples to start from. README.md says
 * how targets are run.
 */
#ifndef BVHD_FUZZ_H
#define BVHD_FUZZ_H

#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>

enum { FUZZ_ROOM = 16 * 1024 }; /* bytes of a sample */

/*
 * Runs the target on one input; libFuzzer prescribes the name. Ends the process when something is wrong, and returns 0
 * otherwise.
 */
int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

/* Makes sample number `index`, of at most FUZZ_ROOM bytes. Returns its size, or 0 when there are no more samples. */
size_t fuzz_sample(uint32_t index, uint8_t *ret_bytes);

/* Ends the process unless the condition holds, in every kind of build. */
#define FUZZ_CHECK(condition)                                                                                          \
    do {                                                                                                               \
        if (!(condition)) {                                                                                            \
            fprintf(stderr, "%s:%d: does not hold: %s\n", __FILE__, __LINE__, #condition);                             \
            abort();                                                                                                   \
        }                                                                                                              \
    } while (0)

#endif
