/* SPDX-License-Identifier: Apache-2.0 */
/* test_image.c - tests the decoding of PNG and JPEG images, whole and broken. */
#include "tests/support/unit.h"

#include <jpeglib.h>
#include <png.h>
#include <setjmp.h>

#include "client/bvhctl/scene/image.h"

enum { WIDTH = 24, HEIGHT = 16, ROOM = 1 << 16 };

static unsigned char file_bytes[ROOM];

/* The left half is red, the right half green, half transparent where there is alpha. */
static void fill(unsigned char *pixels, int components)
{
    for (int i = 0; i < WIDTH * HEIGHT; i++) {
        bool is_left = i % WIDTH < WIDTH / 2;
        const unsigned char rgba[4] = {is_left ? 255 : 0, is_left ? 0 : 255, 0, is_left ? 255 : 128};
        memcpy(pixels + components * i, rgba, (size_t)components);
    }
}

static struct bytes make_png(void)
{
    static unsigned char pixels[WIDTH * HEIGHT * 4];
    fill(pixels, 4);
    png_image image = {.version = PNG_IMAGE_VERSION, .width = WIDTH, .height = HEIGHT, .format = PNG_FORMAT_RGBA};
    png_alloc_size_t size = ROOM;
    assert_true(png_image_write_to_memory(&image, file_bytes, &size, 0, pixels, 0, NULL));
    return (struct bytes){file_bytes, size};
}

static struct bytes make_jpeg_of(int components, J_COLOR_SPACE space)
{
    static unsigned char pixels[WIDTH * HEIGHT * 4];
    struct jpeg_compress_struct jpeg;
    struct jpeg_error_mgr errors;
    unsigned char *data = NULL;
    unsigned long size = 0;
    fill(pixels, components);
    jpeg.err = jpeg_std_error(&errors);
    jpeg_create_compress(&jpeg);
    jpeg_mem_dest(&jpeg, &data, &size);
    jpeg.image_width = WIDTH;
    jpeg.image_height = HEIGHT;
    jpeg.input_components = components;
    jpeg.in_color_space = space;
    jpeg_set_defaults(&jpeg);
    jpeg_set_quality(&jpeg, 95, TRUE);
    jpeg_start_compress(&jpeg, TRUE);
    for (int y = 0; y < HEIGHT; y++) {
        unsigned char *row = pixels + y * WIDTH * components;
        jpeg_write_scanlines(&jpeg, &row, 1);
    }
    jpeg_finish_compress(&jpeg);
    jpeg_destroy_compress(&jpeg);
    assert_true(size <= ROOM);
    memcpy(file_bytes, data, size);
    free(data);
    return (struct bytes){file_bytes, size};
}

static struct bytes make_jpeg(void)
{
    return make_jpeg_of(3, JCS_RGB);
}

static void expect_image(struct bytes file, uint32_t limit, uint32_t width, uint32_t height, bool has_alpha)
{
    struct memory memory;
    struct import_image image;
    struct bvhd_error error = {0};
    memory_init(&memory, UINT64_MAX);
    if (image_decode(file, limit, &memory, &image, &error) != BVHD_OK)
        fail_msg("%s", error.text);
    assert_int_equal(image.width, width);
    assert_int_equal(image.height, height);
    const unsigned char *left = image.rgba + 4 * (size_t)(height / 2 * width), *right = left + 4 * (size_t)(width - 1);
    assert_true(left[0] > 240 && left[1] < 15 && left[2] < 15 && left[3] == 255);
    assert_true(right[0] < 15 && right[1] > 240 && right[2] < 15 && right[3] == (has_alpha ? 128 : 255));
    memory_free(&memory, image.rgba);
    assert_int_equal(memory.live, 0);
}

static void test_formats(void **state)
{
    (void)state;
    expect_image(make_png(), 64, WIDTH, HEIGHT, true);
    expect_image(make_jpeg(), 64, WIDTH, HEIGHT, false);
}

