/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/picture/smooth.h"

#include <math.h>
#include <string.h>

enum { PASSES = 4, REACH = 2 };

struct rgb {
    float at[3];
};

struct pass {
    const struct pixel *pixels;
    const struct rgb *from;
    struct rgb *to;
    uint32_t width, height, step;
};

/*
 * Returns the weight of a neighbouring pixel: 1 if it is in the same plane and faces the same way. The weight falls to
 * 0 quickly, so that light does not leak around edges.
 */
static float likeness(const struct pass *pass, const struct pixel *here, const struct pixel *there)
{
    float facing = 0, apart = 0;
    for (int i = 0; i < 3; i++) {
        facing += here->normal[i] * there->normal[i];
        apart += here->normal[i] * (there->position[i] - here->position[i]);
    }
    float tolerance = 3.0f * here->depth * (float)pass->step / (float)pass->height;
    float plane = 1 - fabsf(apart) / tolerance;
    float turned = 1 - 4 * (1 - facing); /* 0 at about 40 degrees */
    return plane > 0 && turned > 0 ? plane * turned * turned : 0;
}

static void smooth_pixel(const struct pass *pass, uint32_t x, uint32_t y)
{
    static const float kernel[2 * REACH + 1] = {1, 4, 6, 4, 1};
    size_t index = (size_t)y * pass->width + x;
    const struct pixel *here = &pass->pixels[index];
    struct rgb sum = {{0}};
    float weights = 0;
    for (int dy = -REACH; dy <= REACH; dy++)
        for (int dx = -REACH; dx <= REACH; dx++) {
            int64_t u = x + (int64_t)dx * pass->step, v = y + (int64_t)dy * pass->step;
            if (u < 0 || v < 0 || u >= pass->width || v >= pass->height)
                continue;
            size_t other = (size_t)v * pass->width + (size_t)u;
            float weight = kernel[dx + REACH] * kernel[dy + REACH] * likeness(pass, here, &pass->pixels[other]);
            for (int i = 0; i < 3; i++)
                sum.at[i] += weight * pass->from[other].at[i];
            weights += weight;
        }
    for (int i = 0; i < 3; i++)
        pass->to[index].at[i] = weights > 0 ? sum.at[i] / weights : pass->from[index].at[i];
}

static void smooth_row(void *context, size_t row)
{
    const struct pass *pass = context;
    for (uint32_t x = 0; x < pass->width; x++) {
        size_t index = row * pass->width + x;
        if (pass->pixels[index].depth > 0)
            smooth_pixel(pass, x, (uint32_t)row);
        else
            pass->to[index] = pass->from[index];
    }
}

static bool smooth_ambient(struct pixel *pixels, uint32_t width, uint32_t height, const struct parallel *parallel,
                           struct memory *memory)
{
    uint64_t count = (uint64_t)width * height;
    struct rgb *buffers[2] = {memory_array(memory, count, sizeof **buffers),
                              memory_array(memory, count, sizeof **buffers)};
    bool ok = buffers[0] && buffers[1];
    for (uint64_t i = 0; i < count && ok; i++)
        memcpy(&buffers[0][i], pixels[i].ambient, sizeof **buffers);
    for (uint32_t i = 0; i < PASSES && ok; i++) {
        struct pass pass = {pixels, buffers[i % 2], buffers[1 - i % 2], width, height, 1u << i};
        parallel_for(parallel, height, smooth_row, &pass);
    }
    for (uint64_t i = 0; i < count && ok; i++)
        memcpy(pixels[i].ambient, &buffers[PASSES % 2][i], sizeof **buffers);
    memory_free(memory, buffers[0]);
    memory_free(memory, buffers[1]);
    return ok;
}

/* ---- shadows ---- */

struct shadow_pass {
    const struct pixel *pixels;
    const float *from;
    float *to;
    uint32_t width, height, step;
};

static bool is_mixed(float lit)
{
    return lit > 0.001f && lit < 0.999f;
}

