/* SPDX-License-Identifier: Apache-2.0 */
/* Linear swept spheres in both indexing modes and without indices, with caps and without. */
#include "tests/support/builder/random_round.h"

static void make(struct random_input *input, uint32_t index, uint32_t count, struct random *random)
{
    const struct random_round round = {.count = count,
                                       .per_primitive = 2,
                                       .naming = (enum random_naming)random_below(random, 3),
                                       .has_caps = random_chance(random, 0.6)};
    struct geometry *geometry = &input->geometries[index];
    *geometry = (struct geometry){.type = GEOMETRY_SWEPT_SPHERES, .flags = random_below(random, 4)};
    geometry->swept_spheres.indexing_mode = round.naming == RANDOM_SUCCESSIVE ? SWEPT_SUCCESSIVE : SWEPT_LIST;
    geometry->swept_spheres.end_caps_mode = round.has_caps ? SWEPT_CAPS_CHAINED : SWEPT_CAPS_NONE;
    random_round_make(input, index, &round, random);
}

static struct random_fields fields(struct geometry *geometry)
{
    struct random_fields fields = random_round_fields(geometry);
    fields.mode_count = 2;
    fields.modes[0] = &geometry->swept_spheres.indexing_mode;
    fields.modes[1] = &geometry->swept_spheres.end_caps_mode;
    return fields;
}

static void blank(struct geometry *geometry, struct bytes bytes)
{
    random_round_blank(geometry, bytes);
    geometry->swept_spheres.indexing_mode = SWEPT_LIST;
    geometry->swept_spheres.end_caps_mode = SWEPT_CAPS_CHAINED;
}

const struct random_kind random_swept_spheres = {.type = GEOMETRY_SWEPT_SPHERES,
                                                 .shape = ORACLE_SWEPT_SPHERES,
                                                 .make = make,
                                                 .move = random_round_move,
                                                 .fields = fields,
                                                 .blank = blank};
