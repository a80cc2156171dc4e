/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/support/builder/random_kind.h"

const struct random_kind *const random_kinds[RANDOM_KINDS] = {
    &random_triangles,        &random_boxes,           &random_instances, &random_spheres, &random_swept_spheres,
    &random_moving_triangles, &random_moving_instances};

const struct random_kind *random_kind_find(uint32_t type)
{
    for (int i = 0; i < RANDOM_KINDS; i++)
        if (random_kinds[i]->type == type)
            return random_kinds[i];
    return NULL;
}

static const struct random_kind *any_flat(struct random *random)
{
    return random_chance(random, 0.25) ? &random_boxes : &random_triangles;
}

static const struct random_kind *any_round(struct random *random)
{
    return random_chance(random, 0.6) ? &random_swept_spheres : &random_spheres;
}

/* Motion instances are over everything. */
static const struct random_kind *any_moving(struct random *random)
{
    if (random_chance(random, 0.6))
        return &random_moving_triangles;
    return random_chance(random, 0.5) ? any_flat(random) : any_round(random);
}

static const struct random_kind *any(struct random *random)
{
    return random_chance(random, 0.3)   ? any_moving(random)
           : random_chance(random, 0.5) ? any_flat(random)
                                        : any_round(random);
}

static const struct {
    const char *name;
    const struct random_kind *(*choose)(struct random *random);
    uint32_t kinds;
} choices[] = {
    [RANDOM_FLAT] = {"flat", any_flat, RANDOM_FLAT_KINDS},
    [RANDOM_ROUND] = {"round", any_round, RANDOM_ROUND_KINDS},
    [RANDOM_MOTION] = {"motion", any_moving, RANDOM_KINDS},
    [RANDOM_ALL] = {"all", any, RANDOM_KINDS},
};

uint32_t random_kind_count(enum random_choice choice)
{
    return choices[choice].kinds;
}

const struct random_kind *random_kind_any(enum random_choice choice, struct random *random)
{
    return choices[choice].choose(random);
}

const char *random_choice_name(enum random_choice choice)
{
    return choices[choice].name;
}

bool random_choice_from_name(const char *name, enum random_choice *ret_choice)
{
    for (enum random_choice choice = RANDOM_FLAT; choice <= RANDOM_ALL; choice++)
        if (strcmp(name, choices[choice].name) == 0) {
            *ret_choice = choice;
            return true;
        }
    return false;
}
