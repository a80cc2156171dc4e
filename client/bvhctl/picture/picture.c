/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/picture/picture.h"

#include <png.h>
#include <string.h>

#include "client/bvhctl/base/files.h"
#include "client/bvhctl/oracle/rays.h"
#include "client/bvhctl/picture/exposure.h"
#include "client/bvhctl/picture/smooth.h"

struct picture_samples picture_samples(const struct stage *stage, uint32_t samples)
{
    static const struct picture_samples sharp = {4, 9}, blurred = {8, 24};
    return samples ? (struct picture_samples){samples, 0} : stage->is_blurred ? blurred : sharp;
}

static enum bvhd_status no_memory(const struct picture_options *options, struct bvhd_error *error)
{
    return bvhd_error_no_memory(error, "trace", "no memory for a picture of %u x %u", options->width, options->height);
}

struct rendering {
    const struct picture_options *options;
    struct picture_samples samples;
    struct sampler sampler;
    struct pixel *pixels;
    uint8_t *rgb;
    struct sums *sums; /* of the pixels that are being sampled */
    struct edge *edges; /* pixels that wait for more samples */
    uint32_t first, count; /* the range of pixels that are being sampled, unless those in `edges` are */
    uint32_t edge_count;
    double exposure;
};

static void put_floats(float out[3], struct vector value)
{
    out[0] = (float)value.x;
    out[1] = (float)value.y;
    out[2] = (float)value.z;
}

static double luminance(struct vector colour)
{
    return 0.2126 * colour.x + 0.7152 * colour.y + 0.0722 * colour.z;
}

static void set_surface(const struct light *light, struct pixel *pixel, struct vector normal, struct vector position)
{
    struct vector seen = vector_scale(vector_sub(position, light->camera->origin), 1 / light->stage->size);
    put_floats(pixel->normal, vector_unit(normal));
    put_floats(pixel->position, seen);
    pixel->depth = (float)fmax(vector_length(seen), 1e-30);
}

/* The sums over a pixel's samples. */
struct sums {
    struct vector backdrop, albedo, sun, direct, ambient, normal, position;
    unsigned samples, surfaces, subjects;
    double darkest, brightest; /* sample, without ambient light: they differ at edges of objects and of shadows */
};

struct edge {
    uint32_t pixel;
    struct sums sums;
};

static void add_sample(struct sums *sums, const struct light_sample *sample)
{
    struct vector seen = vector_add(sample->backdrop, sample->direct);
    double brightness = seen.x + seen.y + seen.z;
    sums->darkest = sums->samples ? fmin(sums->darkest, brightness) : brightness;
    sums->brightest = sums->samples ? fmax(sums->brightest, brightness) : brightness;
    sums->backdrop = vector_add(sums->backdrop, sample->backdrop);
    sums->samples++;
    if (!sample->is_surface)
        return;
    sums->albedo = vector_add(sums->albedo, sample->albedo);
    sums->direct = vector_add(sums->direct, sample->direct);
    if (sample->shadow.is_needed)
        sums->sun = vector_add(sums->sun, sample->shadow.gain);
    sums->ambient = vector_add(sums->ambient, sample->ambient);
    sums->normal = vector_add(sums->normal, sample->normal);
    sums->position = vector_add(sums->position, sample->position);
    sums->surfaces++;
    sums->subjects += sample->is_subject;
}

static bool is_edge(const struct sums *sums)
{
    return sums->brightest - sums->darkest > 0.12 * (sums->brightest + 0.1);
}

static void finish_pixel(const struct light *light, const struct sums *sums, struct pixel *ret_pixel)
{
    struct pixel pixel = {0};
    put_floats(pixel.backdrop, vector_scale(sums->backdrop, 1.0 / sums->samples));
    put_floats(pixel.albedo, vector_scale(sums->albedo, 1.0 / sums->samples));
    put_floats(pixel.sun, vector_scale(sums->sun, 1.0 / sums->samples));
    pixel.is_subject = 2 * sums->subjects > sums->samples;
    double sun = luminance(sums->sun);
    pixel.lit = sun > 0 ? (float)fmin(luminance(sums->direct) / sun, 1) : 0;
    if (sums->surfaces) {
        put_floats(pixel.ambient, vector_scale(sums->ambient, 1.0 / sums->surfaces));
        set_surface(light, &pixel, sums->normal, vector_scale(sums->position, 1.0 / sums->surfaces));
    }
    *ret_pixel = pixel;
}

