/* SPDX-License-Identifier: Apache-2.0 */
#include "daemon/service/preparation.h"

#include <assert.h>

#include "proto/base/kind.h"
#include "proto/base/place.h"
#include "builder/format/micro_triangle.h"
#include "builder/input/input_kind.h"
#include "builder/input/prepare.h"
#include "builder/input/validate.h"

/*
 * Upper bounds on the bytes that are taken beside the canonical arrays, in all and for each geometry, reference and
 * instance: rows that were read, tables of fetch and view, look-up tables.
 */
enum { FIXED_BYTES = 16 * 1024, GEOMETRY_BYTES = 640, REFERENCE_BYTES = 1024, INSTANCE_BYTES = 48 };

/* A block that grows may lie in memory twice while it is moved, up to this size. */
enum { MOVED_BYTES = 4 << 20 };

static uint64_t sum(uint64_t a, uint64_t b)
{
    uint64_t result;
    return bytes_add(a, b, &result) ? result : UINT64_MAX;
}

static uint64_t product(uint64_t a, uint64_t b)
{
    uint64_t result;
    return bytes_mul(a, b, &result) ? result : UINT64_MAX;
}

static uint64_t least(uint64_t a, uint64_t b)
{
    return a < b ? a : b;
}

/* Returns the most bytes that a canonical copy of the geometry needs for vertices. */
static uint64_t geometry_vertex_bytes(const struct geometry *geometry)
{
    const struct kind *kind = kind_find(geometry->type);
    return product(kind->vertices(geometry), kind->vertex_bytes);
}

/* Returns the bytes that the reading of a geometry takes beside its copy. */
static uint64_t scratch_bytes(const struct geometry *geometry)
{
    const struct input_kind *kind = input_kind_of(geometry->type);
    return kind->beside ? kind->beside(geometry) : 0;
}

static bool has_micromap(const struct geometry *geometry)
{
    return kind_find(geometry->type)->vulkan_type == GEOMETRY_TRIANGLES && geometry->triangles.micromap.is_given;
}

/* Returns what the micromap of a geometry's triangles takes in the copy: an index each. */
static uint64_t attached_bytes(const struct geometry *geometry)
{
    return has_micromap(geometry) ? product(geometry->range.primitive_count, sizeof(uint32_t)) : 0;
}

/* Returns the bytes of the states of triangles of this usage, which may be invalid, if at most `most` are different. */
static uint64_t usage_bytes(const struct micromap_usage *usage, uint64_t most)
{
    const unsigned level = usage->level < MICRO_LEVEL_MAX ? usage->level : MICRO_LEVEL_MAX;
    const enum micro_format format = usage->format == MICRO_2_STATE ? MICRO_2_STATE : MICRO_4_STATE;
    return product(least(usage->count, most), micro_triangle_bytes(format, level));
}

/*
 * Returns the bytes of the states of a micromap when they have been gathered. States of different triangles may overlap
 * in the request, where as many triangles as there are bytes can begin at different ones. The numbers may change before
 * they are read again, which prepare_input is ready for.
 */
static uint64_t gathered_bytes(const struct geometry_micromap *micromap)
{
    const uint64_t row = sizeof(struct micromap_usage);
    uint64_t gathered = 0;
    for (uint64_t i = 0; i < micromap->usages.size / row; i++) {
        struct micromap_usage usage;
        memcpy(&usage, micromap->usages.data + i * row, sizeof usage);
        gathered = sum(gathered, usage_bytes(&usage, micromap->states.size));
    }
    return gathered;
}

/* Returns what that takes beyond the bytes that the request has for states: a block that grows, and the copy. */
static uint64_t overlapping_bytes(const struct geometry *geometry)
{
    enum { COPIES = 4 };
    if (geometry->type != GEOMETRY_MICROMAP)
        return 0;
    const uint64_t gathered = gathered_bytes(&geometry->micromap), given = geometry->micromap.states.size;
    return gathered > given ? product(gathered - given, COPIES) : 0;
}

static uint64_t geometry_bound(const struct geometry *geometry)
{
    const struct kind *kind = kind_find(geometry->type);
    uint64_t count = geometry->range.primitive_count;
    uint64_t arrays = sum(product(count, kind->primitive_bytes), geometry_vertex_bytes(geometry));
    arrays = sum(arrays, sum(scratch_bytes(geometry), attached_bytes(geometry)));
    arrays = sum(arrays, overlapping_bytes(geometry));
    return kind->is_top ? sum(arrays, product(count, INSTANCE_BYTES)) : arrays;
}

