/* SPDX-License-Identifier: Apache-2.0 */
#include "portable_quantise.h"

#include <float.h>

/*
 * In steps: the spare that the format promises, and a bit more than all rounding below can take away. Differences of floats are rounded to
 * double once (relative error 2^-53, at most 255 steps), so that coordinates in steps are wrong by less than 2^-44.
 */
static const double MARGIN = 1.0 / 64 + 0x1p-40;

static double power_of_two(int exponent)
{
    uint64_t bits = (uint64_t)(exponent + 1023) << 52;
    double value;
    memcpy(&value, &bits, sizeof value);
    return value;
}

static float next_down(float value)
{
    uint32_t bits;
    if (value == 0)
        return -0x1p-149f;
    memcpy(&bits, &value, sizeof bits);
    bits += value > 0 ? UINT32_C(0xffffffff) : 1;
    memcpy(&value, &bits, sizeof value);
    return value;
}

/* The biased exponent of the smallest float power of two that is >= value > 0; at least 1. */
static int exponent_above(double value)
{
    uint64_t bits;
    memcpy(&bits, &value, sizeof bits);
    int exponent = (int)(bits >> 52) - 1023 + ((bits & ((UINT64_C(1) << 52) - 1)) != 0);
    return exponent + 127 > 1 ? exponent + 127 : 1;
}

/* The largest float with room for the margin below `low`. */
static float origin_below(float low, double step, double inverse)
{
    double wanted = low - step * MARGIN;
    if (wanted <= -FLT_MAX)
        return -FLT_MAX;
    float origin = (float)wanted;
    while (((double)low - origin) * inverse < MARGIN && origin > -FLT_MAX)
        origin = next_down(origin);
    return origin;
}

struct grid {
    float origin;
    double inverse; /* of the step */
    uint8_t exponent;
};

static struct grid fit_grid(float low, float high)
{
    int exponent = exponent_above(((double)high - low) / (255 - 2 * MARGIN));
    for (;; exponent++) {
        double inverse = power_of_two(127 - exponent);
        float origin = origin_below(low, power_of_two(exponent - 127), inverse);
        if (((double)high - origin) * inverse + MARGIN <= 255)
            return (struct grid){origin, inverse, (uint8_t)exponent};
    }
}

/* Truncation rounds down what is not negative, and up when counted from the other end. */
static void quantise(const float min[8], const float max[8], const struct grid *grid, uint8_t ret_lo[8], uint8_t ret_hi[8])
{
    int32_t lo[8], hi[8];
    double origin = grid->origin, inverse = grid->inverse;
    for (int slot = 0; slot < 8; slot++)
        lo[slot] = (int32_t)((min[slot] - origin) * inverse - MARGIN);
    for (int slot = 0; slot < 8; slot++)
        hi[slot] = 256 - (int32_t)(256 - ((max[slot] - origin) * inverse + MARGIN));
    for (int slot = 0; slot < 8; slot++) {
        ret_lo[slot] = (uint8_t)lo[slot];
        ret_hi[slot] = (uint8_t)hi[slot];
    }
}

static void clear_empty(unsigned occupied, uint8_t lo[8], uint8_t hi[8])
{
    for (int slot = 0; slot < 8; slot++)
        if (!(occupied >> slot & 1)) {
            lo[slot] = 255;
            hi[slot] = 0;
        }
}

void portable_quantise(const struct portable_boxes *boxes, unsigned occupied, struct portable_node *ret_node)
{
    for (int axis = 0; axis < 3; axis++) {
        const float *min = boxes->min[axis], *max = boxes->max[axis];
        float low = min[0], high = max[0];
        for (int slot = 1; slot < 8; slot++) {
            low = min[slot] < low ? min[slot] : low;
            high = max[slot] > high ? max[slot] : high;
        }
        uint8_t *lo = ret_node->lo[axis], *hi = ret_node->hi[axis];
        struct grid grid = {low, 0, 0};
        if (low < high) {
            grid = fit_grid(low, high);
            quantise(min, max, &grid, lo, hi);
        } else {
            memset(lo, 0, 8);
            memset(hi, 0, 8);
        }
        ret_node->origin[axis] = grid.origin;
        ret_node->exponent[axis] = grid.exponent;
        if (occupied != 0xff)
            clear_empty(occupied, lo, hi);
    }
}
