/* SPDX-License-Identifier: Apache-2.0 */
/* backend_service.h - has structures built by the service, through libbvhd. */
#ifndef BVHCTL_BACKEND_SERVICE_H
#define BVHCTL_BACKEND_SERVICE_H

#include "client/bvhctl/base/progress.h"
#include "client/bvhctl/service/backend.h"
#include "client/bvhctl/service/connect.h"

struct backend_service {
    struct backend backend;
    struct connect connect;
    struct progress *progress;
};

/*
 * Connects to the service that `options` name, by connect_open. The progress of builds is drawn by `progress`.
 * `memory` and `progress` must outlive the backend. End with backend_service_close.
 */
enum bvhd_status backend_service_open(struct backend_service *service, const struct options *options,
                                      struct memory *memory, struct progress *progress, struct bvhd_error *error);

/* All results must have been released before. A zeroed struct is allowed. */
void backend_service_close(struct backend_service *service);

#endif