static uint64_t count_primitives(const struct build_input *input)
{
    uint64_t primitives = 0;
    for (uint32_t i = 0; i < input->geometry_count; i++)
        primitives = sum(primitives, input->geometries[i].range.primitive_count);
    return primitives;
}

/*
 * Returns the most bytes of a record with the input's geometries: a row for each, or two if some have micromaps, which
 * are within GEOMETRY_BYTES, and a bit for each primitive. The record of an update's source has no more if the update
 * keeps Vulkan's rules.
 */
static uint64_t record_most(const struct build_input *input)
{
    uint64_t rows = product(input->geometry_count, sizeof(struct record_geometry));
    for (uint32_t i = 0; i < input->geometry_count; i++)
        if (has_micromap(&input->geometries[i])) {
            rows = sum(rows, product(input->geometry_count, sizeof(struct record_micromap)));
            break;
        }
    const uint64_t words = sum(count_primitives(input) / 64, 1);
    return sum(sum(sizeof(struct record_header), rows), product(words, sizeof(uint64_t)));
}

/* The bits of the records: of the input's own, and of the source's, which may come from disk. */
static uint64_t record_bound(const struct build_input *input)
{
    if (input->mode != MODE_UPDATE && !(input->flags & BUILD_ALLOW_UPDATE))
        return 0;
    const uint64_t bits = count_primitives(input) / 8;
    return input->mode == MODE_UPDATE ? 2 * bits : bits;
}

uint64_t preparation_bound(const struct build_input *input)
{
    uint64_t copy = 0;
    for (uint32_t i = 0; i < input->geometry_count; i++)
        copy = sum(copy, sum(geometry_bound(&input->geometries[i]), GEOMETRY_BYTES));
    copy = sum(copy, product(input->reference_count, REFERENCE_BYTES));
    return sum(sum(copy, least(copy, MOVED_BYTES)), sum(record_bound(input), FIXED_BYTES));
}

/*
 * Positions, radii, 32-bit indices and instance records are copied unchanged. Without indices, a triangle of 36 bytes
 * gets 12 bytes of them, and a linear swept sphere of 32 bytes gets 4; instances of 64 or 160 bytes take INSTANCE_BYTES
 * more; small copies lie in memory twice. The promise always covers the rows: a payload without room for the declared
 * rows is refused before they are read.
 */
uint64_t preparation_guess(const struct control_item *item)
{
    uint64_t size = item->payload_size;
    uint64_t copy = sum(size, item->type == STRUCTURE_TOP ? size / 64 * INSTANCE_BYTES : size / 3);
    uint64_t geometries = least(item->geometry_count, size / ROWS_GEOMETRY_LEAST);
    uint64_t references = least(item->reference_count, size / ROWS_REFERENCE_LEAST);
    uint64_t rows = sum(product(geometries, GEOMETRY_BYTES), product(references, REFERENCE_BYTES));
    return sum(sum(copy, least(copy, MOVED_BYTES)), sum(2 * rows, FIXED_BYTES));
}

/*
 * Triangles with shared vertices and 16-bit indices have about 12 bytes each, and take some 250 while they are built;
 * most payloads are larger. Instance records have 64 bytes.
 */
uint64_t preparation_guess_build(const struct control_item *item)
{
    enum { GEOMETRY_RATIO = 16, INSTANCE_RATIO = 4 };
    return product(item->payload_size, item->type == STRUCTURE_TOP ? INSTANCE_RATIO : GEOMETRY_RATIO);
}

uint64_t preparation_build_bytes(uint64_t primitives, uint64_t vertex_bytes, bool high, bool moves)
{
    /*
     * Peak bytes per primitive, for as many threads as there are pieces, so that all pieces are built at once. Vertices
     * come in addition: the result has all of them. A ref and its scratch take 64 bytes. The trees take up to 177
     * beside them: clusters (cluster_tree.h) do so when ploc.h gives up at once and binned.h takes over. Quality high
     * has 1.4 refs per primitive, each of which takes 180 more during reinsertion. Top levels are never split. What
     * moves has a second box in each of two nodes per primitive, and larger nodes and records in the result.
     */
    enum { CLUSTERS = 248, HIGH = 344, SECOND_KEY = 96, FIXED = 16 * 1024 };
    const uint64_t each = (uint64_t)(high ? HIGH : CLUSTERS) + (moves ? SECOND_KEY : 0);
    return sum(sum(product(primitives, each), vertex_bytes), FIXED);
}

/*
 * The states of a bake may be those of the highest level, and lie in memory twice when they are written; offsets reach
 * 4 GiB of them. Beside them it has tables of texels and of triangles.
 */
