/* SPDX-License-Identifier: Apache-2.0 */
/*
 * scene_model.h - scenes such as people have, by numbers from a seed: architecture, a town, hair, hills, clutter,
 * machines, leaves.
 */
#ifndef BVHD_BENCH_SCENE_MODEL_H
#define BVHD_BENCH_SCENE_MODEL_H

#include "tests/support/scene/adversarial.h"

/* All of them, *ret_count of them. Proportions depend on the seed, too, not places alone. */
const struct adversarial *scene_model_all(uint32_t *ret_count);

#endif
