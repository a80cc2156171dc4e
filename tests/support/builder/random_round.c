/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/support/builder/random_round.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>

#include "tests/support/builder/random_format.h"

enum { LARGEST_ELEMENT = 24, MOST_VERTICES = 60000 };

/* The choices for one geometry. */
struct random_plan {
    struct random_round round;
    const struct random_format *format, *radius_format;
    uint32_t vertex_count, index_count, first_vertex, offset;
    uint64_t stride, radius_stride;
    unsigned char *vertices, *radii; /* from the geometry's own offset on */
    uint32_t indices[]; /* without first_vertex */
};

/* Both kinds have the same arrays. */
static struct geometry_spheres *arrays_of(struct geometry *geometry)
{
    return geometry->type == GEOMETRY_SPHERES ? &geometry->spheres : &geometry->swept_spheres.ends;
}

/* ---- vertices ---- */

/* How the vertices of one geometry are distributed. */
struct manner {
    double scale, offset; /* of the whole */
    double step; /* the distance of neighbours in a chain, relative to `scale` */
    double thickness; /* a radius, relative to a step */
    double taper; /* by how much it changes from vertex to vertex */
    double noise; /* share of vertices that are odd */
    uint32_t chain; /* vertices; 1: a cloud */
};

static struct manner manner_make(const struct random_plan *plan, struct random *random)
{
    static const double scales[] = {50, 1e-3, 1e-3, 1e15, 1e-15, 1e19, 1e-19, 1e36};
    static const uint32_t chains[] = {1, 2, 2, 4, 10, 100000};
    const bool is_wide = plan->format->component >= FLOAT && plan->radius_format->component == FLOAT;
    struct manner manner = {.scale = 1};
    if (is_wide && random_chance(random, 0.02))
        manner.scale = scales[random_below(random, sizeof scales / sizeof scales[0])];
    manner.offset = is_wide && random_chance(random, 0.02) ? 100 * manner.scale : 0;
    manner.step = pow(10, random_between(random, -1.5, -0.3));
    manner.thickness = pow(10, random_between(random, -1, 0.3));
    manner.taper = random_chance(random, 0.5) ? random_between(random, 0.7, 1) : 1;
    manner.noise = random_chance(random, 0.05) ? 0.03 : 0;
    manner.chain = chains[random_below(random, sizeof chains / sizeof chains[0])];
    return manner;
}

/* Puts an unusual value into a vertex. */
static void make_odd(const struct manner *manner, const double previous[4], struct random *random, double vertex[4])
{
    /* The smallest doubles become 0 and -0 in every format. */
    static const double radii[] = {DBL_TRUE_MIN, DBL_TRUE_MIN, -DBL_TRUE_MIN, FLT_TRUE_MIN, NAN, INFINITY, 1e30};
    static const double places[] = {NAN, INFINITY, -INFINITY, -0.0, -FLT_MAX};
    double square = 0;
    for (int axis = 0; axis < 3; axis++)
        square += pow(vertex[axis] - previous[axis], 2);
    switch (random_below(random, 8)) {
    case 0:
        vertex[random_below(random, 3)] = places[random_below(random, sizeof places / sizeof places[0])];
        break;
    case 1: /* one sphere in the other */
        vertex[3] = previous[3] + sqrt(square) * random_between(random, 1, 3);
        break;
    case 2: /* almost so */
    case 3:
        vertex[3] = fabs(previous[3] + (random_chance(random, 0.5) ? -1 : 1) * sqrt(square) *
                                           (1 + 1e-6 * random_between(random, -1, 1)));
        break;
    case 4: /* almost at the same place */
        for (int axis = 0; axis < 3; axis++)
            vertex[axis] = previous[axis] + (random_chance(random, 0.5) ? 1e-6 * manner->scale : 0);
        break;
    default:
        vertex[3] = radii[random_below(random, sizeof radii / sizeof radii[0])];
    }
}

