/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/support/builder/random_input.h"

#include <float.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

uint32_t random_below(struct random *random, uint32_t count)
{
    return (uint32_t)(random_next(random) % count);
}

bool random_chance(struct random *random, double probability)
{
    return random_between(random, 0, 1) < probability;
}

void *random_input_buffer(struct random_input *input, uint64_t size)
{
    void *buffer = malloc(size ? size : 1);
    if (!buffer || input->buffer_count == RANDOM_INPUT_BUFFERS) {
        fprintf(stderr, "random_input: no memory\n");
        exit(1);
    }
    input->sizes[input->buffer_count] = size;
    input->buffers[input->buffer_count++] = buffer;
    return buffer;
}

/* ---- Vertex formats ---- */

enum component { UNORM8, SNORM8, UNORM16, SNORM16, HALF, FLOAT, DOUBLE, PACKED };

struct format {
    uint32_t number; /* VkFormat */
    enum component component;
    uint32_t read; /* number of components that are read */
    uint32_t stored; /* number of components of an element */
};

static const struct format formats[] = {
    {16, UNORM8, 2, 2}, {17, SNORM8, 2, 2},  {24, SNORM8, 3, 3},  {37, UNORM8, 3, 4},  {38, SNORM8, 3, 4},
    {64, PACKED, 3, 1}, {77, UNORM16, 2, 2}, {78, SNORM16, 2, 2}, {83, HALF, 2, 2},    {85, SNORM16, 3, 3},
    {90, HALF, 3, 3},   {91, UNORM16, 3, 4}, {92, SNORM16, 3, 4}, {97, HALF, 3, 4},    {103, FLOAT, 2, 2},
    {106, FLOAT, 3, 3}, {109, FLOAT, 3, 4},  {115, DOUBLE, 2, 2}, {118, DOUBLE, 3, 3}, {121, DOUBLE, 3, 4},
};

static const uint32_t component_sizes[] = {
    [UNORM8] = 1, [SNORM8] = 1, [UNORM16] = 2, [SNORM16] = 2, [HALF] = 2, [FLOAT] = 4, [DOUBLE] = 8, [PACKED] = 4};

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

static void encode(enum component component, double value, unsigned char *ret_bytes)
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

static float decode(enum component component, const unsigned char *bytes)
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

static void encode_vertex(const struct format *format, const double position[3], unsigned char *ret_element)
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

static void decode_vertex(const struct format *format, const unsigned char *element, float ret_position[3])
{
    uint32_t word;
    ret_position[2] = 0;
    if (format->component == PACKED) {
        memcpy(&word, element, 4);
        for (int axis = 0; axis < 3; axis++)
            ret_position[axis] = (float)((word >> 10 * axis & 1023) / 1023.0);
        return;
    }
    for (uint32_t i = 0; i < format->read; i++)
        ret_position[i] = decode(format->component, element + i * component_sizes[format->component]);
}

/* ---- Positions ---- */

/* How the primitives of one geometry are distributed. */
struct manner {
    double scale, offset, size; /* of the whole, and of a primitive relative to it */
    double noise; /* share of components with unusual values */
    uint32_t width; /* width in vertices of a sheet; 0: the primitives are scattered */
    uint64_t seed;
};

static struct manner random_manner(struct random *random, bool wide_range)
{
    static const double scales[] = {1, 1, 1, 1, 1, 50, 1e-3, 1e-20, 1e19, 1e37, 1e-41, 3e38};
    struct manner manner = {.scale = 1, .seed = random_next(random)};
    if (wide_range)
        manner.scale = scales[random_below(random, sizeof scales / sizeof scales[0])];
    manner.offset = wide_range && random_chance(random, 0.1) ? 1000 * manner.scale : 0;
    manner.offset = fabs(manner.offset) < 1e38 ? manner.offset : 0;
    manner.size = pow(10, random_between(random, -3, 0));
    manner.noise = random_chance(random, 0.3) ? 0.01 : 0;
    manner.width = random_chance(random, 0.5) ? 2 + random_below(random, 40) : 0;
    return manner;
}

