/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/input/input_kind.h"

#include "builder/input/classification.h"
#include "builder/input/fetch_internal.h"
#include "builder/input/outline.h"
#include "builder/input/validate.h"
#include "proto/base/place.h"
#include "proto/base/round_outward.h"

/* A number of records that stay in the first-level cache between two passes over them. */
enum { BLOCK = 256 };

/*
 * Bits 0 to 3 are the instance flags that bvhd implements; the next two are about opacity micromaps; the others do not
 * exist.
 */
enum { INSTANCE_MICROMAP_FLAGS = 0x30, INSTANCE_UNKNOWN_FLAGS = 0xc0 };
enum { RECORD_FLAGS = 52 };

static enum bvhd_status check_memory(const struct validate_subject *subject)
{
    const struct bytes *records = &subject->geometry->instances.records;
    const struct geometry_range *range = &subject->geometry->range;
    if (range->primitive_offset % 16 != 0)
        return bvhd_error_rule(subject->error, BVHD_VUID_03660, VALIDATE_RANGE_PLACE(subject, "primitiveOffset"),
                               "%u is no multiple of 16", range->primitive_offset);
    if (range->primitive_count > 0 &&
        (!records->data || !bytes_reach(records->size, range->primitive_offset, 64, range->primitive_count - 1, 64)))
        return validate_refuse_memory(subject, BVHD_VUID_03778, "instances.data", records, "instances");
    return BVHD_OK;
}

