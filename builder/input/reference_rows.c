/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/input/reference_rows.h"

#include "proto/base/kind.h"
#include "proto/base/place.h"
#include "proto/base/validate_shape.h"

/* Where the other fields of a record (canonical.h) have the reference. */
enum { FLAGS_FIELD = 7, REFERENCE_FIELD = 8 };

/* A micromap has nothing but a key and its bytes, which triangle_micromap.c checks. */
static bool is_good(const struct reference *reference, enum reference_kind kind)
{
    bool good = reference->kind == kind && reference->handle != 0;
    if (kind == REFERENCE_MICROMAP)
        return good && reference->has_key && reference->blob.data;
    for (int axis = 0; axis < 3; axis++)
        good =
            good && __builtin_isfinite(reference->bounds.min[axis]) && __builtin_isfinite(reference->bounds.max[axis]);
    return good && slabs_are_valid(&reference->slabs);
}

static enum bvhd_status refuse(const struct reference *reference, enum reference_kind kind, struct place where,
                               struct bvhd_error *error)
{
    if (reference->kind != kind)
        return bvhd_error_set(error, BVHD_UNSUPPORTED, where.text, "reference kind %u", (unsigned)reference->kind);
    if (reference->handle == 0)
        return bvhd_error_set(error, BVHD_INVALID, where.text, "handle 0 names nothing");
    if (kind == REFERENCE_MICROMAP && !reference->has_key)
        return bvhd_error_set(error, BVHD_INVALID, where.text, "a micromap without a key");
    if (kind == REFERENCE_MICROMAP)
        return bvhd_error_set(error, BVHD_NOT_FOUND, where.text, "the bytes of the micromap are not there");
    if (!slabs_are_valid(&reference->slabs))
        return bvhd_error_set(error, BVHD_INVALID, where.text, "slabs are not finite, or turned round");
    return bvhd_error_set(error, BVHD_INVALID, where.text, "bounds are not finite");
}

static enum bvhd_status cancelled(uint32_t index, struct bvhd_error *error)
{
    return bvhd_error_set(error, BVHD_CANCELLED, place("infos[%u]", index).text, "cancelled");
}

static enum bvhd_status check_references(const struct build_input *input, uint32_t index, const atomic_bool *cancel,
                                         struct bvhd_error *error)
{
    if (input->reference_count > 0 && !input->references)
        return bvhd_error_set(error, BVHD_INVALID, place("infos[%u].references", index).text, "no references given");
    const enum reference_kind kind = input->type == STRUCTURE_TOP ? REFERENCE_BLAS : REFERENCE_MICROMAP;
    for (uint32_t i = 0; i < input->reference_count; i++) {
        if (parallel_cancelled_at(cancel, i))
            return cancelled(index, error);
        if (!is_good(&input->references[i], kind))
            return refuse(&input->references[i], kind, place("infos[%u].references[%u]", index, i), error);
    }
    return BVHD_OK;
}

static enum bvhd_status check_unique(const struct handle_entry *entries, uint32_t count, uint32_t index,
                                     struct bvhd_error *error)
{
    for (uint32_t i = 1; i < count; i++)
        if (entries[i].handle == entries[i - 1].handle)
            return bvhd_error_set(error, BVHD_INVALID, place("infos[%u].references[%u]", index, entries[i].number).text,
                                  "the same handle as references[%u]", entries[i - 1].number);
    return BVHD_OK;
}

/* Lists the handles with their positions, and sorts them. Returns false when cancelled. */
static bool list_references(const struct build_input *input, const atomic_bool *cancel, struct handle_entry *entries)
{
    uint32_t count = input->reference_count;
    for (uint32_t i = 0; i < count; i++) {
        if (parallel_cancelled_at(cancel, i))
            return false;
        entries[i] = (struct handle_entry){input->references[i].handle, i};
    }
    return handle_sort_until(entries, entries + count, count, cancel);
}

enum bvhd_status reference_lookup_init(const struct build_input *input, uint32_t index,
                                       const struct build_context *context, struct reference_lookup *ret_lookup,
                                       struct bvhd_error *error)
{
    uint32_t count = input->reference_count;
    enum bvhd_status status = check_references(input, index, context->cancel, error);
    if (status != BVHD_OK || count == 0) {
        if (status == BVHD_OK)
            *ret_lookup = (struct reference_lookup){NULL, 0};
        return status;
    }
    struct handle_entry *entries = memory_array(context->memory, count, 2 * sizeof *entries);
    if (!entries)
        return bvhd_error_no_memory(error, place("infos[%u].references", index).text, "no memory for %u references",
                                    count);
    bool listed = list_references(input, context->cancel, entries);
    status = listed ? check_unique(entries, count, index, error) : cancelled(index, error);
    if (status == BVHD_OK)
        *ret_lookup = (struct reference_lookup){entries, count};
    else
        memory_free(context->memory, entries);
    return status;
}

void reference_lookup_finish(struct reference_lookup *lookup, struct memory *memory)
{
    if (!lookup)
        return;
    memory_free(memory, lookup->entries);
    *lookup = (struct reference_lookup){NULL, 0};
}

