/* SPDX-License-Identifier: Apache-2.0 */
/*
 * builders.h - the builders that tests run over: bvhd's own, and Embree where it can be loaded. Some programs loop over
 * them; others run once more with BVHD_TEST_BUILDER=embree in their environment.
 */
#ifndef BVHD_TEST_BUILDERS_H
#define BVHD_TEST_BUILDERS_H

#include <stdlib.h>

#include "builder/build.h"
#include "builder/method.h"

static inline enum build_builder builders_last(void)
{
    return method_builders() & 1U << BUILDER_EMBREE ? BUILDER_EMBREE : BUILDER_OWN;
}

/*
 * Returns whether Embree may be made to fail. AddressSanitizer ends a C program in which a C++ library that was loaded
 * later throws, as Embree does when its memory is refused; what is thrown does not leave Embree.
 */
static inline bool builders_may_fail(enum build_builder builder)
{
#if defined(__SANITIZE_ADDRESS__)
    return builder == BUILDER_OWN;
#elif defined(__has_feature)
#if __has_feature(address_sanitizer)
    return builder == BUILDER_OWN;
#else
    (void)builder;
    return true;
#endif
#else
    (void)builder;
    return true;
#endif
}

/* Returns the builder that the environment names, or bvhd's own; and that also where there is no Embree. */
static inline enum build_builder builders_asked(void)
{
    const char *name = getenv("BVHD_TEST_BUILDER");
    enum build_builder builder = BUILDER_OWN;
    return name && build_builder_from_name(name, &builder) && builder <= builders_last() ? builder : BUILDER_OWN;
}

/* A loop over the builders, with `name` as the one of each round. */
#define BUILDERS_FOR(name) for (enum build_builder name = BUILDER_OWN; name <= builders_last(); name++)

#endif
