/* SPDX-License-Identifier: Apache-2.0 */
/* backend_service.h - building by the service, through libbvhd. */
#ifndef BVHCTL_BACKEND_SERVICE_H
#define BVHCTL_BACKEND_SERVICE_H

#include "client/bvhctl/service/backend.h"
#include "client/bvhctl/service/connect.h"

struct backend_service {
    struct backend backend;
    struct connect connect;
    struct progress *progress;
    const atomic_bool *cancel;
};

/*
 * Connects to the service that `options` mean, as connect_open. `memory` and `progress`, which it draws, must outlive
 * it; `cancel` may be NULL. End with backend_service_close.
 */
enum bvhd_status backend_service_open(struct backend_service *service, const struct options *options,
                                      struct memory *memory, struct progress *progress, const atomic_bool *cancel,
                                      struct bvhd_error *error);

/* All results must be released. NULL-safe for a zeroed struct. */
void backend_service_close(struct backend_service *service);

#endif
