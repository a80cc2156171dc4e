/* SPDX-License-Identifier: Apache-2.0 */
/*
 * bake_points.c - bakes opacity micromaps of random triangles in random textures, and compares their states with the
 * alpha test at random points, in double.
 *
 *     bake_points [COUNT [SEED]]
 *
 * COUNT is the number of points (1,000,000 by default). Textures are of 1 x 1 to some hundred texels a side: smooth,
 * noisy, of one value, leaves and fences, with all wrap modes, filters, alpha modes and cutoffs; triangles are of all
 * sizes, over thousands of repeats, degenerate and far away. At each point the micro-triangle is looked up as the
 * traversal does, and the texture coordinate is computed in one of the ways in which shaders do it, in floats, or
 * moved as far as the bake was told that samplers may be off. A state that is certain has to agree with the alpha
 * there. Points where alpha equals the cutoff but for 10^-9 are counted as uncertain. It prints each failure; the exit
 * status is 1 if there was any.
 */
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "builder/micromap/bake.h"
#include "tests/support/random.h"
#include "tests/support/scene/cutouts.h"

enum { TRIANGLES = 32, POINTS_A_TRIANGLE = 128, SIZE_MAX_TEXELS = 300 };

struct run {
    struct random random;
    struct memory memory;
    uint64_t points, certain, uncertain, wrong;
    float extra[2]; /* how far samplers may be off, besides rounding */
};

struct texture {
    struct alpha_source source;
    unsigned char texels[SIZE_MAX_TEXELS * SIZE_MAX_TEXELS];
};

static uint64_t choose(struct run *run, uint64_t count)
{
    return (random_next(&run->random) >> 16) % count;
}

/* ---- textures ---- */

static void draw(struct run *run, struct texture *texture)
{
    const uint32_t width = texture->source.width, height = texture->source.height;
    const uint64_t kind = choose(run, 6), seed = random_next(&run->random);
    struct random noise = {seed};
    const double a = random_between(&noise, 0.02, 0.6), b = random_between(&noise, 0.02, 0.6);
    const double gain = random_between(&noise, 30, 2000);
    if (kind < 2 && width == height) {
        cutout_draw(kind == 0 ? CUTOUT_LEAF : CUTOUT_FENCE, width, texture->texels);
        return;
    }
    for (uint32_t y = 0; y < height; y++)
        for (uint32_t x = 0; x < width; x++) {
            double value = 127.5 + gain * (sin(a * x + 2 * sin(b * y)) + cos(b * y));
            if (kind == 4)
                value = (double)(random_next(&noise) >> 56);
            if (kind == 5)
                value = seed % 3 == 0 ? 0 : seed % 3 == 1 ? 255 : 127;
            texture->texels[y * width + x] = (unsigned char)fmin(255, fmax(0, value));
        }
}

static void make_texture(struct run *run, struct texture *texture)
{
    static const float cutoffs[] = {0.5f, 0, 1, 0.25f, 128 / 255.0f, 0.9f, -1, 2, 0x1p-30f};
    const uint32_t shapes[] = {1, 2, 3, 16, 31, 64, 100, 128, 256, 300};
    struct alpha_source *source = &texture->source;
    *source = (struct alpha_source){
        .width = shapes[choose(run, 10)],
        .wrap_u = (enum bake_wrap)choose(run, 3),
        .wrap_v = (enum bake_wrap)choose(run, 3),
        .is_nearest = choose(run, 2),
        .mode = choose(run, 4) == 0 ? BAKE_BLEND : BAKE_MASK,
        .cutoff = choose(run, 3) ? cutoffs[0] : cutoffs[choose(run, sizeof cutoffs / sizeof cutoffs[0])],
    };
    source->height = choose(run, 2) ? source->width : shapes[choose(run, 10)];
    source->row_stride = source->width;
    source->texels = (struct bytes){texture->texels, (uint64_t)source->width * source->height};
    draw(run, texture);
}

/* ---- triangles ---- */