/*
 * Places one sample at a random point of each cell of a grid over the pixel, whose rows have about as many cells each
 * as there are rows. Their times differ by the golden ratio, so that those of neighbouring cells are far apart, and all
 * of them are spread evenly.
 */
static void place_samples(const struct rendering *rendering, uint32_t pixel, uint32_t count,
                          struct light_sample *samples)
{
    const struct picture_options *options = rendering->options;
    const struct stage *stage = options->light->stage;
    uint32_t x = pixel % options->width, y = pixel / options->width, rows = (uint32_t)lround(sqrt(count));
    uint64_t seed = (uint64_t)y << 32 | x << 8 | rows, state = rays_random(&seed), moment = state ^ UINT64_C(0x71e5);
    const double first_moment = rays_uniform(&moment);
    for (uint32_t i = 0; i < count; i++) {
        uint32_t row = i * rows / count, begin = (row * count + rows - 1) / rows,
                 end = ((row + 1) * count + rows - 1) / rows;
        double u = (x + (i - begin + rays_uniform(&state)) / (end - begin)) / options->width;
        double v = (y + (row + rays_uniform(&state)) / rows) / options->height;
        samples[i].direction = camera_direction(options->light->camera, u, v);
        samples[i].index = i % 4;
        samples[i].random = rays_random(&state);
        samples[i].time = stage_time(stage, fmod(first_moment + 0.6180339887498949 * i, 1));
    }
}

/* ---- all pixels, in batches ---- */

enum { CHUNK = 128 }; /* pixels */

static void place_pixels(void *context, size_t index)
{
    const struct rendering *rendering = context;
    const uint32_t samples = rendering->samples.all;
    size_t begin, end;
    parallel_chunk(index, CHUNK, rendering->count, &begin, &end);
    for (size_t i = begin; i < end; i++)
        place_samples(rendering, rendering->first + (uint32_t)i, samples, rendering->sampler.samples + i * samples);
}

/* Returns whether a pixel gets more samples. */
static bool wants_more(const struct rendering *rendering, const struct sums *sums)
{
    return rendering->samples.edges && is_edge(sums);
}

static void add_pixels(void *context, size_t index)
{
    const struct rendering *rendering = context;
    const uint32_t samples = rendering->samples.all;
    size_t begin, end;
    parallel_chunk(index, CHUNK, rendering->count, &begin, &end);
    for (size_t i = begin; i < end; i++) {
        struct sums *sums = &rendering->sums[i];
        *sums = (struct sums){0};
        for (uint32_t k = 0; k < samples; k++)
            add_sample(sums, &rendering->sampler.samples[i * samples + k]);
        if (!wants_more(rendering, sums))
            finish_pixel(rendering->options->light, sums, &rendering->pixels[rendering->first + i]);
    }
}

static void place_edges(void *context, size_t index)
{
    const struct rendering *rendering = context;
    const uint32_t samples = rendering->samples.edges;
    size_t begin, end;
    parallel_chunk(index, CHUNK, rendering->edge_count, &begin, &end);
    for (size_t i = begin; i < end; i++)
        place_samples(rendering, rendering->edges[i].pixel, samples, rendering->sampler.samples + i * samples);
}

static void add_edges(void *context, size_t index)
{
    const struct rendering *rendering = context;
    const uint32_t samples = rendering->samples.edges;
    size_t begin, end;
    parallel_chunk(index, CHUNK, rendering->edge_count, &begin, &end);
    for (size_t i = begin; i < end; i++) {
        struct edge *edge = &rendering->edges[i];
        for (uint32_t k = 0; k < samples; k++)
            add_sample(&edge->sums, &rendering->sampler.samples[i * samples + k]);
        finish_pixel(rendering->options->light, &edge->sums, &rendering->pixels[edge->pixel]);
    }
}

