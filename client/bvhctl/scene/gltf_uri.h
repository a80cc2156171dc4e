/* SPDX-License-Identifier: Apache-2.0 */
/* gltf_uri.h - the URIs of glTF buffers: names of files that are percent-encoded, and bytes in data: URIs. */
#ifndef BVHCTL_GLTF_URI_H
#define BVHCTL_GLTF_URI_H

#include "proto/base/memory.h"
#include "proto/base/status.h"

enum gltf_uri_kind { GLTF_URI_FILE, GLTF_URI_DATA, GLTF_URI_REMOTE };

/* Returns what a URI names. It is remote if it has a scheme other than data:, such as https:. */
enum gltf_uri_kind gltf_uri_kind(const char *uri);

/*
 * Returns the path of a file URI that is relative to the file `base`, which the caller frees with memory_free. NULL
 * when there is no memory. Sequences that are not two hexadecimal digits after a percent sign stay as they are, and
 * so does the whole name if a file with the undecoded name exists.
 */
char *gltf_uri_path(const char *base, const char *uri, struct memory *memory);

/*
 * Decodes a data: URI: base64 after ";base64,", else percent-encoded text. BVHD_INVALID when it is neither. The caller
 * frees *ret_data with memory_free; it is never NULL.
 */
enum bvhd_status gltf_uri_decode(const char *uri, struct memory *memory, unsigned char **ret_data, uint64_t *ret_size);

#endif
