/* SPDX-License-Identifier: Apache-2.0 */
/*
 * gltf_buffer.h - the bytes of the buffers and buffer views of a glTF file. They are loaded when they are first needed
 * and stay until the file is closed, so that a buffer which nothing refers to is never opened.
 */
#ifndef BVHCTL_GLTF_BUFFER_H
#define BVHCTL_GLTF_BUFFER_H

#include "client/bvhctl/scene/gltf_json.h"

struct gltf_view {
    struct bytes bytes; /* decoded, if the view is compressed */
    uint32_t stride; /* bytes from one element to the next; 0: elements are packed */
    uint64_t offset; /* in its buffer, which alignment depends on; 0 if the view is compressed */
};

/*
 * Returns the bytes of buffers[index]: the BIN chunk of a GLB, a data: URI, or a file whose percent-encoded name is
 * relative to the glTF file.
 */
enum bvhd_status gltf_buffer(struct gltf_file *file, uint32_t index, struct bytes *ret_bytes);

/* Returns the part of a buffer that "buffer", "byteOffset" and "byteLength" of `object` name. */
enum bvhd_status gltf_buffer_part(struct gltf_file *file, const struct gltf_value *object, struct bytes *ret_bytes);

/* Returns bufferViews[index], decompressed. */
enum bvhd_status gltf_buffer_view(struct gltf_file *file, uint32_t index, struct gltf_view *ret_view);

#endif
