/* SPDX-License-Identifier: Apache-2.0 */
/*
 * vuid.h - the valid-usage rules of Vulkan that bvhd checks, by name.
 *
 * vuid.def lists each rule once, as BVHD_VUID(name, "VUID-..."). The numbers are wire ABI: append rules, never reorder
 * them.
 */
#ifndef BVHD_VUID_H
#define BVHD_VUID_H

/* Marks a function that the shared library exports. */
#ifndef BVHD_API
#define BVHD_API __attribute__((visibility("default")))
#endif

#ifdef __cplusplus
extern "C" {
#endif

enum bvhd_vuid {
    BVHD_VUID_NONE = 0,
#define BVHD_VUID(name, string) BVHD_VUID_##name,
#include "vuid.def"
#undef BVHD_VUID
    BVHD_VUID_COUNT
};

/*
 * Returns the identifier verbatim, "VUID-...", as a static string; "" for NONE and for a number that this version does
 * not know.
 */
BVHD_API const char *bvhd_vuid_string(enum bvhd_vuid vuid);

#ifdef __cplusplus
}
#endif

#endif
