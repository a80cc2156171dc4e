/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/support/builder/test_ir.h"

#include <stdio.h>
#include <stdlib.h>

#include "builder/format/portable.h"
#include "builder/format/swept_shape.h"
#include "proto/base/kind.h"

static void *need(size_t count, size_t size)
{
    void *block = calloc(count ? count : 1, size);
    if (!block) {
        fprintf(stderr, "no memory for a test\n");
        abort();
    }
    return block;
}

static void place_point(const struct test_shape *shape, struct random *random, const double around[3],
                        float ret_point[3])
{
    double offset[3];
    random_point(random, offset);
    for (int axis = 0; axis < 3; axis++)
        ret_point[axis] = (float)(around[axis] + offset[axis] * shape->size * shape->detail);
}

static void place_centre(const struct test_shape *shape, struct random *random, double ret_centre[3])
{
    random_point(random, ret_centre);
    for (int axis = 0; axis < 3; axis++)
        ret_centre[axis] = shape->centre + ret_centre[axis] * shape->size / 2;
}

/* Makes the positions at t = 1 of a geometry: each vertex goes some way in a direction of its own. */
static const float *make_ends(const struct test_shape *shape, struct random *random,
                              const struct canonical_geometry *geometry, struct test_model *model)
{
    const size_t floats = (size_t)3 * geometry->vertex_count;
    if (!model->data[2])
        model->data[2] = need(floats * shape->geometries, sizeof(float));
    float *ends = (float *)model->data[2] + (size_t)3 * geometry->first_vertex;
    for (size_t i = 0; i < floats; i++)
        ends[i] = (float)(geometry->positions[i] + random_between(random, -1, 2) * shape->size * shape->detail);
    return ends;
}

/* Makes vertices in clusters of eight, so that triangles over neighbours are small. */
static void make_triangles(const struct test_shape *shape, struct random *random, struct test_model *model)
{
    uint32_t vertices = shape->soup ? 3 * shape->primitives : shape->primitives / 3 + 8;
    float *positions = need((size_t)shape->geometries * vertices, 12);
    uint32_t *indices = need((size_t)shape->geometries * shape->primitives, 12);
    double centre[3] = {0};
    for (uint32_t i = 0; i < shape->geometries * vertices; i++) {
        if (i % 8 == 0)
            place_centre(shape, random, centre);
        place_point(shape, random, centre, positions + 3 * (size_t)i);
    }
    for (uint32_t i = 0; i < shape->geometries * shape->primitives; i++) {
        uint32_t base = (uint32_t)(random_next(random) % (vertices / 8)) * 8, from = (uint32_t)random_next(random);
        for (uint32_t k = 0; k < 3; k++)
            indices[3 * (size_t)i + k] = base + (from + 3 * k) % 8;
    }
    for (uint32_t g = 0; g < shape->geometries; g++) {
        struct canonical_geometry *geometry = &model->canonical.geometries[g];
        geometry->vertex_count = vertices;
        geometry->first_vertex = g * vertices;
        geometry->positions = positions + (size_t)3 * vertices * g;
        geometry->indices = shape->soup ? NULL : indices + (size_t)3 * shape->primitives * g;
        if (shape->type == GEOMETRY_MOVING_TRIANGLES && g % 3 == 2)
            geometry->type = GEOMETRY_TRIANGLES;
        else if (shape->type == GEOMETRY_MOVING_TRIANGLES)
            geometry->end_positions = make_ends(shape, random, geometry, model);
    }
    model->canonical.vertex_count = shape->geometries * vertices;
    model->data[0] = positions;
    model->data[1] = indices;
}

/* Makes vertices with radii in clusters of eight. */
static void make_round_vertices(const struct test_shape *shape, struct random *random, uint32_t count,
                                float (*ret_vertices)[4])
{
    double centre[3] = {0};
    for (uint32_t i = 0; i < count; i++) {
        if (i % 8 == 0)
            place_centre(shape, random, centre);
        place_point(shape, random, centre, ret_vertices[i]);
        ret_vertices[i][3] = (float)(random_between(random, 0, 1) * shape->size * shape->detail);
    }
}

