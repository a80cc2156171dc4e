/* SPDX-License-Identifier: Apache-2.0 */
/*
 * content_key.h - the key of a build: SHA-256 over its canonical bytes and everything else that decides the result.
 *
 * The canonical block is cut into leaves of CONTENT_KEY_LEAF bytes (the last may be shorter; an empty block has none),
 * hashed in parallel:
 *
 *     leaf = SHA-256("bvhd key leaf 1\0", u64 bytes in the leaf, the bytes)
 *     key  = SHA-256("bvhd key root 2\0", u64 bytes of the block, u32 BUILD_VERSION, u32 target, u32 layout version, u32 layout flags,
 *                    u32 quality, struct device_format as its 36 bytes, zeros for a layout that leaves nothing open to devices, the leaves' digests in order)
 *
 * Numbers are little-endian. Neither the number of threads nor the machine is in it.
 */
#ifndef BVHD_CONTENT_KEY_H
#define BVHD_CONTENT_KEY_H

#include "builder/format/canonical.h"
#include "builder/context.h"
#include "proto/base/key.h"

/*
 * Some 50 us: several threads share the hash of a small structure too. What a leaf costs beside its bytes is below 1 %
 * of that.
 */
enum { CONTENT_KEY_LEAF = 1 << 16 };

/*
 * Of what build() makes of the same arguments: the quality in the key is the one that it resolves to. BVHD_UNSUPPORTED
 * for an unknown target, BVHD_NO_MEMORY, BVHD_CANCELLED, BVHD_INTERNAL when the hash library fails.
 */
enum bvhd_status content_key(const struct canonical *canonical, const struct build_options *options,
                             const struct build_context *context, struct key *ret_key, struct bvhd_error *error);

#endif
