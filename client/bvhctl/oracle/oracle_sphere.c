/* SPDX-License-Identifier: Apache-2.0 */
/* A sphere is a swept sphere whose ends are equal: wherever a ray enters it is a cap. */
#include "client/bvhctl/oracle/oracle_round_internal.h"

static bool fetch(const struct oracle_moment *moment, uint32_t primitive, union oracle_subject *ret_subject)
{
    const struct oracle_mesh *mesh = moment->mesh;
    uint32_t vertex = mesh->indices ? mesh->indices[primitive] : primitive;
    return oracle_round_make(moment, vertex, vertex, ORACLE_CAP_FIRST | ORACLE_CAP_SECOND, &ret_subject->round);
}

const struct oracle_kind oracle_spheres = {fetch, oracle_round_sphere, oracle_round_meet};
