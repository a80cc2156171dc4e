/* SPDX-License-Identifier: Apache-2.0 */
/*
 * driver_scene.h - one scene twice on a Vulkan device: built by its driver, and built by us in the driver's own format
 * and uploaded by libbvhd.
 *
 * For test programs only: failures are printed and end the program.
 */
#ifndef BVHD_TEST_DRIVER_SCENE_H
#define BVHD_TEST_DRIVER_SCENE_H

#include <bvhd/bvhd_vulkan.h>

#include "tests/support/driver/driver_structure.h"
#include "proto/base/geometry.h"
#include "tests/support/builder/scene_boxes.h"
#include "client/bvhctl/trace/tracer.h"

struct driver_scene_options {
    struct gpu *gpu;
    const struct bvhd_format *format; /* the device's own */
    const struct canonical *bottoms; /* what is built */
    uint32_t bottom_count;
    const struct canonical *driver_bottoms; /* built by the driver instead; NULL: the same */
    const struct canonical *top; /* the key of a reference begins with the number of its bottom level + 1, as u64 */
    enum build_quality quality;
    enum build_builder builder;
    /* ours are built over other geometry, with ALLOW_UPDATE, and then updated to what the driver builds */
    bool updates;
    const struct parallel *parallel;
};

struct driver_scene {
    struct driver_scene_options options; /* what it points to must outlive the scene */
    struct gpu *gpu;
    struct memory memory;
    struct driver_structure *bottoms, top; /* the driver's structures */
    struct bvhd_vulkan_scene *ours;
    /* our structures as built: by row of the top level's references, then the top level */
    struct bvhd_vulkan_bytes *blobs;
    uint32_t row_count;
    struct scene_boxes boxes; /* where AABBs are */
};

void driver_scene_init(struct driver_scene *ret_scene, const struct driver_scene_options *options);
void driver_scene_finish(struct driver_scene *scene);

VkAccelerationStructureKHR driver_scene_our_top(const struct driver_scene *scene);

/* Our structure of row `row`, or the top level for row_count, as a source of copies. It belongs to the scene. */
struct driver_structure driver_scene_ours(const struct driver_scene *scene, uint32_t row);

/* The index in options.bottoms of row `row` of the top level. */
uint32_t driver_scene_bottom(const struct driver_scene *scene, uint32_t row);

/*
 * Loads our top level once more, over bottom levels at these addresses, which are indexed by row. The caller destroys
 * it.
 */
struct driver_structure driver_scene_top_over(struct driver_scene *scene, const uint64_t *addresses);

/*
 * Opens the best device and finds out what it loads natively. Returns false, with a line on stdout that says why and
 * nothing held, where there is no device or it loads no format of ours.
 */
bool driver_scene_device(struct memory *memory, struct gpu **ret_gpu, struct bvhd_format *ret_format);

/* Ends the program unless the status is BVHD_OK. */
void driver_scene_must(enum bvhd_status status, const struct bvhd_error *error);

#endif
