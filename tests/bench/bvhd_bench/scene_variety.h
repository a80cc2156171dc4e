/* SPDX-License-Identifier: Apache-2.0 */
/*
 * scene_variety.h - more scenes by numbers from a seed: of one kind of difficulty each, in proportions that scenes by
 * people mix.
 */
#ifndef BVHD_BENCH_SCENE_VARIETY_H
#define BVHD_BENCH_SCENE_VARIETY_H

#include "tests/support/scene/adversarial.h"

/* All of them, *ret_count of them. Proportions and how the whole is turned depend on the seed, too. */
const struct adversarial *scene_variety_all(uint32_t *ret_count);

#endif
