/* SPDX-License-Identifier: Apache-2.0 */
/* texture_axis.c - wraps numbers of cells and texels into the texture. */
#include "builder/micromap/texture_axis.h"

/* No footprint has as many cells, and sums with it do not overflow. */
static const int64_t endless = INT64_C(1) << 60;

struct texture_axis texture_axis_make(int64_t texels, enum bake_wrap wrap, bool is_bilinear)
{
    const bool has_border = is_bilinear && wrap != BAKE_REPEAT;
    return (struct texture_axis){
        .wrap = wrap,
        .is_bilinear = is_bilinear,
        .texels = texels,
        .cells = has_border ? texels + 1 : texels,
        .period = wrap == BAKE_REPEAT            ? texels
                  : wrap == BAKE_MIRRORED_REPEAT ? 2 * texels
                                                 : 0,
        .first_texel = has_border ? -1 : 0,
        .shift = has_border    ? 0.5
                 : is_bilinear ? -0.5
                               : 0,
    };
}

static int64_t modulo(int64_t at, int64_t period)
{
    const int64_t rest = at % period;
    return rest < 0 ? rest + period : rest;
}

int64_t texture_axis_texel_outside(const struct texture_axis *axis, int64_t at)
{
    if (axis->wrap == BAKE_CLAMP_TO_EDGE)
        return at < 0 ? 0 : axis->texels - 1;
    const int64_t within = modulo(at, axis->period);
    return within < axis->texels ? within : axis->period - 1 - within;
}

struct texture_piece texture_axis_wrapped(const struct texture_axis *axis, int64_t at)
{
    if (axis->wrap == BAKE_CLAMP_TO_EDGE)
        return at < 0 ? (struct texture_piece){0, -at, 0} : (struct texture_piece){axis->cells - 1, endless, 0};
    const int64_t within = modulo(at, axis->period);
    if (within < axis->cells)
        return (struct texture_piece){within, axis->cells - within, 1};
    /* The first and the last of the bilinear cells lie astride the mirrors, which therefore do not repeat them. */
    if (axis->is_bilinear)
        return (struct texture_piece){axis->period - within, axis->period - within, -1};
    return (struct texture_piece){axis->period - 1 - within, axis->period - within, -1};
}
