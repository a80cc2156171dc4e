/* SPDX-License-Identifier: Apache-2.0 */
/*
 * builders.h - the builders that tests run over: bvhd's own, and Embree where it can be loaded. Some programs loop over
 * them; others run once more with BVHD_TEST_BUILDER=embree in their environment; in those that trace on devices, the
 * builders take turns.
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

/* Returns the builder that the environment names, or bvhd's own; and that also where there is no Embree. */
static inline enum build_builder builders_asked(void)
{
    const char *name = getenv("BVHD_TEST_BUILDER");
    enum build_builder builder = BUILDER_OWN;
    return name && build_builder_from_name(name, &builder) && builder <= builders_last() ? builder : BUILDER_OWN;
}

/* Returns the builder of structure number `index` in tests that are too slow to run twice: they take turns. */
static inline enum build_builder builders_turn(uint64_t index)
{
    return index % 2 ? builders_last() : BUILDER_OWN;
}

/* A loop over the builders, with `name` as the one of each round. */
#define BUILDERS_FOR(name) for (enum build_builder name = BUILDER_OWN; name <= builders_last(); name++)

#endif