static double odd_value(struct random *random)
{
    static const double values[] = {NAN,          NAN,    INFINITY, -INFINITY, 0, -0.0,
                                    FLT_TRUE_MIN, -1e-40, 1e30,     -FLT_MAX,  1, 0.5};
    return values[random_below(random, sizeof values / sizeof values[0])];
}

static void random_position(const struct manner *manner, uint32_t vertex, struct random *random, double ret_position[3])
{
    struct random centre = {manner->seed + vertex / 3};
    for (int axis = 0; axis < 3; axis++) {
        double at = random_between(&centre, -1, 1) + manner->size * random_between(random, -1, 1);
        if (manner->width && axis < 2)
            at = 2.0 * (axis ? vertex / manner->width % manner->width : vertex % manner->width) / manner->width - 1;
        ret_position[axis] = manner->offset + manner->scale * fmin(fmax(at, -1), 1);
        if (random_chance(random, manner->noise))
            ret_position[axis] = odd_value(random);
    }
}

/* ---- Triangles ---- */

/* Makes an invertible matrix. */
static void random_matrix(struct random *random, float ret_matrix[12])
{
    double det;
    do {
        for (int i = 0; i < 12; i++)
            ret_matrix[i] = (float)random_between(random, -1.5, 1.5);
        const float *m = ret_matrix;
        det = (double)m[0] * ((double)m[5] * m[10] - (double)m[6] * m[9]) -
              (double)m[1] * ((double)m[4] * m[10] - (double)m[6] * m[8]) +
              (double)m[2] * ((double)m[4] * m[9] - (double)m[5] * m[8]);
    } while (fabs(det) < 0.05);
}

static void apply(const float *matrix, float position[3])
{
    double sums[3];
    for (int row = 0; row < 3; row++)
        sums[row] = (double)matrix[4 * row] * position[0] + (double)matrix[4 * row + 1] * position[1] +
                    (double)matrix[4 * row + 2] * position[2] + matrix[4 * row + 3];
    for (int row = 0; row < 3; row++)
        position[row] = (float)sums[row];
}

/* The choices for one triangle geometry. */
struct random_plan {
    const struct format *format;
    uint32_t count, vertex_count, first_vertex, offset;
    uint64_t stride;
    unsigned char *vertices; /* from the geometry's own offset on */
    uint32_t *indices; /* of all corners, without first_vertex */
    float *matrix; /* the transform; NULL: none */
};

/*
 * Vertex strides are multiples of the component's size (or of the packed element's); 0 and overlapping elements are
 * allowed.
 */
static uint64_t random_stride(const struct format *format, struct random *random)
{
    uint64_t component = component_sizes[format->component], element = component * format->stored;
    if (random_chance(random, 0.5))
        return element;
    if (random_chance(random, 0.05))
        return 0;
    if (random_chance(random, 0.05))
        return component;
    return element + component * random_below(random, 7);
}

static uint64_t element_size(const struct random_plan *plan)
{
    return (uint64_t)component_sizes[plan->format->component] *
           (plan->format->component == PACKED ? 1 : plan->format->read);
}

static void make_vertices(struct random_input *input, struct random_plan *plan, struct random *random,
                          struct geometry *geometry)
{
    bool wide = plan->format->component == FLOAT || plan->format->component == DOUBLE;
    struct manner manner = random_manner(random, wide);
    uint64_t element = element_size(plan);
    uint64_t last = plan->first_vertex + (plan->vertex_count ? plan->vertex_count - 1 : 0);
    uint64_t base = geometry->triangles.index_type == INDEX_NONE ? plan->offset : 0;
    uint64_t size = plan->vertex_count ? base + plan->stride * last + element : 0;
    unsigned char *bytes = random_input_buffer(input, size);
    memset(bytes, 0xff, size);
    for (uint32_t i = 0; i < plan->vertex_count; i++) {
        double position[3];
        random_position(&manner, i, random, position);
        encode_vertex(plan->format, position, bytes + base + plan->stride * (plan->first_vertex + i));
    }
    plan->vertices = bytes + base;
    geometry->triangles.vertices = (struct bytes){bytes, size};
    geometry->triangles.max_vertex = (uint32_t)last;
    if (!plan->count && random_chance(random, 0.3))
        geometry->triangles.vertices = (struct bytes){NULL, 0};
}