/* Linear swept spheres are in chains within the clusters, and have any caps. */
static void make_round(const struct test_shape *shape, struct random *random, struct test_model *model)
{
    const bool is_swept = shape->type == GEOMETRY_SWEPT_SPHERES, is_soup = shape->soup && !is_swept;
    const uint32_t clusters = shape->primitives / 24 + 1, vertices = is_soup ? shape->primitives : 8 * clusters;
    float(*positions)[4] = need((size_t)shape->geometries * vertices, sizeof *positions);
    uint32_t *indices = need((size_t)shape->geometries * shape->primitives, sizeof *indices);
    make_round_vertices(shape, random, shape->geometries * vertices, positions);
    for (uint32_t i = 0; i < shape->geometries * shape->primitives; i++) {
        indices[i] = (uint32_t)(8 * (random_next(random) % clusters) + random_next(random) % (is_swept ? 7 : 8));
        if (is_swept)
            indices[i] |= (uint32_t)random_next(random) & (CANONICAL_CAP_FIRST | CANONICAL_CAP_SECOND);
    }
    for (uint32_t g = 0; g < shape->geometries; g++) {
        struct canonical_geometry *geometry = &model->canonical.geometries[g];
        geometry->vertex_count = vertices;
        geometry->first_vertex = g * vertices;
        geometry->positions = positions[(size_t)vertices * g];
        geometry->indices = is_soup ? NULL : indices + (size_t)shape->primitives * g;
    }
    model->canonical.vertex_count = shape->geometries * vertices;
    model->data[0] = positions;
    model->data[1] = indices;
}

static void make_aabbs(const struct test_shape *shape, struct random *random, struct test_model *model)
{
    float *boxes = need((size_t)shape->geometries * shape->primitives, 24);
    for (uint32_t i = 0; i < shape->geometries * shape->primitives; i++) {
        double centre[3];
        struct box box = box_empty();
        place_centre(shape, random, centre);
        for (int k = 0; k < 2; k++) {
            float point[3];
            place_point(shape, random, centre, point);
            box_add_point(&box, point);
        }
        memcpy(boxes + 6 * (size_t)i, &box, sizeof box);
    }
    for (uint32_t g = 0; g < shape->geometries; g++)
        model->canonical.geometries[g].boxes = boxes + (size_t)6 * shape->primitives * g;
    model->data[0] = boxes;
}

static void make_instances(const struct test_shape *shape, struct random *random, struct test_model *model)
{
    unsigned char *records = need(shape->primitives, 64);
    struct canonical *canonical = &model->canonical;
    canonical->type = STRUCTURE_TOP;
    canonical->reference_count = 3;
    canonical->references = need(3, sizeof *canonical->references);
    for (uint32_t i = 0; i < shape->primitives; i++) {
        unsigned char *record = records + (size_t)64 * i;
        float transform[12];
        double centre[3];
        place_centre(shape, random, centre);
        for (int entry = 0; entry < 12; entry++)
            transform[entry] = (float)(entry % 4 == 3 ? centre[entry / 4]
                                                      : random_between(random, -1, 1) * shape->size * shape->detail);
        memcpy(record, transform, sizeof transform);
        bytes_put32(record + 48, (uint32_t)random_next(random));
        bytes_put32(record + 52, (uint32_t)random_next(random));
        bytes_put64(record + 56, 1 + random_next(random) % 3);
    }
    canonical->geometries[0].instances = records;
    model->data[0] = records;
    model->data[2] = canonical->references;
}

/* Fills `numbers` of a key: a matrix, or the fields of VkSRTDataNV, whose last three are its translation. */
static void make_key(const struct test_shape *shape, struct random *random, bool is_srt, float numbers[PORTABLE_SRT])
{
    double centre[3];
    place_centre(shape, random, centre);
    for (int i = 0; i < PORTABLE_SRT; i++)
        numbers[i] = (float)random_between(random, -1, 1) * (is_srt ? 1 : (float)(shape->size * shape->detail));
    for (int axis = 0; axis < 3; axis++)
        numbers[is_srt ? 13 + axis : 4 * axis + 3] = (float)centre[axis];
}

static void make_moving_instances(const struct test_shape *shape, struct random *random, struct test_model *model)
{
    static const uint32_t numbers[MOTION_TYPES] = {PORTABLE_MATRIX, PORTABLE_MATRIX, PORTABLE_SRT};
    unsigned char *records = need(shape->primitives, MOTION_RECORD_STRIDE);
    struct canonical *canonical = &model->canonical;
    canonical->type = STRUCTURE_TOP;
    canonical->reference_count = 3;
    canonical->references = need(3, sizeof *canonical->references);
    for (uint32_t i = 0; i < shape->primitives; i++) {
        const uint32_t motion = i % MOTION_TYPES;
        unsigned char *record = records + (size_t)MOTION_RECORD_STRIDE * i, *at = record + MOTION_RECORD_DATA;
        bytes_put32(record, motion);
        for (uint32_t key = 0; key < (motion == MOTION_STATIC ? 1u : 2u); key++) {
            float values[PORTABLE_SRT];
            make_key(shape, random, motion == MOTION_SRT, values);
            memcpy(at, values, numbers[motion] * sizeof *values);
            at += numbers[motion] * sizeof *values;
        }
        bytes_put32(at, (uint32_t)random_next(random));
        bytes_put32(at + 4, (uint32_t)random_next(random));
        bytes_put64(at + 8, 1 + random_next(random) % 3);
    }
    canonical->geometries[0].instances = records;
    model->data[0] = records;
    model->data[2] = canonical->references;
}