static uint64_t bake_bytes(const struct geometry *geometry)
{
    enum { EACH = 160, TEXEL = 2 };
    const struct geometry_bake *bake = &geometry->bake;
    const struct micromap_usage usage = {geometry->range.primitive_count, bake->level, bake->format};
    const uint64_t states = least(usage_bytes(&usage, UINT64_MAX), UINT64_C(1) << 32);
    return sum(product(states, 2), sum(product(usage.count, EACH), product(TEXEL, product(bake->width, bake->height))));
}

/* A micromap is written as it was gathered. */
static uint64_t micromap_bytes(const struct geometry *geometry)
{
    if (geometry->type == GEOMETRY_BAKED_MICROMAP)
        return sum(bake_bytes(geometry), FIXED_BYTES);
    const uint64_t triangles = product(geometry->range.primitive_count, sizeof(struct micromap_triangle));
    return sum(sum(triangles, gathered_bytes(&geometry->micromap)), FIXED_BYTES);
}

/* A refit has a box for each node of its source, which takes more bytes itself. */
static uint64_t update_bytes(const struct update_source *source)
{
    return sum(source->blob ? source->blob->size : 0, FIXED_BYTES);
}

/* What the kinds of a structure's geometries say together: if one of them moves, all vertices have two places. */
struct kinds {
    uint64_t vertex_size; /* of the largest one */
    bool moves;
};

static void add_kind(struct kinds *kinds, uint32_t type)
{
    const struct kind *kind = kind_find(type);
    kinds->vertex_size = kind->vertex_bytes > kinds->vertex_size ? kind->vertex_bytes : kinds->vertex_size;
    kinds->moves = kinds->moves || kind->moves;
}

static uint64_t entry_bytes(const struct build_entry *entry)
{
    const struct canonical *canonical = &entry->canonical;
    struct kinds kinds = {0};
    for (uint32_t i = 0; i < canonical->geometry_count; i++)
        add_kind(&kinds, canonical->geometries[i].type);
    return preparation_build_bytes(canonical->primitive_count, product(canonical->vertex_count, kinds.vertex_size),
                                   entry->options.quality == QUALITY_HIGH, kinds.moves);
}

uint64_t preparation_make_bytes(const struct preparation *preparation)
{
    const struct build_entry *entry = &preparation->entry;
    if (entry->canonical.type == STRUCTURE_MICROMAP)
        return preparation->needed_build;
    return entry->is_update ? update_bytes(&preparation->updated) : entry_bytes(entry);
}

/* Bounds what the build of an input takes, whatever its quality turns out to be. */
static uint64_t build_bound(const struct build_input *input)
{
    enum build_quality quality = input->options.quality;
    uint64_t primitives = 0, vertices = 0;
    struct kinds kinds = {0};
    if (input->type == STRUCTURE_MICROMAP)
        return micromap_bytes(&input->geometries[0]);
    for (uint32_t i = 0; i < input->geometry_count; i++) {
        const struct geometry *geometry = &input->geometries[i];
        primitives = sum(primitives, geometry->range.primitive_count);
        vertices = sum(vertices, kind_find(geometry->type)->vertices(geometry));
        add_kind(&kinds, geometry->type);
    }
    return preparation_build_bytes(primitives, product(vertices, kinds.vertex_size),
                                   quality != QUALITY_FAST && quality != QUALITY_BALANCED, kinds.moves);
}

struct preparation *preparation_create(const struct control_item *item, uint32_t index,
                                       const struct preparation_source *source, struct memory *memory)
{
    struct preparation *preparation = memory_alloc(memory, sizeof *preparation);
    struct preparation_source taken = *source;
    if (!preparation) {
        preparation_drop_source(&taken);
        return NULL;
    }
    *preparation =
        (struct preparation){.asked = *item, .index = index, .updated = {.blob = taken.updated}, .within = memory};
    preparation->updated.record.memory = &preparation->memory;
    preparation->micromaps.memory = memory;
    taken.updated = NULL;
    preparation->source = taken;
    memory_init_within(&preparation->memory, memory, UINT64_MAX);
    return preparation;
}

void preparation_account(struct preparation *preparation, struct memory *memory)
{
    assert(atomic_load_explicit(&preparation->memory.live, memory_order_relaxed) == 0);
    memory_init_within(&preparation->memory, memory, UINT64_MAX);
}

void preparation_drop_source(struct preparation_source *source)
{
    payload_unref(source->payload);
    attachment_unref(source->attachment);
    blob_unref(source->updated);
    *source = (struct preparation_source){0};
}

