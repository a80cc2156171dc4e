/* SPDX-License-Identifier: Apache-2.0 */
/*
 * content_key.h - computes the key of a build: SHA-256 over its canonical bytes and everything else that decides the
 * result. Equal keys mean equal results, which is what caches and coalescing rely on.
 *
 * The canonical block is cut into leaves of CONTENT_KEY_LEAF bytes (the last may be shorter; an empty block has none),
 * which are hashed in parallel:
 *
 *     leaf = SHA-256("bvhd key leaf 1\0", u64 size of the leaf, its bytes)
 *     key  = SHA-256("bvhd key root 2\0", u64 bytes of the block, u32 BUILD_VERSION, u32 target, u32 layout version,
 *                    u32 layout flags, u32 quality, 36 bytes of struct device_format, the leaves' digests in order)
 *
 * For Embree (BUILDER_EMBREE), whose trees depend on its version too, the root is instead
 *
 *     key  = SHA-256("bvhd key embree\0", ... the same up to the device ..., u32 version, u32 estimate (embree.h), the
 *                    leaves' digests in order)
 *
 * so that keys of bvhd's own builders are what they were without it. For an update of the structure with the key
 * `source` it is
 *
 *     key  = SHA-256("bvhd key update\0", 32 bytes of the source's key, u64 bytes of the block, u32 REFIT_VERSION,
 *                    u32 target, u32 layout version, the leaves' digests in order)
 *
 * The device's 36 bytes are zero for a layout that
 * does not depend on the device. Numbers are little-endian. The key does not depend on the number of threads or, apart
 * from Embree's estimate, on the machine.
 */
#ifndef BVHD_CONTENT_KEY_H
#define BVHD_CONTENT_KEY_H

#include "builder/format/canonical.h"
#include "builder/context.h"
#include "proto/base/key.h"

/*
 * Bytes of a leaf; one takes about 50 us to hash. Leaves are this small so that several threads share the work for a
 * small structure too; the fixed cost of a leaf is below 1 % of that time.
 */
enum { CONTENT_KEY_LEAF = 1 << 16 };

/*
 * Computes the key of the result that build() gives for the same arguments: the quality in it is the one that
 * tier_resolve chooses. Returns BVHD_UNSUPPORTED for an unknown target or builder, or for Embree where there is none,
 * BVHD_NO_MEMORY, BVHD_CANCELLED, and
 * BVHD_INTERNAL when the hash library fails. *ret_key is written only on success.
 */
enum bvhd_status content_key(const struct canonical *canonical, const struct build_options *options,
                             const struct build_context *context, struct key *ret_key, struct bvhd_error *error);

/*
 * Computes the key of the structure that refit() makes of the one with the key `source`, for the new geometry in
 * `canonical`. Of the options only the target counts: everything else is the source's. Fails as content_key does.
 */
enum bvhd_status content_key_update(const struct canonical *canonical, const struct build_options *options,
                                    const struct key *source, const struct build_context *context, struct key *ret_key,
                                    struct bvhd_error *error);

/*
 * Computes the name under which the record of a structure is kept: SHA-256("bvhd key record", 32 bytes of the
 * structure's key). Fails with BVHD_NO_MEMORY or BVHD_INTERNAL.
 */
enum bvhd_status content_key_of_record(const struct key *key, struct key *ret_key, struct bvhd_error *error);

#endif
