/* SPDX-License-Identifier: Apache-2.0 */
/* vulkan_contents.h - the contents of portable structures, as far as the choice of tracing kernels depends on them. */
#ifndef BVHD_VULKAN_CONTENTS_H
#define BVHD_VULKAN_CONTENTS_H

#include <stdbool.h>
#include <stdint.h>

#include "proto/base/bytes.h"

/* The contents of all structures of a scene. All zero stands for no structure. */
struct vulkan_contents {
    uint32_t kinds; /* the bit 1 << enum portable_content for each kind of records that occurs */
    bool has_large_steps; /* some node's boxes have steps that are larger than its structure's coordinates */
};

/* Adds a portable structure, which bvhd_vulkan_check has passed. Returns its enum portable_content. */
uint32_t vulkan_contents_add(struct vulkan_contents *contents, struct bytes blob);

#endif
