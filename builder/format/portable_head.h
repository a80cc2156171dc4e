/* SPDX-License-Identifier: Apache-2.0 */
/*
 * portable_head.h - writes what comes before the body of a portable structure, and tells how large its parts are, for
 * builds and refits alike.
 */
#ifndef BVHD_PORTABLE_HEAD_H
#define BVHD_PORTABLE_HEAD_H

#include "builder/format/layout.h"
#include "builder/format/portable.h"

/* Returns the number of handles: a top level has one for each row of its table of references. */
uint32_t portable_head_handles(const struct portable_header *header, const struct canonical *canonical);

/* Returns the offset of the body in a blob that has this header and this number of handles. */
uint64_t portable_head_body(const struct portable_header *header, uint32_t handles);

/*
 * Writes the serialized header, the handles or the addresses of micromaps, and zeros up to the body. Number i of either
 * is i + 1, as in the references of a canonical copy, until a loader replaces it by the device's own.
 */
void portable_head_write(unsigned char *blob, const struct portable_header *header, uint32_t handles);

/* Returns the sizes of a blob's sections; its total is the size of the blob. */
struct layout_sizes portable_head_sizes(const struct portable_header *header, uint32_t handles);

#endif