/* Makes the next vertex: a centre and a radius. */
static void make_vertex(const struct manner *manner, uint32_t index, const double previous[4], struct random *random,
                        double ret_vertex[4])
{
    const double size = manner->scale * manner->step;
    bool is_first = index % manner->chain == 0;
    for (int axis = 0; axis < 3; axis++) {
        double at = manner->offset + manner->scale * random_between(random, -1, 1);
        if (!is_first && isfinite(previous[axis]) && fabs(previous[axis]) < 1e38)
            at = previous[axis] + size * random_between(random, -0.6, 1);
        ret_vertex[axis] = at;
    }
    ret_vertex[3] = size * manner->thickness * random_between(random, 0.5, 1);
    if (!is_first && previous[3] < 1e3 * size && previous[3] > 0)
        ret_vertex[3] = previous[3] * manner->taper;
    if (random_chance(random, manner->noise))
        make_odd(manner, previous, random, ret_vertex);
}

/* Returns the size of an array of which `count` elements are read from element `first` on. */
static uint64_t array_size(uint64_t offset, uint64_t stride, uint32_t first, uint32_t count, uint64_t element)
{
    return count ? offset + stride * (first + count - 1) + element : 0;
}

static void make_vertices(struct random_input *input, struct random_plan *plan, struct random *random,
                          struct geometry_spheres *arrays)
{
    const struct manner manner = manner_make(plan, random);
    const uint64_t base = arrays->index_type == INDEX_NONE ? plan->offset : 0;
    const uint64_t size =
        array_size(base, plan->stride, plan->first_vertex, plan->vertex_count, random_format_read_size(plan->format));
    const uint64_t radius_size = array_size(base, plan->radius_stride, plan->first_vertex, plan->vertex_count,
                                            random_format_read_size(plan->radius_format));
    unsigned char *vertices = random_input_buffer(input, size), *radii = random_input_buffer(input, radius_size);
    double previous[4] = {0}, vertex[4];
    memset(vertices, 0x3c, size);
    memset(radii, 0x2c, radius_size);
    for (uint32_t i = 0; i < plan->vertex_count; i++) {
        make_vertex(&manner, i, previous, random, vertex);
        const double radius[3] = {vertex[3]};
        random_format_encode(plan->format, vertex, vertices + base + plan->stride * (plan->first_vertex + i));
        random_format_encode(plan->radius_format, radius,
                             radii + base + plan->radius_stride * (plan->first_vertex + i));
        memcpy(previous, vertex, sizeof previous);
    }
    plan->vertices = vertices + base;
    plan->radii = radii + base;
    arrays->vertices = (struct bytes){vertices, size};
    arrays->radii = (struct bytes){radii, radius_size};
}

/* ---- indices ---- */

/* Makes an index, which mostly goes on where the last primitive ended. */
static uint32_t next_index(const struct random_plan *plan, uint32_t at, struct random *random)
{
    const uint32_t vertices = plan->round.naming == RANDOM_SUCCESSIVE ? plan->vertex_count - 1 : plan->vertex_count;
    const bool is_second = plan->round.naming == RANDOM_LIST && plan->round.per_primitive == 2 && at % 2 == 1;
    const uint32_t last = at ? plan->indices[at - 1] : 0;
    if (at == 0 || random_chance(random, 0.05))
        return random_below(random, vertices);
    if (random_chance(random, 0.02))
        return last;
    /* the pairs of a list are 0 1, 1 2, 2 3 */
    const bool is_shared = plan->round.naming == RANDOM_LIST && plan->round.per_primitive == 2 && !is_second;
    return is_shared ? last : (last + 1) % vertices;
}

static void make_indices(struct random_input *input, struct random_plan *plan, struct random *random,
                         struct geometry_spheres *arrays)
{
    const uint32_t size = arrays->index_type == INDEX_UINT16 ? 2 : 4;
    const uint64_t bytes = array_size(plan->offset, arrays->index_stride, 0, plan->index_count, size);
    unsigned char *buffer = random_input_buffer(input, bytes);
    memset(buffer, 0xee, bytes);
    for (uint32_t i = 0; i < plan->index_count; i++) {
        plan->indices[i] = next_index(plan, i, random);
        /* All numbers are little-endian. */
        memcpy(buffer + plan->offset + arrays->index_stride * i, &plan->indices[i], size);
    }
    /* Where elements overlap, the last one counts. */
    for (uint32_t i = 0; i < plan->index_count; i++) {
        plan->indices[i] = 0;
        memcpy(&plan->indices[i], buffer + plan->offset + arrays->index_stride * i, size);
    }
    arrays->indices = (struct bytes){buffer, bytes};
}

