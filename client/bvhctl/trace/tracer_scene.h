/* SPDX-License-Identifier: Apache-2.0 */
/* tracer_scene.h - the structures of a directory, loaded into a device. */
#ifndef BVHCTL_TRACER_SCENE_H
#define BVHCTL_TRACER_SCENE_H

#include "client/bvhctl/gpu/gpu.h"
#include "client/bvhctl/scene/structures.h"

/*
 * bvhd_vulkan_scene_create over the files, in their order, with its flags and errors; what is wrong with one of them is
 * said of the file, by its name. Waits. The caller ends it with bvhd_vulkan_scene_destroy.
 */
enum bvhd_status tracer_scene_create(struct gpu *gpu, const struct structures *structures, uint32_t flags,
                                     struct memory *memory, struct bvhd_vulkan_scene **ret_scene,
                                     struct bvhd_error *error);

#endif
