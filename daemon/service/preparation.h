/* SPDX-License-Identifier: Apache-2.0 */
/*
 * preparation.h - reads an item's payload into its canonical copy and computes its key, on a worker; holds both, and
 * the source of an update, until the build or the update ends.
 *
 * How much memory that takes is not known before the rows are read, because one byte of payload may stand for any
 * number of boxes. So a preparation starts with a promise that suits an ordinary payload. If the rows need more, it
 * stops, says how much, and is run again once it has been promised that. It also stops, once, for the loop to look up
 * the opacity micromaps that the rows name (micromap_source.h).
 */
#ifndef BVHD_PREPARATION_H
#define BVHD_PREPARATION_H

#include "daemon/service/admission.h"
#include "daemon/service/attachment.h"
#include "daemon/service/micromap_source.h"
#include "builder/update/build_entry.h"
#include "daemon/service/update_source.h"
#include "proto/wire/control.h"
#include "proto/base/handle_table.h"
#include "proto/base/request_limits.h"
#include "proto/wire/rows.h"

/* Where an item's bytes lie: in a payload, or in an attachment. And what it updates, if that is in memory. */
struct preparation_source {
    struct payload *payload; /* a ref, or NULL */
    struct attachment *attachment; /* a ref, or NULL */
    struct blob *updated; /* a ref, or NULL */
    uint64_t offset, size; /* checked for a payload; for an attachment, they are checked when it is open */
};

/* The destinations of the items of one request, sorted, for VUID 03407. */
struct preparation_batch {
    const struct handle_entry *destinations;
    uint32_t count;
};

struct preparation {
    /* in */
    struct control_item asked;
    uint32_t index; /* of the item in its request, for errors */
    struct preparation_source source;
    struct preparation_batch batch;
    const struct limits *limits;
    struct update_source updated; /* of an update; the caller sets its disk. What is missing is found by the worker */
    struct micromap_sources micromaps; /* that its triangles name; the caller sets their disk */
    uint64_t promised; /* bytes */
    uint64_t promised_build; /* bytes for the build that follows; only large preparations need that promise */
    enum admission_class class; /* of the promise */
    /* out */
    enum bvhd_status status;
    struct bvhd_error error;
    /* 0, or bytes of which more than was promised are needed, here or for the build: then nothing else was done */
    uint64_t needed, needed_build;
    /* Micromaps have been listed, and nothing else was done: it is to be run again when they have been looked up. */
    bool names_micromaps;
    struct build_entry entry; /* from `memory` */
    struct memory memory; /* counts what the preparation holds */
    struct memory *within; /* the account that the struct itself is from */
};

/* The bytes to promise at first, for the preparation and for the build that follows it. */
uint64_t preparation_guess(const struct control_item *item);
uint64_t preparation_guess_build(const struct control_item *item);

/*
 * Estimates the most bytes that a build takes at a time, without its canonical copy. vertex_bytes: those of all
 * vertices of the result. high: the quality is high. moves: the structure has places at t = 0 and at t = 1.
 */
uint64_t preparation_build_bytes(uint64_t primitives, uint64_t vertex_bytes, bool high, bool moves);

/*
 * Estimates the most bytes that the build or the update takes at a time, beside what the preparation holds. Nothing is
 * known of an update whose source was not found.
 */
uint64_t preparation_make_bytes(const struct preparation *preparation);

/* Drops the refs of a source. */
void preparation_drop_source(struct preparation_source *source);

/* Takes the refs of `source`, also when it fails; returns NULL without memory. */
struct preparation *preparation_create(const struct control_item *item, uint32_t index,
                                       const struct preparation_source *source, struct memory *memory);

/* Sets the account that the copy will count in. The preparation must not hold anything yet. */
void preparation_account(struct preparation *preparation, struct memory *memory);

/* Runs on a worker, and fills the fields under "out". Drops the source unless it is to be run again. */
void preparation_run(struct preparation *preparation, const struct parallel *parallel, const atomic_bool *cancel);

/* Frees everything, which takes milliseconds for a large copy. For any thread. NULL-safe. */
void preparation_destroy(struct preparation *preparation);

/*
 * Returns an upper bound on the bytes that prepare() and content_key() take for an input, with its rows and with the
 * records of an update that keeps Vulkan's rules; UINT64_MAX if it does not fit 64 bits.
 */
uint64_t preparation_bound(const struct build_input *input);

#endif
