/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/input/input_kind.h"

#include <math.h>

#include "builder/input/canonical_form.h"

static void view(const void *data, struct canonical_geometry *geometry)
{
    geometry->boxes = data;
}

static enum bvhd_status check_foreign(const struct canonical *canonical, uint32_t index, struct bvhd_error *error)
{
    const struct canonical_geometry *geometry = &canonical->geometries[index];
    for (uint64_t i = 0; i < geometry->primitive_count; i++) {
        const float *box = geometry->boxes + 6 * i;
        bool nan = isnan(box[1]) | isnan(box[2]) | isnan(box[3]) | isnan(box[4]) | isnan(box[5]);
        if (nan && !isnan(box[0]))
            return form_corrupt_row(error, index, "boxes", "a NaN in an active box");
    }
    return BVHD_OK;
}

const struct input_kind input_aabbs = {
    .primitive_size = 6 * sizeof(float),
    .view = view,
    .check_foreign = check_foreign,
};
