/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/oracle/oracle_round_internal.h"

static bool fetch(const struct oracle_moment *moment, uint32_t primitive, union oracle_subject *ret_subject)
{
    const struct oracle_mesh *mesh = moment->mesh;
    uint64_t at = (uint64_t)2 * primitive;
    uint32_t first = mesh->indices ? mesh->indices[at] : (uint32_t)at;
    uint32_t second = mesh->indices ? mesh->indices[at + 1] : (uint32_t)at + 1;
    unsigned caps = mesh->caps ? mesh->caps[primitive] : ORACLE_CAP_FIRST | ORACLE_CAP_SECOND;
    return oracle_round_make(moment, first, second, caps, &ret_subject->round);
}

const struct oracle_kind oracle_swept_spheres = {fetch, oracle_round_sphere, oracle_round_meet};
