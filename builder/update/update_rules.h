/* SPDX-License-Identifier: Apache-2.0 */
/*
 * update_rules.h - decides whether a request may update a structure: Vulkan's rules about what an update must not
 * change (Vulkan specification, vkBuildAccelerationStructuresKHR, the rules about mode UPDATE).
 *
 * Positions, boxes, values of transforms, and everything about instances but their number and which of them are
 * inactive, may change.
 */
#ifndef BVHD_UPDATE_RULES_H
#define BVHD_UPDATE_RULES_H

#include "builder/update/record.h"

/*
 * Compares the record of an update's own canonical copy, `now`, with that of its source: the structure whose key the
 * request names, as it was last built or updated. `index` is the entry's place in its batch, for errors. Returns
 * BVHD_INVALID with the rule and the place of the first difference; for another target, layout flags or device than the
 * source's without a rule, because Vulkan has none. Returns BVHD_UNSUPPORTED where only the vertex stride can have
 * changed to or from 0, because the source has one vertex where the update has many, or the reverse.
 */
enum bvhd_status update_rules_check(const struct record *source, const struct record *now, uint32_t index,
                                    struct bvhd_error *error);

/* Fills the error for a source without a record, because it was built without ALLOW_UPDATE: VUID 03667. */
enum bvhd_status update_rules_not_updatable(uint32_t index, struct bvhd_error *error);

#endif
