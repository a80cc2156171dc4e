/* SPDX-License-Identifier: Apache-2.0 */
/*
 * moving_structure.h - makes structures that move for tests of the traversal, without the builder: trees of eight
 * children over boxes at both keys, as the traversal sees them. For unit tests only.
 */
#ifndef BVHD_MOVING_STRUCTURE_H
#define BVHD_MOVING_STRUCTURE_H

#include <math.h>

#include "builder/format/portable_quantise.h"
#include "builder/traverse/unpacked.h"

enum { MOVING_LEAF = 3, MOVING_WIDTH = 8 };

/* The boxes of something at t = 0 and t = 1. */
struct span {
    struct box keys[2];
    uint32_t index;
};

/* A structure, as the traversal sees it. */
struct made {
    struct portable_header header;
    struct portable_view view;
    struct portable_moving_node *nodes;
    struct portable_indexed_triangle *triangles;
    struct portable_moving_vertex *vertices;
    struct portable_moving_instance *instances;
    struct portable_geometry geometries[2];
    struct unpacked_moving_node *unpacked;
    uint32_t *order; /* of the records: what they were made from */
};

/* A node that is to be written: some of the spans. */
struct task {
    struct span *spans;
    uint32_t count;
};

static inline struct box around(const struct span *spans, uint32_t count, int key)
{
    struct box box = box_empty();
    for (uint32_t i = 0; i < count; i++)
        box_grow(&box, &spans[i].keys[key]);
    return box;
}

static int sort_axis;

static inline int by_centre(const void *a, const void *b)
{
    double centres[2];
    for (int i = 0; i < 2; i++) {
        const struct span *span = i ? b : a;
        centres[i] = (double)span->keys[0].min[sort_axis] + span->keys[0].max[sort_axis] +
                     span->keys[1].min[sort_axis] + span->keys[1].max[sort_axis];
    }
    return (centres[0] > centres[1]) - (centres[0] < centres[1]);
}

static inline uint8_t steps_down(double at, double step)
{
    return step == 0 ? 0 : (uint8_t)fmin(255, fmax(0, floor(at / step - PORTABLE_MARGIN)));
}

static inline uint8_t steps_up(double at, double step)
{
    return step == 0 ? 0 : (uint8_t)fmin(255, fmax(0, ceil(at / step + PORTABLE_MARGIN)));
}

/* Puts the boxes of both keys into a node, on a grid that holds all. */
static inline void write_boxes(const struct box keys[2][MOVING_WIDTH], unsigned occupied,
                               struct portable_moving_node *node)
{
    struct portable_boxes boxes;
    unsigned filled = (unsigned)__builtin_ctz(occupied);
    for (unsigned slot = 0; slot < MOVING_WIDTH; slot++) {
        struct box both = keys[0][occupied >> slot & 1 ? slot : filled];
        box_grow(&both, &keys[1][occupied >> slot & 1 ? slot : filled]);
        for (int axis = 0; axis < 3; axis++) {
            boxes.min[axis][slot] = both.min[axis];
            boxes.max[axis][slot] = both.max[axis];
        }
    }
    portable_quantise(&boxes, occupied, &node->start);
    for (int axis = 0; axis < 3; axis++)
        for (unsigned slot = 0; slot < MOVING_WIDTH; slot++) {
            const double origin = node->start.origin[axis],
                         step = node->start.exponent[axis] ? ldexp(1, node->start.exponent[axis] - 127) : 0;
            const bool is_there = occupied >> slot & 1;
            node->start.lo[axis][slot] = is_there ? steps_down(keys[0][slot].min[axis] - origin, step) : 255;
            node->start.hi[axis][slot] = is_there ? steps_up(keys[0][slot].max[axis] - origin, step) : 0;
            node->end_lo[axis][slot] = is_there ? steps_down(keys[1][slot].min[axis] - origin, step) : 255;
            node->end_hi[axis][slot] = is_there ? steps_up(keys[1][slot].max[axis] - origin, step) : 0;
        }
}

/* Makes the nodes over spans, level by level, and the order of the records. */
static inline void make_nodes(struct made *made, struct span *spans, uint32_t count)
{
    struct task *tasks = calloc(count + 1, sizeof *tasks);
    uint32_t node_count = count > 0, records = 0;
    made->nodes = calloc(count + 1, sizeof *made->nodes);
    made->order = calloc(count + 1, sizeof *made->order);
    assert_true(tasks && made->nodes && made->order);
    tasks[0] = (struct task){spans, count};
    for (uint32_t at = 0; at < node_count; at++) {
        struct task task = tasks[at];
        struct portable_moving_node *node = &made->nodes[at];
        struct box keys[2][MOVING_WIDTH];
        const struct box start = around(task.spans, task.count, 0);
        uint32_t each = (task.count + MOVING_WIDTH - 1) / MOVING_WIDTH, inner = 0;
        unsigned occupied = 0;
        sort_axis = 0;
        for (int axis = 1; axis < 3; axis++)
            if (start.max[axis] - start.min[axis] > start.max[sort_axis] - start.min[sort_axis])
                sort_axis = axis;
        qsort(task.spans, task.count, sizeof *task.spans, by_centre);
        node->start.first_child = node_count;
        node->start.first_record = records;
        for (uint32_t slot = 0, first = 0; first < task.count; slot++, first += each) {
            const uint32_t some = task.count - first < each ? task.count - first : each;
            occupied |= 1u << slot;
            for (int key = 0; key < 2; key++)
                keys[key][slot] = around(task.spans + first, some, key);
            if (some > MOVING_LEAF) {
                node->start.inner_mask |= (uint8_t)(1u << slot);
                node->start.meta[slot] = (uint8_t)(0x20 | (24 + slot));
                tasks[node_count + inner++] = (struct task){task.spans + first, some};
                continue;
            }
            node->start.meta[slot] = (uint8_t)(((1u << some) - 1) << 5 | (records - node->start.first_record));
            for (uint32_t i = 0; i < some; i++)
                made->order[records++] = task.spans[first + i].index;
        }
        node_count += inner;
        write_boxes((const struct box(*)[MOVING_WIDTH])keys, occupied, node);
    }
    const struct box both[2] = {around(spans, count, 0), around(spans, count, 1)};
    struct box bounds = both[0];
    box_grow(&bounds, &both[1]);
    memcpy(made->header.bounds, &bounds, sizeof made->header.bounds);
    made->header.node_count = node_count;
    made->header.record_count = records;
    made->view.nodes = (const struct portable_node *)made->nodes;
    made->view.node_size = sizeof *made->nodes;
    made->view.header = &made->header;
    made->view.geometries = made->geometries;
    free(tasks);
}

/* Makes the copy for AVX2. */
static inline const struct unpacked_node *unpack(struct made *made)
{
    made->unpacked = malloc(unpacked_moving_size(&made->header));
    assert_non_null(made->unpacked);
    unpacked_moving_fill(&made->view, made->unpacked);
    return &made->unpacked->start;
}

static inline void finish_made(struct made *made)
{
    free(made->unpacked);
    free(made->nodes);
    free(made->triangles);
    free(made->vertices);
    free(made->instances);
    free(made->order);
}

#endif
