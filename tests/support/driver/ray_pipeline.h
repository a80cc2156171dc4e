/* SPDX-License-Identifier: Apache-2.0 */
/*
 * ray_pipeline.h - traces rays through a driver's structures by its ray-tracing pipeline, with generation, miss,
 * closest hit and any hit shaders that report what a tracer reports. The any-hit shader accepts; AABBs are hit where
 * the ray enters them (an intersection shader). It measures devices without ray queries.
 */
#ifndef BVHD_TEST_RAY_PIPELINE_H
#define BVHD_TEST_RAY_PIPELINE_H

#include "tests/support/builder/scene_boxes.h"
#include "client/bvhctl/trace/tracer.h"

/*
 * Creates a tracer. Returns BVHD_UNSUPPORTED on a device without VK_KHR_ray_tracing_pipeline. `top` must outlive the
 * tracer. Without boxes (below) it must not contain AABBs.
 */
enum bvhd_status ray_pipeline_create(struct gpu *gpu, VkAccelerationStructureKHR top, struct memory *memory,
                                     struct tracer **ret_tracer, struct bvhd_error *error);

/* From the next trace on, AABBs are hit too, by a second launch after the triangles. The arrays are copied. */
enum bvhd_status ray_pipeline_set_boxes(struct tracer *tracer, const struct scene_boxes *boxes,
                                        struct bvhd_error *error);

#endif
