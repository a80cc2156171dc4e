/* SPDX-License-Identifier: Apache-2.0 */
/* vertex_format.h - the VkFormats in which positions may come (row F02), and their decoding to float. */
#ifndef BVHD_VERTEX_FORMAT_H
#define BVHD_VERTEX_FORMAT_H

#include <stdint.h>

struct vertex_format {
    uint32_t format; /* VkFormat */
    const char *name; /* "R32G32B32_SFLOAT" */
    uint32_t size; /* bytes of one element that are read */
    /* strides and offsets are multiples of it: the component size, or the whole element when packed */
    uint32_t alignment;

    /* Decodes `count` elements, `stride` bytes apart from `source` on, to tightly packed xyz; a missing z is 0, a fourth component is
     * ignored, NaN stays NaN. Reads each byte once. */
    void (*decode)(const unsigned char *source, uint64_t stride, uint64_t count, float *ret_positions);
};

/* NULL when the format is not a vertex format of bvhd. */
const struct vertex_format *vertex_format_find(uint32_t format);

/* All of them, for tests and announcements; *ret_count of them. */
const struct vertex_format *vertex_formats(uint32_t *ret_count);

#endif