/* Returns an index in a strip of the sheet, a neighbour, a repetition, or any index. */
static uint32_t random_index(const struct random_plan *plan, uint32_t corner, struct random *random)
{
    static const uint32_t strip[6] = {0, 1, 7, 1, 8, 7};
    uint32_t triangle = corner / 3;
    if (random_chance(random, 0.02))
        return random_below(random, plan->vertex_count);
    return (triangle / 2 + strip[corner % 6]) % plan->vertex_count;
}

static void make_indices(struct random_input *input, struct random_plan *plan, struct random *random,
                         struct geometry *geometry)
{
    uint32_t type = geometry->triangles.index_type, size = type == INDEX_UINT16 ? 2 : 4;
    uint64_t bytes = plan->count ? plan->offset + (uint64_t)size * 3 * plan->count : 0;
    unsigned char *buffer = random_input_buffer(input, bytes);
    memset(buffer, 0xee, bytes);
    for (uint32_t i = 0; i < 3 * plan->count; i++) {
        plan->indices[i] = random_index(plan, i, random);
        /* All numbers are little-endian. */
        memcpy(buffer + plan->offset + (uint64_t)size * i, &plan->indices[i], size);
    }
    geometry->triangles.indices = (struct bytes){buffer, bytes};
}

static void *zeroed(size_t count, size_t size)
{
    void *block = calloc(count ? count : 1, size);
    if (!block) {
        fprintf(stderr, "random_input: no memory\n");
        exit(1);
    }
    return block;
}

static void mean_triangles(const struct random_plan *plan, struct random_meaning *ret_meaning)
{
    ret_meaning->count = plan->count;
    ret_meaning->corners = zeroed(plan->count, sizeof *ret_meaning->corners);
    ret_meaning->moved = plan->matrix != NULL;
    for (uint32_t i = 0; i < 3 * plan->count; i++) {
        float *corner = ret_meaning->corners[i / 3][i % 3];
        decode_vertex(plan->format, plan->vertices + plan->stride * (plan->first_vertex + plan->indices[i]), corner);
        if (plan->matrix)
            apply(plan->matrix, corner);
    }
}

static float *make_transform(struct random_input *input, struct random *random, struct geometry *geometry)
{
    if (!random_chance(random, 0.3))
        return NULL;
    uint32_t offset = 16 * random_below(random, 3);
    unsigned char *bytes = random_input_buffer(input, offset + 48);
    float matrix[12];
    memset(bytes, 0xdd, offset);
    random_matrix(random, matrix);
    memcpy(bytes + offset, matrix, sizeof matrix);
    geometry->triangles.transform = (struct bytes){bytes, offset + 48};
    geometry->range.transform_offset = offset;
    return (float *)(void *)(bytes + offset);
}

static void make_triangles(struct random_input *input, uint32_t index, uint32_t count, struct random *random)
{
    static const uint32_t index_types[] = {INDEX_NONE, INDEX_UINT16, INDEX_UINT32};
    struct geometry *geometry = &input->geometries[index];
    struct random_plan plan = {.format = &formats[random_below(random, sizeof formats / sizeof formats[0])],
                               .count = count};
    *geometry = (struct geometry){.type = GEOMETRY_TRIANGLES, .flags = random_below(random, 4)};
    uint32_t type = index_types[random_below(random, 3)];
    uint32_t unit = type == INDEX_NONE ? component_sizes[plan.format->component] : type == INDEX_UINT16 ? 2 : 4;
    plan.stride = random_stride(plan.format, random);
    plan.first_vertex = random_chance(random, 0.3) ? random_below(random, 20) : 0;
    plan.offset = random_chance(random, 0.3) ? unit * random_below(random, 10) : 0;
    plan.vertex_count = type == INDEX_NONE || !count ? 3 * count : 1 + random_below(random, 2 * count + 8);
    plan.vertex_count = plan.vertex_count > 60000 ? 60000 : plan.vertex_count;
    plan.indices = zeroed(3 * (size_t)count, sizeof *plan.indices);
    geometry->triangles.vertex_format = plan.format->number;
    geometry->triangles.vertex_stride = plan.stride;
    geometry->triangles.index_type = type;
    geometry->range = (struct geometry_range){count, plan.offset, plan.first_vertex, 0};
    make_vertices(input, &plan, random, geometry);
    for (uint32_t i = 0; i < 3 * count; i++)
        plan.indices[i] = i;
    if (type != INDEX_NONE)
        make_indices(input, &plan, random, geometry);
    plan.matrix = make_transform(input, random, geometry);
    mean_triangles(&plan, &input->meanings[index]);
    input->plans[index] = zeroed(1, sizeof plan);
    *input->plans[index] = plan;
}

