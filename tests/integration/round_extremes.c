/* SPDX-License-Identifier: Apache-2.0 */
/*
 * round_extremes.c - builds spheres and linear swept spheres of extreme shapes in every quality, and compares rays
 * through them with brute force: long chains, huge radii, one place for all, cones that are almost flat, and more.
 *
 *     round_extremes [SIZE [RAYS]]
 *
 * SIZE is the number of primitives (100,000 by default), RAYS that of rays through each scene (200). It prints each
 * failure; the exit status is 1 if there was any.
 */
#include <float.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "builder/format/portable.h"
#include "builder/traverse/traverse.h"
#include "builder/update/batch.h"
#include "client/bvhctl/oracle/rays.h"
#include "tests/support/builder/box_judge.h"
#include "tests/support/random.h"

/* A vertex is a centre and a radius, tightly packed. */
struct strand {
    uint32_t count; /* primitives */
    float (*vertices)[4];
    uint32_t *first_ends; /* of successive swept spheres; NULL: spheres, one a vertex */
    bool has_caps;
};

struct run {
    struct memory memory;
    struct build_context context;
    uint64_t failures, rays, hits, uncertain;
};

static void *allocate(size_t count, size_t size)
{
    void *block = calloc(count, size);
    if (!block) {
        fprintf(stderr, "round_extremes: no memory\n");
        exit(1);
    }
    return block;
}

/* ---- scenes ---- */

static void put(float vertex[4], double x, double y, double z, double radius)
{
    vertex[0] = (float)x;
    vertex[1] = (float)y;
    vertex[2] = (float)z;
    vertex[3] = (float)radius;
}

/* One chain that winds up, each part of which touches the next ones. */
static void coil(struct random *random, uint32_t i, uint32_t count, float vertex[4])
{
    double turn = 0.05 * i, up = 4.0 * i / count;
    put(vertex, cos(turn) + 1e-3 * random_between(random, -1, 1), sin(turn), up, 0.01);
}

/* Straight, so that all joints are on one line, and ever thinner. */
static void needle(struct random *random, uint32_t i, uint32_t count, float vertex[4])
{
    (void)random;
    put(vertex, 3.0 * i / count, 2.0 * i / count, 1.0 * i / count, 0.1 * (count - i) / count);
}

static void one_place(struct random *random, uint32_t i, uint32_t count, float vertex[4])
{
    (void)random;
    (void)i;
    (void)count;
    put(vertex, 0.5, 0.25, -1, 0.75);
}

/* One in the other: swept spheres swallow each other. */
static void shells(struct random *random, uint32_t i, uint32_t count, float vertex[4])
{
    put(vertex, 1e-4 * random_between(random, -1, 1), 0, 0, 1 + 1.0 * i / count);
}

/* Each sphere is in the next one, or out of it by very little. */
static void flat_cones(struct random *random, uint32_t i, uint32_t count, float vertex[4])
{
    double step = 1.0 / (1 + i % 64);
    (void)count;
    put(vertex, (i % 2) * step + i / 64 % 50, i / 3200, 0,
        0.3 + (i % 2) * step * (1 + 1e-6 * random_between(random, -2, 2)));
}

/* Radii of 1e30 round small spheres, which no ray from inside hits. */
static void giants(struct random *random, uint32_t i, uint32_t count, float vertex[4])
{
    (void)count;
    put(vertex, random_between(random, -1, 1), random_between(random, -1, 1), random_between(random, -1, 1),
        i % 1000 == 999 ? 1e30 : 0.01);
}

static void far_away(struct random *random, uint32_t i, uint32_t count, float vertex[4])
{
    (void)i;
    (void)count;
    put(vertex, 1e6 + random_between(random, -100, 100), -3e6 + random_between(random, -100, 100),
        random_between(random, -100, 100), 8);
}

/* Magnitudes from the smallest float to the largest. */
static void powers(struct random *random, uint32_t i, uint32_t count, float vertex[4])
{
    double size = pow(10, -44.0 + 82.0 * i / count);
    put(vertex, size, size * random_between(random, 0, 1), -size, size * 0.2);
}

/* Most are inactive, degenerate, or cannot be hit. */
static void odd(struct random *random, uint32_t i, uint32_t count, float vertex[4])
{
    static const float values[] = {NAN, INFINITY, -INFINITY, -0.0f, FLT_TRUE_MIN, FLT_MAX};
    (void)count;
    put(vertex, random_between(random, -1, 1), random_between(random, -1, 1), random_between(random, -1, 1), 0.02);
    if (i % 4 != 0)
        vertex[random_next(random) % 3] = values[random_next(random) % 6];
    if (i % 4 == 2)
        vertex[3] = values[random_next(random) % 2 ? 0 : 3 + random_next(random) % 2];
}