/* ---- meaning ---- */

/* Returns vertex `end` of a primitive, without first_vertex. */
static uint32_t vertex_of(const struct random_plan *plan, uint32_t primitive, uint32_t end)
{
    if (plan->round.naming == RANDOM_SUCCESSIVE)
        return plan->indices[primitive] + end;
    const uint32_t at = plan->round.per_primitive * primitive + end;
    return plan->round.naming == RANDOM_LIST ? plan->indices[at] : at;
}

/* A primitive that goes on with a chain has a cap at its second end alone. */
static uint8_t caps_of(const struct random_plan *plan, uint32_t primitive)
{
    if (!plan->round.has_caps)
        return 0;
    if (plan->round.naming == RANDOM_SUCCESSIVE && primitive > 0 &&
        plan->indices[primitive] == plan->indices[primitive - 1] + 1)
        return ORACLE_CAP_SECOND;
    return ORACLE_CAP_FIRST | ORACLE_CAP_SECOND;
}

static void decode(const struct random_plan *plan, uint32_t vertex, float ret_centre[3], float *ret_radius)
{
    const uint64_t at = (uint64_t)plan->first_vertex + vertex;
    float radius[3];
    random_format_decode(plan->format, plan->vertices + plan->stride * at, ret_centre);
    random_format_decode(plan->radius_format, plan->radii + plan->radius_stride * at, radius);
    *ret_radius = radius[0];
}

static void mean(const struct random_plan *plan, struct random_meaning *meaning)
{
    const uint32_t each = plan->round.per_primitive, count = plan->round.count;
    free(meaning->centres);
    free(meaning->radii);
    free(meaning->caps);
    meaning->count = count;
    meaning->centres = random_input_zeroed((size_t)each * count, sizeof *meaning->centres);
    meaning->radii = random_input_zeroed((size_t)each * count, sizeof *meaning->radii);
    meaning->caps = random_input_zeroed(count, 1);
    for (uint32_t i = 0; i < count; i++) {
        meaning->caps[i] = caps_of(plan, i);
        for (uint32_t end = 0; end < each; end++)
            decode(plan, vertex_of(plan, i, end), meaning->centres[each * (size_t)i + end],
                   &meaning->radii[each * (size_t)i + end]);
    }
}

/* ---- a geometry ---- */

static uint32_t vertices_for(const struct random_round *round, struct random *random)
{
    if (round->naming == RANDOM_EVERY || round->count == 0)
        return round->per_primitive * round->count;
    const uint32_t most = round->per_primitive * round->count + 8;
    const uint32_t vertices = round->per_primitive + random_below(random, most);
    return vertices > MOST_VERTICES ? MOST_VERTICES : vertices;
}

