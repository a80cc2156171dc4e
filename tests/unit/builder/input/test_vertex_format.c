/* SPDX-License-Identifier: Apache-2.0 */
/* test_vertex_format.c - tests that every vertex format decodes each value, and reads nothing outside. */
#include "tests/support/unit.h"

#include <math.h>
#include <sys/mman.h>
#include <unistd.h>

#include "builder/input/vertex_format.h"
#include "proto/base/vertex_element.h"

enum kind { UNORM, SNORM, SFLOAT, PACKED };

/* The formats' numbers and properties, written down a second time from the Vulkan specification. */
static const struct expected {
    uint32_t format;
    const char *name;
    enum kind kind;
    unsigned bits, components;
} expected[] = {
    {16, "R8G8_UNORM", UNORM, 8, 2},
    {17, "R8G8_SNORM", SNORM, 8, 2},
    {24, "R8G8B8_SNORM", SNORM, 8, 3},
    {37, "R8G8B8A8_UNORM", UNORM, 8, 4},
    {38, "R8G8B8A8_SNORM", SNORM, 8, 4},
    {64, "A2B10G10R10_UNORM_PACK32", PACKED, 10, 4},
    {77, "R16G16_UNORM", UNORM, 16, 2},
    {78, "R16G16_SNORM", SNORM, 16, 2},
    {83, "R16G16_SFLOAT", SFLOAT, 16, 2},
    {85, "R16G16B16_SNORM", SNORM, 16, 3},
    {90, "R16G16B16_SFLOAT", SFLOAT, 16, 3},
    {91, "R16G16B16A16_UNORM", UNORM, 16, 4},
    {92, "R16G16B16A16_SNORM", SNORM, 16, 4},
    {97, "R16G16B16A16_SFLOAT", SFLOAT, 16, 4},
    {103, "R32G32_SFLOAT", SFLOAT, 32, 2},
    {106, "R32G32B32_SFLOAT", SFLOAT, 32, 3},
    {109, "R32G32B32A32_SFLOAT", SFLOAT, 32, 4},
    {115, "R64G64_SFLOAT", SFLOAT, 64, 2},
    {118, "R64G64B64_SFLOAT", SFLOAT, 64, 3},
    {121, "R64G64B64A64_SFLOAT", SFLOAT, 64, 4},
};

enum { EXPECTED = sizeof expected / sizeof expected[0] };

static uint32_t bits_of(float value)
{
    uint32_t bits;
    memcpy(&bits, &value, sizeof bits);
    return bits;
}

static double half_value(unsigned half)
{
    int exponent = half >> 10 & 31, mantissa = half & 1023;
    double magnitude = exponent == 31 ? (mantissa ? NAN : INFINITY)
                       : exponent     ? ldexp(1024 + mantissa, exponent - 25)
                                      : ldexp(mantissa, -24);
    return half & 0x8000 ? -magnitude : magnitude;
}

/* Returns the value that the bits `raw` of a component stand for. */
static double value_of(const struct expected *format, uint64_t raw)
{
    int64_t number = (int64_t)(raw << (64 - format->bits)) >> (64 - format->bits);
    double value;
    switch (format->kind) {
    case UNORM:
    case PACKED:
        return (double)raw / (double)((1u << format->bits) - 1);
    case SNORM:
        value = (double)number / (double)((1u << (format->bits - 1)) - 1);
        return value < -1 ? -1 : value;
    default:
        return half_value((unsigned)raw);
    }
}

static void list_is_complete(void **state)
{
    (void)state;
    uint32_t count;
    const struct vertex_format *formats = vertex_formats(&count);
    assert_int_equal(count, EXPECTED);
    for (unsigned i = 0; i < EXPECTED; i++) {
        const struct vertex_format *format = vertex_format_find(expected[i].format);
        unsigned read = expected[i].components < 3 ? expected[i].components : 3;
        assert_non_null(format);
        assert_true(format >= formats && format < formats + count);
        assert_string_equal(format->name, expected[i].name);
        assert_int_equal(format->size, expected[i].kind == PACKED ? 4 : read * expected[i].bits / 8);
        assert_int_equal(format->alignment, expected[i].kind == PACKED ? 4 : expected[i].bits / 8);
    }
    static const uint32_t others[] = {0, 1, 15, 18, 65, 98, 107, 112, 122, 126, UINT32_MAX};
    for (unsigned i = 0; i < sizeof others / sizeof others[0]; i++)
        assert_null(vertex_format_find(others[i]));
}

