/* SPDX-License-Identifier: Apache-2.0 */
/*
 * backend.h - where structures are built: in this process (backend_local), or by the service (backend_service). Both
 * are asked as the service's clients ask, with bvhd/bvhd.h's structs, and answer with its results; whoever asks does
 * not know which one it is.
 */
#ifndef BVHCTL_BACKEND_H
#define BVHCTL_BACKEND_H

#include <stdatomic.h>

#include "bvhd/bvhd.h"
#include "client/bvhctl/base/progress.h"

struct backend {
    /*
     * Builds all of `build`'s infos and waits for them. BVHD_OK: ret_results[info_count] is filled, each with its own
     * error, never BVHD_PENDING; their bytes live until *ret_hold is released. Anything else: nothing could be tried,
     * or the service is gone; nothing is held.
     */
    enum bvhd_status (*build)(struct backend *backend, const struct bvhd_build *build, struct bvhd_result *ret_results,
                              void **ret_hold, struct bvhd_error *error);
    void (*release)(struct backend *backend, void *hold); /* NULL-safe */
};

#endif