void preparation_destroy(struct preparation *preparation)
{
    if (!preparation)
        return;
    preparation_drop_source(&preparation->source);
    update_source_finish(&preparation->updated);
    micromap_sources_finish(&preparation->micromaps);
    build_entry_finish(&preparation->entry, &preparation->memory);
    memory_free(preparation->within, preparation);
}

static enum bvhd_status find_bytes(struct preparation *preparation, struct bytes *ret_bytes)
{
    const struct preparation_source *source = &preparation->source;
    struct payload *payload = source->payload;
    if (source->attachment) {
        enum bvhd_status status = attachment_open(source->attachment, &payload, &preparation->error);
        if (status != BVHD_OK)
            return status;
    }
    struct bytes whole = payload_bytes(payload);
    if (!bytes_reach(whole.size, source->offset, 0, 0, source->size))
        return bvhd_error_set(&preparation->error, BVHD_INVALID, place("infos[%u].payload", preparation->index).text,
                              "the region ends outside of its source");
    *ret_bytes = (struct bytes){whole.data + source->offset, source->size};
    return BVHD_OK;
}

/* Returns another item that builds into `handle`, or HANDLE_NONE. Equal handles are adjacent, so two are enough. */
static uint32_t other_destination(const struct preparation_batch *batch, uint64_t handle, uint32_t index)
{
    uint32_t at = handle ? handle_find(batch->destinations, batch->count, handle) : HANDLE_NONE;
    if (at != HANDLE_NONE && batch->destinations[at].number == index)
        at++;
    bool other = at < batch->count && batch->destinations[at].handle == handle;
    return other ? batch->destinations[at].number : HANDLE_NONE;
}

/* The rule between items that needs the payload: no item refers to a destination of another (VUID 03407). */
static enum bvhd_status check_references(struct preparation *preparation, const struct build_input *input)
{
    for (uint32_t i = 0; preparation->batch.count > 0 && i < input->reference_count; i++) {
        uint32_t other = other_destination(&preparation->batch, input->references[i].handle, preparation->index);
        if (other != HANDLE_NONE)
            return bvhd_error_rule(&preparation->error, BVHD_VUID_03407,
                                   place("infos[%u].references[%u]", preparation->index, i).text,
                                   "infos[%u] builds into this structure", other);
    }
    return BVHD_OK;
}

/*
 * The record of a source is part of what was promised, so it is not read before. It may be larger than the bound has it
 * if the update breaks a rule, which is told with the help of the record: more is needed then.
 */
static enum bvhd_status find_record(struct preparation *preparation, const struct build_input *input, uint64_t bound,
                                    const atomic_bool *cancel, struct build_entry_source *ret_source)
{
    struct update_source *updated = &preparation->updated;
    *ret_source = (struct build_entry_source){.blob = {NULL, 0}};
    if (input->mode != MODE_UPDATE)
        return BVHD_OK;
    updated->record.room = sum(record_most(input), preparation->promised - bound);
    enum bvhd_status status =
        update_source_find_record(updated, &input->source_key, preparation->index, cancel, &preparation->error);
    if (status == BVHD_TOO_LARGE)
        preparation->needed = sum(bound, updated->record.size - record_most(input));
    if (status == BVHD_OK)
        ret_source->record = update_source_record(updated);
    return status;
}

/* A micromap's bytes, and what is made of them while indices are checked, which is no more. */
enum { MICROMAP_COPIES = 2 };

/*
 * Lists the micromaps that the input names if that has not been done yet; else reads those that are not in memory, and
 * adds to *bound what all of them take. The rows may have changed since they were listed: what they name in addition
 * is missing then.
 */
static enum bvhd_status find_micromaps(struct preparation *preparation, const struct build_input *input,
                                       const atomic_bool *cancel, uint64_t *bound)
{
    struct micromap_sources *micromaps = &preparation->micromaps;
    uint64_t size = 0;
    if (!micromap_sources_are_named(input))
        return BVHD_OK;
    if (!micromaps->rows) {
        enum bvhd_status status = micromap_sources_list(micromaps, input, preparation->index, &preparation->error);
        preparation->names_micromaps = status == BVHD_OK;
        return status;
    }
    const uint64_t room = preparation->promised > *bound ? (preparation->promised - *bound) / MICROMAP_COPIES : 0;
    enum bvhd_status status = micromap_sources_read(micromaps, room, cancel, &size, &preparation->error);
    if (status == BVHD_OK)
        *bound = sum(*bound, product(size, MICROMAP_COPIES));
    return status;
}

