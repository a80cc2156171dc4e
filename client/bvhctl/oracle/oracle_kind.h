/* SPDX-License-Identifier: Apache-2.0 */
/*
 * oracle_kind.h - what the oracle has to know about one kind of primitives: how to read them, where they are, and
 * whether a ray meets them. The rest of the oracle is the same for all kinds.
 */
#ifndef BVHD_ORACLE_KIND_H
#define BVHD_ORACLE_KIND_H

#include "client/bvhctl/oracle/oracle_moment.h"
#include "client/bvhctl/oracle/oracle_ray.h"
#include "client/bvhctl/oracle/oracle_round.h"
#include "client/bvhctl/oracle/oracle_triangle.h"

/* A primitive in world space, of the kind that has fetched it. */
union oracle_subject {
    struct oracle_triangle triangle;
    struct oracle_round round;
};

enum oracle_presence { ORACLE_ABSENT, ORACLE_POSSIBLE, ORACLE_SURE };

struct oracle_crossing {
    double t;
    /*
     * the interval of t for comparisons with other primitives on the same ray. It leaves out the moves of inputs that
     * shift the t of all primitives alike, and is wide enough to meet that of every distance which counts as equal
     * (bvhd_cpu.h: to 32 significant bits)
     */
    double low, high;
    double shift; /* what those moves add: t itself is in [low - shift, high + shift] */
};

/*
 * A primitive that is possibly hit. If it is open, it is a triangle: in world space, and as it is seen along the ray,
 * which is at 0.
 */
struct oracle_outline {
    bool open; /* only the edges leave it open whether it is hit: distance and facing are sure */
    double corners[3][3]; /* in world space; equal ones are the same corner */
    double seen[3][2];
    bool sure[3]; /* [k]: the ray surely does not pass through edge k, which is opposite to corner k */
    bool positive; /* the sign of the area */
};

struct oracle_kind {
    /*
     * Reads a primitive of the mesh as it is at a time. Returns false for one that no ray can hit then. The subject may
     * refer to the moment.
     */
    bool (*fetch)(const struct oracle_moment *moment, uint32_t primitive, union oracle_subject *ret_subject);
    /* Makes a sphere that contains the primitive and all its moves. */
    void (*sphere)(const union oracle_subject *subject, double ret_centre[3], double *ret_radius);
    /*
     * Returns whether the ray meets the primitive between tmin and tmax. Of the ray's flags, triangles honour those of
     * culling by facing; no others are honoured. *ret_crossing is filled in unless the result is ABSENT, *ret_outline
     * if it is POSSIBLE.
     */
    enum oracle_presence (*meet)(const struct oracle_ray *ray, const union oracle_subject *subject,
                                 struct oracle_crossing *ret_crossing, struct oracle_outline *ret_outline);
};

extern const struct oracle_kind oracle_triangles, oracle_spheres, oracle_swept_spheres;

/* Returns the less certain one of two presences. */
static inline enum oracle_presence oracle_worse(enum oracle_presence a, enum oracle_presence b)
{
    return a < b ? a : b;
}

/* Makes a crossing of an interval of t, which it widens as struct oracle_crossing says. */
struct oracle_crossing oracle_crossing_make(double t, double low, double high, double shift);

/* Returns whether t is in the open interval tmin < t < tmax of the ray. */
enum oracle_presence oracle_crossing_between(const struct oracle_crossing *crossing, const struct oracle_ray *ray);

#endif
