/* SPDX-License-Identifier: Apache-2.0 */
/* moving_instances.c - motion instances: records of three types, which stand still or move by a matrix or an SRT. */
#include <float.h>
#include <math.h>

#include "builder/input/classification.h"
#include "builder/input/instances.h"
#include "builder/input/srt_bounds.h"
#include "builder/input/transform.h"
#include "builder/input/validate.h"
#include "proto/base/round_outward.h"

/* A number of records that stay in the first-level cache between two passes over them. */
enum { BLOCK = 96 };

/* Where a record has its own flags, which are 0, and how many bytes its other fields have. */
enum { RECORD_FLAGS = 4, FIELDS_SIZE = 16 };

/* One type of motion instance: its names in places of errors, and the matrices that rules check. */
struct motion_type {
    const char *member;
    const char *matrices[2]; /* the members with matrices that must be invertible; NULL: none */
    enum bvhd_vuid flags; /* the rule about the flags of the instance */
};

static const struct motion_type types[MOTION_TYPES] = {
    [MOTION_STATIC] = {"staticInstance", {"transform", NULL}, BVHD_VUID_Instance_flags_parameter},
    [MOTION_MATRIX] = {"matrixMotionInstance",
                       {"transformT0", "transformT1"},
                       BVHD_VUID_MatrixMotionInstance_flags_parameter},
    [MOTION_SRT] = {"srtMotionInstance", {NULL, NULL}, BVHD_VUID_SRTMotionInstance_flags_parameter},
};

/* Returns the first of the type's matrices that is not invertible, or 2. */
static int find_singular(const unsigned char *record)
{
    const struct motion_type *type = &types[bytes_get32(record)];
    float matrix[12];
    for (int i = 0; i < 2; i++) {
        memcpy(matrix, record + MOTION_RECORD_DATA + (size_t)i * sizeof matrix, sizeof matrix);
        if (type->matrices[i] && !validate_invertible(matrix))
            return i;
    }
    return 2;
}

/* Checks a record of a known type. */
static bool is_valid(const unsigned char *record)
{
    const unsigned char *fields = record + canonical_record_fields(GEOMETRY_MOVING_INSTANCES, record);
    return bytes_get32(record + RECORD_FLAGS) == 0 && instances_flags_are_valid(fields) &&
           (!instances_are_active(fields) || find_singular(record) == 2);
}

/* Copies records, of which the last one of the geometry ends before its stride does. */
static void copy_records(const unsigned char *source, uint32_t count, bool with_last, unsigned char *records)
{
    enum { PADDING = MOTION_RECORD_STRIDE - MOTION_RECORD_SIZE };
    const size_t size = (size_t)MOTION_RECORD_STRIDE * count;
    memcpy(records, source, size - (with_last ? PADDING : 0));
    memset(records + size - PADDING, 0, with_last ? PADDING : 0);
}

/* Clears what a record has behind the fields that its type uses. A record of no type stays as it is, for `finish`. */
static void take_records(struct fetch *fetch, unsigned char *records, uint32_t first, uint32_t count)
{
    struct instances_handle last = {0, 0};
    bool known = true;
    for (uint32_t i = 0; i < count; i++) {
        unsigned char *record = records + (size_t)MOTION_RECORD_STRIDE * i;
        if (bytes_get32(record) >= MOTION_TYPES) {
            fetch_suspect(fetch);
            continue;
        }
        const uint32_t at = canonical_record_fields(GEOMETRY_MOVING_INSTANCES, record), end = at + FIELDS_SIZE;
        memset(record + end, 0, MOTION_RECORD_STRIDE - end);
        known = known && instances_look_up(fetch, record + at, first + i, &last);
        if (!is_valid(record))
            fetch_suspect(fetch);
    }
}

static void fetch_records(struct fetch *fetch, uint32_t index, uint32_t first, uint32_t count)
{
    const struct geometry *geometry = &fetch->input->geometries[index];
    const size_t begin = (size_t)MOTION_RECORD_STRIDE * first;
    const unsigned char *source = geometry->instances.records.data + geometry->range.primitive_offset + begin;
    unsigned char *target = fetch->block + fetch_row(fetch, index)->data_offset + begin;
    for (uint32_t at = 0; at < count; at += BLOCK) {
        const uint32_t some = count - at < BLOCK ? count - at : BLOCK;
        unsigned char *records = target + (size_t)MOTION_RECORD_STRIDE * at;
        copy_records(source + (size_t)MOTION_RECORD_STRIDE * at, some,
                     first + at + some == geometry->range.primitive_count, records);
        fetch_settle();
        take_records(fetch, records, first + at, some);
    }
}