static void in_chunks(struct rendering *rendering, uint32_t pixels, parallel_task task)
{
    parallel_for(rendering->options->parallel, parallel_chunks(CHUNK, pixels), task, rendering);
}

/* Returns how many pixels with so many samples each are sampled at once. */
static uint32_t pixels_at_once(const struct rendering *rendering, uint32_t samples)
{
    return samples ? rendering->options->batch / samples : 0;
}

static enum bvhd_status sample_edges(struct rendering *rendering, struct bvhd_error *error)
{
    in_chunks(rendering, rendering->edge_count, place_edges);
    enum bvhd_status status =
        sampler_take(&rendering->sampler, rendering->edge_count * rendering->samples.edges, error);
    if (status != BVHD_OK)
        return status;
    in_chunks(rendering, rendering->edge_count, add_edges);
    rendering->edge_count = 0;
    return BVHD_OK;
}

/* Collects the pixels on edges, and samples them again when there are enough for a batch. */
static enum bvhd_status collect_edges(struct rendering *rendering, struct bvhd_error *error)
{
    const uint32_t most = pixels_at_once(rendering, rendering->samples.edges);
    enum bvhd_status status = BVHD_OK;
    for (uint32_t i = 0; i < rendering->count && status == BVHD_OK; i++) {
        if (!wants_more(rendering, &rendering->sums[i]))
            continue;
        rendering->edges[rendering->edge_count++] = (struct edge){rendering->first + i, rendering->sums[i]};
        if (rendering->edge_count == most)
            status = sample_edges(rendering, error);
    }
    return status;
}

static enum bvhd_status sample_pixels(struct rendering *rendering, struct bvhd_error *error)
{
    const struct picture_options *options = rendering->options;
    uint32_t total = options->width * options->height, step = pixels_at_once(rendering, rendering->samples.all);
    enum bvhd_status status = BVHD_OK;
    for (uint32_t first = 0; first < total && status == BVHD_OK; first += rendering->count) {
        rendering->first = first;
        rendering->count = total - first < step ? total - first : step;
        in_chunks(rendering, rendering->count, place_pixels);
        status = sampler_take(&rendering->sampler, rendering->count * rendering->samples.all, error);
        if (status != BVHD_OK)
            return status;
        in_chunks(rendering, rendering->count, add_pixels);
        status = collect_edges(rendering, error);
        if (options->progress)
            options->progress(options->progress_context, first + rendering->count, total);
    }
    return status != BVHD_OK ? status : sample_edges(rendering, error);
}

/* ---- from light to colours ---- */

/* Returns the light that a pixel's surfaces reflect. */
static struct vector reflected_light(const struct pixel *pixel)
{
    struct vector ambient = vector_mul(vector_from_floats(pixel->albedo), vector_from_floats(pixel->ambient));
    return vector_mad(ambient, vector_from_floats(pixel->sun), (double)pixel->lit);
}

/* Returns the exposure that fits the subject, or without one the whole picture. */
static double choose_exposure(const struct rendering *rendering)
{
    const struct picture_options *options = rendering->options;
    uint64_t count = (uint64_t)options->width * options->height;
    struct histogram subject = {{0}, 0}, all = {{0}, 0};
    if (options->exposure > 0)
        return options->exposure;
    for (uint64_t i = 0; i < count; i++) {
        double light = luminance(reflected_light(&rendering->pixels[i]));
        histogram_add(&all, light);
        if (rendering->pixels[i].is_subject)
            histogram_add(&subject, light);
    }
    return exposure_choose(subject.count ? &subject : &all, options->light->camera->is_inside);
}

/*
 * Returns the light of a pixel as it is developed. Outdoors the exposure is for the scene and its floor; the backdrop
 * always has the same brightness.
 */
static struct vector exposed_light(const struct rendering *rendering, const struct pixel *pixel)
{
    double backdrop = rendering->options->light->camera->is_inside ? rendering->exposure : 1;
    return vector_mad(vector_scale(vector_from_floats(pixel->backdrop), backdrop), reflected_light(pixel),
                      rendering->exposure);
}

