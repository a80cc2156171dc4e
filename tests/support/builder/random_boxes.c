/* SPDX-License-Identifier: Apache-2.0 */
/* Boxes of any shape and stride, some of which overlap in memory. */
#include "tests/support/builder/random_kind.h"

#include <math.h>

#include "tests/support/builder/random_manner.h"

static void make_box(const struct random_manner *manner, uint32_t index, struct random *random, float ret_box[6])
{
    double a[3], b[3];
    random_manner_position(manner, 3 * index, random, a);
    random_manner_position(manner, 3 * index, random, b);
    bool flat = random_chance(random, 0.1);
    for (int axis = 0; axis < 3; axis++) {
        if (flat && random_chance(random, 0.7))
            b[axis] = a[axis];
        bool sorted = a[axis] <= b[axis] || isnan(a[axis]) || isnan(b[axis]);
        ret_box[axis] = (float)(sorted ? a[axis] : b[axis]);
        ret_box[3 + axis] = (float)(sorted ? b[axis] : a[axis]);
    }
}

static void make(struct random_input *input, uint32_t index, uint32_t count, struct random *random)
{
    struct geometry *geometry = &input->geometries[index];
    struct random_meaning *meaning = &input->meanings[index];
    struct random_manner manner = random_manner_make(random, true);
    *geometry = (struct geometry){.type = GEOMETRY_AABBS, .flags = random_below(random, 4)};
    manner.width = 0;
    uint32_t offset = 8 * random_below(random, 4);
    uint64_t stride = random_chance(random, 0.05) ? 8 * (uint64_t)random_below(random, 3)
                                                  : 24 + 8 * (uint64_t)random_below(random, 3);
    uint64_t size = count ? offset + stride * (count - 1) + 24 : 0;
    unsigned char *bytes = random_input_buffer(input, size);
    memset(bytes, 0, size);
    meaning->count = count;
    meaning->boxes = random_input_zeroed(count, sizeof *meaning->boxes);
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
static void move(struct random_input *input, uint32_t index, struct random *random)
{
    const struct geometry *geometry = &input->geometries[index];
    struct random_meaning *meaning = &input->meanings[index];
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

static struct random_fields fields(struct geometry *geometry)
{
    return (struct random_fields){
        .array_count = 1, .arrays = {&geometry->aabbs.boxes}, .stride_count = 1, .strides = {&geometry->aabbs.stride}};
}

static void blank(struct geometry *geometry, struct bytes bytes)
{
    geometry->aabbs = (struct geometry_aabbs){24, bytes};
}

const struct random_kind random_boxes = {
    .type = GEOMETRY_AABBS, .are_candidates = true, .make = make, .move = move, .fields = fields, .blank = blank};
