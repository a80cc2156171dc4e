/* SPDX-License-Identifier: Apache-2.0 */
/* gltf_meshopt.h - buffer views that are compressed by EXT_meshopt_compression or KHR_meshopt_compression. */
#ifndef BVHCTL_GLTF_MESHOPT_H
#define BVHCTL_GLTF_MESHOPT_H

#include "client/bvhctl/scene/gltf_json.h"

/*
 * Decodes a buffer view whose extension object is `compressed`. The bytes of *ret_bytes are owned. The number of
 * decoded bytes is bounded by the number of compressed ones before anything is allocated.
 */
enum bvhd_status gltf_meshopt_decode(struct gltf_file *file, const struct gltf_value *view,
                                     const struct gltf_value *compressed, struct gltf_bytes *ret_bytes);

#endif
