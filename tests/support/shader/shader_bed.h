/* SPDX-License-Identifier: Apache-2.0 */
/*
 * shader_bed.h - traces rays by the ray queries of client/shaders over scenes on the host, on a Vulkan device, and
 * returns all that a query reports. For test programs only: when Vulkan fails they print a message and end.
 */
#ifndef BVHD_SHADER_BED_H
#define BVHD_SHADER_BED_H

#include "client/bvhctl/gpu/gpu.h"
#include "builder/traverse/traverse.h"

enum { SHADER_BED_CANDIDATES = 40, SHADER_BED_PORTION = 4096 };

/*
 * The kernel's policy for candidates: ACCEPT confirms all of them, IGNORE none, SOME those that shader_policy_accepts
 * names, and END confirms one and ends the query.
 */
enum shader_policy { SHADER_ACCEPT, SHADER_IGNORE, SHADER_SOME, SHADER_END };

/* Written by the kernel. */
struct shader_intersection {
    float t, u, v;
    uint32_t instance, custom_index, geometry, primitive;
    uint32_t flags; /* bit 0: front face, bit 1: AABB, bit 2: sphere, bit 3: linear swept sphere */
    uint32_t sbt_offset;
    uint32_t is_opaque; /* for AABB candidates */
};

struct shader_answer {
    struct shader_intersection hit;
    uint32_t type; /* 0: nothing was hit; then only candidate_count is valid */
    uint32_t candidate_count; /* can exceed SHADER_BED_CANDIDATES */
};

struct shader_details {
    float corners[3][3]; /* spheres and linear swept spheres: both centres, both radii and 0 */
    float object_origin[3], object_direction[3];
    float object_to_world[4][3], world_to_object[4][3]; /* by columns */
};

struct shader_full_answer {
    struct shader_answer answer;
    struct shader_details details;
    struct shader_intersection candidates[SHADER_BED_CANDIDATES];
};

struct shader_bed;

struct shader_bed_options {
    const char *device; /* as for gpu_open */
    bool by_address; /* the shader reads the structures by their device address; otherwise through a storage buffer */
    bool plain_bytes, fused_fma; /* the shader's BVHD_PLAIN_BYTES and BVHD_FUSED_FMA */
    bool is_round, moves; /* whether it knows spheres and linear swept spheres, and motion */
};

/* Returns BVHD_UNAVAILABLE or BVHD_NOT_FOUND when there is no such device. */
enum bvhd_status shader_bed_create(const struct shader_bed_options *options, struct memory *memory,
                                   struct shader_bed **ret_bed, struct bvhd_error *error);
void shader_bed_destroy(struct shader_bed *bed);
const char *shader_bed_device(const struct shader_bed *bed);

/* Sets the scene to trace from now on. */
void shader_bed_load(struct shader_bed *bed, const struct scene *scene);

/* Traces any number of rays, and fills ret_answers[count]. */
void shader_bed_trace(struct shader_bed *bed, const struct ray *rays, uint32_t count, enum shader_policy policy,
                      struct shader_answer *ret_answers);
/* Traces at most SHADER_BED_PORTION rays. */
void shader_bed_trace_fully(struct shader_bed *bed, const struct ray *rays, uint32_t count, enum shader_policy policy,
                            struct shader_full_answer *ret_answers);

/* Returns whether SHADER_SOME accepts a candidate with these numbers. */
bool shader_policy_accepts(uint32_t instance, uint32_t geometry, uint32_t primitive);

#endif