static void put(unsigned char *element, const struct expected *format, unsigned component, uint64_t raw)
{
    if (format->kind == PACKED) {
        uint32_t word;
        memcpy(&word, element, 4);
        word = (word & ~(UINT32_C(0x3ff) << 10 * component)) | (uint32_t)raw << 10 * component;
        memcpy(element, &word, 4);
    } else {
        memcpy(element + component * format->bits / 8, &raw, format->bits / 8);
    }
}

static void assert_value(float got, double want)
{
    if (want != want)
        assert_true(got != got);
    else
        assert_int_equal(bits_of(got), bits_of((float)want));
}

/* Decodes every value of components of up to 16 bits; the other components have other values. */
static void small_components_decode(void **state)
{
    (void)state;
    for (unsigned f = 0; f < EXPECTED; f++) {
        const struct expected *format = &expected[f];
        if (format->bits > 16)
            continue;
        uint64_t mask = (UINT64_C(1) << format->bits) - 1;
        for (uint64_t raw = 0; raw <= mask; raw++) {
            unsigned char element[8] = {0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff};
            uint64_t values[3] = {raw, (raw * 7 + 1) & mask, (raw ^ 0x2aa) & mask};
            float position[4] = {0, 0, 0, 42};
            for (unsigned i = 0; i < 3 && i < format->components; i++)
                put(element, format, i, values[i]);
            vertex_format_find(format->format)->decode(element, 16, 1, position);
            for (unsigned i = 0; i < 3; i++)
                assert_value(position[i], i < format->components ? value_of(format, values[i]) : 0);
            assert_true(position[3] == 42);
        }
    }
}

/* 32-bit floats are copied bit for bit, signalling NaNs included. */
static void floats_are_copied(void **state)
{
    (void)state;
    static const uint32_t patterns[8] = {0,          0x80000000, 0x3f800000, 0x7f800001,
                                         0xffc12345, 0x00000001, 0x7f800000, 0xff7fffff};
    static const uint32_t formats[3] = {103, 106, 109};
    for (int f = 0; f < 3; f++)
        for (unsigned words = f == 0 ? 2 : 3; words < 7; words++) {
            uint32_t source[64], positions[24];
            unsigned count = 64 / words < 8 ? 64 / words : 8;
            for (unsigned i = 0; i < 64; i++)
                source[i] = patterns[i * 5 % 8] ^ (i & 2);
            vertex_format_find(formats[f])->decode((const unsigned char *)source, 4 * words, count, (float *)positions);
            for (unsigned i = 0; i < 3 * count; i++)
                assert_int_equal(positions[i], f == 0 && i % 3 == 2 ? 0 : source[i / 3 * words + i % 3]);
        }
}

static void doubles_are_rounded(void **state)
{
    (void)state;
    static const struct {
        double value;
        uint32_t bits;
    } cases[] = {
        {1.0, 0x3f800000},
        {-0.0, 0x80000000},
        {1.0 + 0x1p-24, 0x3f800000}, /* a tie, which rounds to even */
        {1.0 + 0x3p-24, 0x3f800002},
        {1.0 + 0x1.000001p-24, 0x3f800001},
        {0x1p-149, 0x00000001},
        {0x1p-150, 0x00000000},
        {0x1.8p-149, 0x00000002},
        {-0x1.fffffep127, 0xff7fffff},
        {0x1.ffffffp127, 0x7f800000},
        {1e300, 0x7f800000},
        {-INFINITY, 0xff800000},
        {NAN, 0x7fc00000},
        {-NAN, 0x7fc00000},
    };
    for (unsigned i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        double element[4] = {cases[i].value, 2, cases[i].value, NAN};
        float position[3];
        for (uint32_t format = 115; format <= 121; format += 3) {
            vertex_format_find(format)->decode((const unsigned char *)element, 32, 1, position);
            assert_int_equal(bits_of(position[0]), cases[i].bits);
            assert_int_equal(bits_of(position[1]), 0x40000000);
            assert_int_equal(bits_of(position[2]), format == 115 ? 0 : cases[i].bits);
        }
    }
}

