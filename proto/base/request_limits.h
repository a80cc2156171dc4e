/* SPDX-License-Identifier: Apache-2.0 */
/*
 * request_limits.h - what one request may ask for. Announced to clients; a request over one gets the VUID named here,
 * or TOO_LARGE.
 */
#ifndef BVHD_REQUEST_LIMITS_H
#define BVHD_REQUEST_LIMITS_H

#include <stdint.h>

/* The specification's minima, and the most that the ids of the formats hold (row F61). */
#define LIMIT_MAX_GEOMETRIES ((UINT64_C(1) << 24) - 1) /* a BLAS: type-03793 */
#define LIMIT_MAX_INSTANCES ((UINT64_C(1) << 24) - 1) /* a TLAS: pInfos-03801 */
#define LIMIT_MAX_PRIMITIVES ((UINT64_C(1) << 29) - 1) /* a BLAS, all geometries together: type-03794, type-03795 */

struct limits {
    uint64_t max_geometries;
    uint64_t max_instances;
    uint64_t max_primitives;
    uint64_t max_canonical_bytes; /* of one structure's canonical copy: TOO_LARGE */
};

static inline struct limits limits_default(void)
{
    return (struct limits){LIMIT_MAX_GEOMETRIES, LIMIT_MAX_INSTANCES, LIMIT_MAX_PRIMITIVES, UINT64_C(1) << 36};
}

#endif
