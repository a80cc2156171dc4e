/* SPDX-License-Identifier: Apache-2.0 */
/* output.h - where the memory of a blob comes from: the heap, or for example pages that will be sent to a client. */
#ifndef BVHD_OUTPUT_H
#define BVHD_OUTPUT_H

#include <stdint.h>

#include "proto/base/memory.h"
#include "proto/base/status.h"

/*
 * allocate() returns `size` bytes for the whole blob, 64-byte aligned; NULL fails the build with BVHD_NO_MEMORY. It is
 * called at most once per build, with the final size. discard() takes the bytes back if the build fails afterwards.
 * Both are called on the thread that builds.
 */
struct build_output {
    unsigned char *(*allocate)(struct build_output *self, uint64_t size);
    void (*discard)(struct build_output *self, unsigned char *bytes);
};

/*
 * Allocates a blob from `output`, or, when that is NULL, from `memory`. NULL: there was none, and the error is set.
 */
unsigned char *output_allocate(struct build_output *output, struct memory *memory, uint64_t size,
                               struct bvhd_error *error);

/* Takes a blob of output_allocate back. NULL is allowed. */
void output_discard(struct build_output *output, struct memory *memory, unsigned char *blob);

#endif
