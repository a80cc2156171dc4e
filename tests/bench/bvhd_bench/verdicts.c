/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/bench/bvhd_bench/verdicts.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "client/bvhctl/oracle/rays.h"

/* Picks a random triangle with finite corners; false when none is found. */
static bool pick(const struct ply *mesh, uint64_t *state, const float *ret_corners[3])
{
    enum { TRIES = 100 };
    for (int try = 0; try < TRIES && mesh->triangle_count > 0; try++) {
        const uint32_t *corners = mesh->indices + (size_t)3 * (rays_random(state) % mesh->triangle_count);
        bool is_finite = true;
        for (int k = 0; k < 3; k++) {
            ret_corners[k] = mesh->positions + (size_t)3 * corners[k];
            for (int axis = 0; axis < 3; axis++)
                is_finite &= isfinite(ret_corners[k][axis]) != 0;
        }
        if (is_finite)
            return true;
    }
    return false;
}

/* Aims the ray from its origin at a point `share` along an edge of a random triangle. */
static void aim_at_edge(const struct ply *mesh, double share, uint64_t *state, struct ray *ray)
{
    const float *corners[3];
    double direction[3], length = 0;
    if (!pick(mesh, state, corners))
        return;
    for (int axis = 0; axis < 3; axis++) {
        direction[axis] = corners[0][axis] + share * ((double)corners[1][axis] - corners[0][axis]) - ray->origin[axis];
        length = hypot(length, direction[axis]);
    }
    for (int axis = 0; axis < 3 && length > 0; axis++)
        ray->direction[axis] = (float)(direction[axis] / length);
}

/*
 * Redirects half of the rays: of every four, one to a corner and one to an edge. Both start outside of the scene, where
 * rays of even index start.
 */
static void aim_at_edges(const struct ply *mesh, uint64_t seed, struct trial *trial)
{
    uint64_t state = seed;
    for (uint32_t i = 0; i < trial->count; i++) {
        struct ray *ray = &trial->rays[i];
        if (i % 4 == 3)
            memcpy(ray->origin, ray[-1].origin, sizeof ray->origin);
        if (i % 4 >= 2)
            aim_at_edge(mesh, i % 4 == 2 ? 0 : rays_uniform(&state), &state, ray);
    }
}

struct trial trial_make(struct bench *bench, const struct ply *mesh, uint64_t seed, uint32_t rays)
{
    struct bvhd_error error;
    struct trial trial = {.count = rays, .memory = &bench->memory};
    const struct oracle_mesh own = {.positions = mesh->positions,
                                    .indices = mesh->indices,
                                    .primitive_count = mesh->triangle_count,
                                    .instance = RAY_NO_INSTANCE};
    trial.rays = tree_need(rays, sizeof *trial.rays);
    trial.answers = tree_need(rays, sizeof *trial.answers);
    rays_make(&own, 1, seed, rays, trial.rays);
    aim_at_edges(mesh, seed, &trial);
    if (oracle_trace(&own, 1, trial.rays, rays, &bench->memory, bench->parallel, NULL, NULL, trial.answers, &error) !=
        BVHD_OK) {
        fprintf(stderr, "bvhd-bench: brute force: %s\n", error.text);
        exit(1);
    }
    return trial;
}

void trial_finish(struct trial *trial)
{
    oracle_finish(trial->answers, trial->count, trial->memory);
    free(trial->answers);
    free(trial->rays);
}

/* Whether the hit is right in everything but the distance. */
static bool is_inexact(const struct oracle_answer *answer, const struct ray_hit *hit)
{
    bool is_tied = false;
    for (uint32_t i = 0; answer->outcome == ORACLE_HIT && i < answer->tied_count; i++)
        is_tied |= hit->primitive - answer->tied[i].primitive < answer->tied[i].count;
    return is_tied;
}

struct verdicts verdicts_of(const struct trial *trial, const struct subject *subject)
{
    struct verdicts verdicts = {.rays = trial->count};
    for (uint32_t i = 0; i < trial->count; i++) {
        struct ray_hit hit;
        double t_rel_err;
        bool is_hit = subject_trace(subject, &trial->rays[i], &hit, NULL);
        enum oracle_verdict verdict = oracle_judge(&trial->answers[i], is_hit ? &hit : NULL, &t_rel_err);
        bool inexact = verdict == ORACLE_WRONG_HIT && is_inexact(&trial->answers[i], &hit);
        verdicts.hits += is_hit;
        verdicts.uncertain += verdict == ORACLE_UNDECIDED;
        verdicts.wrong_miss += verdict == ORACLE_WRONG_MISS;
        verdicts.wrong_hit += verdict == ORACLE_WRONG_HIT && !inexact;
        verdicts.inexact += inexact;
        verdicts.wrong_primitive += verdict == ORACLE_WRONG_PRIMITIVE;
        if (t_rel_err > verdicts.t_rel_err_max)
            verdicts.t_rel_err_max = t_rel_err;
    }
    return verdicts;
}

uint64_t verdicts_wrong(const struct verdicts *verdicts)
{
    return verdicts->wrong_miss + verdicts->wrong_hit + verdicts->wrong_primitive;
}
