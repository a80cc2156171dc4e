/* SPDX-License-Identifier: Apache-2.0 */
/*
 * request_limits.h - the limits of one request. They are announced to clients; a request over a limit fails with the
 * VUID named here, or with TOO_LARGE.
 */
#ifndef BVHD_REQUEST_LIMITS_H
#define BVHD_REQUEST_LIMITS_H

#include <stdint.h>

/*
 * The minima that the Vulkan specification requires (Limits: maxGeometryCount, maxInstanceCount, maxPrimitiveCount),
 * which are also the largest numbers that the formats can store.
 */
#define LIMIT_MAX_GEOMETRIES ((UINT64_C(1) << 24) - 1) /* per BLAS: VUID type-03793 */
#define LIMIT_MAX_INSTANCES ((UINT64_C(1) << 24) - 1) /* per TLAS: VUID pInfos-03801 */
/* per BLAS, all geometries together: VUIDs type-03794, type-03795 */
#define LIMIT_MAX_PRIMITIVES ((UINT64_C(1) << 29) - 1)

/* The limits that a daemon or a program applies to each request. */
struct limits {
    uint64_t max_geometries;
    uint64_t max_instances;
    uint64_t max_primitives;
    uint64_t max_canonical_bytes; /* of one structure's canonical copy; beyond it: TOO_LARGE */
};

static inline struct limits limits_default(void)
{
    return (struct limits){LIMIT_MAX_GEOMETRIES, LIMIT_MAX_INSTANCES, LIMIT_MAX_PRIMITIVES, UINT64_C(1) << 36};
}

#endif
