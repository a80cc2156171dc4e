/* SPDX-License-Identifier: Apache-2.0 */
/* instances.h - what instances and motion instances share (input_kind.h). */
#ifndef BVHD_INPUT_INSTANCES_H
#define BVHD_INPUT_INSTANCES_H

#include "builder/input/fetch_internal.h"
#include "builder/input/input_kind.h"
#include "proto/base/place.h"

/* The handle that was looked up last: instances that follow each other often name one structure. */
struct instances_handle {
    uint64_t handle, reference;
};

enum bvhd_status instances_check_memory(const struct validate_subject *subject);
void instances_view(const void *data, struct canonical_geometry *geometry);

/* Returns the record of instance `index`, or its other fields, which follow its matrices. */
static inline const unsigned char *instances_record(const struct canonical_geometry *geometry, uint64_t index)
{
    const uint64_t size = geometry->type == GEOMETRY_MOVING_INSTANCES ? MOTION_RECORD_STRIDE : FORM_RECORD_SIZE;
    return geometry->instances + size * index;
}

static inline const unsigned char *instances_fields(const struct canonical_geometry *geometry, uint64_t index)
{
    const unsigned char *record = instances_record(geometry, index);
    return record + canonical_record_fields(geometry->type, record);
}

/*
 * Replaces the handle in the fields of record `index` by its position in the caller's table. Returns false for an
 * unknown one, which is noted, because then the request fails.
 */
bool instances_look_up(struct fetch *fetch, unsigned char *fields, uint32_t index, struct instances_handle *last);

/* Reports the first unknown handle, as one that breaks `rule`. */
enum bvhd_status instances_report_unknown(const struct fetch *fetch, uint32_t geometry, enum bvhd_vuid rule,
                                          struct bvhd_error *error);

/* Returns whether the fields say flags that are valid, and whether they name a structure. */
bool instances_flags_are_valid(const unsigned char *fields);
bool instances_are_active(const unsigned char *fields);

/* Reports flags that are not valid: they break `rule`, unless bvhd does not implement them. */
enum bvhd_status instances_report_flags(const unsigned char *fields, enum bvhd_vuid rule, struct place where,
                                        struct bvhd_error *error);

/* Checks that references are numbered in the order of first use, as the writer does. */
enum bvhd_status instances_check_references(const struct canonical *canonical, uint32_t geometry,
                                            struct bvhd_error *error);

#endif
