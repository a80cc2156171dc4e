/* SPDX-License-Identifier: Apache-2.0 */
/*
 * ray_pipeline.h - rays through a driver's structures by its ray-tracing pipeline: generation, miss, closest hit and any hit shaders that report what a tracer
 * reports. Any-hit accepts; AABBs are hit where the ray enters them (an intersection shader). Devices without ray queries are measured by it.
 */
#ifndef BVHD_TEST_RAY_PIPELINE_H
#define BVHD_TEST_RAY_PIPELINE_H

#include "tracer.h"

/* BVHD_UNSUPPORTED on a device without VK_KHR_ray_tracing_pipeline. `top` must outlive the tracer. Without boxes (below) nothing of it may be an AABB. */
enum bvhd_status ray_pipeline_create(struct gpu *gpu, VkAccelerationStructureKHR top, struct memory *memory, struct tracer **ret_tracer,
                                     struct bvhd_error *error);

/* The AABBs of a scene, which no shader of a pipeline is told of. */
struct ray_pipeline_boxes {
    const float *boxes; /* six floats each, of all structures */
    uint32_t box_count;
    uint32_t instance_count, geometry_stride; /* instances of the top level; at least the most geometries that one of them has */
    const uint32_t
        *first; /* [instance * geometry_stride + geometry]: row in `boxes` of that geometry's primitive 0; anything for triangles */
};

/* From the next trace on AABBs are hit too, by a second launch after the triangles. The arrays are copied. */
enum bvhd_status ray_pipeline_set_boxes(struct tracer *tracer, const struct ray_pipeline_boxes *boxes, struct bvhd_error *error);

#endif
