/* SPDX-License-Identifier: Apache-2.0 */
/*
 * local_job.h - prepares and builds, or updates, one structure in this process, from the same payload that a daemon
 * would get.
 *
 * A job begins with one item that waits for it. Other items may join it once its key is known, and any of them may
 * leave; a job without items is abandoned and stops within milliseconds. The thread that runs a job needs no lock for
 * local_job_prepare and local_job_build; `waiters` and `link` belong to the client's lock.
 */
#ifndef BVHD_LOCAL_JOB_H
#define BVHD_LOCAL_JOB_H

#include "builder/local/build_library.h"
#include "client/placement.h"
#include "client/result_blob.h"
#include "proto/base/list.h"
#include "proto/wire/control.h"

struct local_job {
    struct list_link link; /* among the client's jobs that may be joined */
    bool is_open; /* it may be joined: its key is known, and it is being built */
    struct list waiters; /* items, by client_item.local.link; empty: abandoned */
    uint32_t index; /* the first item's position in its batch, for errors */
    struct control_item asked;
    struct held payload; /* until it is prepared */
    const unsigned char *pool_bytes; /* HELD_POOL: the payload */
    atomic_bool cancel; /* also set when `deadline` has passed */
    _Atomic uint64_t deadline; /* by clock_ns, after which no item wants the result; LIBRARY_NEVER: none */
    struct memory memory; /* of the preparation */
    const struct build_library *library;
    struct bvhd_blob *source; /* of an update: a reference; NULL: this process does not have it */
    struct local_micromaps *micromaps; /* which it names, until it is prepared; NULL: none */
    struct build_entry entry;
    enum bvhd_status status;
    struct bvhd_error error;
    struct bvhd_blob *blob; /* the job's reference */
    struct summary summary; /* of the structure in `blob` */
    double prepare_ms;
    _Atomic uint32_t thousandths; /* of the build that are done */
};

/*
 * Creates a job without items, which takes over *payload and the reference to the source. Returns NULL, and takes
 * nothing, without memory.
 */
struct local_job *local_job_create(const struct control_item *asked, uint32_t index, struct held *payload,
                                   const unsigned char *pool_bytes, struct bvhd_blob *source);

/* Frees a job whose payload has been released. NULL is allowed. */
void local_job_destroy(struct local_job *job);

/*
 * Loads the library, reads the payload and makes its copy with the key. Sets `status` and `error`: BVHD_SOURCE_LOST for
 * an update whose source is not there.
 */
void local_job_prepare(struct local_job *job, const struct parallel *parallel);

/*
 * Builds the structure of a copy that was made. Sets `status`, `error`, `blob` and `summary`. It may be called again
 * after BVHD_CANCELLED.
 */
void local_job_build(struct local_job *job, const struct parallel *parallel);

/* Returns how far the build is, in thousandths. Any thread. */
uint32_t local_job_thousandths(const struct local_job *job);

/* Describes the result of a job that has succeeded, as a daemon does. `is_own`: not for an item that has joined. */
void local_job_describe(const struct local_job *job, bool is_own, struct control_result *ret_result);

#endif
