/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/input/prepare.h"

#include "builder/input/canonical_form.h"
#include "builder/input/fetch.h"
#include "builder/input/input_kind.h"
#include "proto/base/kind.h"
#include "proto/base/place.h"
#include "builder/input/reference_rows.h"
#include "builder/input/triangle_micromap.h"
#include "builder/input/validate.h"

/*
 * The state of one prepare call. The block grows once: at first it has the header, the geometry rows and the arrays of
 * primitives, whose sizes are known; then, when the highest index of each geometry is known, positions and reference
 * rows are added. A small block would be copied as it grows, by one thread while all others wait, so that it gets room
 * for the positions from the start.
 */
struct work {
    const struct build_input *input;
    uint32_t index;
    uint64_t max_bytes;
    const struct build_context *context;
    struct memory *memory; /* the context's */
    struct bvhd_error *error;
    struct fetch fetch; /* its view becomes the result */
    unsigned char *block;
    uint64_t size; /* bytes of the sections that have been placed */
    uint64_t room; /* bytes that the block has room for */
    struct reference_rows references; /* a bottom level's are its micromaps */
};

static struct form_geometry *rows_of(const struct work *work)
{
    return (void *)(work->block + sizeof(struct form_header));
}

static enum bvhd_status no_memory(const struct work *work, uint64_t size)
{
    return bvhd_error_no_memory(work->error, place("infos[%u]", work->index).text, "no memory for a copy of %llu bytes",
                                (unsigned long long)size);
}

static enum bvhd_status too_large(const struct work *work, const char *what)
{
    return bvhd_error_set(work->error, BVHD_TOO_LARGE, place("infos[%u]", work->index).text, "%s", what);
}

/* Gives the block that much room, and keeps the contents. */
static bool resize(struct work *work, uint64_t room)
{
    unsigned char *block = memory_resize(work->memory, work->block, room);
    if (!block)
        return false;
    work->block = block;
    work->room = room;
    return true;
}

/* Makes room for `size` bytes, and for `more` that may follow; keeps the contents. */
static enum bvhd_status grow(struct work *work, uint64_t size, uint64_t more)
{
    if (size > work->max_bytes)
        return too_large(work, "the canonical copy is over the limit");
    if (size > work->room && !resize(work, size + more))
        return no_memory(work, size + more);
    work->size = size;
    return BVHD_OK;
}

/* Gives back room, if it is more than an eighth of the block, as far as there is memory for that. */
static void shrink(struct work *work)
{
    if (work->room - work->size > work->size / 8)
        resize(work, work->size);
}

/* Returns how many bytes of positions to expect after the first `size` bytes of a block that would be copied. */
static uint64_t positions_expected(const struct work *work, uint64_t size)
{
    enum { COPIED_BELOW = 4 << 20, MOST_RATIO = 4 };
    uint64_t most = 0;
    if (size >= COPIED_BELOW)
        return 0;
    for (uint32_t i = 0; i < work->input->geometry_count && most <= MOST_RATIO * size; i++) {
        const struct geometry *geometry = &work->input->geometries[i];
        const struct kind *kind = kind_find(geometry->type);
        most += bytes_align(kind->vertices(geometry) * kind->vertex_bytes, FORM_ALIGNMENT);
    }
    return most <= MOST_RATIO * size && size + most <= work->max_bytes ? most : 0;
}

static bool is_update(const struct build_input *input)
{
    return input->flags & BUILD_ALLOW_UPDATE;
}

static struct form_geometry make_row(const struct geometry *geometry, bool update)
{
    const struct input_kind *kind = input_kind_of(geometry->type);
    struct form_geometry row = {
        .type = geometry->type,
        .flags = geometry->flags,
        .primitive_count = geometry->range.primitive_count,
    };
    if (kind->describe)
        kind->describe(geometry, update, &row);
    if (form_may_have_micromap(geometry->type) && geometry->triangles.micromap.is_given)
        row.micromap_offset = FORM_UNPLACED;
    return row;
}

/* Clears the bytes between an array and the next section; all other bytes of the block get written. */
static void clear_gap(unsigned char *block, uint64_t offset, uint64_t size)
{
    uint64_t end = offset + size;
    memset(block + end, 0, bytes_align(end, FORM_ALIGNMENT) - end);
}

static void clear_gaps(struct work *work, enum form_section section)
{
    struct form_geometry *rows = rows_of(work);
    for (uint32_t i = 0; i < work->input->geometry_count; i++) {
        uint64_t *offset = form_offset(&rows[i], section);
        if (offset && *offset)
            clear_gap(work->block, *offset, form_bytes(&rows[i], section));
    }
}

/*
 * Checks the cancel flag between steps that do not check it themselves: with millions of rows each of them takes a
 * while.
 */
static enum bvhd_status look_at_cancel(const struct work *work)
{
    if (!context_cancelled(work->context))
        return BVHD_OK;
    return bvhd_error_set(work->error, BVHD_CANCELLED, place("infos[%u]", work->index).text, "cancelled");
}

/* Stops early when cancelled. */
static void make_rows(struct work *work)
{
    const struct build_input *input = work->input;
    for (uint32_t i = 0; i < input->geometry_count && !parallel_cancelled_at(work->context->cancel, i); i++)
        rows_of(work)[i] = make_row(&input->geometries[i], is_update(input));
}

