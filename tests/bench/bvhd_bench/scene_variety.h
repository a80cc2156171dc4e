/* SPDX-License-Identifier: Apache-2.0 */
/*
 * scene_variety.h - generates more scenes from a seed, each with one kind of difficulty, in the proportions that are
 * found in scenes made by people.
 */
#ifndef BVHD_BENCH_SCENE_VARIETY_H
#define BVHD_BENCH_SCENE_VARIETY_H

#include "tests/support/scene/adversarial.h"

/*
 * Returns all of them; their number is *ret_count. Their proportions and the rotation of the whole scene depend on the
 * seed, too.
 */
const struct adversarial *scene_variety_all(uint32_t *ret_count);

#endif
