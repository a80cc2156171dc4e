/* SPDX-License-Identifier: Apache-2.0 */
/*
 * build_entry.h - makes the structure of one entry, by a build or by an update, in the two steps that a daemon and a
 * program's own process have in common: build_entry_prepare finds its key, and build_entry_make its bytes.
 *
 * A structure with ALLOW_UPDATE has a record beside its bytes (record.h). Whoever keeps the structure keeps both; an
 * update needs them.
 */
#ifndef BVHD_BUILD_ENTRY_H
#define BVHD_BUILD_ENTRY_H

#include "builder/summary.h"
#include "builder/update/refit.h"
#include "proto/base/request_limits.h"

/* The source of an update: a structure that was built or updated with ALLOW_UPDATE, and its record. */
struct build_entry_source {
    struct bytes blob; /* 16-byte aligned */
    struct bytes record; /* 8-byte aligned; no bytes: it was built without ALLOW_UPDATE */
};

struct build_entry {
    struct canonical canonical;
    struct build_options options; /* the quality in them is the one that is built */
    struct key key;
    bool is_update;
    struct record record; /* with ALLOW_UPDATE: what is kept beside the result; complete after build_entry_make */
};

/* A structure that build_entry_make has made. */
struct build_made {
    unsigned char *blob; /* as build() and refit() say */
    uint64_t size;
    struct summary summary; /* without the time of the build, which the caller adds */
};

/*
 * Makes the canonical copy, and what follows from it. For an update it also checks what must be as in the source, whose
 * record is in source->record; a build ignores `source`, and an update without one is BVHD_SOURCE_LOST. `index` is the
 * entry's place in its batch, for errors, which are those of prepare(), content_key(), record_make() and
 * update_rules_check(). The entry is freed by build_entry_finish.
 */
enum bvhd_status build_entry_prepare(const struct build_input *input, uint32_t index, const struct limits *limits,
                                     const struct build_entry_source *source, const struct build_context *context,
                                     struct build_entry *ret_entry, struct bvhd_error *error);

/*
 * Makes the bytes and completes the record. Errors are those of build() and refit(). It may be called again after a
 * failure.
 */
enum bvhd_status build_entry_make(struct build_entry *entry, const struct build_entry_source *source,
                                  const struct build_context *context, struct build_made *ret_made,
                                  struct bvhd_error *error);

/* Fills the error of an update whose source is not there any more, or not all of it: `what`. */
enum bvhd_status build_entry_source_lost(const struct key *key, uint32_t index, const char *what,
                                         struct bvhd_error *error);

/* Frees what build_entry_prepare made, with the same memory. NULL is allowed, and so is an entry that is all 0. */
void build_entry_finish(struct build_entry *entry, struct memory *memory);

#endif
