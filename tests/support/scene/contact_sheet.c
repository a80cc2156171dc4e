/* SPDX-License-Identifier: Apache-2.0 */
/* contact_sheet - puts small pictures into one, in rows, with a name under each. Its usage text is its manual. */
#include <ctype.h>
#include <errno.h>
#include <png.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { GAP = 6, GLYPH_WIDTH = 5, GLYPH_HEIGHT = 7, CAPTION = GLYPH_HEIGHT + 6, MOST_COLUMNS = 64, LEVELS = 64 };

static const uint8_t paper = 248, ink = 40;

/* The letters of captions, in rows from the top; the highest of five bits is the leftmost pixel. */
static const struct glyph {
    char letter;
    uint8_t rows[GLYPH_HEIGHT];
} glyphs[] = {
    {'a', {0x00, 0x00, 0x0e, 0x01, 0x0f, 0x11, 0x0f}}, {'b', {0x10, 0x10, 0x1e, 0x11, 0x11, 0x11, 0x1e}},
    {'c', {0x00, 0x00, 0x0e, 0x10, 0x10, 0x11, 0x0e}}, {'d', {0x01, 0x01, 0x0f, 0x11, 0x11, 0x11, 0x0f}},
    {'e', {0x00, 0x00, 0x0e, 0x11, 0x1f, 0x10, 0x0e}}, {'f', {0x06, 0x09, 0x08, 0x1c, 0x08, 0x08, 0x08}},
    {'g', {0x00, 0x00, 0x0f, 0x11, 0x0f, 0x01, 0x0e}}, {'h', {0x10, 0x10, 0x16, 0x19, 0x11, 0x11, 0x11}},
    {'i', {0x04, 0x00, 0x0c, 0x04, 0x04, 0x04, 0x0e}}, {'j', {0x02, 0x00, 0x06, 0x02, 0x02, 0x12, 0x0c}},
    {'k', {0x10, 0x10, 0x12, 0x14, 0x18, 0x14, 0x12}}, {'l', {0x0c, 0x04, 0x04, 0x04, 0x04, 0x04, 0x0e}},
    {'m', {0x00, 0x00, 0x1a, 0x15, 0x15, 0x11, 0x11}}, {'n', {0x00, 0x00, 0x16, 0x19, 0x11, 0x11, 0x11}},
    {'o', {0x00, 0x00, 0x0e, 0x11, 0x11, 0x11, 0x0e}}, {'p', {0x00, 0x00, 0x1e, 0x11, 0x1e, 0x10, 0x10}},
    {'q', {0x00, 0x00, 0x0d, 0x13, 0x0f, 0x01, 0x01}}, {'r', {0x00, 0x00, 0x16, 0x19, 0x10, 0x10, 0x10}},
    {'s', {0x00, 0x00, 0x0e, 0x10, 0x0e, 0x01, 0x1e}}, {'t', {0x08, 0x08, 0x1c, 0x08, 0x08, 0x09, 0x06}},
    {'u', {0x00, 0x00, 0x11, 0x11, 0x11, 0x13, 0x0d}}, {'v', {0x00, 0x00, 0x11, 0x11, 0x11, 0x0a, 0x04}},
    {'w', {0x00, 0x00, 0x11, 0x11, 0x15, 0x15, 0x0a}}, {'x', {0x00, 0x00, 0x11, 0x0a, 0x04, 0x0a, 0x11}},
    {'y', {0x00, 0x00, 0x11, 0x11, 0x0f, 0x01, 0x0e}}, {'z', {0x00, 0x00, 0x1f, 0x02, 0x04, 0x08, 0x1f}},
    {'0', {0x0e, 0x11, 0x13, 0x15, 0x19, 0x11, 0x0e}}, {'1', {0x04, 0x0c, 0x04, 0x04, 0x04, 0x04, 0x0e}},
    {'2', {0x0e, 0x11, 0x01, 0x02, 0x04, 0x08, 0x1f}}, {'3', {0x1f, 0x02, 0x04, 0x02, 0x01, 0x11, 0x0e}},
    {'4', {0x02, 0x06, 0x0a, 0x12, 0x1f, 0x02, 0x02}}, {'5', {0x1f, 0x10, 0x1e, 0x01, 0x01, 0x11, 0x0e}},
    {'6', {0x06, 0x08, 0x10, 0x1e, 0x11, 0x11, 0x0e}}, {'7', {0x1f, 0x01, 0x02, 0x04, 0x08, 0x08, 0x08}},
    {'8', {0x0e, 0x11, 0x11, 0x0e, 0x11, 0x11, 0x0e}}, {'9', {0x0e, 0x11, 0x11, 0x0f, 0x01, 0x02, 0x0c}},
    {'-', {0x00, 0x00, 0x00, 0x1f, 0x00, 0x00, 0x00}}, {'_', {0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x1f}},
};

struct picture {
    uint32_t width, height;
    uint8_t *rgb;
};

