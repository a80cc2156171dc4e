/* SPDX-License-Identifier: Apache-2.0 */
/*
 * output.h - where the bytes of a blob come from when they are not to come from memory: pages that will be sent, for
 * instance.
 */
#ifndef BVHD_OUTPUT_H
#define BVHD_OUTPUT_H

#include <stdint.h>

/*
 * allocate() gives `size` bytes for the whole blob, 64-byte aligned; NULL fails the build with BVHD_NO_MEMORY. It is
 * called at most once a build, with the final size. discard() takes the bytes back when the build fails afterwards.
 * Both are called from the thread that builds.
 */
struct build_output {
    unsigned char *(*allocate)(struct build_output *self, uint64_t size);
    void (*discard)(struct build_output *self, unsigned char *bytes);
};

#endif
