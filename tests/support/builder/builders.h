/* SPDX-License-Identifier: Apache-2.0 */
/* builders.h - the builders that tests run over: bvhd's own, and Embree where it can be loaded. */
#ifndef BVHD_TEST_BUILDERS_H
#define BVHD_TEST_BUILDERS_H

#include "builder/method.h"

static inline enum build_builder builders_last(void)
{
    return method_builders() & 1U << BUILDER_EMBREE ? BUILDER_EMBREE : BUILDER_OWN;
}

/* A loop over the builders, with `name` as the one of each round. */
#define BUILDERS_FOR(name) for (enum build_builder name = BUILDER_OWN; name <= builders_last(); name++)

#endif