static void view(const void *data, struct canonical_geometry *geometry)
{
    geometry->instances = data;
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

static bool are_valid(const unsigned char *records, uint64_t count)
{
    for (uint64_t i = 0; i < count; i++, records += FORM_RECORD_SIZE)
        if (!flags_are_valid(bytes_get32(records + RECORD_FLAGS) >> 24) ||
            (bytes_get64(records + FORM_RECORD_REFERENCE) != 0 && !matrix_is_valid(records)))
            return false;
    return true;
}

/*
 * Replaces handles by positions in the caller's table. Stops at the first unknown handle, because then the request
 * fails.
 */
static void look_up(struct fetch *fetch, unsigned char *records, uint32_t first, uint32_t count)
{
    uint64_t last_handle = 0, last_reference = 0;
    for (uint32_t i = 0; i < count; i++) {
        unsigned char *field = records + (size_t)FORM_RECORD_SIZE * i + FORM_RECORD_REFERENCE;
        uint64_t handle = bytes_get64(field);
        if (handle != last_handle) {
            last_handle = handle;
            last_reference = handle ? reference_lookup_find(&fetch->lookup, handle) : 0;
        }
        if (handle && !last_reference) {
            fetch_lower(&fetch->first_unknown, first + i);
            return;
        }
        bytes_put64(field, last_reference);
    }
}

static void fetch_records(struct fetch *fetch, uint32_t index, uint32_t first, uint32_t count)
{
    const struct geometry *geometry = &fetch->input->geometries[index];
    size_t begin = (size_t)FORM_RECORD_SIZE * first;
    const unsigned char *source = geometry->instances.records.data + geometry->range.primitive_offset + begin;
    unsigned char *target = fetch->block + fetch_row(fetch, index)->data_offset + begin;
    for (uint32_t at = 0; at < count; at += BLOCK) {
        uint32_t some = count - at < BLOCK ? count - at : BLOCK;
        unsigned char *records = target + (size_t)FORM_RECORD_SIZE * at;
        memcpy(records, source + (size_t)FORM_RECORD_SIZE * at, (size_t)FORM_RECORD_SIZE * some);
        fetch_settle();
        look_up(fetch, records, first + at, some);
        if (!are_valid(records, some))
            fetch_suspect(fetch);
    }
}

static enum bvhd_status finish(struct fetch *fetch, uint32_t geometry, struct bvhd_error *error)
{
    if (fetch->first_unknown == UINT32_MAX)
        return BVHD_OK;
    return bvhd_error_rule(error, BVHD_VUID_03779,
                           place("infos[%u].geometries[%u].instances[%u].accelerationStructureReference", fetch->index,
                                 geometry, fetch->first_unknown)
                               .text,
                           "names no known structure");
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

static enum bvhd_status check_contents(const struct canonical_geometry *geometry, uint32_t first, uint32_t count,
                                       uint32_t info, uint32_t index, struct bvhd_error *error)
{
    for (uint32_t i = first; i < first + count; i++) {
        const unsigned char *record = geometry->instances + (uint64_t)FORM_RECORD_SIZE * i;
        if (!are_valid(record, 1))
            return report_instance(record, place("infos[%u].geometries[%u].instances[%u]", info, index, i), error);
    }
    return BVHD_OK;
}

/* Checks that references are numbered in the order of first use, as the writer does. */
static enum bvhd_status check_foreign(const struct canonical *canonical, uint32_t index, struct bvhd_error *error)
{
    const struct canonical_geometry *geometry = &canonical->geometries[index];
    uint64_t used = 0;
    for (uint32_t i = 0; i < geometry->primitive_count; i++) {
        uint64_t reference = bytes_get64(geometry->instances + (uint64_t)FORM_RECORD_SIZE * i + FORM_RECORD_REFERENCE);
        if (reference > used + 1 || reference > canonical->reference_count)
            return form_corrupt(error, place("geometries[%u].instances[%u]", index, i).text,
                                "a reference out of order");
        used = reference > used ? reference : used;
    }
    if (used != canonical->reference_count)
        return form_corrupt(error, "referenceCount", "references that no instance names");
    return BVHD_OK;
}

/*
 * Transforms a box by its centre and half extent: c' = M c + t, e' = |M| e. `slack` bounds the rounding errors of these
 * few operations, relative to the sum of magnitudes.
 */
static void transform_box(const float matrix[12], const struct box *box, struct box *ret_box)
{
    for (int row = 0; row < 3; row++) {
        const float *m = matrix + 4 * row;
        double centre = m[3], extent = 0, magnitude = fabs((double)m[3]);
        for (int axis = 0; axis < 3; axis++) {
            double min = box->min[axis], max = box->max[axis];
            centre += m[axis] * (0.5 * (min + max));
            extent += fabs((double)m[axis]) * (0.5 * (max - min));
            magnitude += fabs((double)m[axis]) * (fabs(min) + fabs(max));
        }
        double slack = magnitude * 0x1p-48;
        ret_box->min[row] = classification_clamp(round_down(centre - extent - slack));
        ret_box->max[row] = classification_clamp(round_up(centre + extent + slack));
    }
}

static struct classification look(const struct canonical *canonical, const struct canonical_geometry *geometry,
                                  uint32_t index)
{
    bool keep_all = canonical->flags & BUILD_ALLOW_UPDATE;
    struct classification finding = {.box = box_empty()};
    struct canonical_instance instance = canonical_instance(geometry, index);
    if (instance.reference == 0 || classification_has_nan(instance.transform, 12))
        return finding;
    finding.active = true;
    const struct canonical_reference *reference = &canonical->references[instance.reference - 1];
    struct box bounds = reference->bounds;
    bool infinite = classification_has_infinity(instance.transform, 12);
    finding.degenerate = box_is_empty(&bounds);
    finding.kept = keep_all || !(infinite || finding.degenerate);
    for (int k = 0; k < 12; k++)
        instance.transform[k] = classification_clamp(instance.transform[k]);
    for (int axis = 0; axis < 3; axis++) {
        bounds.min[axis] = finding.degenerate ? 0 : classification_clamp(bounds.min[axis]);
        bounds.max[axis] = finding.degenerate ? 0 : classification_clamp(bounds.max[axis]);
    }
    transform_box(instance.transform, &bounds, &finding.box);
    if (!(infinite || finding.degenerate || canonical->ignores_slabs))
        outline_narrow(instance.transform, &bounds, &reference->slabs, &finding.box);
    return finding;
}

static uint32_t collect(const struct canonical *canonical, const struct canonical_geometry *geometry, uint32_t first,
                        uint32_t end, struct classification_counts *counts, struct primitive_ref *refs)
{
    return classification_collect(look, canonical, geometry, first, end, counts, refs);
}

const struct input_kind input_instances = {
    .version = CANONICAL_VERSION,
    .check_memory = check_memory,
    .view = view,
    .fetch_primitives = fetch_records,
    .finish = finish,
    .check_contents = check_contents,
    .check_foreign = check_foreign,
    .look = look,
    .collect = collect,
};