static bool vertex_is_number(const struct random_plan *plan, uint32_t vertex)
{
    float position[3];
    decode_vertex(plan->format, plan->vertices + plan->stride * (plan->first_vertex + vertex), position);
    return !isnan(position[0]) && !isnan(position[1]) && !isnan(position[2]);
}

/* Vertices without NaNs change places. Where elements overlap, they would change others too, and stay. */
static void move_triangles(struct random_plan *plan, struct random *random, struct random_meaning *meaning)
{
    const uint64_t size = element_size(plan);
    const uint32_t most = random_chance(random, 0.5) ? plan->vertex_count : 8;
    unsigned char swap[24];
    for (uint32_t i = 0; i < plan->vertex_count && plan->stride >= size; i++) {
        const uint32_t k = (i + random_below(random, most)) % plan->vertex_count;
        unsigned char *a = plan->vertices + plan->stride * (plan->first_vertex + i),
                      *b = plan->vertices + plan->stride * (plan->first_vertex + k);
        if (!vertex_is_number(plan, i) || !vertex_is_number(plan, k) || random_chance(random, 0.3))
            continue;
        memcpy(swap, a, size);
        memcpy(a, b, size);
        memcpy(b, swap, size);
    }
    if (plan->matrix && random_chance(random, 0.5))
        random_matrix(random, plan->matrix);
    free(meaning->corners);
    mean_triangles(plan, meaning);
}

/* ---- Boxes ---- */

static void make_box(const struct manner *manner, uint32_t index, struct random *random, float ret_box[6])
{
    double a[3], b[3];
    random_position(manner, 3 * index, random, a);
    random_position(manner, 3 * index, random, b);
    bool flat = random_chance(random, 0.1);
    for (int axis = 0; axis < 3; axis++) {
        if (flat && random_chance(random, 0.7))
            b[axis] = a[axis];
        bool sorted = a[axis] <= b[axis] || isnan(a[axis]) || isnan(b[axis]);
        ret_box[axis] = (float)(sorted ? a[axis] : b[axis]);
        ret_box[3 + axis] = (float)(sorted ? b[axis] : a[axis]);
    }
}

static void make_boxes(struct random_input *input, uint32_t index, uint32_t count, struct random *random)
{
    struct geometry *geometry = &input->geometries[index];
    struct random_meaning *meaning = &input->meanings[index];
    struct manner manner = random_manner(random, true);
    *geometry = (struct geometry){.type = GEOMETRY_AABBS, .flags = random_below(random, 4)};
    manner.width = 0;
    uint32_t offset = 8 * random_below(random, 4);
    uint64_t stride = random_chance(random, 0.05) ? 8 * (uint64_t)random_below(random, 3)
                                                  : 24 + 8 * (uint64_t)random_below(random, 3);
    uint64_t size = count ? offset + stride * (count - 1) + 24 : 0;
    unsigned char *bytes = random_input_buffer(input, size);
    memset(bytes, 0, size);
    meaning->count = count;
    meaning->boxes = zeroed(count, sizeof *meaning->boxes);
    for (uint32_t i = 0; i < count && stride >= 24; i++) {
        make_box(&manner, i, random, meaning->boxes[i]);
        memcpy(bytes + offset + stride * i, meaning->boxes[i], 24);
    }
    if (count && stride == 0) {
        make_box(&manner, 0, random, meaning->boxes[0]);
        memcpy(bytes + offset, meaning->boxes[0], 24);
    }
    for (uint32_t i = 0; i < count; i++)
        memcpy(meaning->boxes[i], bytes + offset + stride * i, 24);
    geometry->aabbs = (struct geometry_aabbs){stride, {bytes, size}};
    geometry->range = (struct geometry_range){.primitive_count = count, .primitive_offset = offset};
}