static void make_triangle(struct run *run, float corners[3][2])
{
    const double size = pow(10, random_between(&run->random, -3, choose(run, 4) ? 0.5 : 4));
    const double away = choose(run, 3) ? 1 : pow(10, random_between(&run->random, 0, 5));
    double origin[2] = {random_between(&run->random, -away, away), random_between(&run->random, -away, away)};
    for (int corner = 0; corner < 3; corner++)
        for (int axis = 0; axis < 2; axis++)
            corners[corner][axis] = (float)(origin[axis] + random_between(&run->random, -size, size));
    switch (choose(run, 12)) {
    case 0: /* a card */
        memcpy(corners, ((const float[3][2]){{0, 0}, {1, 0}, {0, 1}}), 3 * sizeof corners[0]);
        break;
    case 1: /* a line along an axis */
        corners[0][1] = corners[1][1] = corners[2][1];
        break;
    case 2: /* a line of three points */
        for (int axis = 0; axis < 2; axis++)
            corners[2][axis] = (corners[0][axis] + corners[1][axis]) / 2;
        break;
    case 3: /* a point */
        memcpy(corners[1], corners[0], sizeof corners[0]);
        memcpy(corners[2], corners[0], sizeof corners[0]);
        break;
    case 4: /* on texels of powers of two */
        for (int axis = 0; axis < 6; axis++)
            corners[axis / 2][axis % 2] = rintf(corners[axis / 2][axis % 2] * 64) / 64;
        break;
    default:
        break;
    }
}

/* ---- points ---- */

static double wrapped(enum bake_wrap wrap, double texel, double size)
{
    if (wrap == BAKE_CLAMP_TO_EDGE)
        return fmin(fmax(texel, 0), size - 1);
    const double period = wrap == BAKE_REPEAT ? size : 2 * size, within = texel - floor(texel / period) * period;
    return within < size ? within : period - 1 - within;
}

static double texel_at(const struct texture *texture, double x, double y)
{
    const struct alpha_source *source = &texture->source;
    const size_t column = (size_t)wrapped(source->wrap_u, x, source->width);
    return texture->texels[(size_t)wrapped(source->wrap_v, y, source->height) * source->width + column];
}

/* Filtered alpha, from 0 to 255. */
static double alpha_at(const struct texture *texture, const double at[2])
{
    double x = at[0] * texture->source.width, y = at[1] * texture->source.height;
    if (texture->source.is_nearest)
        return texel_at(texture, floor(x), floor(y));
    x -= 0.5;
    y -= 0.5;
    const double i = floor(x), j = floor(y), s = x - i, t = y - j;
    return (1 - t) * ((1 - s) * texel_at(texture, i, j) + s * texel_at(texture, i + 1, j)) +
           t * ((1 - s) * texel_at(texture, i, j + 1) + s * texel_at(texture, i + 1, j + 1));
}

/* Chooses barycentrics inside the triangle: anywhere, on edges, at corners, on the lines of a level. */
static void choose_weights(struct run *run, unsigned level, float ret_weights[2])
{
    double u = random_between(&run->random, 0, 1), v = random_between(&run->random, 0, 1);
    const double parts = ldexp(1, (int)level);
    switch (choose(run, 6)) {
    case 0:
        u = choose(run, 2) ? 0 : floor(u * parts) / parts;
        break;
    case 1:
        v = choose(run, 2) ? 0 : floor(v * parts) / parts;
        break;
    case 2:
        v = choose(run, 2) ? 1 - u : floor((u + v) * parts) / parts - u;
        break;
    case 3:
        u = rint(u * parts) / parts;
        v = rint(v * parts) / parts;
        break;
    default:
        break;
    }
    u = fmin(1, fmax(0, u));
    v = fmin(1, fmax(0, v));
    ret_weights[0] = (float)(u + v > 1 ? 1 - u : u);
    ret_weights[1] = (float)(u + v > 1 ? 1 - v : v);
}

/* Computes the texture coordinate in one of the ways of shaders, or exactly. */
static void interpolate(struct run *run, const float corners[3][2], const float weights[2], double ret_at[2])
{
    const float u = weights[0], v = weights[1], w = 1 - u - v;
    const uint64_t manner = choose(run, 4);
    for (int axis = 0; axis < 2; axis++) {
        const float a = corners[0][axis], b = corners[1][axis], c = corners[2][axis];
        if (manner == 0)
            ret_at[axis] = (double)(w * a + u * b + v * c);
        else if (manner == 1)
            ret_at[axis] = (double)(a + u * (b - a) + v * (c - a));
        else if (manner == 2)
            ret_at[axis] = (double)fmaf(v, c, fmaf(u, b, w * a));
        else
            ret_at[axis] = (1 - (double)u - (double)v) * (double)a + (double)u * (double)b + (double)v * (double)c;
    }
}

static void print_failure(const struct run *run, const struct texture *texture, const float corners[3][2],
                          const float weights[2], enum micro_state state, double alpha)
{
    const struct alpha_source *source = &texture->source;
    if (run->wrong > 20)
        return;
    printf("wrong: state %d where alpha is %.9g, mode %d, cutoff %g, %u x %u, wrap %d %d, nearest %d\n", state,
           alpha / 255, source->mode, (double)source->cutoff, source->width, source->height, source->wrap_u,
           source->wrap_v, source->is_nearest);
    printf("  u %a, v %a, corners (%a %a) (%a %a) (%a %a)\n", (double)weights[0], (double)weights[1],
           (double)corners[0][0], (double)corners[0][1], (double)corners[1][0], (double)corners[1][1],
           (double)corners[2][0], (double)corners[2][1]);
}

