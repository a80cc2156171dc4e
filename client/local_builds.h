/* SPDX-License-Identifier: Apache-2.0 */
/*
 * local_builds.h - the batches of a client that are built in this process, by libbvhd_build. All functions require the
 * client's lock.
 *
 * Such a batch is in a queue of its own. Threads take copied items from it: those of the client (local_threads) if the
 * program allows any, else those that wait for a batch. An item becomes a job (local_job), which is run without the
 * lock. Items whose keys are equal share one job, and later ones the result.
 */
#ifndef BVHD_LOCAL_BUILDS_H
#define BVHD_LOCAL_BUILDS_H

#include <bvhd/bvhd.h>

#include "client/local_results.h"
#include "client/local_threads.h"
#include "proto/base/list.h"
#include "proto/base/parallel.h"

struct local_job;

/* The state of a client's own builds. */
struct local_builds {
    enum bvhd_local policy;
    struct bvhd_batch *queue; /* batches with items that no thread has taken, by priority, then by age */
    struct list jobs; /* jobs that are being built, which may be joined */
    struct local_results results;
    struct local_threads threads;
};

/* An item's part in local builds. */
struct local_item {
    struct list_link link; /* among the job's items */
    struct local_job *job; /* ITEM_BUILDING; NULL: none */
    struct bvhd_batch *batch;
    double prepare_ms;
    struct local_entry entry;
};

void local_builds_init(struct local_builds *builds, const struct bvhd_client_options *options);

/* Ends the threads, without the client's lock. All batches have been destroyed. */
void local_builds_finish(struct bvhd_client *client);

/*
 * Takes over what is not sent of a batch: builds are queued here, and keys are answered at once with what is held. If
 * no thread may build, because the program has an event loop and allows none, the items fail with BVHD_UNSUPPORTED and
 * batch->is_refused is set.
 */
void local_builds_take(struct bvhd_batch *batch);

/* Does the same with all batches that are queued for a daemon. */
void local_builds_take_all(struct bvhd_client *client);

/*
 * Lets an item keep the structure that it updates and the micromaps that it names, if they were built here: the program
 * may drop them before the item's build begins. An item that is done keeps nothing. Returns false without memory for
 * that; then it may be called again.
 */
bool local_builds_hold_named(struct bvhd_batch *batch, uint32_t index);

/* Answers keys of a new batch by results that are held here. */
void local_builds_answer_held(struct bvhd_batch *batch);

/* Returns the error of a batch that is refused. */
enum bvhd_status local_builds_refusal(struct bvhd_error *error);

/* Returns whether threads that wait have to build. */
bool local_builds_in_wait(const struct bvhd_client *client);

/* Returns whether there is an item to build. */
bool local_builds_has_work(struct bvhd_client *client);

/* After payloads were copied: lets the client's threads build, if there are any and there is work. */
void local_builds_wake(struct bvhd_client *client);

/*
 * Takes an item and builds it, with the lock dropped meanwhile: of the highest priority, and there of `own` (NULL: no
 * preference) or of the oldest batch. Returns false, and drops no lock, if there is none.
 */
bool local_builds_run(struct bvhd_client *client, const struct parallel *parallel, const struct bvhd_batch *own);

/* An item that is ITEM_BUILDING is done or no longer wanted: it leaves its job. */
void local_builds_leave(struct client_item *item);

#endif
