/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/support/builder/random_format.h"

#include <math.h>
#include <string.h>

#include "tests/support/builder/random_input.h"

static const struct random_format formats[] = {
    {16, UNORM8, 2, 2}, {17, SNORM8, 2, 2},  {24, SNORM8, 3, 3},  {37, UNORM8, 3, 4},  {38, SNORM8, 3, 4},
    {64, PACKED, 3, 1}, {77, UNORM16, 2, 2}, {78, SNORM16, 2, 2}, {83, HALF, 2, 2},    {85, SNORM16, 3, 3},
    {90, HALF, 3, 3},   {91, UNORM16, 3, 4}, {92, SNORM16, 3, 4}, {97, HALF, 3, 4},    {103, FLOAT, 2, 2},
    {106, FLOAT, 3, 3}, {109, FLOAT, 3, 4},  {115, DOUBLE, 2, 2}, {118, DOUBLE, 3, 3}, {121, DOUBLE, 3, 4},
};

static const uint32_t component_sizes[] = {
    [UNORM8] = 1, [SNORM8] = 1, [UNORM16] = 2, [SNORM16] = 2, [HALF] = 2, [FLOAT] = 4, [DOUBLE] = 8, [PACKED] = 4};

const struct random_format *random_format_any(struct random *random)
{
    return &formats[random_below(random, sizeof formats / sizeof formats[0])];
}

const struct random_format *random_format_radius(struct random *random)
{
    static const struct random_format radii[] = {{100, FLOAT, 1, 1}, {100, FLOAT, 1, 1}, {76, HALF, 1, 1}};
    return &radii[random_below(random, sizeof radii / sizeof radii[0])];
}

uint32_t random_format_unit(const struct random_format *format)
{
    return component_sizes[format->component];
}

uint32_t random_format_read_size(const struct random_format *format)
{
    return component_sizes[format->component] * (format->component == PACKED ? 1 : format->read);
}

uint64_t random_format_stride(const struct random_format *format, struct random *random)
{
    uint64_t component = random_format_unit(format), element = component * format->stored;
    if (random_chance(random, 0.5))
        return element;
    if (random_chance(random, 0.05))
        return 0;
    if (random_chance(random, 0.05))
        return component;
    return element + component * random_below(random, 7);
}

static double half_value(uint16_t bits)
{
    int exponent = bits >> 10 & 31, fraction = bits & 1023;
    double size = exponent == 0    ? ldexp(fraction, -24)
                  : exponent == 31 ? (fraction ? NAN : INFINITY)
                                   : ldexp(1024 + fraction, exponent - 25);
    return bits & 0x8000 ? -size : size;
}

/* Rounds towards zero; numbers that are too small become 0. */
static uint16_t half_bits(double value)
{
    int exponent;
    double fraction = frexp(fabs(value), &exponent);
    uint16_t sign = signbit(value) ? 0x8000 : 0;
    if (isnan(value))
        return 0x7e01;
    if (fabs(value) >= 65536)
        return sign | 0x7c00;
    if (exponent < -13)
        return sign;
    return (uint16_t)(sign | (exponent + 14) << 10 | ((int)(fraction * 2048) & 1023));
}

static void encode(enum random_component component, double value, unsigned char *ret_bytes)
{
    double unit = fmin(fmax(isnan(value) ? 0 : value, -1), 1);
    uint8_t u8 = (uint8_t)lrint(255 * fabs(unit));
    int8_t s8 = (int8_t)lrint(127.6 * unit - 0.5); /* -128 is possible */
    uint16_t u16 = component == HALF ? half_bits(value) : (uint16_t)lrint(65535 * fabs(unit));
    int16_t s16 = (int16_t)lrint(32767 * unit);
    float f = (float)value;
    switch (component) {
    case UNORM8:
        memcpy(ret_bytes, &u8, 1);
        break;
    case SNORM8:
        memcpy(ret_bytes, &s8, 1);
        break;
    case SNORM16:
        memcpy(ret_bytes, &s16, 2);
        break;
    case FLOAT:
        memcpy(ret_bytes, &f, 4);
        break;
    case DOUBLE:
        memcpy(ret_bytes, &value, 8);
        break;
    default:
        memcpy(ret_bytes, &u16, 2);
        break;
    }
}

static float decode(enum random_component component, const unsigned char *bytes)
{
    uint16_t u16 = 0;
    int16_t s16;
    float f;
    double d;
    memcpy(&u16, bytes, component_sizes[component] == 1 ? 1 : 2);
    memcpy(&s16, &u16, 2);
    switch (component) {
    case UNORM8:
        return (float)(bytes[0] / 255.0);
    case SNORM8:
        return (float)fmax((int8_t)bytes[0] / 127.0, -1);
    case UNORM16:
        return (float)(u16 / 65535.0);
    case SNORM16:
        return (float)fmax(s16 / 32767.0, -1);
    case HALF:
        return (float)half_value(u16);
    case FLOAT:
        memcpy(&f, bytes, 4);
        return f;
    default:
        memcpy(&d, bytes, 8);
        return (float)d;
    }
}

void random_format_encode(const struct random_format *format, const double position[3], unsigned char *ret_element)
{
    if (format->component == PACKED) {
        uint32_t word = 3u << 30;
        for (int axis = 0; axis < 3; axis++)
            word |= (uint32_t)lrint(1023 * fmin(fabs(position[axis]), 1)) << 10 * axis;
        memcpy(ret_element, &word, 4);
        return;
    }
    for (uint32_t i = 0; i < format->read; i++)
        encode(format->component, position[i], ret_element + i * component_sizes[format->component]);
}

void random_format_decode(const struct random_format *format, const unsigned char *element, float ret_position[3])
{
    uint32_t word;
    ret_position[1] = ret_position[2] = 0;
    if (format->component == PACKED) {
        memcpy(&word, element, 4);
        for (int axis = 0; axis < 3; axis++)
            ret_position[axis] = (float)((word >> 10 * axis & 1023) / 1023.0);
        return;
    }
    for (uint32_t i = 0; i < format->read; i++)
        ret_position[i] = decode(format->component, element + i * component_sizes[format->component]);
}