/* No copy has more bytes than were promised for it, whatever has been written to the payload meanwhile. */
static struct limits limits_of(const struct preparation *preparation)
{
    struct limits limits = *preparation->limits;
    limits.max_canonical_bytes = least(limits.max_canonical_bytes, preparation->promised);
    return limits;
}

static enum bvhd_status prepare_with_micromaps(struct preparation *preparation, const struct build_input *input,
                                               const struct build_entry_source *source,
                                               const struct build_context *context)
{
    const struct limits limits = limits_of(preparation);
    struct reference *references = (struct reference *)(uintptr_t)input->references; /* from rows_read */
    enum bvhd_status status = micromap_sources_open(&preparation->micromaps, references, input->reference_count,
                                                    preparation->index, &preparation->error);
    if (status != BVHD_OK)
        return status;
    status = build_entry_prepare(input, preparation->index, &limits, source, context, &preparation->entry,
                                 &preparation->error);
    micromap_sources_close(&preparation->micromaps);
    return status;
}

static enum bvhd_status prepare_input(struct preparation *preparation, const struct build_input *input, uint64_t bound,
                                      const struct build_context *context)
{
    struct build_entry_source source;
    enum bvhd_status status = find_record(preparation, input, bound, context->cancel, &source);
    if (status == BVHD_OK)
        status = check_references(preparation, input);
    if (status == BVHD_OK)
        status = prepare_with_micromaps(preparation, input, &source, context);
    memory_explain(&preparation->memory, &preparation->error);
    return status;
}

/* What the build or the update takes. */
static uint64_t make_bound(const struct preparation *preparation, const struct build_input *input)
{
    return input->mode == MODE_UPDATE ? update_bytes(&preparation->updated) : build_bound(input);
}

static bool exceeds_promise(const struct preparation *preparation, uint64_t bytes, uint64_t build)
{
    return bytes > preparation->promised ||
           (preparation->class == ADMISSION_LARGE && build > preparation->promised_build);
}

/* Finds what the input starts from and what it names, and bounds what it takes to prepare it. */
static enum bvhd_status find_sources(struct preparation *preparation, const struct build_input *input,
                                     const atomic_bool *cancel, uint64_t *ret_bound)
{
    enum bvhd_status status = BVHD_OK;
    if (input->mode == MODE_UPDATE)
        status = update_source_find(&preparation->updated, &input->source_key, preparation->index, cancel,
                                    &preparation->error);
    *ret_bound = preparation_bound(input);
    return status == BVHD_OK ? find_micromaps(preparation, input, cancel, ret_bound) : status;
}

/* Prepares the input if enough memory has been promised, else says how much is needed. */
static enum bvhd_status prepare_within_promise(struct preparation *preparation, const struct build_input *input,
                                               uint64_t bound, const struct build_context *context)
{
    preparation->needed_build = make_bound(preparation, input);
    if (!exceeds_promise(preparation, bound, preparation->needed_build))
        return prepare_input(preparation, input, bound, context);
    preparation->needed = bound > preparation->promised ? bound : preparation->promised;
    return BVHD_OK;
}

static enum bvhd_status run(struct preparation *preparation, const struct build_context *context)
{
    const struct control_item *asked = &preparation->asked;
    struct rows_shape shape = {asked->geometry_count, asked->geometry_size, asked->reference_count,
                               asked->reference_size, context->cancel};
    struct build_input input = control_item_input(asked);
    struct bytes bytes;
    enum bvhd_status status = find_bytes(preparation, &bytes);
    if (status == BVHD_OK)
        status = rows_read(bytes, &shape, preparation->index, context->memory, &input, &preparation->error);
    if (status != BVHD_OK)
        return status;
    uint64_t bound;
    status =
        validate_input_until(&input, preparation->index, preparation->limits, context->cancel, &preparation->error);
    if (status == BVHD_OK)
        status = find_sources(preparation, &input, context->cancel, &bound);
    if (status == BVHD_OK && !preparation->names_micromaps)
        status = prepare_within_promise(preparation, &input, bound, context);
    rows_finish(&input, context->memory);
    return status;
}

void preparation_run(struct preparation *preparation, const struct parallel *parallel, const atomic_bool *cancel)
{
    struct build_context context = {.memory = &preparation->memory, .parallel = parallel, .cancel = cancel};
    preparation->needed = preparation->needed_build = 0;
    preparation->names_micromaps = false;
    preparation->status = run(preparation, &context);
    if (preparation->needed == 0 && !preparation->names_micromaps)
        preparation_drop_source(&preparation->source);
}
