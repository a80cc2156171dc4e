/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/support/builder/random_round.h"

static void make(struct random_input *input, uint32_t index, uint32_t count, struct random *random)
{
    const struct random_round round = {
        .count = count, .per_primitive = 1, .naming = random_chance(random, 0.5) ? RANDOM_LIST : RANDOM_EVERY};
    input->geometries[index] = (struct geometry){.type = GEOMETRY_SPHERES, .flags = random_below(random, 4)};
    random_round_make(input, index, &round, random);
}

const struct random_kind random_spheres = {.type = GEOMETRY_SPHERES,
                                           .shape = ORACLE_SPHERES,
                                           .make = make,
                                           .move = random_round_move,
                                           .fields = random_round_fields,
                                           .blank = random_round_blank};
