/* SPDX-License-Identifier: Apache-2.0 */
/*
 * pack.h - removes boxes from a sequence: moves the remaining ones together (stream compaction), eight at a time where
 * the machine can.
 */
#ifndef BVHD_PACK_H
#define BVHD_PACK_H

#include "builder/piece/nearest.h"

enum { PACK_PAD = 8 };

/*
 * Copies those of `count` boxes and nodes whose `kept` is 1 (not 0), in their order, to the start of another sequence.
 * It may read up to PACK_PAD entries beyond `count`, whose `kept` must be 0, and may overwrite up to PACK_PAD entries
 * behind the copies.
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