/* Returns the unit cube's box under a row-major matrix of floats at any address. */
static struct box box_of_cube(const unsigned char *matrix)
{
    struct box box = box_empty();
    float m[12];
    memcpy(m, matrix, sizeof m);
    for (int corner = 0; corner < 8; corner++) {
        float point[3];
        for (int row = 0; row < 3; row++)
            point[row] = m[4 * row + 3] + (corner & 1 ? m[4 * row] : 0) + (corner & 2 ? m[4 * row + 1] : 0) +
                         (corner & 4 ? m[4 * row + 2] : 0);
        box_add_point(&box, point);
    }
    return box;
}

/*
 * Returns the box of what moves at one key. That of an instance which rotates is a wide one around its places, the same
 * at both keys.
 */
static struct box box_at(const struct canonical_geometry *geometry, uint32_t index, uint32_t key)
{
    struct box box = box_empty();
    if (geometry->type != GEOMETRY_MOVING_INSTANCES) {
        const float *positions = key && geometry->end_positions ? geometry->end_positions : geometry->positions;
        for (uint32_t k = 0; k < 3; k++) {
            const uint32_t corner = 3 * index + k;
            box_add_point(&box, positions + (size_t)3 * (geometry->indices ? geometry->indices[corner] : corner));
        }
        return box;
    }
    const unsigned char *record = geometry->instances + (size_t)MOTION_RECORD_STRIDE * index;
    const uint32_t motion = bytes_get32(record);
    record += MOTION_RECORD_DATA;
    if (motion != MOTION_SRT)
        return box_of_cube(record + (motion == MOTION_MATRIX && key ? 48 : 0));
    for (int end = 0; end < 2; end++) {
        float place[3];
        memcpy(place, record + 64 * end + 52, sizeof place);
        box_add_point(&box, place);
    }
    for (int axis = 0; axis < 3; axis++) {
        box.min[axis] -= 8;
        box.max[axis] += 8;
    }
    return box;
}

static bool is_in_tree(const struct test_shape *shape, uint32_t primitive)
{
    return !shape->inactive || primitive % shape->inactive != 0;
}

static void find_keys(const struct test_shape *shape, struct test_model *model)
{
    const uint32_t count = model->canonical.primitive_count;
    for (uint32_t key = 0; key < IR_MAX_KEYS; key++) {
        model->keys[key] = need(count, sizeof *model->keys[key]);
        for (uint32_t i = 0; i < count; i++)
            model->keys[key][i] = is_in_tree(shape, i) ? box_at(&model->canonical.geometries[i / shape->primitives],
                                                                i % shape->primitives, key)
                                                       : box_empty();
    }
}

/* Fills the boxes over both keys. */
static void join_keys(struct test_model *model)
{
    for (uint32_t i = 0; i < model->canonical.primitive_count; i++) {
        model->boxes[i] = model->keys[0][i];
        box_grow(&model->boxes[i], &model->keys[1][i]);
    }
}

/*
 * Returns a primitive's box; for an instance, the unit cube's through the matrix, which is accurate enough for a test.
 */
static struct box box_of(const struct canonical_geometry *geometry, uint32_t index)
{
    struct box box = box_empty();
    if (geometry->type == GEOMETRY_TRIANGLES) {
        float corners[3][3];
        canonical_triangle(geometry, index, corners);
        for (int k = 0; k < 3; k++)
            box_add_point(&box, corners[k]);
    } else if (geometry->type == GEOMETRY_SPHERES) {
        box = swept_shape_sphere(geometry->positions +
                                 (size_t)4 * (geometry->indices ? geometry->indices[index] : index));
    } else if (geometry->type == GEOMETRY_SWEPT_SPHERES) {
        const uint32_t word = geometry->indices[index];
        const float *first = geometry->positions + (size_t)4 * (word & CANONICAL_END_MASK);
        box = swept_shape_box(first, first + 4, word >> 30);
    } else if (geometry->type == GEOMETRY_AABBS) {
        memcpy(&box, geometry->boxes + 6 * (size_t)index, sizeof box);
    } else {
        box = box_of_cube(geometry->instances + (size_t)64 * index);
    }
    return box;
}

