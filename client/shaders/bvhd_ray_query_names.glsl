// SPDX-License-Identifier: Apache-2.0
/*
 * bvhd_ray_query_names.glsl - the constants of bvhd_ray_query.glsl (which includes it): flags of rays and of instances,
 * and what candidates and hits are.
 */
#ifndef BVHD_RAY_QUERY_NAMES_GLSL
#define BVHD_RAY_QUERY_NAMES_GLSL

// Ray flags, with the values of gl_RayFlags...EXT.
const uint BVHD_RAY_FLAGS_NONE = 0x0u;
const uint BVHD_RAY_FLAGS_OPAQUE = 0x1u;
const uint BVHD_RAY_FLAGS_NO_OPAQUE = 0x2u;
const uint BVHD_RAY_FLAGS_TERMINATE_ON_FIRST_HIT = 0x4u;
const uint BVHD_RAY_FLAGS_CULL_BACK_FACING = 0x10u;
const uint BVHD_RAY_FLAGS_CULL_FRONT_FACING = 0x20u;
const uint BVHD_RAY_FLAGS_CULL_OPAQUE = 0x40u;
const uint BVHD_RAY_FLAGS_CULL_NO_OPAQUE = 0x80u;
const uint BVHD_RAY_FLAGS_SKIP_TRIANGLES = 0x100u;
const uint BVHD_RAY_FLAGS_SKIP_AABBS = 0x200u;

const uint BVHD_CANDIDATE_TRIANGLE = 0u;
const uint BVHD_CANDIDATE_AABB = 1u;
const uint BVHD_CANDIDATE_SPHERE = 2u;
const uint BVHD_CANDIDATE_SWEPT_SPHERE = 3u;
const uint BVHD_COMMITTED_NONE = 0u;
const uint BVHD_COMMITTED_TRIANGLE = 1u;
const uint BVHD_COMMITTED_GENERATED = 2u;
const uint BVHD_COMMITTED_SPHERE = 3u;
const uint BVHD_COMMITTED_SWEPT_SPHERE = 4u;

const uint BVHD_NO_INSTANCE = 0xffffffffu; // there is no top level

// VkGeometryInstanceFlagsKHR.
const uint BVHD_INSTANCE_CULL_DISABLE = 0x1u;
const uint BVHD_INSTANCE_FLIP_FACING = 0x2u;
const uint BVHD_INSTANCE_FORCE_OPAQUE = 0x4u;
const uint BVHD_INSTANCE_FORCE_NO_OPAQUE = 0x8u;

#endif
