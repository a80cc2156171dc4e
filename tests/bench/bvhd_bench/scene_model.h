/* SPDX-License-Identifier: Apache-2.0 */
/*
 * scene_model.h - generates scenes like those that people make, from a seed: architecture, a town, hair, hills,
 * clutter, machines, leaves.
 */
#ifndef BVHD_BENCH_SCENE_MODEL_H
#define BVHD_BENCH_SCENE_MODEL_H

#include "tests/support/scene/adversarial.h"

/* Returns all of them; their number is *ret_count. Not only places but also proportions depend on the seed. */
const struct adversarial *scene_model_all(uint32_t *ret_count);

#endif
