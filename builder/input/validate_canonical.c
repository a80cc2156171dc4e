/* SPDX-License-Identifier: Apache-2.0 */
#include <math.h>

#include "proto/base/parallel.h"
#include "proto/base/place.h"
#include "builder/input/validate.h"

/*
 * Bits 0 to 3 are the instance flags that bvhd implements; the next two are about opacity micromaps; the others do not
 * exist.
 */
enum { INSTANCE_MICROMAP_FLAGS = 0x30, INSTANCE_UNKNOWN_FLAGS = 0xc0 };
enum { RECORD_SIZE = 64, RECORD_FLAGS = 52, RECORD_REFERENCE = 56 };

/* The permanent of the absolute values is what the determinant would be if no products cancelled. */
bool validate_invertible(const float m[12])
{
    double determinant = 0, permanent = 0;
    for (int i = 0; i < 3; i++) {
        int j = (i + 1) % 3, k = (i + 2) % 3;
        double a = (double)m[4 + j] * m[8 + k], b = (double)m[4 + k] * m[8 + j];
        determinant += m[i] * (a - b);
        permanent += fabs((double)m[i]) * (fabs(a) + fabs(b));
    }
    return isfinite(determinant) && fabs(determinant) > permanent * 0x1p-48;
}

/*
 * Comparisons with NaN are false, so an inactive box, whose minimum x is NaN, is valid whatever its other fields are.
 */
static bool box_is_valid(const float *box)
{
    return box[0] != box[0] || !((box[0] > box[3]) | (box[1] > box[4]) | (box[2] > box[5]));
}

bool validate_boxes(const float *boxes, uint64_t count)
{
    bool valid = true;
    for (uint64_t i = 0; i < count; i++)
        valid &= box_is_valid(boxes + 6 * i);
    return valid;
}

static bool flags_are_valid(uint32_t flags)
{
    const uint32_t both = INSTANCE_FORCE_OPAQUE | INSTANCE_FORCE_NO_OPAQUE;
    return (flags & (INSTANCE_MICROMAP_FLAGS | INSTANCE_UNKNOWN_FLAGS)) == 0 && (flags & both) != both;
}

static bool matrix_is_valid(const unsigned char *record)
{
    float matrix[12];
    memcpy(matrix, record, sizeof matrix);
    return validate_invertible(matrix);
}

bool validate_instances(const unsigned char *records, uint64_t count)
{
    for (uint64_t i = 0; i < count; i++, records += RECORD_SIZE)
        if (!flags_are_valid(bytes_get32(records + RECORD_FLAGS) >> 24) ||
            (bytes_get64(records + RECORD_REFERENCE) != 0 && !matrix_is_valid(records)))
            return false;
    return true;
}

static enum bvhd_status report_box(const float *box, struct place where, struct bvhd_error *error)
{
    static const enum bvhd_vuid rules[3] = {BVHD_VUID_03546, BVHD_VUID_03547, BVHD_VUID_03548};
    static const char *const names[3] = {"X", "Y", "Z"};
    int axis = box[0] > box[3] ? 0 : box[1] > box[4] ? 1 : 2;
    return bvhd_error_rule(error, rules[axis], place("%s.min%s", where.text, names[axis]).text,
                           "%g is over the maximum, %g", (double)box[axis], (double)box[3 + axis]);
}

/* The geometry whose contents are being checked. */
struct checking {
    uint32_t info, index;
    const atomic_bool *cancel;
};

/* Checks the flag every few thousand primitives. */
static bool is_cancelled(const struct checking *checking, uint32_t primitive)
{
    return primitive % 8192 == 0 && parallel_cancelled(checking->cancel);
}

static enum bvhd_status report_cancelled(const struct checking *checking, struct bvhd_error *error)
{
    return bvhd_error_set(error, BVHD_CANCELLED, place("infos[%u]", checking->info).text, "cancelled");
}

static enum bvhd_status check_boxes(const struct canonical_geometry *geometry, const struct checking *checking,
                                    struct bvhd_error *error)
{
    for (uint32_t i = 0; i < geometry->primitive_count; i++) {
        if (is_cancelled(checking, i))
            return report_cancelled(checking, error);
        const float *box = geometry->boxes + (uint64_t)6 * i;
        if (!box_is_valid(box))
            return report_box(box, place("infos[%u].geometries[%u].aabbs[%u]", checking->info, checking->index, i),
                              error);
    }
    return BVHD_OK;
}

static enum bvhd_status report_instance(const unsigned char *record, struct place where, struct bvhd_error *error)
{
    uint32_t flags = bytes_get32(record + RECORD_FLAGS) >> 24;
    struct place where_flags = place("%s.flags", where.text);
    if (flags & INSTANCE_UNKNOWN_FLAGS)
        return bvhd_error_rule(error, BVHD_VUID_Instance_flags_parameter, where_flags.text, "unknown bits 0x%x",
                               flags & INSTANCE_UNKNOWN_FLAGS);
    if (flags & INSTANCE_MICROMAP_FLAGS)
        return bvhd_error_set(error, BVHD_UNSUPPORTED, where_flags.text, "flags 0x%x are about opacity micromaps",
                              flags & INSTANCE_MICROMAP_FLAGS);
    if (!flags_are_valid(flags))
        return bvhd_error_rule(error, BVHD_VUID_Instance_flags_parameter, where_flags.text,
                               "FORCE_OPAQUE and FORCE_NO_OPAQUE exclude each other");
    return bvhd_error_rule(error, BVHD_VUID_03799, place("%s.transform", where.text).text,
                           "the 3x3 part is not invertible");
}

static enum bvhd_status check_instances(const struct canonical_geometry *geometry, const struct checking *checking,
                                        struct bvhd_error *error)
{
    for (uint32_t i = 0; i < geometry->primitive_count; i++) {
        if (is_cancelled(checking, i))
            return report_cancelled(checking, error);
        const unsigned char *record = geometry->instances + (uint64_t)RECORD_SIZE * i;
        if (!validate_instances(record, 1))
            return report_instance(
                record, place("infos[%u].geometries[%u].instances[%u]", checking->info, checking->index, i), error);
    }
    return BVHD_OK;
}

enum bvhd_status validate_canonical(const struct canonical *canonical, uint32_t index, const atomic_bool *cancel,
                                    struct bvhd_error *error)
{
    enum bvhd_status status = BVHD_OK;
    for (uint32_t i = 0; status == BVHD_OK && i < canonical->geometry_count; i++) {
        const struct canonical_geometry *geometry = &canonical->geometries[i];
        const struct checking checking = {index, i, cancel};
        if (geometry->type == GEOMETRY_AABBS)
            status = check_boxes(geometry, &checking, error);
        else if (geometry->type == GEOMETRY_INSTANCES)
            status = check_instances(geometry, &checking, error);
    }
    return status;
}
