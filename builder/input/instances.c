/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/input/instances.h"

#include "builder/input/classification.h"
#include "builder/input/outline.h"
#include "builder/input/transform.h"
#include "builder/input/validate.h"
#include "proto/base/kind.h"
#include "proto/base/round_outward.h"

/* A number of records that stay in the first-level cache between two passes over them. */
enum { BLOCK = 256 };

/* The instance flags that came with opacity micromaps, and those that do not exist. */
enum {
    INSTANCE_MICROMAP_FLAGS = INSTANCE_FORCE_MICROMAP_2_STATE | INSTANCE_DISABLE_MICROMAPS,
    INSTANCE_UNKNOWN_FLAGS = 0xc0
};

/* Where the other fields of a record have the flags and the reference. */
enum { FIELD_FLAGS = 4, FIELD_REFERENCE = 8 };

enum bvhd_status instances_check_memory(const struct validate_subject *subject)
{
    const struct bytes *records = &subject->geometry->instances.records;
    const struct geometry_range *range = &subject->geometry->range;
    const uint64_t stride = kind_find(subject->geometry->type)->primitive_bytes;
    const uint64_t size = subject->geometry->type == GEOMETRY_MOVING_INSTANCES ? MOTION_RECORD_SIZE : stride;
    if (range->primitive_offset % 16 != 0)
        return bvhd_error_rule(subject->error, BVHD_VUID_03660, VALIDATE_RANGE_PLACE(subject, "primitiveOffset"),
                               "%u is no multiple of 16", range->primitive_offset);
    if (range->primitive_count > 0 && (!records->data || !bytes_reach(records->size, range->primitive_offset, stride,
                                                                      range->primitive_count - 1, size)))
        return validate_refuse_memory(subject, BVHD_VUID_03778, "instances.data", records, "instances");
    return BVHD_OK;
}

void instances_view(const void *data, struct canonical_geometry *geometry)
{
    geometry->instances = data;
}

bool instances_flags_are_valid(const unsigned char *fields)
{
    const uint32_t both = INSTANCE_FORCE_OPAQUE | INSTANCE_FORCE_NO_OPAQUE, flags = fields[FIELD_FLAGS + 3];
    const uint32_t foreign = INSTANCE_UNKNOWN_FLAGS | (validate_micromaps ? 0 : INSTANCE_MICROMAP_FLAGS);
    return (flags & foreign) == 0 && (flags & both) != both;
}

bool instances_are_active(const unsigned char *fields)
{
    return bytes_get64(fields + FIELD_REFERENCE) != 0;
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
        if (!instances_flags_are_valid(records + sizeof(float[12])) ||
            (instances_are_active(records + sizeof(float[12])) && !matrix_is_valid(records)))
            return false;
    return true;
}

bool instances_look_up(struct fetch *fetch, unsigned char *fields, uint32_t index, struct instances_handle *last)
{
    const uint64_t handle = bytes_get64(fields + FIELD_REFERENCE);
    if (handle != last->handle) {
        last->handle = handle;
        last->reference = handle ? reference_lookup_find(&fetch->lookup, handle) : 0;
    }
    if (handle && !last->reference) {
        fetch_lower(&fetch->first_unknown, index);
        return false;
    }
    bytes_put64(fields + FIELD_REFERENCE, last->reference);
    return true;
}

