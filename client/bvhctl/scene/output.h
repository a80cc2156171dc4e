/* SPDX-License-Identifier: Apache-2.0 */
/*
 * output.h - writes what a build makes: a directory of files with a manifest, or one container with all of it.
 *
 * Files are never half-written, and those whose bytes do not change keep their modification time. A container appears
 * when it is complete, or not at all. In a directory, files that an earlier build of the same scene has left and that
 * this one does not make are removed at the end.
 */
#ifndef BVHCTL_OUTPUT_H
#define BVHCTL_OUTPUT_H

#include "builder/format/container.h"
#include "client/bvhctl/base/files.h"
#include "client/bvhctl/scene/file_names.h"
#include "client/bvhctl/scene/manifest.h"

struct output {
    const char *path; /* the caller's */
    bool is_container;
    bool replaces_all; /* set by the caller: earlier structures of other scenes are stale, too */
    struct memory *memory;
    struct manifest before; /* of a directory: that of the build before; empty if there is none */
    struct output_name { /* what this build has written to a directory */
        char *file, *scene;
    } * written;
    uint64_t written_count, written_capacity;
    struct files_stream stream; /* of a container */
    struct container_writer writer;
    uint32_t *rows; /* of a container: the rows of the structures of this scene, by their numbers */
    uint64_t row_capacity;
    uint32_t changed; /* files that were written */
    uint32_t removed; /* files of earlier builds that were removed */
};

/* Returns whether a path means a container: it ends with ".bvhd". */
bool output_is_container(const char *path);

/*
 * Begins the output of a build: creates the directory, or the temporary file of a container. `memory` is for lists. End
 * with output_close.
 */
enum bvhd_status output_open(struct output *output, const char *path, struct memory *memory, struct bvhd_error *error);

/*
 * Writes structure `index` of an assembly, which was built without error: those of a scene one after the other, its top
 * level last, and of structures with equal file names only the first.
 */
enum bvhd_status output_put(struct output *output, const struct assembly *assembly, uint32_t index,
                            const struct file_names *names, struct bvhd_error *error);

/*
 * Writes the manifest, as manifest.json or into the container. After a build that is not complete nothing is removed,
 * and no container is written.
 */
enum bvhd_status output_end(struct output *output, struct bytes manifest, bool is_complete, struct bvhd_error *error);

/* Abandons what output_end has not finished. NULL-safe, idempotent. */
void output_close(struct output *output);

#endif
