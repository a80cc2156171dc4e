/* SPDX-License-Identifier: Apache-2.0 */
/*
 * gltf_file.h - an opened glTF 2.0 file: its JSON, the lists in it, the BIN chunk of a GLB, and the bytes that were
 * loaded or decoded so far. Internal to gltf.h.
 */
#ifndef BVHCTL_GLTF_FILE_H
#define BVHCTL_GLTF_FILE_H

#include "client/bvhctl/scene/gltf_arena.h"
#include "client/bvhctl/scene/import.h"
#include "client/bvhctl/scene/import_files.h"
#include "proto/base/bytes.h"

struct cJSON;

enum gltf_list_name {
    GLTF_ACCESSORS,
    GLTF_ANIMATIONS,
    GLTF_BUFFER_VIEWS,
    GLTF_BUFFERS,
    GLTF_MATERIALS,
    GLTF_MESHES,
    GLTF_NODES,
    GLTF_SCENES,
    GLTF_SKINS,
    GLTF_LISTS
};

/* One of the lists of the outermost object; each item is a JSON object. */
struct gltf_list {
    const struct cJSON **items;
    uint32_t count;
};

/* The bytes of a buffer, or of a buffer view that had to be decoded, once something needs them. */
struct gltf_bytes {
    bool is_loaded;
    unsigned char *owned; /* from memory; NULL if the bytes are in the file, or mapped */
    struct bytes mapped; /* by import_files_map */
    struct bytes bytes;
};

struct gltf_file {
    const char *path;
    struct memory *memory;
    struct import_files *files; /* the record of all files that are read */
    struct import_counts *counts;
    struct bvhd_error *error;
    struct bytes data; /* the whole file, mapped */
    bool is_old; /* it is of glTF 1.0: nothing else is set */
    bool has_bin;
    struct bytes bin; /* the BIN chunk */
    struct gltf_arena arena; /* of the JSON */
    const struct cJSON *root;
    struct gltf_list lists[GLTF_LISTS];
    struct gltf_bytes *buffers, *views; /* one for each buffer and buffer view */
};

/* Returns the name of a list in the JSON, such as "accessors". */
const char *gltf_list_text(enum gltf_list_name list);

/*
 * Reads and parses the file whose path, memory, files, counts and error are set. The JSON has the right kinds in its
 * lists after that, and nothing else was checked. End with gltf_file_close, also after an error.
 */
enum bvhd_status gltf_file_open(struct gltf_file *file);

void gltf_file_close(struct gltf_file *file);

#endif
