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

struct assembly {
    const struct import *import;
    struct bvhd_result *items; /* bottom levels in the order of the import, then the top level: bottom_count + 1 */
    uint32_t *handles; /* of each handle of the top level, in their order: the bottom level that it names */
    uint32_t handle_count;
    uint32_t *rows; /* of each row of the top level's references: the bottom level that it names */
    uint32_t row_count;
    struct backend *backend;
    void *bottoms, *top; /* owners of the results, which the backend releases */
};

/*
 * Builds everything and waits for it. It fails only when nothing could be tried, or when the service is gone; otherwise
 * each item has an error of its own. `import`, whose memory is used, and `backend` must outlive *ret_assembly. End with
 * assembly_finish.
 */
enum bvhd_status assemble(const struct import *import, const struct options *options, struct backend *backend,
                          struct assembly *ret_assembly, struct bvhd_error *error);

/* NULL-safe, idempotent. */
void assembly_finish(struct assembly *assembly);

#endif
