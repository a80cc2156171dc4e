/* SPDX-License-Identifier: Apache-2.0 */
/*
 * bench_bake.c - measures how fast opacity micromaps are baked, and how much they decide for their bytes.
 *
 *     bench_bake [--threads N] [--triangles N] [--turns N] [--levels FIRST LAST] [--size N] [--texels N] [--only NAME]
 *
 * The first table bakes N triangles (100,000), each over 64 x 64 texels (--texels) of a texture of 2048 x 2048 (--size)
 * at a random place and turn, at each level (4): an atlas of 16 x 16 leaves, a fence of 32 x 32 meshes, one large leaf,
 * smooth blots, and noise, where each texel is random. It prints the time of the fastest of some turns (3), in wall
 * clock and in processor time a micro-triangle, bytes of states, and the share of the triangles' area that is certain.
 *
 * The second table bakes cards of two triangles with one leaf, and quads with some meshes of a fence, at each level
 * from 1 to 8: bytes, and the share that is certain, beside the share of micro-triangles in which samples find only
 * opaque or only transparent points, which is the most that a micromap of this level can decide.
 *
 * The third one chooses levels by their worth, and under budgets, for the leaves of the first. With --only and the name
 * of a texture there is only its part of the first table.
 */
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "builder/micromap/bake.h"
#include "builder/workers.h"
#include "tests/support/random.h"
#include "tests/support/scene/cutouts.h"

enum { SAMPLES = 64 };

struct settings {
    unsigned threads, turns, first, last;
    uint32_t triangles, size;
    double texels;
    const char *only;
};

struct texture {
    const char *name;
    unsigned char *alpha;
    uint32_t size;
    bool is_nearest;
};

static void fail(const char *what)
{
    fprintf(stderr, "bench_bake: %s\n", what);
    exit(1);
}

static void *need(size_t size)
{
    void *block = calloc(size ? size : 1, 1);
    if (!block)
        fail("no memory");
    return block;
}

