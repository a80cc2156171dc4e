/* SPDX-License-Identifier: Apache-2.0 */
/*
 * scene_boxes.h - the AABBs of a scene on a device, for shaders that decide on candidates: ray queries and pipelines do
 * not tell them.
 */
#ifndef BVHD_TEST_SCENE_BOXES_H
#define BVHD_TEST_SCENE_BOXES_H

#include <stdint.h>

struct scene_boxes {
    const float *boxes; /* six floats each, of all structures */
    uint32_t box_count;
    uint32_t instance_count,
        geometry_stride; /* instances of the top level; at least the most geometries that one of them has */
    /* [instance * geometry_stride + geometry]: row in `boxes` of that geometry's primitive 0; anything for triangles */
    const uint32_t *first;
};

#endif