/* Returns the first record of a type that there is not, or the number of records. */
static uint32_t find_unknown_type(const unsigned char *records, uint32_t count)
{
    uint32_t i = 0;
    while (i < count && bytes_get32(records + (size_t)MOTION_RECORD_STRIDE * i) < MOTION_TYPES)
        i++;
    return i;
}

/* Types are checked before anything else looks at the records, because they decide where the fields are. */
static enum bvhd_status finish(struct fetch *fetch, uint32_t index, struct bvhd_error *error)
{
    const struct form_geometry *row = fetch_row(fetch, index);
    const unsigned char *records = fetch->block + row->data_offset;
    const uint32_t unknown = fetch->suspect ? find_unknown_type(records, row->primitive_count) : row->primitive_count;
    if (unknown < row->primitive_count)
        return bvhd_error_rule(error, BVHD_VUID_MotionInstance_type_parameter,
                               place("infos[%u].geometries[%u].instances[%u].type", fetch->index, index, unknown).text,
                               "there is no type %u of motion instances",
                               bytes_get32(records + (size_t)MOTION_RECORD_STRIDE * unknown));
    return instances_report_unknown(fetch, index, BVHD_VUID_04930, error);
}

static enum bvhd_status report_record(const unsigned char *record, struct place where, struct bvhd_error *error)
{
    const struct motion_type *type = &types[bytes_get32(record)];
    const unsigned char *fields = record + canonical_record_fields(GEOMETRY_MOVING_INSTANCES, record);
    const uint32_t flags = bytes_get32(record + RECORD_FLAGS);
    if (flags != 0)
        return bvhd_error_rule(error, BVHD_VUID_MotionInstance_flags_zerobitmask, place("%s.flags", where.text).text,
                               "0x%x, not 0", flags);
    struct place data = place("%s.data.%s", where.text, type->member);
    if (!instances_flags_are_valid(fields))
        return instances_report_flags(fields, type->flags, data, error);
    return bvhd_error_rule(error, BVHD_VUID_03799,
                           place("%s.%s", data.text, type->matrices[find_singular(record)]).text,
                           "the 3x3 part is not invertible");
}

static enum bvhd_status check_contents(const struct canonical_geometry *geometry, uint32_t first, uint32_t count,
                                       uint32_t info, uint32_t index, struct bvhd_error *error)
{
    for (uint32_t i = first; i < first + count; i++) {
        const unsigned char *record = instances_record(geometry, i);
        if (!is_valid(record))
            return report_record(record, place("infos[%u].geometries[%u].instances[%u]", info, index, i), error);
    }
    return BVHD_OK;
}

static bool ends_with_zeros(const unsigned char *record)
{
    unsigned char any = 0;
    for (uint32_t at = canonical_record_fields(GEOMETRY_MOVING_INSTANCES, record) + FIELDS_SIZE;
         at < MOTION_RECORD_STRIDE; at++)
        any |= record[at];
    return any == 0;
}

static enum bvhd_status check_foreign(const struct canonical *canonical, uint32_t index, struct bvhd_error *error)
{
    const struct canonical_geometry *geometry = &canonical->geometries[index];
    const uint32_t count = geometry->primitive_count;
    if (find_unknown_type(geometry->instances, count) < count)
        return form_corrupt_row(error, index, "instances", "a type that there is not");
    for (uint32_t i = 0; i < count; i++)
        if (!ends_with_zeros(instances_record(geometry, i)))
            return form_corrupt_row(error, index, "instances", "unused bytes that are not 0");
    return instances_check_references(canonical, index, error);
}

/*
 * Finds the boxes under the matrices of both ends, static ones too. The matrix of another time is interpolated, and
 * each of its numbers is rounded by less than 2^-22 of the greater magnitude at both ends.
 */
