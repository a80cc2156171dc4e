/* SPDX-License-Identifier: Apache-2.0 */
/*
 * portable_scene.h - a top level and the bottom levels that it names, in one buffer, as a GPU or a CPU traverses them.
 *
 * A packed buffer is the serialized blobs one after the other, each at a multiple of 64 bytes, the top level first; the handles of the top
 * level are replaced by the byte offsets of their blobs in the buffer. Structures that are kept apart are traversed through struct scene
 * alone (traverse.h), with one view for each handle.
 */
#ifndef BVHD_PORTABLE_SCENE_H
#define BVHD_PORTABLE_SCENE_H

#include "traverse.h"

/*
 * Packs blobs[0], a top level whose handle count is count - 1, and blobs[1 + i], what handle i names, into one new buffer from `memory` (the
 * caller frees it). A bottom level alone (count 1) is packed as it is. A blob that appears for several handles (same data pointer) is stored
 * once. Only sizes and handle counts are checked here, the rest when the buffer is opened. BVHD_CORRUPT, BVHD_INVALID (count does not fit
 * the handles), BVHD_TOO_LARGE, BVHD_NO_MEMORY.
 */
enum bvhd_status portable_pack(const struct bytes *blobs, uint32_t count, struct memory *memory, unsigned char **ret_buffer,
                               uint64_t *ret_size, struct bvhd_error *error);

/* A buffer opened for traversal: views of all its structures. It points into itself: do not move or copy it. */
struct portable_scene {
    struct scene scene;
    struct portable_view top; /* used when scene.top is set */
    struct portable_view *views; /* one for each distinct bottom level */
    const struct portable_view **bottoms; /* by handle */
    struct memory *memory;
};

/*
 * Opens a hostile packed buffer, 64-byte aligned, that outlives the scene: every structure through portable_open, every handle an offset of a
 * bottom level behind the top level. A place names the handle, "handles[3]: nodes[17].meta". End with portable_scene_finish.
 */
enum bvhd_status portable_scene_open(struct bytes buffer, struct memory *memory, struct portable_scene *ret_scene,
                                     struct bvhd_error *error);

/* NULL-safe; the buffer is the caller's. */
void portable_scene_finish(struct portable_scene *scene);

#endif