/* Makes the choices, and the description without its arrays. */
static struct random_plan *make_plan(const struct random_round *round, struct random *random, struct geometry *geometry)
{
    const uint32_t indices = round->naming == RANDOM_EVERY        ? 0
                             : round->naming == RANDOM_SUCCESSIVE ? round->count
                                                                  : round->per_primitive * round->count;
    struct random_plan *plan = random_input_zeroed(1, sizeof *plan + (size_t)indices * sizeof plan->indices[0]);
    struct geometry_spheres *arrays = arrays_of(geometry);
    plan->round = *round;
    plan->format = random_format_any(random);
    plan->radius_format = random_format_radius(random);
    plan->index_count = indices;
    plan->vertex_count = vertices_for(round, random);
    plan->stride = random_format_stride(plan->format, random);
    plan->radius_stride = random_format_stride(plan->radius_format, random);
    plan->first_vertex = random_chance(random, 0.3) ? random_below(random, 20) : 0;
    arrays->vertex_format = plan->format->number;
    arrays->radius_format = plan->radius_format->number;
    arrays->vertex_stride = plan->stride;
    arrays->radius_stride = plan->radius_stride;
    arrays->index_type = indices == 0 && round->naming == RANDOM_EVERY ? INDEX_NONE : random_below(random, 2);
    uint32_t unit = arrays->index_type == INDEX_UINT16 ? 2 : 4;
    arrays->index_stride = random_chance(random, 0.7) ? unit : unit * random_below(random, 5);
    /* The same offset counts for centres and radii. */
    plan->offset = random_chance(random, 0.3) ? 8 * random_below(random, 10) : 0;
    geometry->range = (struct geometry_range){round->count, plan->offset, plan->first_vertex, 0};
    return plan;
}

void random_round_make(struct random_input *input, uint32_t index, const struct random_round *round,
                       struct random *random)
{
    struct geometry *geometry = &input->geometries[index];
    struct random_plan *plan = make_plan(round, random, geometry);
    make_vertices(input, plan, random, arrays_of(geometry));
    if (round->naming != RANDOM_EVERY)
        make_indices(input, plan, random, arrays_of(geometry));
    input->meanings[index].shape = input->kind->shape;
    mean(plan, &input->meanings[index]);
    input->plans[index] = plan;
}

/* ---- moves ---- */

static bool is_number(const struct random_format *format, const unsigned char *element)
{
    float values[3];
    random_format_decode(format, element, values);
    return !isnan(values[0]) && (format->read == 1 || (!isnan(values[1]) && !isnan(values[2])));
}

/* Elements without NaNs change places. Where they overlap, they would change others too, and stay. */
static void shuffle(const struct random_format *format, unsigned char *elements, uint64_t stride, uint32_t count,
                    uint32_t most, struct random *random)
{
    const uint64_t size = random_format_read_size(format);
    unsigned char swap[LARGEST_ELEMENT];
    for (uint32_t i = 0; i < count && stride >= size; i++) {
        const uint32_t k = (i + random_below(random, most)) % count;
        unsigned char *a = elements + stride * i, *b = elements + stride * k;
        if (!is_number(format, a) || !is_number(format, b) || random_chance(random, 0.3))
            continue;
        memcpy(swap, a, size);
        memcpy(a, b, size);
        memcpy(b, swap, size);
    }
}

void random_round_move(struct random_input *input, uint32_t index, struct random *random)
{
    struct random_plan *plan = input->plans[index];
    const uint32_t most = random_chance(random, 0.3) ? plan->vertex_count : 3;
    shuffle(plan->format, plan->vertices + plan->stride * plan->first_vertex, plan->stride, plan->vertex_count, most,
            random);
    shuffle(plan->radius_format, plan->radii + plan->radius_stride * plan->first_vertex, plan->radius_stride,
            plan->vertex_count, most, random);
    mean(plan, &input->meanings[index]);
}

/* ---- descriptions ---- */

struct random_fields random_round_fields(struct geometry *geometry)
{
    struct geometry_spheres *arrays = arrays_of(geometry);
    return (struct random_fields){
        .array_count = 3,
        .arrays = {&arrays->vertices, &arrays->radii, &arrays->indices},
        .format_count = 2,
        .formats = {&arrays->vertex_format, &arrays->radius_format},
        .index_type = &arrays->index_type,
        .stride_count = 3,
        .strides = {&arrays->vertex_stride, &arrays->radius_stride, &arrays->index_stride},
    };
}

void random_round_blank(struct geometry *geometry, struct bytes bytes)
{
    *arrays_of(geometry) = (struct geometry_spheres){.vertex_format = 106,
                                                     .radius_format = 100,
                                                     .index_type = INDEX_NONE,
                                                     .vertex_stride = 16,
                                                     .radius_stride = 16,
                                                     .vertices = bytes,
                                                     .radii = bytes};
}