/* Compares the state at a point with alpha. */
static void judge_point(struct run *run, const struct texture *texture, const float corners[3][2],
                        const float weights[2], enum micro_state state)
{
    const struct alpha_source *source = &texture->source;
    double at[2];
    interpolate(run, corners, weights, at);
    for (int axis = 0; axis < 2; axis++)
        at[axis] += (double)run->extra[axis] * random_between(&run->random, -1, 1);
    const double alpha = alpha_at(texture, at), cutoff = (double)source->cutoff * 255;
    bool is_opaque = source->mode == BAKE_BLEND ? alpha >= 255 : alpha >= cutoff;
    const bool is_transparent = source->mode == BAKE_BLEND ? alpha <= 0 : !is_opaque;
    const bool is_near = source->mode == BAKE_BLEND ? fmin(alpha, 255 - alpha) < 1e-9 && alpha > 0 && alpha < 255
                                                    : fabs(alpha - cutoff) < 1e-5;
    run->points++;
    if (state >= MICRO_UNKNOWN_TRANSPARENT)
        return;
    run->certain++;
    if (state == MICRO_OPAQUE ? is_opaque : is_transparent)
        return;
    if (is_near) {
        run->uncertain++;
        return;
    }
    run->wrong++;
    print_failure(run, texture, corners, weights, state, alpha);
}

static void judge_triangle(struct run *run, const struct texture *texture, const struct baked *baked, uint32_t i,
                           const float corners[3][2], unsigned level)
{
    for (int point = 0; point < POINTS_A_TRIANGLE; point++) {
        float weights[2];
        choose_weights(run, level, weights);
        const uint32_t index = baked->indices[i];
        enum micro_state state = (enum micro_state)(~index & 3);
        if (index < baked->triangle_count) {
            const struct micromap_triangle *triangle = &baked->triangles[index];
            state = micro_triangle_state(baked->data + triangle->offset, MICRO_4_STATE,
                                         micro_triangle_index(weights[0], weights[1], triangle->level));
        }
        judge_point(run, texture, corners, weights, state);
    }
}

static void run_texture(struct run *run, struct texture *texture)
{
    float corners[3 * TRIANGLES][2];
    struct build_context context = {.memory = &run->memory, .parallel = &parallel_serial};
    struct baked baked;
    struct bvhd_error error;
    make_texture(run, texture);
    for (int i = 0; i < TRIANGLES; i++)
        make_triangle(run, corners + 3 * i);
    const unsigned level = (unsigned)choose(run, 7) + (choose(run, 16) == 0);
    for (int axis = 0; axis < 2; axis++)
        run->extra[axis] = choose(run, 4) ? 0 : (float)random_between(&run->random, 0, 0.02);
    struct bake_request request = {.texture = texture->source,
                                   .coordinates = (const float(*)[2])corners,
                                   .coordinate_count = 3 * TRIANGLES,
                                   .triangle_count = TRIANGLES,
                                   .extra = {run->extra[0], run->extra[1]},
                                   .format = MICRO_4_STATE,
                                   .level = choose(run, 8) ? level : BAKE_LEVEL_AUTO,
                                   .last_level = level,
                                   .worth = 1e-4,
                                   .budget = UINT64_MAX};
    if (bake(&request, &context, &baked, &error) != BVHD_OK) {
        printf("refused: %s\n", error.text);
        run->wrong++;
        return;
    }
    for (uint32_t i = 0; i < TRIANGLES; i++)
        judge_triangle(run, texture, &baked, i, (const float(*)[2])corners + 3 * i, level);
    bake_finish(&baked, &run->memory);
}

int main(int argc, char **argv)
{
    static struct texture texture;
    const uint64_t count = argc > 1 ? strtoull(argv[1], NULL, 10) : 1000000;
    struct run run = {.random = {argc > 2 ? strtoull(argv[2], NULL, 10) : 1}};
    memory_init(&run.memory, UINT64_MAX);
    while (run.points < count && run.wrong < 1000)
        run_texture(&run, &texture);
    printf("%" PRIu64 " points: %" PRIu64 " in certain states, %" PRIu64 " wrong, %" PRIu64 " uncertain\n", run.points,
           run.certain, run.wrong, run.uncertain);
    return run.wrong > 0 || run.certain == 0 || run.memory.live != 0 ? 1 : 0;
}
