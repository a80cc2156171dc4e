/* SPDX-License-Identifier: Apache-2.0 */
#include "bvhd/vuid.h"

static const char *const strings[BVHD_VUID_COUNT] = {
    [BVHD_VUID_NONE] = "",
#define BVHD_VUID(name, string) [BVHD_VUID_##name] = string,
#include "bvhd/vuid.def"
#undef BVHD_VUID
};

const char *bvhd_vuid_string(enum bvhd_vuid vuid)
{
    return (unsigned)vuid < BVHD_VUID_COUNT ? strings[vuid] : "";
}
