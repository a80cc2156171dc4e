/* SPDX-License-Identifier: Apache-2.0 */
/*
 * random_update.h - updates a structure of a random request again and again, as a program does. For test programs only.
 */
#ifndef BVHD_RANDOM_UPDATE_H
#define BVHD_RANDOM_UPDATE_H

#include "builder/update/batch.h"
#include "builder/update/refit.h"
#include "tests/support/random.h"

/* A request with ALLOW_UPDATE, and how it is moved. */
struct random_update {
    const struct build_input *input;
    void (*move)(void *request, struct random *random);
    void *request;
    uint32_t most; /* updates */
    const struct build_context *context;
};

/*
 * Updates an item that has just been built from the request: 0 to `most` times it moves the request and replaces the
 * item's blob and facts. *updates counts the updates. Records are read back as untrusted bytes on the way.
 *
 * Returns BVHD_INVALID with VUID 03663 or 03664 when a move changed which primitives are active, so that the item is
 * not what the request means. All other failures are mistakes; BVHD_INTERNAL stands for a senseless decay.
 */
enum bvhd_status random_update_run(const struct random_update *update, struct random *random, struct batch_item *item,
                                   uint64_t *updates, struct bvhd_error *error);

#endif