/*
 * The last element ends where the memory ends, and starts at every alignment; there is no memory for a fourth
 * component.
 */
static void nothing_outside_is_read(void **state)
{
    (void)state;
    size_t page = (size_t)sysconf(_SC_PAGESIZE);
    unsigned char *memory = mmap(NULL, 3 * page, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    assert_true(memory != MAP_FAILED);
    assert_int_equal(mprotect(memory, page, PROT_NONE), 0);
    assert_int_equal(mprotect(memory + 2 * page, page, PROT_NONE), 0);
    for (size_t i = 0; i < page; i++)
        memory[page + i] = (unsigned char)(i * 31 + 7);

    for (unsigned f = 0; f < EXPECTED; f++) {
        const struct vertex_format *format = vertex_format_find(expected[f].format);
        for (uint64_t stride = 0; stride < 40; stride++) {
            float many[3 * 17], one[3];
            unsigned char *source = memory + 2 * page - format->size - 16 * stride;
            format->decode(source, stride, 17, many);
            for (unsigned i = 0; i < 17; i++) {
                format->decode(source + i * stride, 0, 1, one);
                assert_memory_equal(many + 3 * i, one, sizeof one);
            }
        }
        float first[3];
        format->decode(memory + page, 64, 1, first);
        format->decode(memory + page, 64, 0, NULL);
    }
    munmap(memory, 3 * page);
}

/* Radii are decoded as the components of vertices of their format are. */
static void radii_are_decoded(void **state)
{
    (void)state;
    static const uint32_t expected_sizes[][2] = {{RADIUS_FLOAT16, 2}, {RADIUS_FLOAT32, 4}};
    for (int i = 0; i < 2; i++) {
        assert_int_equal(radius_format_find(expected_sizes[i][0])->format, expected_sizes[i][0]);
        assert_int_equal(radius_format_find(expected_sizes[i][0])->size, expected_sizes[i][1]);
        assert_int_equal(radius_element_find(expected_sizes[i][0])->size, expected_sizes[i][1]);
    }
    assert_null(radius_format_find(106));
    for (uint32_t half = 0; half < 1 << 16; half += 3) {
        const uint16_t halves[6] = {(uint16_t)half, 0, (uint16_t)(half + 1), 0, (uint16_t)(half + 2), 0};
        float radii[3], position[3];
        radius_format_find(RADIUS_FLOAT16)->decode((const unsigned char *)halves, 4, 3, radii);
        for (int k = 0; k < 3; k++) {
            vertex_format_find(83)->decode((const unsigned char *)&halves[2 * k], 0, 1, position);
            assert_int_equal(bits_of(radii[k]), bits_of(position[0]));
        }
    }
    const uint32_t floats[4] = {0x3f800000, 0x7fc12345, 0xff812345, 0x80000001};
    for (uint64_t stride = 0; stride < 3; stride++) {
        float radii[4];
        radius_format_find(RADIUS_FLOAT32)
            ->decode((const unsigned char *)floats, 4 * stride, stride < 2 ? 4 : 2, radii);
        for (uint64_t k = 0; k < (stride < 2 ? 4 : 2); k++)
            assert_int_equal(bits_of(radii[k]), floats[stride * k]);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(list_is_complete),        cmocka_unit_test(small_components_decode),
        cmocka_unit_test(floats_are_copied),       cmocka_unit_test(doubles_are_rounded),
        cmocka_unit_test(nothing_outside_is_read), cmocka_unit_test(radii_are_decoded),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
