/* SPDX-License-Identifier: Apache-2.0 */
/*
 * assemble.h - the acceleration structures of an imported scene: asked for in Vulkan's structs, as any client does.
 *
 * One batch for the bottom levels, one for the top level, which names them by key and bounds. A structure that fails
 * does not disturb the others; a top level fails when a bottom level that it needs has failed.
 */
#ifndef BVHCTL_ASSEMBLE_H
#define BVHCTL_ASSEMBLE_H

#include "client/bvhctl/service/backend.h"
#include "client/bvhctl/scene/import.h"
#include "client/bvhctl/base/options.h"

struct assembly {
    const struct import *import;
    struct bvhd_result *items; /* bottom levels in the order of the import, then the top level: bottom_count + 1 */
    uint32_t *handles; /* for each handle of the top level, in their order, the bottom level that it names */
    uint32_t handle_count;
    struct backend *backend;
    void *bottoms, *top; /* the backend's: what the results live in */
};

/*
 * Fails only when nothing could be tried, or the service is gone; else look at each item's error. `import`, whose
 * memory is used, and `backend` must outlive *ret_assembly.
 */
enum bvhd_status assemble(const struct import *import, const struct options *options, struct backend *backend,
                          struct assembly *ret_assembly, struct bvhd_error *error);

/* NULL-safe, idempotent. */
void assembly_finish(struct assembly *assembly);

#endif