static void fail(const char *path, const char *why)
{
    fprintf(stderr, "contact_sheet: %s: %s\n", path, why);
    exit(1);
}

static struct picture make_picture(uint32_t width, uint32_t height)
{
    struct picture picture = {width, height, malloc((size_t)width * height * 3)};
    if (!picture.rgb)
        fail("picture", "no memory");
    memset(picture.rgb, paper, (size_t)width * height * 3);
    return picture;
}

static struct picture read_picture(const char *path)
{
    png_image image = {.version = PNG_IMAGE_VERSION};
    if (!png_image_begin_read_from_file(&image, path))
        fail(path, image.message);
    image.format = PNG_FORMAT_RGB;
    struct picture picture = make_picture(image.width, image.height);
    if (!png_image_finish_read(&image, NULL, picture.rgb, 0, NULL))
        fail(path, image.message);
    return picture;
}

/* Copies a picture. Its colours get fewer levels, so that the file is small. */
static void paste(struct picture *sheet, const struct picture *tile, uint32_t left, uint32_t top)
{
    for (uint32_t y = 0; y < tile->height; y++)
        for (uint32_t i = 0; i < 3 * tile->width; i++) {
            unsigned value = tile->rgb[3 * (size_t)tile->width * y + i];
            unsigned level = (value * (LEVELS - 1) + 127) / 255;
            sheet->rgb[3 * ((size_t)sheet->width * (top + y) + left) + i] = (uint8_t)(level * 255 / (LEVELS - 1));
        }
}

static void write_letter(struct picture *sheet, char letter, uint32_t left, uint32_t top)
{
    for (size_t i = 0; i < sizeof glyphs / sizeof *glyphs; i++)
        for (uint32_t y = 0; y < GLYPH_HEIGHT && glyphs[i].letter == letter; y++)
            for (uint32_t x = 0; x < GLYPH_WIDTH; x++)
                if (glyphs[i].rows[y] >> (GLYPH_WIDTH - 1 - x) & 1)
                    memset(sheet->rgb + 3 * ((size_t)sheet->width * (top + y) + left + x), ink, 3);
}

/* Returns the name of a file without its directory and extension. */
static void name_of(const char *path, char ret_name[64])
{
    const char *slash = strrchr(path, '/');
    snprintf(ret_name, 64, "%s", slash ? slash + 1 : path);
    char *dot = strrchr(ret_name, '.');
    if (dot)
        *dot = '\0';
}

/* Writes a caption in the middle of a column. */
static void write_caption(struct picture *sheet, const char *path, uint32_t left, uint32_t width, uint32_t top)
{
    char name[64];
    name_of(path, name);
    uint32_t step = GLYPH_WIDTH + 1, fitting = width / step, length = (uint32_t)strlen(name);
    length = length < fitting ? length : fitting;
    left += (width - length * step) / 2;
    for (uint32_t i = 0; i < length; i++)
        write_letter(sheet, (char)tolower((unsigned char)name[i]), left + i * step, top);
}

static struct picture compose(char **paths, uint32_t count, uint32_t columns)
{
    struct picture sheet = {0};
    uint32_t rows = (count + columns - 1) / columns, width = 0, height = 0;
    for (uint32_t i = 0; i < count; i++) {
        struct picture tile = read_picture(paths[i]);
        if (i == 0) {
            width = tile.width;
            height = tile.height;
            sheet = make_picture(GAP + columns * (width + GAP), GAP + rows * (height + CAPTION + GAP));
        }
        if (tile.width != width || tile.height != height)
            fail(paths[i], "it has another size than the first picture");
        uint32_t left = GAP + i % columns * (width + GAP), top = GAP + i / columns * (height + CAPTION + GAP);
        paste(&sheet, &tile, left, top);
        write_caption(&sheet, paths[i], left, width, top + height + 3);
        free(tile.rgb);
    }
    return sheet;
}

static uint32_t parse_columns(const char *text)
{
    char *rest;
    unsigned long columns = strtoul(text, &rest, 10);
    return *rest || columns > MOST_COLUMNS ? 0 : (uint32_t)columns;
}

int main(int argc, char **argv)
{
    uint32_t columns = argc > 3 ? parse_columns(argv[1]) : 0;
    if (!columns) {
        fprintf(stderr,
                "usage: contact_sheet COLUMNS OUT.png PICTURE.png...\n"
                "\n"
                "Puts pictures of one size into one, in rows of COLUMNS, each with its file's name under it.\n");
        return 2;
    }
    struct picture sheet = compose(argv + 3, (uint32_t)argc - 3, columns);
    png_image image = {.version = PNG_IMAGE_VERSION, .width = sheet.width, .height = sheet.height};
    image.format = PNG_FORMAT_RGB;
    if (!png_image_write_to_file(&image, argv[2], 0, sheet.rgb, 0, NULL))
        fail(argv[2], image.message);
    png_image_free(&image);
    free(sheet.rgb);
    return 0;
}