uint64_t reference_lookup_find(const struct reference_lookup *lookup, uint64_t handle)
{
    uint32_t at = handle_find(lookup->entries, lookup->count, handle);
    return at == HANDLE_NONE ? 0 : (uint64_t)lookup->entries[at].number + 1;
}

static struct form_reference row_of(const struct reference *reference)
{
    struct form_reference row = {.kind = reference->kind};
    if (reference->has_key)
        row.key = reference->key;
    row.bounds = box_is_empty(&reference->bounds) ? box_empty() : reference->bounds;
    if (slabs_are_known(&reference->slabs) && !box_is_empty(&reference->bounds))
        row.slabs = reference->slabs;
    return row;
}

/* Checks the flag every few thousand records. */
static bool is_cancelled(const struct build_context *context, uint32_t record)
{
    return record % 8192 == 0 && context_cancelled(context);
}

/* Refuses a structure that moves in a top level that does not: Vulkan has this rule without a VUID. */
static enum bvhd_status refuse_motion(const struct reference_records *records, uint32_t record,
                                      struct bvhd_error *error)
{
    return bvhd_error_set(
        error, BVHD_INVALID,
        place("infos[%u].geometries[0].instances[%u].accelerationStructureReference", records->index, record).text,
        "names a structure that moves, which needs VK_BUILD_ACCELERATION_STRUCTURE_MOTION_BIT_NV in "
        "infos[%u].flags",
        records->index);
}

/* Refuses an instance that disables the micromaps of a structure that was not built for that. */
static enum bvhd_status refuse_disabling(const struct reference_records *records, uint32_t record,
                                         struct bvhd_error *error)
{
    return bvhd_error_rule(error, BVHD_VUID_11581,
                           place("infos[%u].geometries[0].instances[%u].flags", records->index, record).text,
                           "DISABLE_OPACITY_MICROMAPS, but the structure was built without "
                           "ALLOW_DISABLE_OPACITY_MICROMAPS");
}

/*
 * Numbers the structures in the order of first use: makes a row for each, and writes its number into the records. The
 * number of rows is smaller when cancelled. Fails if a structure moves that must not.
 */
static enum bvhd_status number_references(const struct reference_records *records, const struct reference *references,
                                          const struct build_context *context, uint32_t *row_of_reference,
                                          struct reference_rows *numbered, struct bvhd_error *error)
{
    const struct kind *kind = kind_find(records->type);
    const uint32_t size = kind->primitive_bytes;
    uint32_t count = 0;
    for (uint32_t i = 0; i < records->count && !is_cancelled(context, i); i++) {
        unsigned char *record = records->records + (uint64_t)size * i;
        unsigned char *field = record + canonical_record_fields(records->type, record) + REFERENCE_FIELD;
        uint64_t reference = bytes_get64(field);
        if (reference == 0)
            continue;
        if (validate_micromaps && field[FLAGS_FIELD - REFERENCE_FIELD] & INSTANCE_DISABLE_MICROMAPS &&
            !references[reference - 1].may_disable_micromaps)
            return refuse_disabling(records, i, error);
        uint32_t *row = &row_of_reference[reference - 1];
        if (*row == 0) {
            if (references[reference - 1].moves && !kind->moves)
                return refuse_motion(records, i, error);
            numbered->rows[count] = row_of(&references[reference - 1]);
            *row = ++count;
        }
        bytes_put64(field, *row);
    }
    numbered->count = count;
    return BVHD_OK;
}

/* The rows are incomplete when it is cancelled on the way. The caller frees them, also when it fails. */
static enum bvhd_status make(const struct reference_records *records, const struct reference *references,
                             uint32_t reference_count, const struct build_context *context, struct reference_rows *rows,
                             struct bvhd_error *error)
{
    enum bvhd_status status;
    uint32_t capacity = reference_count < records->count ? reference_count : records->count;
    uint32_t *numbers = memory_array(context->memory, reference_count, sizeof *numbers);
    rows->rows = memory_array(context->memory, capacity, sizeof *rows->rows);
    if (numbers && rows->rows) {
        memset(numbers, 0, reference_count * sizeof *numbers);
        status = number_references(records, references, context, numbers, rows, error);
    } else {
        status = bvhd_error_no_memory(error, "references", "no memory for %u references", reference_count);
    }
    memory_free(context->memory, numbers);
    return status;
}

enum bvhd_status reference_rows_make(const struct reference_records *records, const struct reference *references,
                                     uint32_t reference_count, const struct build_context *context,
                                     struct reference_rows *ret_rows, struct bvhd_error *error)
{
    struct reference_rows made = {NULL, 0};
    enum bvhd_status status = BVHD_OK;
    if (reference_count > 0 && records->count > 0)
        status = make(records, references, reference_count, context, &made, error);
    if (status == BVHD_OK && context_cancelled(context))
        status = bvhd_error_set(error, BVHD_CANCELLED, "references", "cancelled");
    if (status == BVHD_OK)
        *ret_rows = made;
    else
        memory_free(context->memory, made.rows);
    return status;
}
