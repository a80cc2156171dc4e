/* SPDX-License-Identifier: Apache-2.0 */
/* Triangles with every vertex format and index type, with overlapping elements, offsets and transforms. */
#include "tests/support/builder/random_kind.h"

#include <math.h>
#include <stdlib.h>

#include "tests/support/builder/random_format.h"
#include "tests/support/builder/random_manner.h"

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

/* The choices for one geometry. */
struct random_plan {
    const struct random_format *format;
    uint32_t count, vertex_count, first_vertex, offset;
    uint64_t stride;
    unsigned char *vertices; /* from the geometry's own offset on */
    unsigned char *end_vertices; /* the same at time 1; NULL: they stand still */
    float *matrix; /* the transform; NULL: none */
    bool has_moved; /* before it stood still */
    uint32_t indices[]; /* of all corners, without first_vertex */
};

static void make_vertices(struct random_input *input, struct random_plan *plan, struct random *random,
                          struct geometry *geometry)
{
    bool wide = !input->is_calm && (plan->format->component == FLOAT || plan->format->component == DOUBLE);
    struct random_manner manner = random_manner_make(random, wide);
    if (input->is_calm) { /* no rows of vertices on one line either */
        manner.noise = 0;
        manner.size = fmax(manner.size, 0.03);
        manner.width = plan->format->read < 3 ? 0 : manner.width;
    }
    uint64_t element = random_format_read_size(plan->format);
    uint64_t last = plan->first_vertex + (plan->vertex_count ? plan->vertex_count - 1 : 0);
    uint64_t base = geometry->triangles.index_type == INDEX_NONE ? plan->offset : 0;
    uint64_t size = plan->vertex_count ? base + plan->stride * last + element : 0;
    unsigned char *bytes = random_input_buffer(input, size);
    memset(bytes, 0xff, size);
    for (uint32_t i = 0; i < plan->vertex_count; i++) {
        double position[3];
        random_manner_position(&manner, i, random, position);
        random_format_encode(plan->format, position, bytes + base + plan->stride * (plan->first_vertex + i));
    }
    plan->vertices = bytes + base;
    geometry->triangles.vertices = (struct bytes){bytes, size};
    geometry->triangles.max_vertex = (uint32_t)last;
    if (!plan->count && random_chance(random, 0.3))
        geometry->triangles.vertices = (struct bytes){NULL, 0};
}

/* How the vertices of a geometry move. */
enum travel { RESTING, DRIFTING, SCATTERED, EXCHANGED, FAR_AWAY, TRAVELS };

struct journey {
    enum travel travel;
    struct random_manner manner; /* of places that do not depend on those at time 0 */
    double velocity[3];
    double noise; /* share of components with unusual values */
};

static struct journey random_journey(bool wide, struct random *random)
{
    struct journey journey = {.travel = (enum travel)random_below(random, TRAVELS),
                              .manner = random_manner_make(random, wide)};
    double size = pow(10, random_between(random, -2, wide && journey.travel == FAR_AWAY ? 30 : 0.5));
    for (int axis = 0; axis < 3; axis++)
        journey.velocity[axis] = size * random_between(random, -1, 1);
    journey.noise = wide && random_chance(random, 0.3) ? 0.01 : 0;
    return journey;
}

/* Makes the place at time 1 of vertex i. */
static void arrive(const struct random_plan *plan, const struct journey *journey, uint32_t i, struct random *random,
                   double ret_position[3])
{
    static const double odd[] = {NAN, INFINITY, -INFINITY, 3e38, -3e38, 1e-40};
    const uint32_t from = journey->travel != EXCHANGED ? i : i + 1 < plan->vertex_count ? i ^ 1 : 0;
    float start[3];
    random_format_decode(plan->format, plan->vertices + plan->stride * (plan->first_vertex + from), start);
    random_manner_position(&journey->manner, i, random, ret_position);
    for (int axis = 0; axis < 3; axis++) {
        if (journey->travel != SCATTERED)
            ret_position[axis] = start[axis];
        if (journey->travel == DRIFTING || journey->travel == FAR_AWAY)
            ret_position[axis] += journey->velocity[axis] * random_between(random, 0.9, 1);
        if (random_chance(random, journey->noise))
            ret_position[axis] = odd[random_below(random, sizeof odd / sizeof odd[0])];
    }
}

