/* SPDX-License-Identifier: Apache-2.0 */
/* vertex_format.h - the VkFormats in which positions and radii may be given, and their decoding to float. */
#ifndef BVHD_VERTEX_FORMAT_H
#define BVHD_VERTEX_FORMAT_H

#include <stdint.h>

struct vertex_format {
    uint32_t format; /* VkFormat */
    const char *name; /* "R32G32B32_SFLOAT" */
    uint32_t size; /* bytes of one element that are read */
    /* strides and offsets are multiples of it: the component size, or the whole element when packed */
    uint32_t alignment;

    /*
     * Decodes `count` elements, which lie `stride` bytes apart from `source` on, to tightly packed xyz. A missing z is
     * 0, a fourth component is ignored, a NaN stays a NaN. Reads each byte once.
     */
    void (*decode)(const unsigned char *source, uint64_t stride, uint64_t count, float *ret_positions);
};

/* Returns NULL when bvhd does not read this format as vertices. */
const struct vertex_format *vertex_format_find(uint32_t format);

/* A format of radii. */
struct radius_format {
    uint32_t format; /* VkFormat */
    uint32_t size; /* bytes of one element */

    /* Decodes `count` elements, which lie `stride` bytes apart from `source` on. Reads each byte once. */
    void (*decode)(const unsigned char *source, uint64_t stride, uint64_t count, float *ret_radii);
};

/* Returns NULL when bvhd does not read this format as radii. */
const struct radius_format *radius_format_find(uint32_t format);

/* Returns the static table of all *ret_count formats, for tests and for announcing them. */
const struct vertex_format *vertex_formats(uint32_t *ret_count);

#endif
