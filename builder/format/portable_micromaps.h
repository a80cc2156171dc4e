/* SPDX-License-Identifier: Apache-2.0 */
/*
 * portable_micromaps.h - the last section of a bottom level with micromaps: the micromaps that its triangles name, and
 * an index for each primitive (struct portable_micromap). For builds and refits alike.
 */
#ifndef BVHD_PORTABLE_MICROMAPS_H
#define BVHD_PORTABLE_MICROMAPS_H

#include "builder/format/canonical.h"
#include "builder/format/portable.h"

/* Sets the numbers of micromaps and indices in a header whose version and primitive_count are set. */
void portable_micromaps_count(const struct canonical *canonical, struct portable_header *header);

/* Places the section behind the geometries of a header with these numbers, and sets body_size. */
void portable_micromaps_place(struct portable_header *header);

/* Returns the field `micromap` of a geometry's row. */
uint32_t portable_micromaps_of(const struct canonical_geometry *geometry);

/* Writes the section of a complete header, if it has one, into the body. */
void portable_micromaps_write(const struct canonical *canonical, const struct portable_header *header,
                              unsigned char *body);

/* Returns the most bytes that the section takes for this number of micromaps and of primitives. */
uint64_t portable_micromaps_bound(uint64_t micromaps, uint64_t primitives);

#endif