/* Makes places of the vertices at time 1, in an array like that of time 0. */
static void make_end_vertices(struct random_input *input, struct random_plan *plan, struct random *random,
                              struct geometry *geometry)
{
    const bool wide = !input->is_calm && (plan->format->component == FLOAT || plan->format->component == DOUBLE);
    const struct journey journey = random_journey(wide, random);
    const struct bytes vertices = geometry->triangles.vertices;
    geometry->triangles.end_vertices = vertices;
    if (!vertices.data)
        return;
    unsigned char *bytes = random_input_buffer(input, vertices.size);
    memset(bytes, 0xff, vertices.size);
    plan->end_vertices = bytes + (plan->vertices - vertices.data);
    for (uint32_t i = 0; i < plan->vertex_count; i++) {
        double position[3];
        arrive(plan, &journey, i, random, position);
        random_format_encode(plan->format, position, plan->end_vertices + plan->stride * (plan->first_vertex + i));
    }
    geometry->triangles.end_vertices.data = bytes;
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

static float (*mean_corners(const struct random_plan *plan, const unsigned char *vertices))[3][3]
{
    float(*corners)[3][3] = random_input_zeroed(plan->count, sizeof *corners);
    for (uint32_t i = 0; i < 3 * plan->count; i++) {
        float *corner = corners[i / 3][i % 3];
        random_format_decode(plan->format, vertices + plan->stride * (plan->first_vertex + plan->indices[i]), corner);
        if (plan->matrix)
            apply(plan->matrix, corner);
    }
    return corners;
}

static void mean(const struct random_plan *plan, struct random_meaning *ret_meaning)
{
    ret_meaning->count = plan->count;
    ret_meaning->moved |= plan->matrix != NULL;
    ret_meaning->corners = mean_corners(plan, plan->vertices);
    ret_meaning->end_corners = plan->end_vertices ? mean_corners(plan, plan->end_vertices) : NULL;
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

/* Makes the choices, and the description without its arrays. */
static struct random_plan *make_plan(uint32_t count, struct random *random, struct geometry *ret_geometry)
{
    static const uint32_t index_types[] = {INDEX_NONE, INDEX_UINT16, INDEX_UINT32};
    struct random_plan *plan = random_input_zeroed(1, sizeof *plan + 3 * (size_t)count * sizeof plan->indices[0]);
    plan->format = random_format_any(random);
    plan->count = count;
    *ret_geometry = (struct geometry){.type = GEOMETRY_TRIANGLES, .flags = random_below(random, 4)};
    uint32_t type = index_types[random_below(random, 3)];
    uint32_t unit = type == INDEX_NONE ? random_format_unit(plan->format) : type == INDEX_UINT16 ? 2 : 4;
    plan->stride = random_format_stride(plan->format, random);
    plan->first_vertex = random_chance(random, 0.3) ? random_below(random, 20) : 0;
    plan->offset = random_chance(random, 0.3) ? unit * random_below(random, 10) : 0;
    plan->vertex_count = type == INDEX_NONE || !count ? 3 * count : 1 + random_below(random, 2 * count + 8);
    plan->vertex_count = plan->vertex_count > 60000 ? 60000 : plan->vertex_count;
    ret_geometry->triangles.vertex_format = plan->format->number;
    ret_geometry->triangles.vertex_stride = plan->stride;
    ret_geometry->triangles.index_type = type;
    ret_geometry->range = (struct geometry_range){count, plan->offset, plan->first_vertex, 0};
    return plan;
}

static void make_any(struct random_input *input, uint32_t index, uint32_t count, bool moves, struct random *random)
{
    struct geometry *geometry = &input->geometries[index];
    struct random_plan *plan = make_plan(count, random, geometry);
    make_vertices(input, plan, random, geometry);
    if (moves)
        make_end_vertices(input, plan, random, geometry);
    for (uint32_t i = 0; i < 3 * count; i++)
        plan->indices[i] = i;
    if (geometry->triangles.index_type != INDEX_NONE)
        make_indices(input, plan, random, geometry);
    plan->matrix = make_transform(input, random, geometry);
    mean(plan, &input->meanings[index]);
    input->plans[index] = plan;
}

static void make(struct random_input *input, uint32_t index, uint32_t count, struct random *random)
{
    make_any(input, index, count, false, random);
}

/* One geometry in four stands still. */
static void make_moving(struct random_input *input, uint32_t index, uint32_t count, struct random *random)
{
    const bool moves = random_chance(random, 0.75);
    input->input.flags |= BUILD_MOTION;
    make_any(input, index, count, moves, random);
    if (moves)
        input->geometries[index].type = GEOMETRY_MOVING_TRIANGLES;
    else
        input->meanings[index].moved = true; /* a place between two equal ones is rounded, too */
}

static bool vertex_is_number(const struct random_plan *plan, const unsigned char *vertices, uint32_t vertex)
{
    float position[3];
    random_format_decode(plan->format, vertices + plan->stride * (plan->first_vertex + vertex), position);
    return !isnan(position[0]) && !isnan(position[1]) && !isnan(position[2]);
}

/* Vertices without NaNs change places. Where elements overlap, they would change others too, and stay. */
static void shuffle(const struct random_plan *plan, unsigned char *vertices, struct random *random)
{
    const uint64_t size = random_format_read_size(plan->format);
    const uint32_t most = random_chance(random, 0.5) ? plan->vertex_count : 8;
    unsigned char swap[24];
    for (uint32_t i = 0; i < plan->vertex_count && plan->stride >= size; i++) {
        const uint32_t k = (i + random_below(random, most)) % plan->vertex_count;
        unsigned char *a = vertices + plan->stride * (plan->first_vertex + i),
                      *b = vertices + plan->stride * (plan->first_vertex + k);
        if (!vertex_is_number(plan, vertices, i) || !vertex_is_number(plan, vertices, k) || random_chance(random, 0.3))
            continue;
        memcpy(swap, a, size);
        memcpy(a, b, size);
        memcpy(b, swap, size);
    }
}

static void move(struct random_input *input, uint32_t index, struct random *random)
{
    struct random_plan *plan = input->plans[index];
    shuffle(plan, plan->vertices, random);
    if (plan->end_vertices)
        shuffle(plan, plan->end_vertices, random);
    if (plan->matrix && random_chance(random, 0.5))
        random_matrix(random, plan->matrix);
    free(input->meanings[index].corners);
    free(input->meanings[index].end_corners);
    mean(plan, &input->meanings[index]);
}

/* Makes what stands still move, or what moves stand still for ever, so that no buffer is made twice. */
static void begin_or_end(struct random_input *input, uint32_t index, struct random *random)
{
    struct geometry *geometry = &input->geometries[index];
    struct random_plan *plan = input->plans[index];
    const bool moves = geometry->type == GEOMETRY_TRIANGLES;
    if (moves && plan->has_moved)
        return;
    geometry->type = moves ? GEOMETRY_MOVING_TRIANGLES : GEOMETRY_TRIANGLES;
    plan->has_moved = true;
    if (moves) {
        make_end_vertices(input, plan, random, geometry);
    } else {
        geometry->triangles.end_vertices = (struct bytes){NULL, 0};
        plan->end_vertices = NULL;
    }
    input->meanings[index].moved |= !moves;
}

static bool moves_elsewhere(const struct random_input *input, uint32_t index)
{
    bool moves = false;
    for (uint32_t i = 0; i < input->input.geometry_count; i++)
        moves |= i != index && input->geometries[i].type == GEOMETRY_MOVING_TRIANGLES;
    return moves;
}

/* An update may change which geometries move as long as one of them does. */
static void move_moving(struct random_input *input, uint32_t index, struct random *random)
{
    if (random_chance(random, 0.2) && moves_elsewhere(input, index))
        begin_or_end(input, index, random);
    move(input, index, random);
}

static struct random_fields fields(struct geometry *geometry)
{
    struct geometry_triangles *triangles = &geometry->triangles;
    return (struct random_fields){
        .array_count = 3,
        .arrays = {&triangles->vertices, &triangles->indices, &triangles->transform},
        .format_count = 1,
        .formats = {&triangles->vertex_format},
        .index_type = &triangles->index_type,
        .max_vertex = &triangles->max_vertex,
        .stride_count = 1,
        .strides = {&triangles->vertex_stride},
    };
}

static void blank(struct geometry *geometry, struct bytes bytes)
{
    geometry->triangles = (struct geometry_triangles){
        .vertex_format = 106, .vertex_stride = 12, .index_type = INDEX_NONE, .vertices = bytes};
}

const struct random_kind random_triangles = {
    .type = GEOMETRY_TRIANGLES, .make = make, .move = move, .fields = fields, .blank = blank};

static struct random_fields moving_fields(struct geometry *geometry)
{
    struct random_fields known = fields(geometry);
    known.arrays[known.array_count++] = &geometry->triangles.end_vertices;
    return known;
}

static void blank_moving(struct geometry *geometry, struct bytes bytes)
{
    blank(geometry, bytes);
    geometry->triangles.end_vertices = bytes;
}

const struct random_kind random_moving_triangles = {.type = GEOMETRY_MOVING_TRIANGLES,
                                                    .make = make_moving,
                                                    .move = move_moving,
                                                    .fields = moving_fields,
                                                    .blank = blank_moving};