/* Makes the corners a little darker, as a lens does. */
static double vignette(const struct rendering *rendering, uint32_t x, uint32_t y)
{
    double u = 2 * (x + 0.5) / rendering->options->width - 1, v = 2 * (y + 0.5) / rendering->options->height - 1;
    return 1 - 0.09 * (u * u + v * v);
}

static void develop_row(void *context, size_t row)
{
    const struct rendering *rendering = context;
    for (uint32_t x = 0; x < rendering->options->width; x++) {
        size_t index = row * rendering->options->width + x;
        struct vector colour = exposed_light(rendering, &rendering->pixels[index]);
        colour = light_display(vector_scale(colour, vignette(rendering, x, (uint32_t)row)));
        rendering->rgb[3 * index] = (uint8_t)lround(255 * colour.x);
        rendering->rgb[3 * index + 1] = (uint8_t)lround(255 * colour.y);
        rendering->rgb[3 * index + 2] = (uint8_t)lround(255 * colour.z);
    }
}

static enum bvhd_status prepare(struct rendering *rendering, struct memory *memory, struct bvhd_error *error)
{
    const struct picture_options *options = rendering->options;
    uint64_t count = (uint64_t)options->width * options->height;
    uint64_t sums = pixels_at_once(rendering, rendering->samples.all),
             edges = pixels_at_once(rendering, rendering->samples.edges);
    struct sampler_options sampler = {.light = options->light,
                                      .tracer = options->tracer,
                                      .parallel = options->parallel,
                                      .batch = options->batch,
                                      .watch = options->watch,
                                      .watch_context = options->watch_context};
    rendering->pixels = memory_array(memory, count, sizeof *rendering->pixels);
    rendering->rgb = memory_array(memory, count, 3);
    rendering->sums = memory_array(memory, sums, sizeof *rendering->sums);
    rendering->edges = memory_array(memory, edges + 1, sizeof *rendering->edges);
    if (!rendering->pixels || !rendering->rgb || !rendering->sums || !rendering->edges)
        return no_memory(options, error);
    return sampler_init(&rendering->sampler, &sampler, memory, error);
}

static enum bvhd_status develop(struct rendering *rendering, struct memory *memory, struct bvhd_error *error)
{
    const struct picture_options *options = rendering->options;
    const uint32_t samples = rendering->samples.all + rendering->samples.edges;
    if (!smooth_light(rendering->pixels, options->width, options->height, samples, options->parallel, memory))
        return no_memory(options, error);
    rendering->exposure = choose_exposure(rendering);
    parallel_for(options->parallel, options->height, develop_row, rendering);
    return BVHD_OK;
}

enum bvhd_status picture_render(const struct picture_options *options, struct memory *memory,
                                struct picture *ret_picture, struct bvhd_error *error)
{
    struct rendering rendering = {.options = options,
                                  .samples = picture_samples(options->light->stage, options->samples)};
    enum bvhd_status status = prepare(&rendering, memory, error);
    if (status == BVHD_OK)
        status = sample_pixels(&rendering, error);
    struct picture picture = {.width = options->width,
                              .height = options->height,
                              .rgb = rendering.rgb,
                              .rays = rendering.sampler.rays,
                              .seconds = rendering.sampler.seconds,
                              .memory = memory};
    sampler_finish(&rendering.sampler);
    memory_free(memory, rendering.sums);
    memory_free(memory, rendering.edges);
    if (status == BVHD_OK)
        status = develop(&rendering, memory, error);
    memory_free(memory, rendering.pixels);
    picture.exposure = rendering.exposure;
    if (status != BVHD_OK)
        memory_free(memory, rendering.rgb);
    else
        *ret_picture = picture;
    return status;
}

enum bvhd_status picture_write_png(const struct picture *picture, const char *path, struct bvhd_error *error)
{
    png_image image = {
        .version = PNG_IMAGE_VERSION, .width = picture->width, .height = picture->height, .format = PNG_FORMAT_RGB};
    png_alloc_size_t size = PNG_IMAGE_PNG_SIZE_MAX(image);
    unsigned char *data = memory_alloc(picture->memory, size);
    if (!data)
        return bvhd_error_no_memory(error, path, "no memory for the PNG file");
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