static void nothing(struct random *random, uint32_t i, uint32_t count, float vertex[4])
{
    (void)random;
    (void)i;
    (void)count;
    put(vertex, NAN, 0, 0, 1);
}

static const struct {
    const char *name;
    void (*make)(struct random *random, uint32_t i, uint32_t count, float vertex[4]);
} scenes[] = {
    {"coil", coil},         {"needle", needle},         {"one place", one_place},
    {"shells", shells},     {"flat cones", flat_cones}, {"giants", giants},
    {"far away", far_away}, {"powers", powers},         {"odd", odd},
    {"nothing", nothing},
};

/* Makes spheres, or a chain of swept spheres with caps at its ends or without. */
static struct strand make_strand(size_t scene, uint32_t count, bool is_swept, bool has_caps)
{
    struct random random = {scene + 1};
    struct strand strand = {.count = count, .has_caps = has_caps};
    strand.vertices = allocate((size_t)count + 1, sizeof *strand.vertices);
    for (uint32_t i = 0; i <= count; i++)
        scenes[scene].make(&random, i, count + 1, strand.vertices[i]);
    strand.first_ends = is_swept ? allocate(count, sizeof *strand.first_ends) : NULL;
    for (uint32_t i = 0; is_swept && i < count; i++)
        strand.first_ends[i] = i;
    return strand;
}

static struct geometry geometry_of(const struct strand *strand)
{
    const uint64_t vertices = (uint64_t)strand->count + (strand->first_ends != NULL);
    const unsigned char *data = (const unsigned char *)strand->vertices;
    const struct geometry_spheres arrays = {
        .vertex_format = 106,
        .radius_format = 100,
        .index_type = strand->first_ends ? INDEX_UINT32 : INDEX_NONE,
        .vertex_stride = 16,
        .radius_stride = 16,
        .index_stride = 4,
        .vertices = {data, 16 * vertices},
        .radii = {data + 12, 16 * vertices - 12},
        .indices = {(const unsigned char *)strand->first_ends, strand->first_ends ? 4 * (uint64_t)strand->count : 0}};
    struct geometry geometry = {.type = GEOMETRY_SPHERES, .range = {.primitive_count = strand->count}};
    geometry.spheres = arrays;
    if (strand->first_ends) {
        geometry.type = GEOMETRY_SWEPT_SPHERES;
        geometry.swept_spheres = (struct geometry_swept_spheres){
            arrays, SWEPT_SUCCESSIVE, strand->has_caps ? SWEPT_CAPS_CHAINED : SWEPT_CAPS_NONE};
    }
    return geometry;
}

/* ---- judging ---- */

/* What the oracle knows of a strand. */
struct model {
    struct oracle_mesh mesh;
    float (*centres)[3];
    float *radii;
    uint32_t *indices; /* two a swept sphere */
    uint8_t *caps;
};

static struct model model_of(const struct strand *strand)
{
    struct model model = {.centres = allocate((size_t)strand->count + 1, sizeof *model.centres),
                          .radii = allocate((size_t)strand->count + 1, sizeof *model.radii),
                          .indices = allocate((size_t)strand->count + 1, 2 * sizeof *model.indices),
                          .caps = allocate((size_t)strand->count + 1, 1)};
    for (uint32_t i = 0; i <= strand->count; i++) {
        memcpy(model.centres[i], strand->vertices[i], sizeof model.centres[i]);
        model.radii[i] = strand->vertices[i][3];
        model.indices[2 * (size_t)i] = i;
        model.indices[2 * (size_t)i + 1] = i + 1;
        if (strand->has_caps)
            model.caps[i] = ORACLE_CAP_SECOND | (i == 0 ? ORACLE_CAP_FIRST : 0);
    }
    model.mesh = (struct oracle_mesh){.shape = strand->first_ends ? ORACLE_SWEPT_SPHERES : ORACLE_SPHERES,
                                      .positions = model.centres[0],
                                      .indices = strand->first_ends ? model.indices : NULL,
                                      .radii = model.radii,
                                      .caps = model.caps,
                                      .primitive_count = strand->count,
                                      .instance = RAY_NO_INSTANCE};
    return model;
}

static void model_finish(struct model *model)
{
    free(model->centres);
    free(model->radii);
    free(model->indices);
    free(model->caps);
}

static void fail(struct run *run, const char *what, const char *how)
{
    run->failures++;
    if (run->failures <= 20)
        fprintf(stderr, "round_extremes: %s: %s\n", what, how);
}