static double seconds(clockid_t clock)
{
    struct timespec now;
    clock_gettime(clock, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

/* A sum of waves, whose outlines are about as long as those of leaves of 64 texels. */
static void draw_blots(uint32_t size, unsigned char *alpha)
{
    for (uint32_t y = 0; y < size; y++)
        for (uint32_t x = 0; x < size; x++) {
            const double wave = sin(x * 0.05 + 3 * sin(y * 0.021)) + sin(y * 0.047 + 2 * sin(x * 0.033));
            alpha[(size_t)y * size + x] = (unsigned char)fmin(255, fmax(0, 127.5 + 400 * wave));
        }
}

static void draw_noise(uint32_t size, unsigned char *alpha)
{
    struct random random = {1};
    for (size_t i = 0; i < (size_t)size * size; i++)
        alpha[i] = (unsigned char)(random_next(&random) >> 56);
}

static struct texture draw(const char *name, uint32_t size)
{
    struct texture texture = {.name = name, .alpha = need((size_t)size * size), .size = size};
    if (strcmp(name, "leaves") == 0)
        cutout_draw_atlas(CUTOUT_LEAF, size, 16, texture.alpha);
    else if (strcmp(name, "fence") == 0)
        cutout_draw_atlas(CUTOUT_FENCE, size, 32, texture.alpha);
    else if (strcmp(name, "leaf") == 0)
        cutout_draw(CUTOUT_LEAF, size, texture.alpha);
    else if (strcmp(name, "mesh") == 0)
        cutout_draw(CUTOUT_FENCE, size, texture.alpha);
    else if (strcmp(name, "blots") == 0)
        draw_blots(size, texture.alpha);
    else
        draw_noise(size, texture.alpha);
    return texture;
}

/* Right-angled triangles with legs of so many texels, anywhere and turned anyhow. */
static float (*place_triangles(const struct settings *settings))[2]
{
    float(*coordinates)[2] = need(3 * (size_t)settings->triangles * sizeof *coordinates);
    struct random random = {7};
    const double leg = settings->texels / settings->size;
    for (uint32_t i = 0; i < settings->triangles; i++) {
        const double turn = random_between(&random, 0, 2 * acos(-1.0));
        const double s = random_between(&random, 0, 1), t = random_between(&random, 0, 1);
        const double u[2] = {leg * cos(turn), leg * sin(turn)};
        const double corners[3][2] = {{s, t}, {s + u[0], t + u[1]}, {s - u[1], t + u[0]}};
        for (int corner = 0; corner < 3; corner++)
            for (int axis = 0; axis < 2; axis++)
                coordinates[3 * i + (uint32_t)corner][axis] = (float)corners[corner][axis];
    }
    return coordinates;
}

static struct bake_request request_of(const struct texture *texture, const float (*coordinates)[2], uint32_t count,
                                      uint32_t level)
{
    const uint64_t size = texture->size;
    return (struct bake_request){.texture = {.texels = {texture->alpha, size * size},
                                             .row_stride = size,
                                             .width = texture->size,
                                             .height = texture->size,
                                             .is_nearest = texture->is_nearest,
                                             .cutoff = 0.5f},
                                 .coordinates = coordinates,
                                 .coordinate_count = 3 * count,
                                 .triangle_count = count,
                                 .format = MICRO_4_STATE,
                                 .level = level};
}

/* Bakes some times. Prints nothing; returns the result of the last time and the least times. */
static struct baked measure(const struct bake_request *request, unsigned turns, struct build_context *context,
                            double *ret_wall, double *ret_busy)
{
    struct baked baked = {0};
    struct bvhd_error error;
    *ret_wall = *ret_busy = INFINITY;
    for (unsigned turn = 0; turn < turns; turn++) {
        bake_finish(&baked, context->memory);
        const double wall = seconds(CLOCK_MONOTONIC), busy = seconds(CLOCK_PROCESS_CPUTIME_ID);
        if (bake(request, context, &baked, &error) != BVHD_OK)
            fail(error.text);
        *ret_wall = fmin(*ret_wall, seconds(CLOCK_MONOTONIC) - wall);
        *ret_busy = fmin(*ret_busy, seconds(CLOCK_PROCESS_CPUTIME_ID) - busy);
    }
    return baked;
}

static void print_speed(const struct settings *settings, struct build_context *context)
{
    static const char *const names[] = {"leaves", "fence", "leaf", "blots", "noise"};
    float(*coordinates)[2] = place_triangles(settings);
    printf("| texture | filter | level | seconds | processor s | ns a micro-triangle | MB | certain |\n");
    printf("|---|---|---|---|---|---|---|---|\n");
    for (size_t i = 0; i < 2 * sizeof names / sizeof names[0]; i++) {
        if (settings->only && strcmp(settings->only, names[i / 2]) != 0)
            continue;
        struct texture texture = draw(names[i / 2], settings->size);
        texture.is_nearest = i & 1;
        for (unsigned level = settings->first; level <= settings->last; level++) {
            const struct bake_request request =
                request_of(&texture, (const float(*)[2])coordinates, settings->triangles, level);
            double wall, busy;
            struct baked baked = measure(&request, settings->turns, context, &wall, &busy);
            printf("| %s | %s | %u | %.3f | %.3f | %.1f | %.1f | %.1f %% |\n", texture.name,
                   texture.is_nearest ? "nearest" : "bilinear", level, wall, busy,
                   1e9 * busy / ((double)settings->triangles * micro_triangle_count(level)),
                   (double)baked.data_size / 1e6, 100 * baked.statistics.decided);
            fflush(stdout);
            bake_finish(&baked, context->memory);
        }
        free(texture.alpha);
    }
    free(coordinates);
}

/* Filtered alpha, of a texture that repeats. */
static double alpha_at(const struct texture *texture, double s, double t)
{
    const double size = texture->size, x = s * size - 0.5, y = t * size - 0.5, i = floor(x), j = floor(y);
    double sum = 0;
    for (int corner = 0; corner < 4; corner++) {
        const double column = i + (corner & 1), row = j + (corner >> 1);
        const size_t at =
            (size_t)(row - floor(row / size) * size) * texture->size + (size_t)(column - floor(column / size) * size);
        sum += (1 - fabs(x - column)) * (1 - fabs(y - row)) * texture->alpha[at];
    }
    return sum;
}

/* Returns the share of micro-triangles of two triangles in which samples find both opaque and transparent points. */
static double mixed_share(const struct texture *texture, const float (*coordinates)[2], unsigned level)
{
    uint32_t mixed = 0;
    for (uint32_t i = 0; i < 2 * micro_triangle_count(level); i++) {
        const float(*triangle)[2] = coordinates + 3 * (i / micro_triangle_count(level));
        uint32_t corners[3][2];
        bool passes = false, fails = false;
        micro_triangle_corners(i % micro_triangle_count(level), level, corners);
        for (int a = 0; a <= SAMPLES; a++)
            for (int b = 0; a + b <= SAMPLES; b++) {
                const double w[3] = {(double)a / SAMPLES, (double)b / SAMPLES, (double)(SAMPLES - a - b) / SAMPLES};
                double u = 0, v = 0;
                for (int corner = 0; corner < 3; corner++) {
                    u += ldexp(w[corner] * corners[corner][0], -(int)level);
                    v += ldexp(w[corner] * corners[corner][1], -(int)level);
                }
                double at[2];
                for (int axis = 0; axis < 2; axis++)
                    at[axis] = (double)triangle[0][axis] * (1 - u - v) + (double)triangle[1][axis] * u +
                               (double)triangle[2][axis] * v;
                const bool is_opaque = alpha_at(texture, at[0], at[1]) >= 127.5;
                passes |= is_opaque;
                fails |= !is_opaque;
            }
        mixed += passes && fails;
    }
    return mixed / (2.0 * micro_triangle_count(level));
}

/* A quad with some pictures beside each other, and as many below each other. */
struct card {
    const char *name;
    uint32_t size;
    float pictures;
};

static void print_cards(struct build_context *context)
{
    static const float quad[6][2] = {{0, 0}, {1, 0}, {0, 1}, {1, 1}, {0, 1}, {1, 0}};
    static const struct card cards[] = {{"leaf", 256, 1},  {"leaf", 1024, 1}, {"mesh", 256, 1},
                                        {"mesh", 1024, 1}, {"mesh", 256, 3},  {"mesh", 256, 8}};
    printf("\n| card | texels | pictures | level | bytes | certain | at most |\n|---|---|---|---|---|---|---|\n");
    for (size_t i = 0; i < sizeof cards / sizeof cards[0]; i++) {
        struct texture texture = draw(cards[i].name, cards[i].size);
        float coordinates[6][2];
        for (int axis = 0; axis < 12; axis++)
            coordinates[axis / 2][axis % 2] = cards[i].pictures * quad[axis / 2][axis % 2];
        for (unsigned level = 1; level <= 8; level++) {
            const struct bake_request request = request_of(&texture, (const float(*)[2])coordinates, 2, level);
            double wall, busy;
            struct baked baked = measure(&request, 1, context, &wall, &busy);
            printf("| %s | %u | %g x %g | %u | %" PRIu64 " | %.1f %% |", texture.name, texture.size,
                   (double)cards[i].pictures, (double)cards[i].pictures, level, baked.data_size,
                   100 * baked.statistics.decided);
            if (level <= 6)
                printf(" %.1f %% |\n", 100 * (1 - mixed_share(&texture, (const float(*)[2])coordinates, level)));
            else
                printf(" |\n");
            bake_finish(&baked, context->memory);
        }
        free(texture.alpha);
    }
}

static void print_choices(const struct settings *settings, struct build_context *context)
{
    static const double worths[] = {1e-2, 1e-3, 3e-4, 1e-4, 3e-5, 1e-5, 1e-6};
    float(*coordinates)[2] = place_triangles(settings);
    struct texture texture = draw("leaves", settings->size);
    printf("\n| worth | budget MB | seconds | MB | certain |\n|---|---|---|---|---|\n");
    for (size_t i = 0; i < 2 * sizeof worths / sizeof worths[0]; i++) {
        struct bake_request request =
            request_of(&texture, (const float(*)[2])coordinates, settings->triangles, BAKE_LEVEL_AUTO);
        request.worth = worths[i / 2];
        request.budget = i & 1 ? 10 * (uint64_t)settings->triangles : UINT64_MAX;
        request.last_level = 8;
        double wall, busy;
        struct baked baked = measure(&request, 1, context, &wall, &busy);
        printf("| %g | %g | %.3f | %.2f | %.1f %% |\n", request.worth,
               i & 1 ? (double)request.budget / 1e6 : (double)INFINITY, wall, (double)baked.data_size / 1e6,
               100 * baked.statistics.decided);
        bake_finish(&baked, context->memory);
    }
    free(texture.alpha);
    free(coordinates);
}

int main(int argc, char **argv)
{
    struct settings settings = {
        .threads = 2, .turns = 3, .first = 4, .last = 4, .triangles = 100000, .size = 2048, .texels = 64};
    for (int i = 1; i + 1 < argc; i += 2) {
        const unsigned number = (unsigned)strtoul(argv[i + 1], NULL, 10);
        if (strcmp(argv[i], "--threads") == 0)
            settings.threads = number;
        else if (strcmp(argv[i], "--turns") == 0 && number > 0)
            settings.turns = number;
        else if (strcmp(argv[i], "--triangles") == 0)
            settings.triangles = number;
        else if (strcmp(argv[i], "--size") == 0 && number >= 64)
            settings.size = number;
        else if (strcmp(argv[i], "--texels") == 0)
            settings.texels = strtod(argv[i + 1], NULL);
        else if (strcmp(argv[i], "--only") == 0)
            settings.only = argv[i + 1];
        else if (strcmp(argv[i], "--levels") == 0 && i + 2 < argc) {
            settings.first = number;
            settings.last = (unsigned)strtoul(argv[++i + 1], NULL, 10);
        } else
            fail("see the head of bench_bake.c for its options");
    }
    struct workers *workers;
    struct bvhd_error error;
    struct memory memory;
    memory_init(&memory, UINT64_MAX);
    if (workers_create(settings.threads, &workers, &error) != BVHD_OK)
        fail(error.text);
    struct build_context context = {.memory = &memory, .parallel = workers_parallel(workers)};
    print_speed(&settings, &context);
    if (!settings.only) {
        print_cards(&context);
        print_choices(&settings, &context);
    }
    workers_destroy(workers);
    return 0;
}
