/* SPDX-License-Identifier: Apache-2.0 */
/* vertex_element.h - the sizes of the formats of vertices and radii that a build may use. */
#ifndef BVHD_VERTEX_ELEMENT_H
#define BVHD_VERTEX_ELEMENT_H

#include <stdint.h>

/* The formats of radii: VK_FORMAT_R16_SFLOAT and VK_FORMAT_R32_SFLOAT */
enum { RADIUS_FLOAT16 = 76, RADIUS_FLOAT32 = 100 };

struct vertex_element {
    uint32_t format; /* VkFormat */
    const char *name; /* "R32G32B32_SFLOAT" */
    uint32_t size; /* bytes of one element that are read */
    /* strides and offsets are multiples of it: the component size, or the whole element when packed */
    uint32_t alignment;
};

/* Returns a static struct, or NULL when bvhd does not read this format as vertices. */
const struct vertex_element *vertex_element_find(uint32_t format);

/* The same for radii. Vulkan has no rule about the alignment of their strides, so that any stride is legal. */
const struct vertex_element *radius_element_find(uint32_t format);

#endif