void test_model_make(const struct test_shape *shape, uint64_t seed, struct test_model *ret_model)
{
    struct random random = {seed};
    struct test_model model = {.canonical = {
                                   .type = STRUCTURE_BOTTOM,
                                   .geometry_count = shape->geometries,
                                   .primitive_count = shape->geometries * shape->primitives,
                                   .geometries = need(shape->geometries, sizeof(struct canonical_geometry)),
                               }};
    for (uint32_t g = 0; g < shape->geometries; g++) {
        struct canonical_geometry *geometry = &model.canonical.geometries[g];
        geometry->type = shape->type;
        geometry->flags = g % 2 ? 0 : GEOMETRY_OPAQUE;
        geometry->primitive_count = shape->primitives;
        geometry->first_primitive = g * shape->primitives;
    }
    if (shape->type == GEOMETRY_TRIANGLES || shape->type == GEOMETRY_MOVING_TRIANGLES)
        make_triangles(shape, &random, &model);
    else if (shape->type == GEOMETRY_SPHERES || shape->type == GEOMETRY_SWEPT_SPHERES)
        make_round(shape, &random, &model);
    else if (shape->type == GEOMETRY_AABBS)
        make_aabbs(shape, &random, &model);
    else if (shape->type == GEOMETRY_MOVING_INSTANCES)
        make_moving_instances(shape, &random, &model);
    else
        make_instances(shape, &random, &model);
    model.boxes = need(model.canonical.primitive_count, sizeof *model.boxes);
    if (kind_find(shape->type)->moves) {
        find_keys(shape, &model);
        join_keys(&model);
    } else {
        for (uint32_t i = 0; i < model.canonical.primitive_count; i++)
            model.boxes[i] = is_in_tree(shape, i)
                                 ? box_of(&model.canonical.geometries[i / shape->primitives], i % shape->primitives)
                                 : box_empty();
    }
    *ret_model = model;
}

void test_model_finish(struct test_model *model)
{
    for (int i = 0; i < 3; i++)
        free(model->data[i]);
    for (int key = 0; key < IR_MAX_KEYS; key++)
        free(model->keys[key]);
    free(model->canonical.geometries);
    free(model->boxes);
    memset(model, 0, sizeof *model);
}

struct entry {
    double key;
    uint32_t id;
};

static int compare(const void *a, const void *b)
{
    const struct entry *x = a, *y = b;
    return x->key != y->key ? (x->key < y->key ? -1 : 1) : (x->id > y->id) - (x->id < y->id);
}

static int longest_axis(const struct box *box)
{
    int longest = 0;
    for (int axis = 1; axis < 3; axis++)
        if ((double)box->max[axis] - box->min[axis] > (double)box->max[longest] - box->min[longest])
            longest = axis;
    return longest;
}

static void split(struct ir *ir, const struct box *boxes, struct entry *entries, uint32_t node, uint32_t first,
                  uint32_t count, uint32_t leaf_max)
{
    struct box box = box_empty();
    for (uint32_t i = first; i < first + count; i++)
        box_grow(&box, &boxes[entries[i].id]);
    ir->boxes[0][node] = box;
    if (count <= leaf_max) {
        ir->nodes[node] = (struct ir_node){first, count};
        for (uint32_t i = first; i < first + count; i++)
            ir->refs[i] = entries[i].id;
        return;
    }
    int axis = longest_axis(&box);
    for (uint32_t i = first; i < first + count; i++)
        entries[i].key = (double)boxes[entries[i].id].min[axis] + boxes[entries[i].id].max[axis];
    qsort(entries + first, count, sizeof *entries, compare);
    uint32_t children = ir->node_count, half = count / 2;
    ir->node_count += 2;
    ir->nodes[node] = (struct ir_node){children, 0};
    split(ir, boxes, entries, children, first, half, leaf_max);
    split(ir, boxes, entries, children + 1, first + half, count - half, leaf_max);
}

enum bvhd_status test_ir_make(const struct box *boxes, uint32_t count, uint32_t leaf_max, struct memory *memory,
                              struct ir *ret_ir)
{
    struct entry *entries = need(count, sizeof *entries);
    uint32_t kept = 0;
    for (uint32_t i = 0; i < count; i++)
        if (!box_is_empty(&boxes[i]))
            entries[kept++].id = i;
    enum bvhd_status status = ir_init(ret_ir, memory, kept ? 2 * kept - 1 : 0, kept, NULL);
    if (status == BVHD_OK && kept > 0) {
        ret_ir->node_count = 1;
        ret_ir->ref_count = kept;
        split(ret_ir, boxes, entries, 0, 0, kept, leaf_max);
    }
    free(entries);
    return status;
}
