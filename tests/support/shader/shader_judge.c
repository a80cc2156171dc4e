/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/support/shader/shader_judge.h"

#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { SHOWN = 5 };

static void *allocate(uint64_t count, size_t size)
{
    void *block = calloc((size_t)count + 1, size);
    if (!block) {
        fprintf(stderr, "shader judge: no memory\n");
        exit(1);
    }
    return block;
}

enum candidate_verdict shader_judge_candidate(void *context, const struct ray *ray, const struct candidate_space *space,
                                              struct ray_hit *hit)
{
    (void)ray;
    (void)space;
    switch (*(const enum shader_policy *)context) {
    case SHADER_IGNORE:
        return CANDIDATE_IGNORE;
    case SHADER_SOME:
        return shader_policy_accepts(hit->instance, hit->geometry, hit->primitive) ? CANDIDATE_ACCEPT
                                                                                   : CANDIDATE_IGNORE;
    case SHADER_END:
        return CANDIDATE_ACCEPT_AND_END;
    default:
        return CANDIDATE_ACCEPT;
    }
}

/* ---- comparing ---- */

struct ray_hit shader_judge_hit(const struct shader_intersection *hit)
{
    return (struct ray_hit){.t = hit->t,
                            .u = hit->u,
                            .v = hit->v,
                            .instance = hit->instance,
                            .custom_index = hit->custom_index,
                            .sbt_offset = hit->sbt_offset,
                            .geometry = hit->geometry,
                            .primitive = hit->primitive,
                            .front_face = hit->flags & 1,
                            .is_aabb = hit->flags & 2,
                            .is_sphere = hit->flags & 4,
                            .is_swept_sphere = hit->flags & 8};
}

static bool same_primitive(const struct ray_hit *a, const struct ray_hit *b)
{
    return a->instance == b->instance && a->custom_index == b->custom_index && a->sbt_offset == b->sbt_offset &&
           a->geometry == b->geometry && a->primitive == b->primitive && a->front_face == b->front_face &&
           a->is_aabb == b->is_aabb && a->is_sphere == b->is_sphere && a->is_swept_sphere == b->is_swept_sphere;
}

/*
 * Whether two values are equal up to some last bits. The entry into an AABB is rounded at the distance of the ray's
 * origin.
 */
static bool near(float a, float b, double share, double slack)
{
    return a == b || fabs((double)a - b) <= share * fabs((double)b) + slack;
}

static double reach_of(const struct ray *ray)
{
    double reach = 0, speed = 0;
    for (int axis = 0; axis < 3; axis++) {
        reach = fmax(reach, fabs(ray->origin[axis]));
        speed = fmax(speed, fabs(ray->direction[axis]));
    }
    return reach / speed;
}

bool shader_judge_same(const struct ray *ray, const struct ray_hit *a, const struct ray_hit *b)
{
    if (!same_primitive(a, b))
        return false;
    if (a->is_aabb)
        return near(a->t, b->t, 1e-5, 1e-5 * reach_of(ray));
    return near(a->t, b->t, 0x1p-22, 0x1p-140) && near(a->u, b->u, 0, 1e-6) && near(a->v, b->v, 0, 1e-6);
}

static void show(const char *what, const char *verdict, const struct ray *ray, const struct ray_hit *ours,
                 const struct ray_hit *cpu, const struct oracle_answer *answer)
{
    printf("%s: %s: shader ", what, verdict);
    if (ours)
        printf("t %.9g (%u.%u.%u)", (double)ours->t, ours->instance, ours->geometry, ours->primitive);
    else
        printf("nothing");
    if (cpu)
        printf(", CPU t %.9g (%u.%u.%u)", (double)cpu->t, cpu->instance, cpu->geometry, cpu->primitive);
    else
        printf(", CPU nothing");
    if (answer)
        printf(", reference %d t %.12g in %.12g .. %.12g", (int)answer->outcome, answer->t, answer->t_low,
               answer->t_high);
    printf("; ray (%a %a %a) + t (%a %a %a), %a .. %a, flags %x\n", (double)ray->origin[0], (double)ray->origin[1],
           (double)ray->origin[2], (double)ray->direction[0], (double)ray->direction[1], (double)ray->direction[2],
           (double)ray->tmin, (double)ray->tmax, ray->flags);
}