/* Places the first section of the block: rows, and the arrays that fetch_primitives will fill. */
static enum bvhd_status place_primitives(struct work *work)
{
    const struct build_input *input = work->input;
    uint64_t tables = sizeof(struct form_header) + (uint64_t)input->geometry_count * sizeof(struct form_geometry), end;
    enum bvhd_status status = grow(work, tables, 0);
    if (status != BVHD_OK)
        return status;
    make_rows(work);
    status = look_at_cancel(work);
    if (status != BVHD_OK)
        return status;
    if (!form_place(rows_of(work), input->geometry_count, FORM_PRIMITIVES, tables, &end) ||
        !form_place(rows_of(work), input->geometry_count, FORM_MICROMAPS, end, &end))
        return too_large(work, "the canonical copy is over 2^64 bytes");
    status = grow(work, end, positions_expected(work, end));
    if (status != BVHD_OK)
        return status;
    clear_gaps(work, FORM_PRIMITIVES);
    clear_gaps(work, FORM_MICROMAPS);
    return BVHD_OK;
}

/* Places the second section: positions, whose number is known by now, and reference rows. */
static enum bvhd_status place_positions(struct work *work)
{
    uint32_t count = work->input->geometry_count;
    uint64_t end, references = (uint64_t)work->references.count * sizeof(struct form_reference);
    for (uint32_t i = 0; i < count; i++)
        rows_of(work)[i].vertex_count = work->fetch.view.geometries[i].vertex_count;
    if (!form_place(rows_of(work), count, FORM_POSITIONS, work->size, &end) || !bytes_add(end, references, &end))
        return too_large(work, "the canonical copy is over 2^64 bytes");
    enum bvhd_status status = look_at_cancel(work);
    if (status == BVHD_OK)
        status = grow(work, end, 0);
    if (status == BVHD_OK) {
        shrink(work);
        clear_gaps(work, FORM_POSITIONS);
    }
    return status;
}

static void write_header(struct work *work)
{
    const struct canonical *view = &work->fetch.view;
    uint64_t references = (uint64_t)work->references.count * sizeof(struct form_reference);
    struct form_header header = {
        .version = form_version(rows_of(work), view->geometry_count, work->input->flags),
        .type = work->input->type,
        .flags = work->input->flags,
        .geometry_count = view->geometry_count,
        .reference_count = work->references.count,
        .primitive_count = view->primitive_count,
        .vertex_count = view->vertex_count,
        .size = work->size,
        .reference_offset = references ? work->size - references : 0,
    };
    memcpy(header.magic, form_magic, sizeof header.magic);
    memcpy(work->block, &header, sizeof header);
    if (references)
        memcpy(work->block + header.reference_offset, work->references.rows, references);
}

static enum bvhd_status make_references(struct work *work)
{
    struct canonical_geometry *geometry = work->fetch.view.geometries;
    if (work->input->type != STRUCTURE_TOP)
        return triangle_micromaps_read(&work->fetch, work->context, &work->references, work->error);
    const struct reference_records records = {work->index, rows_of(work)->type, geometry->primitive_count,
                                              work->block + rows_of(work)->data_offset};
    return reference_rows_make(&records, work->input->references, work->input->reference_count, work->context,
                               &work->references, work->error);
}

/* Completes the view, which becomes the result with the block and the tables. */
static enum bvhd_status finish_view(struct work *work)
{
    struct canonical *view = &work->fetch.view;
    if (work->references.count > 0) {
        view->references = memory_array(work->memory, work->references.count, sizeof *view->references);
        if (!view->references)
            return no_memory(work, (uint64_t)work->references.count * sizeof *view->references);
    }
    form_view(work->block, view);
    return work->fetch.suspect ? validate_canonical(view, work->index, work->context->cancel, work->error) : BVHD_OK;
}

static enum bvhd_status run(struct work *work)
{
    enum bvhd_status status = look_at_cancel(work);
    if (status == BVHD_OK)
        status = place_primitives(work);
    if (status == BVHD_OK)
        status = look_at_cancel(work);
    if (status == BVHD_OK)
        status = fetch_primitives(&work->fetch, work->block, work->context, work->error);
    if (status == BVHD_OK)
        status = make_references(work);
    if (status == BVHD_OK)
        status = place_positions(work);
    if (status == BVHD_OK)
        status = look_at_cancel(work);
    if (status == BVHD_OK)
        status = fetch_positions(&work->fetch, work->block, work->context, work->error);
    if (status != BVHD_OK)
        return status;
    write_header(work);
    return finish_view(work);
}

enum bvhd_status prepare(const struct build_input *input, uint32_t index, const struct limits *limits,
                         const struct build_context *context, struct canonical *ret_canonical, struct bvhd_error *error)
{
    struct memory *memory = context->memory;
    struct work work = {.input = input,
                        .index = index,
                        .max_bytes = limits->max_canonical_bytes,
                        .context = context,
                        .memory = memory,
                        .error = error};
    enum bvhd_status status = validate_input_until(input, index, limits, context->cancel, error);
    if (status != BVHD_OK)
        return status;
    const struct input_kind *kind = input->geometry_count == 1 ? input_kind_of(input->geometries[0].type) : NULL;
    if (kind && kind->prepare)
        return kind->prepare(input, index, limits, context, ret_canonical, error);
    status = fetch_init(&work.fetch, input, index, context, error);
    if (status != BVHD_OK)
        return status;

    status = run(&work);
    memory_free(memory, work.references.rows);
    struct canonical view = work.fetch.view;
    fetch_finish(&work.fetch, memory);
    view.owned = work.block;
    if (status == BVHD_OK)
        *ret_canonical = view;
    else
        prepare_finish(&view, memory);
    return status;
}

void prepare_finish(struct canonical *canonical, struct memory *memory)
{
    if (!canonical)
        return;
    memory_free(memory, canonical->owned);
    memory_free(memory, canonical->geometries);
    memory_free(memory, canonical->references);
    *canonical = (struct canonical){0};
}
