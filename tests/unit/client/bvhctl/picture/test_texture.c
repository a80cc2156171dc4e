/* SPDX-License-Identifier: Apache-2.0 */
/* test_texture.c - tests textures: what is outside of the image, mixing of pixels, smaller copies. */
#include "tests/support/unit.h"

#include <math.h>

#include "client/bvhctl/picture/texture.h"

enum { WIDTH = 4, HEIGHT = 2 };

/* Red is the number of the column, green that of the row, in steps of 50. */
static unsigned char pixels[WIDTH * HEIGHT * 4];
static const struct import_image image = {WIDTH, HEIGHT, pixels};

static void make_pixels(void)
{
    for (int i = 0; i < WIDTH * HEIGHT; i++) {
        pixels[4 * i] = (unsigned char)(50 * (i % WIDTH));
        pixels[4 * i + 1] = (unsigned char)(50 * (i / WIDTH));
        pixels[4 * i + 2] = 0;
        pixels[4 * i + 3] = 255;
    }
}

static void open_texture(struct texture *texture, struct memory *memory)
{
    make_pixels();
    memory_init(memory, UINT64_MAX);
    assert_true(texture_init(texture, &image, memory));
}

static void close_texture(struct texture *texture, const struct memory *memory)
{
    texture_finish(texture);
    texture_finish(texture);
    assert_int_equal(memory->live, 0);
}

static void expect_pixel(const struct texture *texture, enum import_wrap wrap, double u, double v, int column, int row)
{
    const struct texture_filter filter = {.wrap = {wrap, wrap}, .is_pixelated = true};
    struct texture_colour colour = texture_sample(texture, u, v, &filter);
    assert_true(fabs(colour.rgb.x - texture_linear((unsigned char)(50 * column))) < 1e-9);
    assert_true(fabs(colour.rgb.y - texture_linear((unsigned char)(50 * row))) < 1e-9);
    assert_true(fabs(colour.alpha - 1) < 1e-9);
}

static void test_wrap(void **state)
{
    (void)state;
    struct memory memory;
    struct texture texture;
    open_texture(&texture, &memory);
    expect_pixel(&texture, IMPORT_REPEAT, 0.1, 0.1, 0, 0);
    expect_pixel(&texture, IMPORT_REPEAT, 0.9, 0.9, 3, 1);
    expect_pixel(&texture, IMPORT_REPEAT, 1.3, 0.1, 1, 0);
    expect_pixel(&texture, IMPORT_REPEAT, -0.1, -0.1, 3, 1);
    expect_pixel(&texture, IMPORT_REPEAT, -7.6, 5.2, 1, 0);
    expect_pixel(&texture, IMPORT_CLAMP, -5, -5, 0, 0);
    expect_pixel(&texture, IMPORT_CLAMP, 5, 0.1, 3, 0);
    expect_pixel(&texture, IMPORT_MIRROR, 1.1, 0.1, 3, 0);
    expect_pixel(&texture, IMPORT_MIRROR, -0.1, 0.1, 0, 0);
    expect_pixel(&texture, IMPORT_MIRROR, 1.9, 1.9, 0, 0);
    expect_pixel(&texture, IMPORT_MIRROR, 2.1, 1.1, 0, 1);
    close_texture(&texture, &memory);
}

/* Coordinates of any magnitude find a pixel. */
static void test_any_coordinates(void **state)
{
    (void)state;
    static const double places[] = {0, 1, -1, 1e-300, 1e10, -1e30, 1e300, INFINITY, -INFINITY, NAN};
    static const enum import_wrap wraps[] = {IMPORT_REPEAT, IMPORT_CLAMP, IMPORT_MIRROR};
    struct memory memory;
    struct texture texture;
    open_texture(&texture, &memory);
    for (size_t i = 0; i < sizeof places / sizeof *places; i++)
        for (size_t k = 0; k < 6; k++) {
            const struct texture_filter filter = {
                .wrap = {wraps[k % 3], wraps[k % 3]}, .is_pixelated = k > 2, .level = places[i]};
            struct texture_colour colour = texture_sample(&texture, places[i], places[9 - i], &filter);
            assert_true(colour.rgb.x >= 0 && colour.rgb.x <= 1 && fabs(colour.alpha - 1) < 1e-9);
        }
    close_texture(&texture, &memory);
}

/* Between the middles of two pixels their colours are mixed, in linear light. */
static void test_mixing(void **state)
{
    (void)state;
    struct memory memory;
    struct texture texture;
    const struct texture_filter filter = {.wrap = {IMPORT_CLAMP, IMPORT_CLAMP}};
    open_texture(&texture, &memory);
    struct texture_colour colour = texture_sample(&texture, 0.5, 0.25, &filter);
    assert_true(fabs(colour.rgb.x - (texture_linear(50) + texture_linear(100)) / 2) < 1e-9);
    assert_true(fabs(texture_sample(&texture, 0.375, 0.25, &filter).rgb.x - texture_linear(50)) < 1e-9);
    close_texture(&texture, &memory);
}

/* The smallest copy is the mean of all pixels; the colour of transparent ones does not count. */
static void test_levels(void **state)
{
    (void)state;
    struct memory memory;
    struct texture texture;
    struct texture_filter filter = {.wrap = {IMPORT_REPEAT, IMPORT_REPEAT}, .level = 99};
    open_texture(&texture, &memory);
    assert_int_equal(texture.level_count, 3);
    double mean = (texture_linear(50) + texture_linear(100) + texture_linear(150)) / 4;
    assert_true(fabs(texture_sample(&texture, 0.3, 0.3, &filter).rgb.x - mean) < 0.02);
    close_texture(&texture, &memory);
    for (int i = 0; i < WIDTH * HEIGHT; i++)
        pixels[4 * i + 3] = i % WIDTH == 3 ? 255 : 0;
    assert_true(texture_init(&texture, &image, &memory));
    struct texture_colour colour = texture_sample(&texture, 0.3, 0.3, &filter);
    assert_true(fabs(colour.alpha - 0.25) < 0.01 && fabs(colour.rgb.x - texture_linear(150)) < 0.02);
    close_texture(&texture, &memory);
}

static void test_no_memory(void **state)
{
    (void)state;
    struct memory memory;
    struct texture texture;
    make_pixels();
    memory_init(&memory, UINT64_MAX);
    for (int64_t after = 0; after < 2; after++) {
        atomic_store(&memory.fail_after, after);
        assert_false(texture_init(&texture, &image, &memory));
        assert_int_equal(memory.live, 0);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_wrap),   cmocka_unit_test(test_any_coordinates), cmocka_unit_test(test_mixing),
        cmocka_unit_test(test_levels), cmocka_unit_test(test_no_memory),
    };
    return cmocka_run_group_tests_name("texture", tests, NULL, NULL);
}
