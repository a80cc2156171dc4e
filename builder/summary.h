/* SPDX-License-Identifier: Apache-2.0 */
/*
 * summary.h - makes the summary of a structure that was built (proto/base/summary.h), and its fixed form in the cache
 * on disk (builder/store/store.h).
 *
 * In that form it has SUMMARY_SIZE bytes, little-endian and without gaps. It has no version of its own: a change needs
 * another generation (builder/store/generation.h). Updates are not kept on disk, so their fields have no place there.
 */
#ifndef BVHD_SUMMARY_H
#define BVHD_SUMMARY_H

#include "builder/build.h"
#include "proto/base/summary.h"

enum { SUMMARY_SIZE = 200 };

/* Returns the summary of a structure of that layout. What `stats` does not tell is 0; the caller adds it. */
struct summary summary_of(const struct build_stats *stats, enum target target);

/* Writes the summary of a build, whose method exists; an update's has no form on disk. */
void summary_write(const struct summary *summary, unsigned char ret_bytes[SUMMARY_SIZE]);

/*
 * Reads a summary. The bytes may come from anywhere. BVHD_CORRUPT, with the field, for another number of bytes, and for
 * a target, quality or method that does not exist.
 */
enum bvhd_status summary_read(struct bytes bytes, struct summary *ret_summary, struct bvhd_error *error);

#endif
