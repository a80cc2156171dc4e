/* SPDX-License-Identifier: Apache-2.0 */
/*
 * random_format.h - formats of vertices, written and read independently of the builder. For test programs only.
 */
#ifndef BVHD_RANDOM_FORMAT_H
#define BVHD_RANDOM_FORMAT_H

#include "tests/support/random.h"

enum random_component { UNORM8, SNORM8, UNORM16, SNORM16, HALF, FLOAT, DOUBLE, PACKED };

struct random_format {
    uint32_t number; /* VkFormat */
    enum random_component component;
    uint32_t read; /* number of components that are read */
    uint32_t stored; /* number of components of an element */
};

/* Returns a format of vertices. */
const struct random_format *random_format_any(struct random *random);
/* Returns a format of radii, which have one component. */
const struct random_format *random_format_radius(struct random *random);

/* Returns the size of a component, or of a packed element: strides and offsets are multiples of it. */
uint32_t random_format_unit(const struct random_format *format);
/* Returns how many bytes of an element are read. */
uint32_t random_format_read_size(const struct random_format *format);
/* Returns a multiple of the unit. Some strides are 0, or let elements overlap. */
uint64_t random_format_stride(const struct random_format *format, struct random *random);

/*
 * Values beyond the range of the format are clamped, or become infinite in a half. As many components are read and
 * written as the format has, and missing ones decode as 0.
 */
void random_format_encode(const struct random_format *format, const double position[3], unsigned char *ret_element);
void random_format_decode(const struct random_format *format, const unsigned char *element, float ret_position[3]);

#endif
