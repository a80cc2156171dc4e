/* SPDX-License-Identifier: Apache-2.0 */
/*
 * content_key.h - the key of a build: SHA-256 over its canonical bytes and everything else that decides the result.
 *
 * Leaves of 1 MiB are hashed in parallel, a root over their digests; both are domain-separated and cover lengths. The root also covers
 * the resolved quality, target, layout version and flags, and the builder's version. Not the number of threads nor the machine.
 */
#ifndef BVHD_CONTENT_KEY_H
#define BVHD_CONTENT_KEY_H

#include "canonical.h"
#include "key.h"
#include "memory.h"
#include "parallel.h"

/* `quality` is resolved (build_quality_resolve). BVHD_UNSUPPORTED for an unknown target; BVHD_INTERNAL when the hash library fails. */
enum bvhd_status content_key(const struct canonical *canonical, enum build_quality quality, enum target target, uint32_t layout_flags,
                             struct memory *memory, const struct parallel *parallel, struct key *ret_key, struct bvhd_error *error);

#endif