/*
 * Smooths one pixel as far as its neighbourhood is one of pixels that are partly in shadow, as the soft edge of a far
 * object's shadow is. Across the sharp edge of a near one's shadow there are few of them.
 */
static float smooth_lit(const struct shadow_pass *shadows, uint32_t x, uint32_t y)
{
    const struct pass pass = {.width = shadows->width, .height = shadows->height, .step = shadows->step};
    size_t index = (size_t)y * pass.width + x;
    float sum = 0, weights = 0, mixed = 0;
    for (int dy = -REACH; dy <= REACH; dy++)
        for (int dx = -REACH; dx <= REACH; dx++) {
            int64_t u = x + (int64_t)dx * pass.step, v = y + (int64_t)dy * pass.step;
            if (u < 0 || v < 0 || u >= pass.width || v >= pass.height)
                continue;
            size_t other = (size_t)v * pass.width + (size_t)u;
            float weight = likeness(&pass, &shadows->pixels[index], &shadows->pixels[other]);
            sum += weight * shadows->from[other];
            mixed += is_mixed(shadows->pixels[other].lit) ? weight : 0;
            weights += weight;
        }
    float share = weights > 0 ? mixed / weights : 0;
    float strength = share < 0.2f ? 0 : share > 0.45f ? 1 : (share - 0.2f) * 4;
    return strength > 0 ? shadows->from[index] + strength * (sum / weights - shadows->from[index])
                        : shadows->from[index];
}

/* Returns whether a pixel or one beside it is partly in shadow. */
static bool is_near_edge(const struct shadow_pass *pass, uint32_t x, uint32_t y)
{
    uint32_t right = x + 1 < pass->width ? x + 1 : x, below = y + 1 < pass->height ? y + 1 : y;
    for (uint32_t v = y ? y - 1 : 0; v <= below; v++)
        for (uint32_t u = x ? x - 1 : 0; u <= right; u++)
            if (is_mixed(pass->pixels[(size_t)v * pass->width + u].lit))
                return true;
    return false;
}

static void smooth_lit_row(void *context, size_t row)
{
    const struct shadow_pass *pass = context;
    for (uint32_t x = 0; x < pass->width; x++) {
        size_t index = row * pass->width + x;
        bool is_smoothed = pass->pixels[index].depth > 0 && is_near_edge(pass, x, (uint32_t)row);
        pass->to[index] = is_smoothed ? smooth_lit(pass, x, (uint32_t)row) : pass->from[index];
    }
}

static bool smooth_shadows(struct pixel *pixels, uint32_t width, uint32_t height, uint32_t passes,
                           const struct parallel *parallel, struct memory *memory)
{
    uint64_t count = (uint64_t)width * height;
    float *buffers[2] = {memory_array(memory, count, sizeof **buffers), memory_array(memory, count, sizeof **buffers)};
    bool ok = buffers[0] && buffers[1];
    for (uint64_t i = 0; i < count && ok; i++)
        buffers[0][i] = pixels[i].lit;
    for (uint32_t i = 0; i < passes && ok; i++) {
        struct shadow_pass pass = {pixels, buffers[i % 2], buffers[1 - i % 2], width, height, 1u << i};
        parallel_for(parallel, height, smooth_lit_row, &pass);
    }
    for (uint64_t i = 0; i < count && ok; i++)
        pixels[i].lit = buffers[passes % 2][i];
    memory_free(memory, buffers[0]);
    memory_free(memory, buffers[1]);
    return ok;
}

/* Returns how often shadows are smoothed: of many samples there is less noise, and the smooth edges of what moves. */
static uint32_t shadow_passes(uint32_t samples)
{
    return samples < 16 ? 2 : samples < 64 ? 1 : 0;
}

bool smooth_light(struct pixel *pixels, uint32_t width, uint32_t height, uint32_t samples,
                  const struct parallel *parallel, struct memory *memory)
{
    return smooth_ambient(pixels, width, height, parallel, memory) &&
           smooth_shadows(pixels, width, height, shadow_passes(samples), parallel, memory);
}
