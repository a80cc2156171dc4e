/* SPDX-License-Identifier: Apache-2.0 */
/*
 * summary.h - what is known about a structure beside its bytes, in the fixed form in which the cache on disk keeps it
 * (builder/store/store.h).
 *
 * A summary has SUMMARY_SIZE bytes, little-endian and without gaps. It has no version of its own: a change of its form
 * needs another generation (builder/store/generation.h). The times of stages and the sizes of sections are not kept.
 */
#ifndef BVHD_SUMMARY_H
#define BVHD_SUMMARY_H

#include "builder/build.h"

enum { SUMMARY_SIZE = 200 };

struct summary {
    enum target target; /* the layout of the bytes */
    struct build_stats stats; /* after summary_read, all of `ms` is 0, and so is all of `sizes` but the total */
    double build_ms; /* the duration of the build */
    uint64_t peak_bytes; /* the most memory that the build took at a time */
};

void summary_write(const struct summary *summary, unsigned char ret_bytes[SUMMARY_SIZE]);

/*
 * Reads the summary of a structure of `size` bytes. The bytes may come from anywhere. BVHD_CORRUPT, with the field, for
 * another number of bytes, and for a target, quality or method that does not exist.
 */
enum bvhd_status summary_read(struct bytes bytes, uint64_t size, struct summary *ret_summary, struct bvhd_error *error);

#endif
