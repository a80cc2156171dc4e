/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/picture/texture.h"

#include <stddef.h>

/* The curve of sRGB, for each of its values. */
static const float linear_values[256] = {
    0.0f,        0.000303527f, 0.000607054f, 0.000910581f, 0.00121411f, 0.00151763f, 0.00182116f, 0.00212469f,
    0.00242822f, 0.00273174f,  0.00303527f,  0.00334654f,  0.00367651f, 0.00402472f, 0.00439144f, 0.00477695f,
    0.00518152f, 0.00560539f,  0.00604883f,  0.00651209f,  0.00699541f, 0.00749903f, 0.00802319f, 0.00856813f,
    0.00913406f, 0.00972122f,  0.0103298f,   0.0109601f,   0.0116122f,  0.0122865f,  0.012983f,   0.0137021f,
    0.0144438f,  0.0152085f,   0.0159963f,   0.0168074f,   0.017642f,   0.0185002f,  0.0193824f,  0.0202886f,
    0.021219f,   0.0221739f,   0.0231534f,   0.0241576f,   0.0251869f,  0.0262412f,  0.0273209f,  0.028426f,
    0.0295568f,  0.0307134f,   0.031896f,    0.0331048f,   0.0343398f,  0.0356013f,  0.0368895f,  0.0382044f,
    0.0395462f,  0.0409152f,   0.0423114f,   0.043735f,    0.0451862f,  0.0466651f,  0.0481718f,  0.0497066f,
    0.0512695f,  0.0528606f,   0.0544803f,   0.0561285f,   0.0578054f,  0.0595112f,  0.0612461f,  0.06301f,
    0.0648033f,  0.0666259f,   0.0684782f,   0.0703601f,   0.0722719f,  0.0742136f,  0.0761854f,  0.0781874f,
    0.0802198f,  0.0822827f,   0.0843762f,   0.0865005f,   0.0886556f,  0.0908417f,  0.093059f,   0.0953075f,
    0.0975873f,  0.0998987f,   0.102242f,    0.104616f,    0.107023f,   0.109462f,   0.111932f,   0.114435f,
    0.116971f,   0.119538f,    0.122139f,    0.124772f,    0.127438f,   0.130136f,   0.132868f,   0.135633f,
    0.138432f,   0.141263f,    0.144128f,    0.147027f,    0.14996f,    0.152926f,   0.155926f,   0.158961f,
    0.162029f,   0.165132f,    0.168269f,    0.171441f,    0.174647f,   0.177888f,   0.181164f,   0.184475f,
    0.187821f,   0.191202f,    0.194618f,    0.198069f,    0.201556f,   0.205079f,   0.208637f,   0.212231f,
    0.215861f,   0.219526f,    0.223228f,    0.226966f,    0.23074f,    0.234551f,   0.238398f,   0.242281f,
    0.246201f,   0.250158f,    0.254152f,    0.258183f,    0.262251f,   0.266356f,   0.270498f,   0.274677f,
    0.278894f,   0.283149f,    0.287441f,    0.291771f,    0.296138f,   0.300544f,   0.304987f,   0.309469f,
    0.313989f,   0.318547f,    0.323143f,    0.327778f,    0.332452f,   0.337164f,   0.341914f,   0.346704f,
    0.351533f,   0.3564f,      0.361307f,    0.366253f,    0.371238f,   0.376262f,   0.381326f,   0.386429f,
    0.391572f,   0.396755f,    0.401978f,    0.40724f,     0.412543f,   0.417885f,   0.423268f,   0.42869f,
    0.434154f,   0.439657f,    0.445201f,    0.450786f,    0.456411f,   0.462077f,   0.467784f,   0.473531f,
    0.47932f,    0.48515f,     0.491021f,    0.496933f,    0.502886f,   0.508881f,   0.514918f,   0.520996f,
    0.527115f,   0.533276f,    0.539479f,    0.545724f,    0.552011f,   0.55834f,    0.564712f,   0.571125f,
    0.57758f,    0.584078f,    0.590619f,    0.597202f,    0.603827f,   0.610496f,   0.617207f,   0.62396f,
    0.630757f,   0.637597f,    0.64448f,     0.651406f,    0.658375f,   0.665387f,   0.672443f,   0.679542f,
    0.686685f,   0.693872f,    0.701102f,    0.708376f,    0.715694f,   0.723055f,   0.730461f,   0.73791f,
    0.745404f,   0.752942f,    0.760525f,    0.768151f,    0.775822f,   0.783538f,   0.791298f,   0.799103f,
    0.806952f,   0.814847f,    0.822786f,    0.83077f,     0.838799f,   0.846873f,   0.854993f,   0.863157f,
    0.871367f,   0.879622f,    0.887923f,    0.896269f,    0.904661f,   0.913099f,   0.921582f,   0.930111f,
    0.938686f,   0.947307f,    0.955973f,    0.964686f,    0.973445f,   0.982251f,   0.991102f,   1.0f,
};

double texture_linear(unsigned char value)
{
    return (double)linear_values[value];
}

static unsigned char to_srgb(double value)
{
    double curved = value <= 0.0031308 ? 12.92 * value : 1.055 * pow(value, 1 / 2.4) - 0.055;
    return (unsigned char)lround(255 * fmin(fmax(curved, 0), 1));
}

