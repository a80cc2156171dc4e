/* SPDX-License-Identifier: Apache-2.0 */
/* build_names.c - the names of qualities and of builders (build.h). */
#include <string.h>

#include "builder/build.h"

const char *build_quality_name(enum build_quality quality)
{
    static const char *const names[] = {
        [QUALITY_UNSPECIFIED] = "unspecified",
        [QUALITY_FAST] = "fast",
        [QUALITY_BALANCED] = "balanced",
        [QUALITY_HIGH] = "high",
        [QUALITY_AUTO] = "auto",
    };
    return (unsigned)quality < sizeof names / sizeof *names ? names[quality] : "unknown";
}

static const char *const builder_names[] = {[BUILDER_OWN] = "own", [BUILDER_EMBREE] = "embree"};

const char *build_builder_name(enum build_builder builder)
{
    return (unsigned)builder < sizeof builder_names / sizeof *builder_names ? builder_names[builder] : "unknown";
}

bool build_builder_from_name(const char *name, enum build_builder *ret_builder)
{
    for (enum build_builder builder = BUILDER_OWN; builder <= BUILDER_EMBREE; builder++)
        if (strcmp(name, builder_names[builder]) == 0) {
            *ret_builder = builder;
            return true;
        }
    return false;
}
