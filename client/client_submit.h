/* SPDX-License-Identifier: Apache-2.0 */
/* client_submit.h - what bvhd_batch_submit and bvhd_micromap_submit share. */
#ifndef BVHD_CLIENT_SUBMIT_H
#define BVHD_CLIENT_SUBMIT_H

#include <bvhd/bvhd.h>

/*
 * Does what bvhd_batch_submit does (bvhd.h), whose arguments are not NULL. `known` has an error for each info, which is
 * its result unless it is BVHD_OK; NULL: there are none.
 */
enum bvhd_status client_submit(struct bvhd_client *client, const struct bvhd_build *build,
                               const struct bvhd_error *known, struct bvhd_batch **ret_batch,
                               struct bvhd_error *ret_error);

#endif
