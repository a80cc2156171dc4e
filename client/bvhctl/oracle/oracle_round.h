/* SPDX-License-Identifier: Apache-2.0 */
/*
 * oracle_round.h - spheres and linear swept spheres as the oracle tests them against rays.
 *
 * Both are what a sphere sweeps that moves from one end to another while its radius changes in proportion to its way;
 * the two ends of a sphere are equal. This body is the convex hull of the spheres at its ends. A ray enters it once at
 * most, through the side or through a cap; if the cap is missing, it hits nothing.
 */
#ifndef BVHD_ORACLE_ROUND_H
#define BVHD_ORACLE_ROUND_H

#include "client/bvhctl/oracle/oracle_moment.h"

/* A round body in the space of its mesh, with the way from the world's space into that. */
struct oracle_round {
    struct radial centres[2][3], radii[2];
    bool caps[2];
    const struct oracle_moment *moment; /* that of its mesh, with the way to the world */
};

#endif
