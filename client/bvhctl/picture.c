/* SPDX-License-Identifier: Apache-2.0 */
#include "picture.h"

#include <png.h>
#include <stdatomic.h>
#include <string.h>

#include "clock.h"
#include "files.h"
#include "rays.h"
#include "smooth.h"

enum { GRID = 2, SAMPLES = GRID * GRID, EDGE_GRID = 3 }; /* pixels on edges get the samples of both grids */

struct rendering {
    const struct light *light;
    struct pixel *pixels;
    uint8_t *rgb;
    uint32_t width, height;
    _Atomic uint64_t rays, rows;
    void (*progress)(void *context, uint64_t done, uint64_t total);
    void *progress_context;
    double exposure;
};

static struct vector from_floats(const float at[3])
{
    return vector_make((double)at[0], (double)at[1], (double)at[2]);
}

static void put_floats(float out[3], struct vector value)
{
    out[0] = (float)value.x;
    out[1] = (float)value.y;
    out[2] = (float)value.z;
}

static void set_surface(const struct light *light, struct pixel *pixel, struct vector normal, struct vector position)
{
    struct vector seen = vector_scale(vector_sub(position, light->camera->origin), 1 / light->stage->size);
    put_floats(pixel->normal, vector_unit(normal));
    put_floats(pixel->position, seen);
    pixel->depth = (float)fmax(vector_length(seen), 1e-30);
}

static uint64_t pixel_seed(uint32_t x, uint32_t y)
{
    uint64_t state = (uint64_t)y << 32 | x;
    return rays_random(&state);
}

/* What a pixel's samples add up to. */
struct sums {
    struct vector backdrop, albedo, direct, ambient, normal, position;
    unsigned samples, surfaces;
    double darkest, brightest; /* of what is seen without ambient light: edges of things and of shadows show in it */
    uint64_t rays;
};

static void add_sample(struct sums *sums, const struct light_sample *sample)
{
    struct vector seen = vector_add(sample->backdrop, sample->direct);
    double brightness = seen.x + seen.y + seen.z;
    sums->darkest = sums->samples ? fmin(sums->darkest, brightness) : brightness;
    sums->brightest = sums->samples ? fmax(sums->brightest, brightness) : brightness;
    sums->backdrop = vector_add(sums->backdrop, sample->backdrop);
    sums->samples++;
    sums->rays += sample->rays;
    if (!sample->is_surface)
        return;
    sums->albedo = vector_add(sums->albedo, sample->albedo);
    sums->direct = vector_add(sums->direct, sample->direct);
    sums->ambient = vector_add(sums->ambient, sample->ambient);
    sums->normal = vector_add(sums->normal, sample->normal);
    sums->position = vector_add(sums->position, sample->position);
    sums->surfaces++;
}

/* One sample in each cell of a grid over the pixel. */
static void take_samples(const struct rendering *rendering, uint32_t x, uint32_t y, unsigned grid, uint64_t *state, struct sums *sums)
{
    const struct light *light = rendering->light;
    for (unsigned i = 0; i < grid * grid; i++) {
        double u = (x + (i % grid + rays_uniform(state)) / grid) / rendering->width;
        double v = (y + (i / grid + rays_uniform(state)) / grid) / rendering->height;
        struct light_sample sample = light_look(light, camera_direction(light->camera, u, v), i % SAMPLES, state);
        add_sample(sums, &sample);
    }
}

static void take_pixel(struct rendering *rendering, uint32_t x, uint32_t y, uint64_t *rays)
{
    struct pixel pixel = {0};
    struct sums sums = {0};
    uint64_t state = pixel_seed(x, y);
    take_samples(rendering, x, y, GRID, &state, &sums);
    if (sums.brightest - sums.darkest > 0.12 * (sums.brightest + 0.1))
        take_samples(rendering, x, y, EDGE_GRID, &state, &sums);
    put_floats(pixel.backdrop, vector_scale(sums.backdrop, 1.0 / sums.samples));
    put_floats(pixel.albedo, vector_scale(sums.albedo, 1.0 / sums.samples));
    put_floats(pixel.direct, vector_scale(sums.direct, 1.0 / sums.samples));
    if (sums.surfaces) {
        put_floats(pixel.ambient, vector_scale(sums.ambient, 1.0 / sums.surfaces));
        set_surface(rendering->light, &pixel, sums.normal, vector_scale(sums.position, 1.0 / sums.surfaces));
    }
    *rays += sums.rays;
    rendering->pixels[(size_t)y * rendering->width + x] = pixel;
}

static void take_row(void *context, size_t row)
{
    struct rendering *rendering = context;
    uint64_t rays = 0;
    for (uint32_t x = 0; x < rendering->width; x++)
        take_pixel(rendering, x, (uint32_t)row, &rays);
    atomic_fetch_add(&rendering->rays, rays);
    uint64_t done = atomic_fetch_add(&rendering->rows, 1) + 1;
    if (rendering->progress)
        rendering->progress(rendering->progress_context, done, rendering->height);
}

