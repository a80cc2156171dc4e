/* SPDX-License-Identifier: Apache-2.0 */
/*
 * backend.h - builds structures, either in this process (backend_local) or by the service (backend_service). Both take
 * and return the structs of bvhd/bvhd.h, so that the caller does not have to know which one it has.
 */
#ifndef BVHCTL_BACKEND_H
#define BVHCTL_BACKEND_H

#include <stdatomic.h>

#include "bvhd/bvhd.h"

struct backend {
    /*
     * Builds all infos of `build` and waits for them. BVHD_OK: ret_results[info_count] is filled in. Each result has an
     * error of its own, which is not BVHD_PENDING, and its bytes live until *ret_hold is released. Any other status
     * means that the service is gone, or that no build was started; there is nothing to release then.
     */
    enum bvhd_status (*build)(struct backend *backend, const struct bvhd_build *build, struct bvhd_result *ret_results,
                              void **ret_hold, struct bvhd_error *error);
    void (*release)(struct backend *backend, void *hold); /* NULL-safe */
};

#endif
