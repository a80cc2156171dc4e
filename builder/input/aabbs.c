/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/input/input_kind.h"

#include "builder/input/classification.h"
#include "builder/input/fetch_internal.h"
#include "builder/input/reach.h"
#include "builder/input/transform.h"
#include "builder/input/validate.h"
#include "proto/base/place.h"

/* A number of boxes that stay in the first-level cache between two passes over them. */
enum { BLOCK = 1024 };

static enum bvhd_status check_memory(const struct validate_subject *subject)
{
    const struct geometry_aabbs *aabbs = &subject->geometry->aabbs;
    const struct geometry_range *range = &subject->geometry->range;
    if (range->primitive_offset % 8 != 0)
        return bvhd_error_rule(subject->error, BVHD_VUID_03659, VALIDATE_RANGE_PLACE(subject, "primitiveOffset"),
                               "%u is no multiple of 8", range->primitive_offset);
    if (range->primitive_count > 0 &&
        (!aabbs->boxes.data || !bytes_reach(aabbs->boxes.size, range->primitive_offset, aabbs->stride,
                                            range->primitive_count - 1, 6 * sizeof(float))))
        return validate_refuse_memory(subject, BVHD_VUID_03774, "aabbs.data", &aabbs->boxes, "boxes");
    return BVHD_OK;
}

static void view(const void *data, struct canonical_geometry *geometry)
{
    geometry->boxes = data;
}

/*
 * Comparisons with NaN are false, so an inactive box, whose minimum x is NaN, is valid whatever its other fields are.
 */
static bool box_is_valid(const float *box)
{
    return box[0] != box[0] || !((box[0] > box[3]) | (box[1] > box[4]) | (box[2] > box[5]));
}

static bool are_valid(const float *boxes, uint64_t count)
{
    bool valid = true;
    for (uint64_t i = 0; i < count; i++)
        valid &= box_is_valid(boxes + 6 * i);
    return valid;
}

static void copy_strided(const unsigned char *source, uint64_t stride, size_t count, float *ret_boxes)
{
    if (stride == 6 * sizeof(float)) {
        memcpy(ret_boxes, source, count * stride);
        return;
    }
    for (size_t i = 0; i < count; i++)
        memcpy(ret_boxes + 6 * i, source + i * stride, 6 * sizeof(float));
}

/* A box with a NaN anywhere is inactive; the copy says so by a NaN minimum x. */
static void mark_inactive(float *boxes, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        float *box = boxes + 6 * i;
        bool all_numbers = !isnan(box[1]) & !isnan(box[2]) & !isnan(box[3]) & !isnan(box[4]) & !isnan(box[5]);
        if (!all_numbers && !isnan(box[0]))
            box[0] = transform_nan();
    }
}

/*
 * True when minimum <= maximum on each axis of every box, so that there is no NaN. Nearly all boxes are so, and need no
 * further check.
 */
static bool are_ordinary(const float *boxes, size_t count)
{
    bool ordinary = true;
    for (size_t i = 0; i < count; i++, boxes += 6)
        ordinary &= (boxes[0] <= boxes[3]) & (boxes[1] <= boxes[4]) & (boxes[2] <= boxes[5]);
    return ordinary;
}

static void fetch_boxes(struct fetch *fetch, uint32_t index, uint32_t first, uint32_t count)
{
    const struct geometry *geometry = &fetch->input->geometries[index];
    uint64_t stride = geometry->aabbs.stride;
    const unsigned char *source = geometry->aabbs.boxes.data + geometry->range.primitive_offset + first * stride;
    float *target = (float *)(void *)(fetch->block + fetch_row(fetch, index)->data_offset) + (size_t)6 * first;
    for (uint32_t at = 0; at < count; at += BLOCK) {
        uint32_t some = count - at < BLOCK ? count - at : BLOCK;
        float *boxes = target + (size_t)6 * at;
        copy_strided(source + at * stride, stride, some, boxes);
        fetch_settle();
        if (are_ordinary(boxes, some))
            continue;
        mark_inactive(boxes, some);
        if (!are_valid(boxes, some))
            fetch_suspect(fetch);
    }
}

static enum bvhd_status report_box(const float *box, struct place where, struct bvhd_error *error)
{
    static const enum bvhd_vuid rules[3] = {BVHD_VUID_03546, BVHD_VUID_03547, BVHD_VUID_03548};
    static const char *const names[3] = {"X", "Y", "Z"};
    int axis = box[0] > box[3] ? 0 : box[1] > box[4] ? 1 : 2;
    return bvhd_error_rule(error, rules[axis], place("%s.min%s", where.text, names[axis]).text,
                           "%g is over the maximum, %g", (double)box[axis], (double)box[3 + axis]);
}

static enum bvhd_status check_contents(const struct canonical_geometry *geometry, uint32_t first, uint32_t count,
                                       uint32_t info, uint32_t index, struct bvhd_error *error)
{
    for (uint32_t i = first; i < first + count; i++) {
        const float *box = geometry->boxes + (uint64_t)6 * i;
        if (!box_is_valid(box))
            return report_box(box, place("infos[%u].geometries[%u].aabbs[%u]", info, index, i), error);
    }
    return BVHD_OK;
}

static enum bvhd_status check_foreign(const struct canonical *canonical, uint32_t index, struct bvhd_error *error)
{
    const struct canonical_geometry *geometry = &canonical->geometries[index];
    for (uint64_t i = 0; i < geometry->primitive_count; i++) {
        const float *box = geometry->boxes + 6 * i;
        bool nan = isnan(box[1]) | isnan(box[2]) | isnan(box[3]) | isnan(box[4]) | isnan(box[5]);
        if (nan && !isnan(box[0]))
            return form_corrupt_row(error, index, "boxes", "a NaN in an active box");
    }
    return BVHD_OK;
}

static struct classification look(const struct canonical *canonical, const struct canonical_geometry *geometry,
                                  uint32_t index)
{
    (void)canonical;
    struct classification finding = {.box = box_empty()};
    const float *box = geometry->boxes + (uint64_t)6 * index;
    if (classification_has_nan(box, 6))
        return finding;
    finding.active = finding.kept = finding.degenerate = true;
    for (int axis = 0; axis < 3; axis++) {
        finding.box.min[axis] = classification_clamp(box[axis]);
        finding.box.max[axis] = classification_clamp(box[axis + 3]);
        finding.degenerate &= finding.box.min[axis] == finding.box.max[axis];
    }
    return finding;
}

static uint32_t collect(const struct canonical *canonical, const struct canonical_geometry *geometry, uint32_t first,
                        uint32_t end, struct classification_counts *counts, struct primitive_ref *refs)
{
    return classification_collect(look, canonical, geometry, first, end, counts, refs);
}

static void outline(const struct canonical_geometry *geometry, uint32_t first, uint32_t count, struct reach *reach)
{
    reach_add_boxes(reach, geometry->boxes + (size_t)6 * first, count);
}

const struct input_kind input_aabbs = {
    .version = CANONICAL_VERSION,
    .check_memory = check_memory,
    .view = view,
    .fetch_primitives = fetch_boxes,
    .check_contents = check_contents,
    .check_foreign = check_foreign,
    .look = look,
    .collect = collect,
    .outline = outline,
};
