/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/input/input_kind.h"

#include "builder/input/canonical_form.h"
#include "proto/base/place.h"

static void view(const void *data, struct canonical_geometry *geometry)
{
    geometry->instances = data;
}

/* Checks that references are numbered in the order of first use, as the writer does. */
static enum bvhd_status check_foreign(const struct canonical *canonical, uint32_t index, struct bvhd_error *error)
{
    const struct canonical_geometry *geometry = &canonical->geometries[index];
    uint64_t used = 0;
    for (uint32_t i = 0; i < geometry->primitive_count; i++) {
        uint64_t reference = bytes_get64(geometry->instances + (uint64_t)FORM_RECORD_SIZE * i + FORM_RECORD_REFERENCE);
        if (reference > used + 1 || reference > canonical->reference_count)
            return form_corrupt(error, place("geometries[%u].instances[%u]", index, i).text,
                                "a reference out of order");
        used = reference > used ? reference : used;
    }
    if (used != canonical->reference_count)
        return form_corrupt(error, "referenceCount", "references that no instance names");
    return BVHD_OK;
}

const struct input_kind input_instances = {
    .primitive_size = FORM_RECORD_SIZE,
    .view = view,
    .check_foreign = check_foreign,
};
