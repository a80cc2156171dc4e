/* SPDX-License-Identifier: Apache-2.0 */
/*
 * ray.h - a ray and its hit, as every part of bvhd that traces on the CPU passes them on. They are laid out as
 * bvhd_cpu.h lays out its rays and hits, so that the library hands them over without a conversion.
 */
#ifndef BVHD_RAY_H
#define BVHD_RAY_H

#include <stdbool.h>
#include <stdint.h>

/*
 * VkRayFlags as in SPIR-V. Opaque and NoOpaque exclude each other, as do the two flags of culling by facing and
 * SKIP_TRIANGLES.
 */
enum {
    RAY_OPAQUE = 0x1,
    RAY_NO_OPAQUE = 0x2,
    RAY_TERMINATE_ON_FIRST_HIT = 0x4,
    RAY_CULL_BACK_FACING = 0x10,
    RAY_CULL_FRONT_FACING = 0x20,
    RAY_CULL_OPAQUE = 0x40,
    RAY_CULL_NO_OPAQUE = 0x80,
    RAY_SKIP_TRIANGLES = 0x100,
    RAY_SKIP_AABBS = 0x200,
};

/* The indices of an instance and of a bottom level that are not there. */
#define RAY_NO_INSTANCE UINT32_C(0xffffffff)
#define RAY_NO_BOTTOM UINT32_C(0xffffffff)

/* A ray in world space, with Vulkan's ray flags. */
struct ray {
    float origin[3];
    float tmin;
    /*
     * Need not be of unit length. A ray with a direction of zero, or with an origin or a direction that is not finite,
     * hits nothing.
     */
    float direction[3];
    float tmax; /* may be infinite; the ray hits nothing unless tmin <= tmax */
    uint32_t flags;
    uint32_t cull_mask; /* bits 7 .. 0: instances with mask & cull_mask == 0 are invisible */
    float time; /* 0 .. 1: when it meets what moves; structures without motion ignore it */
    uint32_t reserved; /* 0: programs can pass these rays to the library, whose rays end with it, too */
};

/* Returns whether nothing about the ray's flags or interval is unusual, so that the fastest ways can take it. */
static inline bool ray_is_plain(const struct ray *ray)
{
    return !(ray->flags & ~(uint32_t)RAY_TERMINATE_ON_FIRST_HIT) && ray->tmin >= 0 && ray->tmin <= ray->tmax;
}

/* A hit. It may alias, so that the library fills hits of a program in their place. */
struct __attribute__((may_alias)) ray_hit {
    float t; /* t, u, v are computed in double and rounded once */
    float u, v; /* as those of struct bvhd_cpu_hit */
    uint32_t instance; /* position in the TLAS request; RAY_NO_INSTANCE if there is no TLAS */
    uint32_t custom_index; /* 24 bits */
    uint32_t geometry; /* index in its BLAS */
    uint32_t primitive; /* index in its geometry */
    bool front_face : 1;
    bool is_aabb : 1;
    bool is_sphere : 1;
    bool is_swept_sphere : 1;
    uint32_t unused : 28;
    uint32_t sbt_offset; /* 24 bits */
    uint32_t handle; /* row of the scene's bottoms that was hit; 0 if there is no TLAS; RAY_NO_BOTTOM: a miss */
    uint32_t record; /* row in the BLAS's records, from which positions are fetched */
    uint32_t instance_record; /* row in the TLAS's records; 0 if there is no TLAS */
};

#endif
