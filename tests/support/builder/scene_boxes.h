/* SPDX-License-Identifier: Apache-2.0 */
/*
 * scene_boxes.h - the AABBs of a scene on a device, for shaders that decide about candidates: ray queries and pipelines
 * do not provide the boxes.
 */
#ifndef BVHD_TEST_SCENE_BOXES_H
#define BVHD_TEST_SCENE_BOXES_H

#include <stdint.h>

struct scene_boxes {
    const float *boxes; /* six floats each, of all structures */
    uint32_t box_count;
    /* instances of the top level; geometry_stride is at least the largest number of geometries in one of them */
    uint32_t instance_count, geometry_stride;
    /*
     * [instance * geometry_stride + geometry]: row in `boxes` of that geometry's primitive 0; any value for triangles
     */
    const uint32_t *first;
};

#endif
