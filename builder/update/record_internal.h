/* SPDX-License-Identifier: Apache-2.0 */
/* record_internal.h - what the writer and the reader of records share. */
#ifndef BVHD_RECORD_INTERNAL_H
#define BVHD_RECORD_INTERNAL_H

#include "builder/update/record.h"

static const char record_magic[4] = {'B', 'V', 'H', 'U'};

/* Returns the bytes of a record. They are below 2^40, so that nothing overflows. */
uint64_t record_size(uint32_t geometries, uint32_t primitives, uint32_t inactive, bool has_micromaps);

/* Makes the view of a record whose header fits to its size. */
void record_view(const struct record_header *header, struct record *ret_record);

#endif
