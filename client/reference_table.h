/* SPDX-License-Identifier: Apache-2.0 */
/*
 * reference_table.h - the structures that the instances of one call may name: those of build.references, then the
 * bottom levels that the call itself builds, by their destinations. It also has the keys of sources: an update names
 * what it updates by a handle of build.references. After an update in place that handle stands for the new structure.
 * A reference into whose structure an info builds otherwise has the handle 0 in the table, so that nothing finds it.
 */
#ifndef BVHD_REFERENCE_TABLE_H
#define BVHD_REFERENCE_TABLE_H

#include <bvhd/bvhd.h>

#include "proto/base/geometry.h"
#include "proto/base/handle_table.h"
#include "proto/base/memory.h"
#include "proto/base/status.h"

#define REFERENCE_GIVEN UINT32_MAX

struct reference_table {
    struct reference *references;
    struct handle_entry *handles; /* of the references, sorted; an entry's number is the reference's position */
    uint32_t *infos; /* of each reference: the info that builds it; REFERENCE_GIVEN: none does */
    uint32_t given; /* references of the build */
    uint32_t count; /* all of them */
    const struct bvhd_build *build;
};

/*
 * Checks build->references and makes the table, which reference_table_finish frees. The build must outlive it. Returns
 * BVHD_INVALID, with a place such as "build.references[3].handle", for a handle that is 0 or given twice, for bounds or
 * slabs that are not finite, and for a reference that has neither bounds nor a key; or BVHD_NO_MEMORY. The place of a
 * table that could not be made for lack of memory is "batch".
 */
enum bvhd_status reference_table_make(const struct bvhd_build *build, struct memory *memory,
                                      struct reference_table *ret_table, struct bvhd_error *error);
void reference_table_finish(struct reference_table *table, struct memory *memory);

/* Returns the position of the first reference with that handle, which the table has. */
uint32_t reference_table_find(const struct reference_table *table, uint64_t handle);

/* Returns the key of the reference that was given for that handle, also if an info updates it; NULL: there is none. */
const struct bvhd_key *reference_table_key(const struct reference_table *table, uint64_t handle);

/* Returns whether the reference's bounds have to be looked up by its key. */
bool reference_table_lacks_bounds(const struct reference_table *table, uint32_t number);

#endif
