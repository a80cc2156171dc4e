/* SPDX-License-Identifier: Apache-2.0 */
/*
 * vulkan_bed.h - scenes to upload, whose rays have known answers. Bottom level b is a unit square of two triangles at
 * height b / 64, with more triangles far below. Instance i moves its bottom level by (2 i, 0, i % 5).
 *
 * For test programs only: a build that fails ends them.
 */
#ifndef BVHD_TEST_VULKAN_BED_H
#define BVHD_TEST_VULKAN_BED_H

#include <bvhd/bvhd_vulkan.h>

#include "builder/update/batch.h"
#include "builder/traverse/traverse.h"

struct vulkan_bed_options {
    enum target target;
    struct device_format device;
    uint32_t bottoms, instances; /* without instances the scene is the last bottom level alone */
    uint32_t triangles; /* in each bottom level, at least 2 */
    /* how many bottom levels instances name, counted from the first; the others have no bytes; 0: all */
    uint32_t named;
    /* the last bottom level has spheres around the triangles' corners instead; no ray is known then */
    bool has_spheres;
};

struct vulkan_bed {
    struct vulkan_bed_options options;
    struct memory memory;
    struct batch_item *items; /* bottom levels by row, then the top level */
    struct bvhd_vulkan_bytes *blobs; /* in the form that a scene takes */
    uint32_t count;
};

void vulkan_bed_init(struct vulkan_bed *bed, const struct vulkan_bed_options *options);
void vulkan_bed_finish(struct vulkan_bed *bed);

/* Returns the bottom level that instance i names. */
uint32_t vulkan_bed_bottom(const struct vulkan_bed *bed, uint32_t instance);

/* Returns a ray straight down on instance i, and the distance at which it hits. */
struct ray vulkan_bed_ray(const struct vulkan_bed *bed, uint32_t instance, float *ret_t);

/* Returns the format for bvhd_vulkan.h. */
struct bvhd_format vulkan_bed_format(const struct device_format *device);

#endif
