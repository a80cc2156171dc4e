/* SPDX-License-Identifier: Apache-2.0 */
/* pack.h - moves those boxes of a sequence that are kept together, eight at a time where the machine can. */
#ifndef BVHD_PACK_H
#define BVHD_PACK_H

#include "builder/piece/nearest.h"

enum { PACK_PAD = 8 };

/*
 * Copies the boxes and nodes whose `kept` is 1 (not 0), in their order, to the start of another sequence. Up to
 * PACK_PAD entries after those that are read and written are read and written too; their `kept` must be 0.
 */
void pack_row(const struct nearest_boxes *boxes, const uint32_t *nodes, const uint8_t *kept, uint32_t count,
              const struct nearest_boxes *ret_boxes, uint32_t *ret_nodes);

/*
 * Both implementations, which give the same sequence: for every machine, and for machines with fast AVX2 and BMI2
 * (pack_row_avx2 returns NULL elsewhere).
 */
typedef void (*pack_packer)(const struct nearest_boxes *boxes, const uint32_t *nodes, const uint8_t *kept,
                            uint32_t count, const struct nearest_boxes *ret_boxes, uint32_t *ret_nodes);
void pack_row_plain(const struct nearest_boxes *boxes, const uint32_t *nodes, const uint8_t *kept, uint32_t count,
                    const struct nearest_boxes *ret_boxes, uint32_t *ret_nodes);
pack_packer pack_row_avx2(void);

#endif
