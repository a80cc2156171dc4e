/* SPDX-License-Identifier: Apache-2.0 */
/* oracle_round_internal.h - what the kinds of round bodies share. */
#ifndef BVHD_ORACLE_ROUND_INTERNAL_H
#define BVHD_ORACLE_ROUND_INTERNAL_H

#include "client/bvhctl/oracle/oracle.h"
#include "client/bvhctl/oracle/oracle_kind.h"

/*
 * Makes the body between two vertices of the mesh at a moment, which must outlive it; `caps` are ORACLE_CAP_ bits.
 * Returns false for one that no ray can hit.
 */
bool oracle_round_make(const struct oracle_moment *moment, uint32_t first, uint32_t second, unsigned caps,
                       struct oracle_round *ret_round);

/* The functions of struct oracle_kind. */
void oracle_round_sphere(const union oracle_subject *subject, double ret_centre[3], double *ret_radius);
enum oracle_presence oracle_round_meet(const struct oracle_ray *ray, const union oracle_subject *subject,
                                       struct oracle_crossing *ret_crossing, struct oracle_outline *ret_outline);

#endif