static void judge(struct run *run, const struct portable_view *view, const char *what, const struct ray *rays,
                  const struct oracle_answer *answers, uint32_t count)
{
    const struct scene scene = {.bottoms = &view, .bottom_count = 1};
    for (uint32_t i = 0; i < count; i++) {
        struct ray_hit hit = {0};
        const bool is_hit = traverse(&scene, &rays[i], NULL, &hit, NULL);
        const enum oracle_verdict verdict = oracle_judge(&answers[i], is_hit ? &hit : NULL, NULL);
        char how[300];
        run->rays++;
        run->hits += is_hit;
        run->uncertain += verdict == ORACLE_UNDECIDED;
        if (verdict <= ORACLE_UNDECIDED || box_judge_is_beyond_floats(&rays[i], answers[i].t_end))
            continue;
        snprintf(how, sizeof how, "verdict %d: t %.9g of primitive %u instead of %.9g, ray (%a %a %a) + t (%a %a %a)",
                 (int)verdict, (double)hit.t, hit.primitive, answers[i].t, (double)rays[i].origin[0],
                 (double)rays[i].origin[1], (double)rays[i].origin[2], (double)rays[i].direction[0],
                 (double)rays[i].direction[1], (double)rays[i].direction[2]);
        fail(run, what, how);
    }
}

static void run_quality(struct run *run, const struct strand *strand, enum build_quality quality, const char *what,
                        const struct ray *rays, const struct oracle_answer *answers, uint32_t count)
{
    const struct geometry geometry = geometry_of(strand);
    const struct build_input input = {.type = STRUCTURE_BOTTOM,
                                      .geometry_count = 1,
                                      .geometries = &geometry,
                                      .options = {.quality = quality, .target = TARGET_PORTABLE}};
    const struct limits limits = limits_default();
    struct batch_item item;
    struct bvhd_error error;
    struct portable_view view;
    if (batch_build(&input, 1, &limits, &run->context, &item, &error) != BVHD_OK) {
        fail(run, what, error.text);
        return;
    }
    if (item.status != BVHD_OK)
        fail(run, what, item.error.text);
    else if (portable_open((struct bytes){item.blob, item.size}, &run->memory, &view, &error) != BVHD_OK)
        fail(run, what, error.text);
    else
        judge(run, &view, what, rays, answers, count);
    batch_finish(&item, 1, &run->memory);
}

static void run_scene(struct run *run, size_t scene, uint32_t size, uint32_t count, bool is_swept, bool has_caps)
{
    struct strand strand = make_strand(scene, size, is_swept, has_caps);
    struct model model = model_of(&strand);
    struct ray *rays = allocate(count, sizeof *rays);
    struct oracle_answer *answers = allocate(count, sizeof *answers);
    struct bvhd_error error;
    char what[64];
    snprintf(what, sizeof what, "%s, %s", scenes[scene].name, !is_swept ? "spheres" : has_caps ? "capped" : "open");
    const uint64_t before = run->hits, doubts = run->uncertain;
    rays_make(&model.mesh, 1, scene, count, rays);
    if (oracle_trace(&model.mesh, 1, rays, count, &run->memory, &parallel_serial, NULL, NULL, answers, &error) !=
        BVHD_OK) {
        fail(run, what, error.text);
    } else {
        for (enum build_quality quality = QUALITY_FAST; quality <= QUALITY_HIGH; quality++)
            run_quality(run, &strand, quality, what, rays, answers, count);
        oracle_finish(answers, count, &run->memory);
    }
    printf("%-20s %llu hits, %llu uncertain of %u rays\n", what, (unsigned long long)(run->hits - before),
           (unsigned long long)(run->uncertain - doubts), 3 * count);
    free(rays);
    free(answers);
    model_finish(&model);
    free(strand.vertices);
    free(strand.first_ends);
}

int main(int argc, char **argv)
{
    const uint32_t size = argc > 1 ? (uint32_t)strtoul(argv[1], NULL, 10) : 100000,
                   count = argc > 2 ? (uint32_t)strtoul(argv[2], NULL, 10) : 200;
    struct run run = {0};
    memory_init(&run.memory, UINT64_C(4) << 30);
    run.context = (struct build_context){.memory = &run.memory, .parallel = &parallel_serial};
    for (size_t scene = 0; scene < sizeof scenes / sizeof scenes[0]; scene++) {
        run_scene(&run, scene, size, count, false, false);
        run_scene(&run, scene, size, count, true, true);
        run_scene(&run, scene, size, count, true, false);
    }
    if (run.memory.live)
        fail(&run, "memory", "something is left");
    printf("%llu rays: %llu hits, %llu uncertain, %llu wrong\n", (unsigned long long)run.rays,
           (unsigned long long)run.hits, (unsigned long long)run.uncertain, (unsigned long long)run.failures);
    return run.failures || run.hits < run.rays / 5;
}
