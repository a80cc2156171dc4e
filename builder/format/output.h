/* SPDX-License-Identifier: Apache-2.0 */
/* output.h - an alternative source of a blob's memory, for example pages that will be sent to a client. */
#ifndef BVHD_OUTPUT_H
#define BVHD_OUTPUT_H

#include <stdint.h>

/*
 * allocate() returns `size` bytes for the whole blob, 64-byte aligned; NULL fails the build with BVHD_NO_MEMORY. It is
 * called at most once per build, with the final size. discard() takes the bytes back if the build fails afterwards.
 * Both are called on the thread that builds.
 */
struct build_output {
    unsigned char *(*allocate)(struct build_output *self, uint64_t size);
    void (*discard)(struct build_output *self, unsigned char *bytes);
};

#endif
