/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/input/vertex_format.h"

#include <stdbool.h>
#include <string.h>

#include "proto/base/vertex_element.h"

static float float_of_bits(uint32_t bits)
{
    float value;
    memcpy(&value, &bits, sizeof value);
    return value;
}

static inline float from_unorm8(uint8_t value)
{
    return (float)value / 255.0f;
}

static inline float from_snorm8(int8_t value)
{
    float quotient = (float)value / 127.0f;
    return quotient < -1.0f ? -1.0f : quotient;
}

static inline float from_unorm16(uint16_t value)
{
    return (float)value / 65535.0f;
}

static inline float from_snorm16(int16_t value)
{
    float quotient = (float)value / 32767.0f;
    return quotient < -1.0f ? -1.0f : quotient;
}

/*
 * Converts exactly, keeping the payload of a NaN. Denormals go through an integer, so that no operation has a denormal
 * float as its input.
 */
static inline float from_half(uint16_t half)
{
    uint32_t sign = (uint32_t)(half & 0x8000) << 16, magnitude = half & 0x7fff;
    float denormal = (float)(int32_t)magnitude * 0x1p-24f;
    uint32_t denormal_bits;
    memcpy(&denormal_bits, &denormal, sizeof denormal_bits);

    uint32_t bias = magnitude >= 0x7c00 ? (255u - 31u) << 23 : (127u - 15u) << 23;
    uint32_t normal_bits = (magnitude << 13) + bias;
    return float_of_bits(sign | (magnitude < 0x0400 ? denormal_bits : normal_bits));
}

/* Rounds to the nearest float. Processors differ in what becomes of a NaN's payload, so all NaNs become one. */
static inline float from_double(double value)
{
    return value != value ? float_of_bits(UINT32_C(0x7fc00000)) : (float)value;
}

/*
 * Elements may be unaligned, so memcpy reads them. The loop over components is unrolled, because their number is
 * constant.
 */
#define DECODER(name, type, components, convert)                                                                       \
    static void decode_##name(const unsigned char *source, uint64_t stride, uint64_t count, float *ret_positions)      \
    {                                                                                                                  \
        for (uint64_t i = 0; i < count; i++, source += stride, ret_positions += 3) {                                   \
            type element[components];                                                                                  \
            memcpy(element, source, sizeof element);                                                                   \
            ret_positions[0] = convert(element[0]);                                                                    \
            ret_positions[1] = convert(element[1]);                                                                    \
            ret_positions[2] = components == 3 ? convert(element[components - 1]) : 0.0f;                              \
        }                                                                                                              \
    }

DECODER(R8G8_UNORM, uint8_t, 2, from_unorm8)
DECODER(R8G8_SNORM, int8_t, 2, from_snorm8)
DECODER(R8G8B8_SNORM, int8_t, 3, from_snorm8)
DECODER(R8G8B8A8_UNORM, uint8_t, 3, from_unorm8)
DECODER(R16G16_UNORM, uint16_t, 2, from_unorm16)
DECODER(R16G16_SNORM, int16_t, 2, from_snorm16)
DECODER(R16G16_SFLOAT, uint16_t, 2, from_half)
DECODER(R16G16B16_SNORM, int16_t, 3, from_snorm16)
DECODER(R16G16B16_SFLOAT, uint16_t, 3, from_half)
DECODER(R16G16B16A16_UNORM, uint16_t, 3, from_unorm16)
DECODER(R64G64_SFLOAT, double, 2, from_double)
DECODER(R64G64B64_SFLOAT, double, 3, from_double)

/* These formats differ from others only by a fourth component, which is not read. */
#define decode_R8G8B8A8_SNORM decode_R8G8B8_SNORM
#define decode_R16G16B16A16_SNORM decode_R16G16B16_SNORM
#define decode_R16G16B16A16_SFLOAT decode_R16G16B16_SFLOAT
#define decode_R32G32B32A32_SFLOAT decode_R32G32B32_SFLOAT
#define decode_R64G64B64A64_SFLOAT decode_R64G64B64_SFLOAT

static void decode_A2B10G10R10_UNORM_PACK32(const unsigned char *source, uint64_t stride, uint64_t count,
                                            float *ret_positions)
{
    for (uint64_t i = 0; i < count; i++, source += stride, ret_positions += 3) {
        uint32_t element;
        memcpy(&element, source, sizeof element);
        for (unsigned axis = 0; axis < 3; axis++)
            ret_positions[axis] = (float)(int32_t)(element >> 10 * axis & 0x3ff) / 1023.0f;
    }
}

static void decode_R32G32_SFLOAT(const unsigned char *source, uint64_t stride, uint64_t count, float *ret_positions)
{
    for (uint64_t i = 0; i < count; i++, source += stride, ret_positions += 3) {
        memcpy(ret_positions, source, 2 * sizeof(float));
        ret_positions[2] = 0.0f;
    }
}

static void decode_R32G32B32_SFLOAT(const unsigned char *source, uint64_t stride, uint64_t count, float *ret_positions)
{
    if (stride == 3 * sizeof(float)) {
        memcpy(ret_positions, source, count * stride);
        return;
    }
    for (uint64_t i = 0; i < count; i++, source += stride, ret_positions += 3)
        memcpy(ret_positions, source, 3 * sizeof(float));
}

static const struct vertex_format formats[] = {
#define VERTEX_FORMAT(name, value, size, alignment) {value, #name, size, alignment, decode_##name},
#include "proto/base/vertex_formats.def"
#undef VERTEX_FORMAT
};

enum { FORMAT_COUNT = sizeof formats / sizeof formats[0] };

const struct vertex_format *vertex_format_find(uint32_t format)
{
    for (unsigned i = 0; i < FORMAT_COUNT; i++)
        if (formats[i].format == format)
            return &formats[i];
    return NULL;
}

const struct vertex_format *vertex_formats(uint32_t *ret_count)
{
    *ret_count = FORMAT_COUNT;
    return formats;
}

static void decode_halves(const unsigned char *source, uint64_t stride, uint64_t count, float *ret_radii)
{
    for (uint64_t i = 0; i < count; i++, source += stride) {
        uint16_t element;
        memcpy(&element, source, sizeof element);
        ret_radii[i] = from_half(element);
    }
}

static void decode_floats(const unsigned char *source, uint64_t stride, uint64_t count, float *ret_radii)
{
    for (uint64_t i = 0; i < count; i++, source += stride)
        memcpy(&ret_radii[i], source, sizeof *ret_radii);
}

const struct radius_format *radius_format_find(uint32_t format)
{
    static const struct radius_format radii[] = {
        {RADIUS_FLOAT16, sizeof(uint16_t), decode_halves},
        {RADIUS_FLOAT32, sizeof(float), decode_floats},
    };
    for (unsigned i = 0; i < sizeof radii / sizeof radii[0]; i++)
        if (radii[i].format == format)
            return &radii[i];
    return NULL;
}