/* Writes a PNG by hand: its size, bits and kind of colour as stated, and rows of zeros. */
static struct bytes make_odd_png(uint32_t width, uint32_t height, int kind, int interlace)
{
    unsigned char *data = NULL;
    size_t size = 0;
    FILE *file = open_memstream((char **)&data, &size);
    png_structp png = png_create_write_struct(PNG_LIBPNG_VER_STRING, NULL, NULL, NULL);
    png_infop info = png_create_info_struct(png);
    assert_non_null(file);
    assert_int_equal(setjmp(png_jmpbuf(png)), 0);
    png_init_io(png, file);
    png_set_IHDR(png, info, width, height, 8, kind, interlace, PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
    png_write_info(png, info);
    int passes = png_set_interlace_handling(png);
    unsigned char *row = calloc(width, 4);
    for (unsigned char *at = row; at < row + 4 * (size_t)width; at += 4)
        memcpy(at, "\x10\x20\x30\x40", 4);
    for (int pass = 0; pass < passes; pass++)
        for (uint32_t y = 0; y < height; y++)
            png_write_row(png, row);
    png_write_end(png, info);
    png_destroy_write_struct(&png, &info);
    fclose(file);
    free(row);
    assert_true(size <= ROOM);
    memcpy(file_bytes, data, size);
    free(data);
    return (struct bytes){file_bytes, size};
}

static void expect_first_pixel(struct bytes file, uint32_t limit, uint32_t width, uint32_t height)
{
    struct memory memory;
    struct import_image image;
    enum bvhd_status status = BVHD_NO_MEMORY;
    for (int64_t after = 0; status != BVHD_OK; after++) {
        memory_init(&memory, UINT64_MAX);
        atomic_store(&memory.fail_after, after);
        status = image_decode(file, limit, &memory, &image, NULL);
        assert_true(after < 100);
        if (status == BVHD_OK) {
            assert_int_equal(image.width, width);
            assert_int_equal(image.height, height);
            assert_memory_equal(image.rgba, "\x10\x20\x30\x40", 4);
            memory_free(&memory, image.rgba);
        }
        assert_int_equal(memory.live, 0);
    }
}

/* Interlaced images, and images that are thinner than the factor by which they become smaller. */
static void test_odd_pngs(void **state)
{
    (void)state;
    expect_first_pixel(make_odd_png(9, 7, PNG_COLOR_TYPE_RGBA, PNG_INTERLACE_ADAM7), 64, 9, 7);
    expect_first_pixel(make_odd_png(9, 7, PNG_COLOR_TYPE_RGBA, PNG_INTERLACE_ADAM7), 3, 3, 2);
    expect_first_pixel(make_odd_png(40, 2, PNG_COLOR_TYPE_RGBA, PNG_INTERLACE_NONE), 8, 8, 1);
    expect_first_pixel(make_odd_png(2, 40, PNG_COLOR_TYPE_RGBA, PNG_INTERLACE_NONE), 8, 1, 8);
}

static void test_sizes_beyond_limits(void **state)
{
    (void)state;
    static const uint32_t sizes[][2] = {{0, 1}, {1, 0}, {IMAGE_MOST_SIDE + 1, 1}, {IMAGE_MOST_SIDE, IMAGE_MOST_SIDE}};
    for (int i = 0; i < 4; i++) {
        struct memory memory;
        struct image_rows rows;
        struct bvhd_error error = {0};
        memory_init(&memory, UINT64_MAX);
        assert_int_equal(image_rows_init(&rows, sizes[i][0], sizes[i][1], 64, &memory, &error), BVHD_UNSUPPORTED);
        assert_non_null(strstr(error.text, "beyond the limits"));
        assert_int_equal(memory.live, 0);
    }
}

/* Images beyond the limit become smaller by a whole factor. */
static void test_smaller(void **state)
{
    (void)state;
    expect_image(make_png(), 12, 12, 8, true);
    expect_image(make_png(), 8, 8, 5, true);
    expect_image(make_png(), 2, 2, 1, true);
    expect_image(make_jpeg(), 12, 12, 8, false);
    struct memory memory;
    struct import_image image;
    memory_init(&memory, UINT64_MAX);
    assert_int_equal(image_decode(make_jpeg(), 2, &memory, &image, NULL), BVHD_OK);
    assert_true(image.width == 1 && image.height == 1); /* libjpeg scales by 8 at most */
    memory_free(&memory, image.rgba);
}

/* Decodes bytes that are wrong: nothing is left behind, whatever comes out. */
static enum bvhd_status decode_broken(struct bytes file)
{
    struct memory memory;
    struct import_image image = {0, 0, NULL};
    struct bvhd_error error = {0};
    memory_init(&memory, UINT64_C(1) << 26);
    enum bvhd_status status = image_decode(file, 64, &memory, &image, &error);
    assert_true(status == BVHD_OK ? image.rgba != NULL : error.text[0] != '\0');
    memory_free(&memory, status == BVHD_OK ? image.rgba : NULL);
    assert_int_equal(memory.live, 0);
    return status;
}

static void test_truncated(void **state)
{
    (void)state;
    for (int i = 0; i < 2; i++) {
        struct bytes file = i ? make_jpeg() : make_png();
        /* The last bytes of a PNG are its end mark, which is not read; those of a JPEG are missed. */
        for (uint64_t size = 0; size + 16 < file.size; size++)
            assert_int_not_equal(decode_broken((struct bytes){file.data, size}), BVHD_OK);
    }
}

static void test_wrong_bytes(void **state)
{
    (void)state;
    for (int i = 0; i < 2; i++) {
        struct bytes file = i ? make_jpeg() : make_png();
        for (uint64_t at = 0; at < file.size; at++) {
            unsigned char kept = file_bytes[at];
            file_bytes[at] ^= 0xff;
            decode_broken(file);
            file_bytes[at] = kept;
        }
    }
}

static void test_refused(void **state)
{
    (void)state;
    struct bytes file = make_png();
    static const unsigned char gif[] = "GIF89a";
    assert_int_equal(decode_broken(make_jpeg_of(4, JCS_CMYK)), BVHD_UNSUPPORTED);
    file = make_png();
    assert_int_equal(decode_broken((struct bytes){gif, sizeof gif}), BVHD_UNSUPPORTED);
    assert_int_equal(decode_broken((struct bytes){NULL, 0}), BVHD_UNSUPPORTED);
    file_bytes[16] = 0x7f; /* a width of two billion pixels */
    assert_int_equal(decode_broken(file), BVHD_CORRUPT);
}

static void test_no_memory(void **state)
{
    (void)state;
    for (int i = 0; i < 2; i++) {
        struct bytes file = i ? make_jpeg() : make_png();
        enum bvhd_status status = BVHD_NO_MEMORY;
        for (int64_t after = 0; status != BVHD_OK; after++) {
            struct memory memory;
            struct import_image image;
            memory_init(&memory, UINT64_MAX);
            atomic_store(&memory.fail_after, after);
            status = image_decode(file, 64, &memory, &image, NULL);
            assert_true(after < 100);
            if (status == BVHD_OK)
                memory_free(&memory, image.rgba);
            assert_int_equal(memory.live, 0);
        }
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_formats),   cmocka_unit_test(test_smaller),
        cmocka_unit_test(test_truncated), cmocka_unit_test(test_wrong_bytes),
        cmocka_unit_test(test_refused),   cmocka_unit_test(test_no_memory),
        cmocka_unit_test(test_odd_pngs),  cmocka_unit_test(test_sizes_beyond_limits),
    };
    return cmocka_run_group_tests_name("image", tests, NULL, NULL);
}
