/* SPDX-License-Identifier: Apache-2.0 */
/*
 * preparation.h - from an item's payload to its canonical copy and key, on a worker; and what is kept of it until its
 * build ends.
 *
 * How much memory that takes is not known before the rows are read: one byte of payload may stand for any number of
 * boxes. So it starts with a promise that suits an ordinary payload; when the rows ask for more, it stops, says how
 * much, and is run again with that.
 */
#ifndef BVHD_PREPARATION_H
#define BVHD_PREPARATION_H

#include "daemon/service/admission.h"
#include "daemon/service/attachment.h"
#include "builder/format/canonical.h"
#include "builder/context.h"
#include "proto/wire/control.h"
#include "proto/base/handle_table.h"
#include "proto/base/request_limits.h"
#include "proto/wire/rows.h"

/* Where an item's bytes are: in a payload, or in an attachment. */
struct preparation_source {
    struct payload *payload; /* a ref, or NULL */
    struct attachment *attachment; /* a ref, or NULL */
    uint64_t offset, size; /* a region of a payload was checked; one of an attachment is checked when that is open */
};

/* Destinations of the items of one request, sorted (03407). */
struct preparation_batch {
    const struct handle_entry *destinations;
    uint32_t count;
};

struct preparation {
    /* in */
    struct control_item asked;
    uint32_t index; /* of the item, for errors */
    struct preparation_source source;
    struct preparation_batch batch;
    const struct limits *limits;
    uint64_t promised; /* bytes */
    enum admission_class class; /* whose share that is of */
    /* out */
    enum bvhd_status status;
    struct bvhd_error error;
    uint64_t needed; /* over `promised`: nothing was done but to find that out */
    struct canonical canonical; /* of `memory` */
    struct build_options options; /* as asked; of a copy, with the quality that is built */
    struct key key;
    struct memory memory; /* what it holds */
    struct memory *within; /* what the struct itself is from */
};

/* What to promise at first. */
uint64_t preparation_guess(const struct control_item *item);

/* Takes the refs of `source`, also when it fails (NULL: no memory). */
struct preparation *preparation_create(const struct control_item *item, uint32_t index,
                                       const struct preparation_source *source, struct memory *memory);

/* Where its copy will count, before it runs; holds nothing yet. */
void preparation_account(struct preparation *preparation, struct memory *memory);

/* On a worker. The source is dropped unless more is needed. */
void preparation_run(struct preparation *preparation, const struct parallel *parallel, const atomic_bool *cancel);

/* Frees everything; from any thread. Large copies take some milliseconds. NULL-safe. */
void preparation_destroy(struct preparation *preparation);

/*
 * An upper bound on what prepare() and content_key() take for an input, rows included; UINT64_MAX when it does not fit
 * 64 bits.
 */
uint64_t preparation_bound(const struct build_input *input);

#endif