static bool box_is_number(const float box[6])
{
    bool number = true;
    for (int i = 0; i < 6; i++)
        number &= !isnan(box[i]);
    return number;
}

/* Boxes without NaNs change places. Overlapping ones stay. */
static void move_boxes(const struct geometry *geometry, struct random *random, struct random_meaning *meaning)
{
    const uint64_t stride = geometry->aabbs.stride;
    unsigned char *bytes = (unsigned char *)(uintptr_t)geometry->aabbs.boxes.data + geometry->range.primitive_offset;
    for (uint32_t i = 0; i < meaning->count && stride >= 24; i++) {
        const uint32_t k = random_below(random, meaning->count);
        float swap[6];
        if (!box_is_number(meaning->boxes[i]) || !box_is_number(meaning->boxes[k]))
            continue;
        memcpy(swap, meaning->boxes[i], sizeof swap);
        memcpy(meaning->boxes[i], meaning->boxes[k], sizeof swap);
        memcpy(meaning->boxes[k], swap, sizeof swap);
        memcpy(bytes + stride * i, meaning->boxes[i], sizeof swap);
        memcpy(bytes + stride * k, meaning->boxes[k], sizeof swap);
    }
}

/* ---- Whole requests ---- */

void random_input_move(void *request, struct random *random)
{
    struct random_input *input = request;
    for (uint32_t i = 0; i < input->input.geometry_count; i++) {
        if (input->plans[i])
            move_triangles(input->plans[i], random, &input->meanings[i]);
        else
            move_boxes(&input->geometries[i], random, &input->meanings[i]);
    }
}

void random_input_options(struct build_input *input, struct random *random)
{
    static const uint32_t preferences[] = {0, BUILD_PREFER_FAST_TRACE, BUILD_PREFER_FAST_BUILD};
    static const uint32_t others[] = {BUILD_ALLOW_UPDATE, BUILD_ALLOW_COMPACTION, BUILD_LOW_MEMORY,
                                      BUILD_ALLOW_DATA_ACCESS};
    input->flags = preferences[random_below(random, 3)];
    for (int i = 0; i < 4; i++)
        input->flags |= random_chance(random, 0.25) ? others[i] : 0;
    input->options.quality = (enum build_quality)random_below(random, 5);
    input->options.target = TARGET_PORTABLE;
    input->options.layout_flags = random_below(random, 2);
}

static void start(struct random_input *ret_input, struct random *random)
{
    memset(ret_input, 0, sizeof *ret_input);
    ret_input->input.type = STRUCTURE_BOTTOM;
    ret_input->input.geometries = ret_input->geometries;
    ret_input->input.geometry_count = random_below(random, 20) ? 1 + random_below(random, RANDOM_INPUT_GEOMETRIES) : 0;
    random_input_options(&ret_input->input, random);
}

/* Small counts are as likely as large ones. */
static uint32_t random_count(struct random *random, uint32_t most)
{
    if (most == 0 || random_chance(random, 0.1))
        return 0;
    return (uint32_t)exp(random_between(random, 0, log(most + 1.0)));
}

static void fill(struct random_input *ret_input, struct random *random, uint32_t most, bool boxes)
{
    start(ret_input, random);
    for (uint32_t i = 0; i < ret_input->input.geometry_count; i++) {
        uint32_t count = random_count(random, most / ret_input->input.geometry_count);
        if (boxes)
            make_boxes(ret_input, i, count, random);
        else
            make_triangles(ret_input, i, count, random);
    }
}

void random_input_triangles(struct random_input *ret_input, struct random *random, uint32_t most)
{
    fill(ret_input, random, most, false);
}

void random_input_bottom(struct random_input *ret_input, struct random *random, uint32_t most)
{
    fill(ret_input, random, most, random_chance(random, 0.25));
}

void random_input_finish(struct random_input *input)
{
    for (uint32_t i = 0; i < input->buffer_count; i++)
        free(input->buffers[i]);
    for (int i = 0; i < RANDOM_INPUT_GEOMETRIES; i++) {
        free(input->meanings[i].corners);
        free(input->meanings[i].boxes);
        if (input->plans[i])
            free(input->plans[i]->indices);
        free(input->plans[i]);
    }
    memset(input, 0, sizeof *input);
}