/* Mixes four pixels, of which transparent ones do not count: otherwise their colour would be seen at edges. */
static void mix_pixels(const unsigned char *const from[4], unsigned char ret_pixel[4])
{
    double weights = 0, alpha = 0, sums[3] = {0, 0, 0};
    for (int i = 0; i < 4; i++) {
        double weight = from[i][3] + 1e-3;
        for (int k = 0; k < 3; k++)
            sums[k] += weight * texture_linear(from[i][k]);
        weights += weight;
        alpha += from[i][3];
    }
    for (int k = 0; k < 3; k++)
        ret_pixel[k] = to_srgb(sums[k] / weights);
    ret_pixel[3] = (unsigned char)lround(alpha / 4);
}

static const unsigned char *pixel_at(const struct import_image *image, uint32_t x, uint32_t y)
{
    return image->rgba + 4 * ((size_t)y * image->width + x);
}

static bool halve(const struct import_image *from, struct memory *memory, struct import_image *ret_image)
{
    struct import_image image = {from->width > 1 ? from->width / 2 : 1, from->height > 1 ? from->height / 2 : 1, NULL};
    image.rgba = memory_array(memory, (uint64_t)image.width * image.height, 4);
    if (!image.rgba)
        return false;
    for (uint32_t y = 0; y < image.height; y++)
        for (uint32_t x = 0; x < image.width; x++) {
            uint32_t right = 2 * x + 1 < from->width ? 2 * x + 1 : from->width - 1,
                     below = 2 * y + 1 < from->height ? 2 * y + 1 : from->height - 1;
            uint32_t left = 2 * x < from->width ? 2 * x : right, above = 2 * y < from->height ? 2 * y : below;
            const unsigned char *const four[4] = {pixel_at(from, left, above), pixel_at(from, right, above),
                                                  pixel_at(from, left, below), pixel_at(from, right, below)};
            mix_pixels(four, image.rgba + 4 * ((size_t)y * image.width + x));
        }
    *ret_image = image;
    return true;
}

bool texture_init(struct texture *texture, const struct import_image *image, struct memory *memory)
{
    *texture = (struct texture){.levels = {*image}, .level_count = 1, .memory = memory};
    for (; texture->level_count < TEXTURE_LEVELS; texture->level_count++) {
        const struct import_image *last = &texture->levels[texture->level_count - 1];
        if (last->width == 1 && last->height == 1)
            break;
        if (!halve(last, memory, &texture->levels[texture->level_count])) {
            texture_finish(texture);
            return false;
        }
    }
    return true;
}

void texture_finish(struct texture *texture)
{
    if (!texture || !texture->memory)
        return;
    for (uint32_t i = 1; i < texture->level_count; i++)
        memory_free(texture->memory, texture->levels[i].rgba);
    *texture = (struct texture){0};
}

/* Returns the pixel along one side that a coordinate outside of the image, in pixels, stands for. */
static uint32_t wrap(double at, uint32_t size, enum import_wrap mode)
{
    if (mode == IMPORT_CLAMP || !isfinite(at))
        return at >= size - 1.0 ? size - 1 : at > 0 ? (uint32_t)at : 0;
    double period = mode == IMPORT_MIRROR ? 2.0 * size : size;
    double inside = at - period * floor(at / period);
    if (inside >= size) /* the mirrored half, or a rounding of the division */
        inside = mode == IMPORT_MIRROR ? 2.0 * size - 1 - inside : size - 1;
    return inside <= 0 ? 0 : inside >= size - 1.0 ? size - 1 : (uint32_t)inside;
}

static void add_pixel(const struct import_image *image, double x, double y, const struct texture_filter *filter,
                      double weight, struct texture_colour *sum)
{
    const unsigned char *pixel =
        pixel_at(image, wrap(x, image->width, filter->wrap[0]), wrap(y, image->height, filter->wrap[1]));
    struct vector rgb = {texture_linear(pixel[0]), texture_linear(pixel[1]), texture_linear(pixel[2])};
    sum->rgb = vector_mad(sum->rgb, rgb, weight);
    sum->alpha += weight * pixel[3] / 255;
}

static void add_level(const struct import_image *image, double u, double v, const struct texture_filter *filter,
                      double weight, struct texture_colour *sum)
{
    double x = u * image->width, y = v * image->height;
    if (filter->is_pixelated) {
        add_pixel(image, floor(x), floor(y), filter, weight, sum);
        return;
    }
    double left = floor(x - 0.5), above = floor(y - 0.5), right = x - 0.5 - left, below = y - 0.5 - above;
    add_pixel(image, left, above, filter, weight * (1 - right) * (1 - below), sum);
    add_pixel(image, left + 1, above, filter, weight * right * (1 - below), sum);
    add_pixel(image, left, above + 1, filter, weight * (1 - right) * below, sum);
    add_pixel(image, left + 1, above + 1, filter, weight * right * below, sum);
}

struct texture_colour texture_sample(const struct texture *texture, double u, double v,
                                     const struct texture_filter *filter)
{
    struct texture_colour sum = {{0, 0, 0}, 0};
    u = isfinite(u) ? u : 0;
    v = isfinite(v) ? v : 0;
    double level = fmin(fmax(filter->level, 0), texture->level_count - 1.0), whole = floor(level);
    uint32_t index = (uint32_t)whole;
    double rest = level - whole;
    add_level(&texture->levels[index], u, v, filter, 1 - rest, &sum);
    if (rest > 0)
        add_level(&texture->levels[index + 1], u, v, filter, rest, &sum);
    return sum;
}