/* A ray whose answers differ. */
struct difference {
    struct ray ray;
    bool is_hit, is_cpu_hit;
    struct ray_hit hit, cpu;
};

/*
 * Whether an AABB is involved. The reference has no AABBs, and rounding can decide which of two entries is nearer, or
 * whether one is hit.
 */
static bool is_about_boxes(const struct difference *difference)
{
    return (difference->is_hit && difference->hit.is_aabb) || (difference->is_cpu_hit && difference->cpu.is_aabb);
}

static bool is_about_flat(const struct shader_still *still, const struct difference *difference)
{
    return (difference->is_hit && shader_still_is_flat(still, difference->hit.instance)) ||
           (difference->is_cpu_hit && shader_still_is_flat(still, difference->cpu.instance));
}

static void judge_one(const char *what, const struct shader_still *still, const struct difference *difference,
                      const struct oracle_answer *answer, struct shader_tally *tally)
{
    static const char *const names[] = {"right", "uncertain", "wrong miss", "wrong hit", "wrong primitive"};
    if (is_about_boxes(difference)) {
        tally->boxes++;
        return;
    }
    if (is_about_flat(still, difference)) {
        tally->uncertain++;
        return;
    }
    enum oracle_verdict verdict = oracle_judge(answer, difference->is_hit ? &difference->hit : NULL, NULL);
    tally->right += verdict == ORACLE_RIGHT;
    tally->uncertain += verdict == ORACLE_UNDECIDED;
    if (verdict > ORACLE_UNDECIDED && tally->certain++ < SHOWN)
        show(what, names[verdict], &difference->ray, difference->is_hit ? &difference->hit : NULL,
             difference->is_cpu_hit ? &difference->cpu : NULL, answer);
}

static void judge_differences(const char *what, const struct scene *scene, const struct shader_case *shared,
                              const struct difference *differences, uint32_t count, const struct parallel *parallel,
                              struct memory *memory, struct shader_tally *tally)
{
    struct bvhd_error error;
    struct shader_meshes meshes;
    struct shader_still still;
    struct ray *rays = allocate(count, sizeof *rays);
    struct oracle_answer *answers = allocate(count, sizeof *answers);
    for (uint32_t i = 0; i < count; i++)
        rays[i] = differences[i].ray;
    shader_still_make(scene, rays[0].time, &still);
    shader_meshes_make(&still.scene, shared, &meshes);
    if (oracle_trace(meshes.meshes, meshes.count, rays, count, memory, parallel, NULL, NULL, answers, &error) !=
        BVHD_OK) {
        fprintf(stderr, "shader judge: %s: %s\n", error.where, error.text);
        exit(1);
    }
    for (uint32_t i = 0; i < count; i++)
        judge_one(what, &still, &differences[i], &answers[i], tally);
    oracle_finish(answers, count, memory);
    shader_meshes_finish(&meshes);
    shader_still_finish(&still);
    free(answers);
    free(rays);
}

void shader_judge(const char *what, const struct scene *scene, const struct shader_case *shared, const struct ray *rays,
                  uint32_t count, const struct shader_answer *answers, const struct parallel *parallel,
                  struct memory *memory, struct shader_tally *tally)
{
    enum shader_policy policy = shared->policy;
    struct traverse_options options = {.candidate = shader_judge_candidate, .context = &policy};
    bool ends_early = shared->flags & RAY_TERMINATE_ON_FIRST_HIT || shared->policy == SHADER_END;
    struct difference *differences = allocate(count, sizeof *differences);
    uint32_t differing = 0;
    for (uint32_t i = 0; i < count; i++) {
        struct difference difference = {.ray = rays[i], .is_hit = answers[i].type != 0};
        difference.hit = shader_judge_hit(&answers[i].hit);
        difference.is_cpu_hit = traverse(scene, &rays[i], &options, &difference.cpu, NULL);
        tally->hits += difference.is_cpu_hit;
        bool is_same = difference.is_hit == difference.is_cpu_hit;
        if (is_same && difference.is_hit && !ends_early) {
            is_same = shader_judge_same(&rays[i], &difference.hit, &difference.cpu);
            tally->other_bits += is_same && difference.hit.t != difference.cpu.t;
        }
        if (!is_same)
            differences[differing++] = difference;
    }
    tally->rays += count;
    tally->differing += differing;
    if (differing)
        judge_differences(what, scene, shared, differences, differing, parallel, memory, tally);
    free(differences);
}