/* Stops at the first unknown handle, because then the request fails. */
static void look_up(struct fetch *fetch, unsigned char *records, uint32_t first, uint32_t count)
{
    struct instances_handle last = {0, 0};
    for (uint32_t i = 0; i < count; i++)
        if (!instances_look_up(fetch, records + (size_t)FORM_RECORD_SIZE * i + sizeof(float[12]), first + i, &last))
            return;
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

enum bvhd_status instances_report_unknown(const struct fetch *fetch, uint32_t geometry, enum bvhd_vuid rule,
                                          struct bvhd_error *error)
{
    if (fetch->first_unknown == UINT32_MAX)
        return BVHD_OK;
    return bvhd_error_rule(error, rule,
                           place("infos[%u].geometries[%u].instances[%u].accelerationStructureReference", fetch->index,
                                 geometry, fetch->first_unknown)
                               .text,
                           "names no known structure");
}

static enum bvhd_status finish(struct fetch *fetch, uint32_t geometry, struct bvhd_error *error)
{
    return instances_report_unknown(fetch, geometry, BVHD_VUID_03779, error);
}

enum bvhd_status instances_report_flags(const unsigned char *fields, enum bvhd_vuid rule, struct place where,
                                        struct bvhd_error *error)
{
    const uint32_t flags = fields[FIELD_FLAGS + 3];
    struct place where_flags = place("%s.flags", where.text);
    if (flags & INSTANCE_UNKNOWN_FLAGS)
        return bvhd_error_rule(error, rule, where_flags.text, "unknown bits 0x%x", flags & INSTANCE_UNKNOWN_FLAGS);
    if (flags & INSTANCE_MICROMAP_FLAGS && !validate_micromaps)
        return bvhd_error_set(error, BVHD_UNSUPPORTED, where_flags.text, "flags 0x%x are about opacity micromaps",
                              flags & INSTANCE_MICROMAP_FLAGS);
    return bvhd_error_rule(error, rule, where_flags.text, "FORCE_OPAQUE and FORCE_NO_OPAQUE exclude each other");
}

static enum bvhd_status report_instance(const unsigned char *record, struct place where, struct bvhd_error *error)
{
    const unsigned char *fields = record + sizeof(float[12]);
    if (!instances_flags_are_valid(fields))
        return instances_report_flags(fields, BVHD_VUID_Instance_flags_parameter, where, error);
    return bvhd_error_rule(error, BVHD_VUID_03799, place("%s.transform", where.text).text,
                           "the 3x3 part is not invertible");
}

static enum bvhd_status check_contents(const struct canonical_geometry *geometry, uint32_t first, uint32_t count,
                                       uint32_t info, uint32_t index, struct bvhd_error *error)
{
    for (uint32_t i = first; i < first + count; i++) {
        const unsigned char *record = instances_record(geometry, i);
        if (!are_valid(record, 1))
            return report_instance(record, place("infos[%u].geometries[%u].instances[%u]", info, index, i), error);
    }
    return BVHD_OK;
}

enum bvhd_status instances_check_references(const struct canonical *canonical, uint32_t index, struct bvhd_error *error)
{
    const struct canonical_geometry *geometry = &canonical->geometries[index];
    uint64_t used = 0;
    for (uint32_t i = 0; i < geometry->primitive_count; i++) {
        uint64_t reference = bytes_get64(instances_fields(geometry, i) + FIELD_REFERENCE);
        if (reference > used + 1 || reference > canonical->reference_count)
            return form_corrupt(error, place("geometries[%u].instances[%u]", index, i).text,
                                "a reference out of order");
        used = reference > used ? reference : used;
    }
    if (used != canonical->reference_count)
        return form_corrupt(error, "referenceCount", "references that no instance names");
    return BVHD_OK;
}

static void transform_box(const float matrix[12], const struct box *box, struct box *ret_box)
{
    double rows[12], min[3], max[3];
    for (int i = 0; i < 12; i++)
        rows[i] = matrix[i];
    transform_bounds(rows, box, min, max);
    for (int row = 0; row < 3; row++) {
        ret_box->min[row] = classification_clamp(round_down(min[row]));
        ret_box->max[row] = classification_clamp(round_up(max[row]));
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
    .check_memory = instances_check_memory,
    .view = instances_view,
    .fetch_primitives = fetch_records,
    .finish = finish,
    .check_contents = check_contents,
    .check_foreign = instances_check_references,
    .look = look,
    .collect = collect,
};