static void matrix_bounds(const struct canonical_motion *motion, const struct box *box, struct box ret_boxes[2])
{
    double matrices[2][12], slack[3], min[3], max[3];
    for (int i = 0; i < 12; i++) {
        matrices[0][i] = motion->start[i];
        matrices[1][i] = motion->end[i];
    }
    for (int row = 0; row < 3; row++) {
        const double *a = matrices[0] + (ptrdiff_t)4 * row, *b = matrices[1] + (ptrdiff_t)4 * row;
        double magnitude = fmax(fabs(a[3]), fabs(b[3]));
        for (int axis = 0; axis < 3; axis++)
            magnitude +=
                fmax(fabs(a[axis]), fabs(b[axis])) * fmax(fabs((double)box->min[axis]), fabs((double)box->max[axis]));
        slack[row] = magnitude * 0x1p-21 + 0x1p-140;
    }
    for (int key = 0; key < 2; key++) {
        transform_bounds(matrices[key], box, min, max);
        for (int row = 0; row < 3; row++) {
            ret_boxes[key].min[row] = classification_clamp(round_down(min[row] - slack[row]));
            ret_boxes[key].max[row] = classification_clamp(round_up(max[row] + slack[row]));
        }
    }
}

/*
 * Returns bounds that hold the structure at all times: its own are those of both ends, which rounding lets interpolated
 * vertices leave. An empty structure is at the origin.
 */
static struct box bounds_of(const struct box *bounds)
{
    struct box box = {{0, 0, 0}, {0, 0, 0}};
    for (int axis = 0; axis < 3 && !box_is_empty(bounds); axis++) {
        const double low = bounds->min[axis], high = bounds->max[axis];
        const double slack = fmax(fabs(low), fabs(high)) * 0x1p-22 + 0x1p-147;
        box.min[axis] = classification_clamp(round_down(low - slack));
        box.max[axis] = classification_clamp(round_up(high + slack));
    }
    return box;
}

static void clamp_all(float *numbers)
{
    for (int i = 0; i < SRT_NUMBERS; i++)
        numbers[i] = classification_clamp(numbers[i]);
}

/*
 * A side that is clamped at one end is farther away than its box says. It is clamped at both ends then, because between
 * them it would be too near.
 */
static void clamp_together(struct box boxes[2])
{
    for (int row = 0; row < 3; row++) {
        if (fminf(boxes[0].min[row], boxes[1].min[row]) <= -FLT_MAX)
            boxes[0].min[row] = boxes[1].min[row] = -FLT_MAX;
        if (fmaxf(boxes[0].max[row], boxes[1].max[row]) >= FLT_MAX)
            boxes[0].max[row] = boxes[1].max[row] = FLT_MAX;
    }
}

static struct classification look_at_keys(const struct canonical *canonical, const struct canonical_geometry *geometry,
                                          uint32_t index, struct box ret_boxes[2])
{
    struct classification finding = {.box = box_empty()};
    const uint64_t row = canonical_instance(geometry, index).reference;
    struct canonical_motion motion = canonical_motion(geometry, index);
    if (row == 0 || classification_has_nan(motion.start, 16) || classification_has_nan(motion.end, 16))
        return finding;
    finding.active = true;
    const bool is_infinite =
        classification_has_infinity(motion.start, 16) || classification_has_infinity(motion.end, 16);
    const struct box *bounds = &canonical->references[row - 1].bounds, box = bounds_of(bounds);
    finding.degenerate = box_is_empty(bounds);
    finding.kept = (canonical->flags & BUILD_ALLOW_UPDATE) || !(is_infinite || finding.degenerate);
    clamp_all(motion.start);
    clamp_all(motion.end);
    if (motion.type == MOTION_SRT)
        srt_bounds(motion.start, motion.end, &box, ret_boxes);
    else
        matrix_bounds(&motion, &box, ret_boxes);
    clamp_together(ret_boxes);
    box_grow(&finding.box, &ret_boxes[0]);
    box_grow(&finding.box, &ret_boxes[1]);
    return finding;
}

static struct classification look(const struct canonical *canonical, const struct canonical_geometry *geometry,
                                  uint32_t index)
{
    struct box boxes[2];
    return look_at_keys(canonical, geometry, index, boxes);
}

static uint32_t collect(const struct canonical *canonical, const struct canonical_geometry *geometry, uint32_t first,
                        uint32_t end, struct classification_counts *counts, struct primitive_ref *refs)
{
    return classification_collect(look, canonical, geometry, first, end, counts, refs);
}

const struct input_kind input_moving_instances = {
    .version = CANONICAL_VERSION_ROUND,
    .check_memory = instances_check_memory,
    .view = instances_view,
    .fetch_primitives = fetch_records,
    .finish = finish,
    .check_contents = check_contents,
    .check_foreign = check_foreign,
    .look = look,
    .look_at_keys = look_at_keys,
    .collect = collect,
};
