/* SPDX-License-Identifier: Apache-2.0 */
#include <math.h>

#include "builder/input/input_kind.h"
#include "builder/input/validate.h"
#include "proto/base/parallel.h"
#include "proto/base/place.h"

/* Primitives that are checked between two looks at the cancel flag. */
enum { LOOK = 8192 };

/* The permanent of the absolute values is what the determinant would be if no products cancelled. */
bool validate_invertible(const float m[12])
{
    double determinant = 0, permanent = 0;
    for (int i = 0; i < 3; i++) {
        int j = (i + 1) % 3, k = (i + 2) % 3;
        double a = (double)m[4 + j] * m[8 + k], b = (double)m[4 + k] * m[8 + j];
        determinant += m[i] * (a - b);
        permanent += fabs((double)m[i]) * (fabs(a) + fabs(b));
    }
    return isfinite(determinant) && fabs(determinant) > permanent * 0x1p-48;
}

static enum bvhd_status check_geometry(const struct canonical *canonical, uint32_t index, uint32_t info,
                                       const atomic_bool *cancel, struct bvhd_error *error)
{
    const struct canonical_geometry *geometry = &canonical->geometries[index];
    const struct input_kind *kind = input_kind_of(geometry->type);
    enum bvhd_status status = BVHD_OK;
    size_t chunks = kind->check_contents ? parallel_chunks(LOOK, geometry->primitive_count) : 0, begin, end;
    for (size_t i = 0; status == BVHD_OK && i < chunks; i++) {
        if (parallel_cancelled(cancel))
            return bvhd_error_set(error, BVHD_CANCELLED, place("infos[%u]", info).text, "cancelled");
        parallel_chunk(i, LOOK, geometry->primitive_count, &begin, &end);
        status = kind->check_contents(geometry, (uint32_t)begin, (uint32_t)(end - begin), info, index, error);
    }
    return status;
}

enum bvhd_status validate_canonical(const struct canonical *canonical, uint32_t index, const atomic_bool *cancel,
                                    struct bvhd_error *error)
{
    enum bvhd_status status = BVHD_OK;
    for (uint32_t i = 0; status == BVHD_OK && i < canonical->geometry_count; i++)
        status = check_geometry(canonical, i, index, cancel, error);
    return status;
}
