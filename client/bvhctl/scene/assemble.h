/* SPDX-License-Identifier: Apache-2.0 */
/*
 * assemble.h - builds the acceleration structures of an imported scene. They are described by Vulkan's structs, as any
 * client does.
 *
 * There is one batch for the bottom levels, and then one for the top level, which names them by key and bounds. A
 * structure that fails does not affect the others, but the top level fails when a bottom level that it needs has
 * failed.
 */
#ifndef BVHCTL_ASSEMBLE_H
#define BVHCTL_ASSEMBLE_H

#include "client/bvhctl/service/backend.h"
#include "client/bvhctl/scene/import.h"
#include "client/bvhctl/base/options.h"

/* What was done for a structure. */
enum assembly_method {
    ASSEMBLY_BUILT, /* it had no source */
    ASSEMBLY_UPDATED,
    /* it was built, although it had a source: */
    ASSEMBLY_LOST, /* which the service does not have any more */
    ASSEMBLY_OTHER_ACTIVE, /* in which other primitives could be hit, so that Vulkan forbids the update */
    ASSEMBLY_DECAYED, /* whose tree became too bad by the update */
    ASSEMBLY_METHODS
};

struct assembly_outcome {
    enum assembly_method method;
    double decay; /* of the update: of the one that was kept, or of the one that was not; 0: there was none */
};

/* A structure that is updated. */
struct assembly_source {
    bool has_key; /* false: there is none, and the structure is built */
    struct bvhd_key key;
};

struct assembly_sources {
    const struct assembly_source *items; /* of the bottom levels of the import, and then of the top level */
    double most_decay; /* above it a structure is built instead; 0: where building pays (builder/update/decay.h) */
    double rays; /* expected for each primitive and update; 0: not known */
};

/* The owners of an assembly's results. */
struct assembly_holds {
    struct backend *backend;
    void *holds[4]; /* of the bottom levels, then of the top level */
};

struct assembly {
    const struct import *import;
    struct bvhd_result *items; /* bottom levels in the order of the import, then the top level: bottom_count + 1 */
    uint32_t *handles; /* of each handle of the top level, in their order: the bottom level that it names */
    uint32_t handle_count;
    uint32_t *rows; /* of each row of the top level's references: the bottom level that it names */
    uint32_t row_count;
    bool is_update; /* it was assembled by assemble_update */
    struct assembly_outcome *outcomes; /* one for each item */
    struct assembly_holds results;
};

/*
 * Builds everything and waits for it. It fails only when nothing could be tried, or when the service is gone; otherwise
 * each item has an error of its own. `import`, whose memory is used, and `backend` must outlive *ret_assembly. End with
 * assembly_finish.
 */
enum bvhd_status assemble(const struct import *import, const struct options *options, struct backend *backend,
                          struct assembly *ret_assembly, struct bvhd_error *error);

/* Does the same, but updates what has a source. Of it the flags, the target and the layout have to be the same. */
enum bvhd_status assemble_update(const struct import *import, const struct options *options,
                                 const struct assembly_sources *sources, struct backend *backend,
                                 struct assembly *ret_assembly, struct bvhd_error *error);

/* NULL-safe, idempotent. */
void assembly_finish(struct assembly *assembly);

/* Takes over the results, which assembly_finish leaves alone then. The backend must live until assembly_release. */
struct assembly_holds assembly_take(struct assembly *assembly);

/* Releases results that were taken over. A zeroed struct is allowed. */
void assembly_release(struct assembly_holds *results);

#endif
