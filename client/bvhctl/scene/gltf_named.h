/* SPDX-License-Identifier: Apache-2.0 */
/* gltf_named.h - finds the scene or the animation that a user names. Internal to gltf.h. */
#ifndef BVHCTL_GLTF_NAMED_H
#define BVHCTL_GLTF_NAMED_H

#include "client/bvhctl/scene/gltf_json.h"

/*
 * Finds the item of a list whose name is `wanted`, or else whose number is, from 0. Returns BVHD_INVALID if several
 * have the name, and BVHD_NOT_FOUND if there is none.
 */
enum bvhd_status gltf_named_find(const struct gltf_file *file, enum gltf_list_name list, const char *wanted,
                                 uint32_t *ret_index);

/* Returns the name of an item; "" if it has none. */
const char *gltf_named_text(const struct gltf_file *file, enum gltf_list_name list, uint32_t index);

#endif