static struct vector pixel_colour(const struct pixel *pixel)
{
    struct vector reflected = vector_mul(from_floats(pixel->albedo), from_floats(pixel->ambient));
    return vector_add(vector_add(from_floats(pixel->backdrop), from_floats(pixel->direct)), reflected);
}

/* Outdoors the light is known; inside it depends on the windows: the geometric mean of what is seen becomes a middle grey. */
static double choose_exposure(const struct rendering *rendering)
{
    static const double middle_grey = 0.26;
    uint64_t count = (uint64_t)rendering->width * rendering->height;
    double sum = 0;
    for (uint64_t i = 0; i < count; i++) {
        struct vector colour = pixel_colour(&rendering->pixels[i]);
        sum += log(fmax(0.2126 * colour.x + 0.7152 * colour.y + 0.0722 * colour.z, 1e-3));
    }
    double exposure = middle_grey / exp(sum / (double)count);
    return rendering->light->camera->is_inside ? fmin(fmax(exposure, 0.5), 8) : 1;
}

/* Corners a little darker, as through a lens. */
static double vignette(const struct rendering *rendering, uint32_t x, uint32_t y)
{
    double u = 2 * (x + 0.5) / rendering->width - 1, v = 2 * (y + 0.5) / rendering->height - 1;
    return 1 - 0.09 * (u * u + v * v);
}

static void develop_row(void *context, size_t row)
{
    const struct rendering *rendering = context;
    for (uint32_t x = 0; x < rendering->width; x++) {
        size_t index = row * rendering->width + x;
        struct vector colour = vector_scale(pixel_colour(&rendering->pixels[index]), rendering->exposure);
        colour = light_display(vector_scale(colour, vignette(rendering, x, (uint32_t)row)));
        rendering->rgb[3 * index] = (uint8_t)lround(255 * colour.x);
        rendering->rgb[3 * index + 1] = (uint8_t)lround(255 * colour.y);
        rendering->rgb[3 * index + 2] = (uint8_t)lround(255 * colour.z);
    }
}

enum bvhd_status picture_render(const struct light *light, uint32_t width, uint32_t height, const struct parallel *parallel,
                                void (*progress)(void *context, uint64_t done, uint64_t total), void *progress_context,
                                struct memory *memory, struct picture *ret_picture, struct bvhd_error *error)
{
    struct rendering rendering = {
        .light = light, .width = width, .height = height, .progress = progress, .progress_context = progress_context};
    uint64_t count = (uint64_t)width * height;
    rendering.pixels = memory_array(memory, count, sizeof *rendering.pixels);
    rendering.rgb = memory_array(memory, count, 3);
    bool ok = rendering.pixels && rendering.rgb;
    double start = clock_ms();
    if (ok)
        parallel_for(parallel, height, take_row, &rendering);
    double seconds = (clock_ms() - start) / 1e3;
    if (ok && (ok = smooth_ambient(rendering.pixels, width, height, parallel, memory))) {
        rendering.exposure = choose_exposure(&rendering);
        parallel_for(parallel, height, develop_row, &rendering);
    }
    memory_free(memory, rendering.pixels);
    if (!ok) {
        memory_free(memory, rendering.rgb);
        return bvhd_error_set(error, BVHD_NO_MEMORY, "trace", "no memory for a picture of %u x %u", width, height);
    }
    *ret_picture = (struct picture){width, height, rendering.rgb, atomic_load(&rendering.rays), seconds, memory};
    return BVHD_OK;
}

enum bvhd_status picture_write_png(const struct picture *picture, const char *path, struct bvhd_error *error)
{
    png_image image = {.version = PNG_IMAGE_VERSION, .width = picture->width, .height = picture->height, .format = PNG_FORMAT_RGB};
    png_alloc_size_t size = PNG_IMAGE_PNG_SIZE_MAX(image);
    unsigned char *data = memory_alloc(picture->memory, size);
    if (!data)
        return bvhd_error_set(error, BVHD_NO_MEMORY, path, "no memory for the PNG file");
    enum bvhd_status status = BVHD_OK;
    if (!png_image_write_to_memory(&image, data, &size, 0, picture->rgb, 0, NULL))
        status = bvhd_error_set(error, BVHD_INTERNAL, path, "libpng: %s", image.message);
    else
        status = files_write(path, (struct bytes){data, size}, picture->memory, NULL, error);
    png_image_free(&image);
    memory_free(picture->memory, data);
    return status;
}

void picture_finish(struct picture *picture)
{
    if (!picture || !picture->memory)
        return;
    memory_free(picture->memory, picture->rgb);
    *picture = (struct picture){0};
}
