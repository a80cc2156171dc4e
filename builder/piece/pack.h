/* SPDX-License-Identifier: Apache-2.0 */
/* pack.h - moves what stays of a row of boxes together, many at a time. */
#ifndef BVHD_PACK_H
#define BVHD_PACK_H

#include "builder/piece/nearest.h"

enum { PACK_PAD = 8 };

/*
 * Copies the boxes and nodes of a row for which `kept` is 1, and not 0, in their order, to the begin of another. Up to
 * PACK_PAD behind what is read and written are read and written, too, and have to be 0 in `kept`.
 */
void pack_row(const struct nearest_boxes *boxes, const uint32_t *nodes, const uint8_t *kept, uint32_t count,
              const struct nearest_boxes *ret_boxes, uint32_t *ret_nodes);

/* The two ways to the same row: for every machine, and for those that are quick at AVX2 and BMI2 (NULL elsewhere). */
typedef void (*pack_packer)(const struct nearest_boxes *boxes, const uint32_t *nodes, const uint8_t *kept,
                            uint32_t count, const struct nearest_boxes *ret_boxes, uint32_t *ret_nodes);
void pack_row_plain(const struct nearest_boxes *boxes, const uint32_t *nodes, const uint8_t *kept, uint32_t count,
                    const struct nearest_boxes *ret_boxes, uint32_t *ret_nodes);
pack_packer pack_row_avx2(void);

#endif
