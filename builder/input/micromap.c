/* SPDX-License-Identifier: Apache-2.0 */
/*
 * micromap.c - opacity micromaps: the table of their triangles, and the states, gathered so that equal ones of one
 * level and format are stored once, in the order of first use, and bits beyond the last state are 0.
 */
#include <inttypes.h>

#include "builder/context.h"
#include "builder/format/micro_triangle.h"
#include "builder/input/canonical_form.h"
#include "builder/input/fetch_internal.h"
#include "builder/input/input_kind.h"
#include "builder/input/micromap_usages.h"
#include "builder/input/validate.h"
#include "proto/base/checksum.h"
#include "proto/base/place.h"
#include "proto/base/request_limits.h"

/* The state of one call of prepare_micromap. */
struct gathering {
    const struct build_input *input;
    const struct geometry_micromap *micromap;
    uint32_t index, count;
    const struct build_context *context;
    struct bvhd_error *error;
    uint64_t most; /* bytes that may be gathered */
    struct micromap_triangle *triangles;
    uint32_t *slots; /* a hash table: 1-based triangles that were the first ones with their states; 0: empty */
    uint64_t slot_count; /* a power of two, at least twice `count` */
    unsigned char *states;
    uint64_t size, room; /* bytes of states, and those for which there is memory */
};

static struct place place_of(const struct gathering *g, const char *field)
{
    return place("infos[%u].geometries[0].micromap.%s", g->index, field);
}

static enum bvhd_status check_memory(const struct validate_subject *subject)
{
    const struct geometry_micromap *micromap = &subject->geometry->micromap;
    const uint32_t count = subject->geometry->range.primitive_count;
    if (count == 0)
        return BVHD_OK;
    if (!micromap->states.data)
        return validate_refuse_memory(subject, BVHD_VUID_07553, "micromap.data", &micromap->states, "states");
    if (!micromap->triangles.data ||
        !bytes_reach(micromap->triangles.size, 0, micromap->stride, count - 1, sizeof(struct micromap_triangle)))
        return validate_refuse_memory(subject, BVHD_VUID_07554, "micromap.triangleArray", &micromap->triangles,
                                      "triangles");
    return BVHD_OK;
}

static uint32_t bytes_of(const struct micromap_triangle *triangle)
{
    return micro_triangle_bytes((enum micro_format)triangle->format, triangle->level);
}

static enum bvhd_status refuse_triangle(const struct gathering *g, uint32_t i)
{
    const struct micromap_triangle *triangle = &g->triangles[i];
    const bool is_lossy = g->input->flags & BUILD_MICROMAP_LOSSY;
    const struct place where = place("%s[%u]", place_of(g, "triangleArray").text, i);
    if (triangle->format != MICRO_2_STATE && triangle->format != MICRO_4_STATE)
        return bvhd_error_rule(g->error, BVHD_VUID_07522, where.text, "format %u, which is none of micromaps",
                               triangle->format);
    if (is_lossy && triangle->format != MICRO_4_STATE)
        return bvhd_error_rule(g->error, BVHD_VUID_11713, where.text, "a lossy micromap has 4 states");
    if (triangle->level > MICRO_LEVEL_MAX)
        return bvhd_error_rule(g->error,
                               triangle->format == MICRO_2_STATE ? BVHD_VUID_07523
                               : is_lossy                        ? BVHD_VUID_11567
                                                                 : BVHD_VUID_11566,
                               where.text, "level %u, at most %d", triangle->level, MICRO_LEVEL_MAX);
    return bvhd_error_rule(g->error, BVHD_VUID_07553, where.text,
                           "%" PRIu32 " bytes from %" PRIu32 " on reach past the %" PRIu64 " bytes of states",
                           bytes_of(triangle), triangle->offset, g->micromap->states.size);
}

static enum bvhd_status cancelled(const struct gathering *g)
{
    return bvhd_error_set(g->error, BVHD_CANCELLED, place("infos[%u]", g->index).text, "cancelled");
}

/* Reads the array of triangles once, and checks and counts what was read. */
static enum bvhd_status read_triangles(struct gathering *g, struct micromap_usages *found)
{
    const struct geometry_micromap *micromap = g->micromap;
    const bool is_lossy = g->input->flags & BUILD_MICROMAP_LOSSY;
    for (uint32_t i = 0; i < g->count; i++) {
        if (parallel_cancelled_at(g->context->cancel, i))
            return cancelled(g);
        memcpy(&g->triangles[i], micromap->triangles.data + micromap->stride * i, sizeof g->triangles[i]);
        fetch_settle();
        const struct micromap_triangle triangle = g->triangles[i];
        if (!micromap_usage_is_valid(triangle.format, triangle.level) ||
            (is_lossy && triangle.format != MICRO_4_STATE) ||
            !bytes_reach(micromap->states.size, triangle.offset, 0, 0, bytes_of(&triangle)))
            return refuse_triangle(g, i);
        found->counts[triangle.format - 1][triangle.level]++;
    }
    return BVHD_OK;
}

static enum bvhd_status check_triangles(struct gathering *g)
{
    struct micromap_usages said, found = {{{0}}};
    const struct place where = place_of(g, "usageCounts");
    enum bvhd_status status = micromap_usages_read(&g->micromap->usages, g->input->flags, where, &said, g->error);
    if (status == BVHD_OK && micromap_usages_total(&said) != g->count)
        return bvhd_error_set(g->error, BVHD_INVALID, where.text,
                              "%" PRIu64 " triangles in all, but primitiveCount is %" PRIu32,
                              micromap_usages_total(&said), g->count);
    if (status == BVHD_OK)
        status = read_triangles(g, &found);
    return status == BVHD_OK ? micromap_usages_compare(&said, &found, where, g->error) : status;
}

static bool make_room(struct gathering *g, uint64_t size)
{
    enum { LEAST = 4096 };
    if (size <= g->room)
        return true;
    uint64_t room = g->room * 2 > LEAST ? g->room * 2 : LEAST;
    room = room < size ? size : room;
    unsigned char *states = memory_resize(g->context->memory, g->states, room);
    if (!states)
        return false;
    g->states = states;
    g->room = room;
    return true;
}

/* Clears the bits beyond the last state, of which there are some in triangles of less than a byte. */
static void clear_padding(const struct micromap_triangle *triangle, unsigned char *states)
{
    const uint32_t bits = micro_triangle_count(triangle->level) * triangle->format;
    if (bits < 8)
        states[0] &= (unsigned char)((1u << bits) - 1);
}

/* Returns the slot of the first triangle with the same states, or the empty one where it belongs. */
static uint32_t *find_slot(const struct gathering *g, const struct micromap_triangle *triangle,
                           const unsigned char *states, uint32_t size)
{
    const uint64_t kind = (uint64_t)triangle->format << 8 | triangle->level;
    uint64_t at = checksum((struct bytes){states, size}, kind) & (g->slot_count - 1);
    for (; g->slots[at]; at = (at + 1) & (g->slot_count - 1)) {
        const struct micromap_triangle *other = &g->triangles[g->slots[at] - 1];
        if (other->format == triangle->format && other->level == triangle->level &&
            memcmp(g->states + other->offset, states, size) == 0)
            break;
    }
    return &g->slots[at];
}

/* Reads the states of a triangle behind those that there are, and keeps them if they are new. */
static enum bvhd_status gather_triangle(struct gathering *g, uint32_t i)
{
    struct micromap_triangle *triangle = &g->triangles[i];
    const uint32_t size = bytes_of(triangle);
    if (!make_room(g, g->size + size))
        return bvhd_error_no_memory(g->error, place_of(g, "data").text, "no memory for %llu bytes of states",
                                    (unsigned long long)(g->size + size));
    unsigned char *states = g->states + g->size;
    memcpy(states, g->micromap->states.data + triangle->offset, size);
    fetch_settle();
    clear_padding(triangle, states);
    uint32_t *slot = find_slot(g, triangle, states, size);
    if (*slot) {
        triangle->offset = g->triangles[*slot - 1].offset;
        return BVHD_OK;
    }
    if (g->size + size > g->most)
        return bvhd_error_set(g->error, BVHD_TOO_LARGE, place_of(g, "data").text,
                              "the states are over the limit of %" PRIu64 " bytes", g->most);
    *slot = i + 1;
    triangle->offset = (uint32_t)g->size;
    g->size += size;
    return BVHD_OK;
}

/*
 * States may overlap, so that reading takes longer than they have bytes; it is looked at the flag after each megabyte.
 */
static enum bvhd_status gather(struct gathering *g)
{
    enum { LOOK = 1 << 20 };
    enum bvhd_status status = BVHD_OK;
    uint64_t read = LOOK;
    for (uint32_t i = 0; status == BVHD_OK && i < g->count; i++) {
        if (read >= LOOK) {
            if (context_cancelled(g->context))
                return cancelled(g);
            read = 0;
        }
        read += bytes_of(&g->triangles[i]) + sizeof *g->triangles;
        status = gather_triangle(g, i);
    }
    return status;
}

static enum bvhd_status no_memory(const struct gathering *g)
{
    return bvhd_error_no_memory(g->error, place("infos[%u]", g->index).text, "no memory for %u triangles", g->count);
}

/* Makes the block of what was gathered. */
static enum bvhd_status make_block(const struct gathering *g, uint64_t max_bytes, struct canonical *ret_canonical)
{
    const uint64_t tables = sizeof(struct form_header) + sizeof(struct form_geometry);
    uint64_t middle, end;
    struct form_geometry row = {.type = g->input->geometries[0].type,
                                .primitive_count = g->count,
                                .vertex_count = (uint32_t)g->size,
                                .indexed = g->count > 0};
    if (!form_place(&row, 1, FORM_PRIMITIVES, tables, &middle) || !form_place(&row, 1, FORM_POSITIONS, middle, &end) ||
        end > max_bytes)
        return bvhd_error_set(g->error, BVHD_TOO_LARGE, place("infos[%u]", g->index).text,
                              "the canonical copy is over the limit");
    unsigned char *block = memory_alloc(g->context->memory, end);
    ret_canonical->geometries = memory_array(g->context->memory, 1, sizeof *ret_canonical->geometries);
    if (!block || !ret_canonical->geometries) {
        memory_free(g->context->memory, block);
        memory_free(g->context->memory, ret_canonical->geometries);
        return no_memory(g);
    }
    struct form_header header = {.version = CANONICAL_VERSION_MICROMAP,
                                 .type = STRUCTURE_MICROMAP,
                                 .flags = g->input->flags,
                                 .geometry_count = 1,
                                 .primitive_count = g->count,
                                 .vertex_count = (uint32_t)g->size,
                                 .size = end};
    memcpy(header.magic, form_magic, sizeof header.magic);
    memset(block, 0, end);
    memcpy(block, &header, sizeof header);
    memcpy(block + sizeof header, &row, sizeof row);
    if (g->count > 0) {
        memcpy(block + row.index_offset, g->triangles, (uint64_t)g->count * sizeof *g->triangles);
        memcpy(block + row.data_offset, g->states, g->size);
    }
    form_view(block, ret_canonical);
    ret_canonical->owned = block;
    return BVHD_OK;
}

static bool allocate(struct gathering *g)
{
    struct memory *memory = g->context->memory;
    if (g->count == 0)
        return true;
    g->slot_count = 2;
    while (g->slot_count < 2 * (uint64_t)g->count)
        g->slot_count *= 2;
    g->triangles = memory_array(memory, g->count, sizeof *g->triangles);
    g->slots = memory_array(memory, g->slot_count, sizeof *g->slots);
    if (!g->triangles || !g->slots)
        return false;
    memset(g->slots, 0, g->slot_count * sizeof *g->slots);
    return true;
}

static enum bvhd_status prepare_micromap(const struct build_input *input, uint32_t index, const struct limits *limits,
                                         const struct build_context *context, struct canonical *ret_canonical,
                                         struct bvhd_error *error)
{
    const uint64_t most = limits->max_canonical_bytes;
    struct canonical made = {0};
    struct gathering g = {.input = input,
                          .micromap = &input->geometries[0].micromap,
                          .index = index,
                          .count = input->geometries[0].range.primitive_count,
                          .context = context,
                          .error = error,
                          .most = most < UINT32_MAX ? most : UINT32_MAX};
    enum bvhd_status status = allocate(&g) ? check_triangles(&g) : no_memory(&g);
    if (status == BVHD_OK)
        status = gather(&g);
    if (status == BVHD_OK)
        status = make_block(&g, most, &made);
    memory_free(context->memory, g.triangles);
    memory_free(context->memory, g.slots);
    memory_free(context->memory, g.states);
    if (status == BVHD_OK)
        *ret_canonical = made;
    return status;
}

/* The triangles have been taken for indices. */
static void view(const void *data, struct canonical_geometry *geometry)
{
    geometry->micro_triangles = (const struct micromap_triangle *)(const void *)geometry->indices;
    geometry->indices = NULL;
    geometry->states = data;
}

/* Memory beside the copy: the table of triangles, the hash table, and the states. */
static uint64_t beside(const struct geometry *geometry)
{
    return (uint64_t)geometry->range.primitive_count * (sizeof(struct micromap_triangle) + 4 * sizeof(uint32_t)) +
           2 * geometry->micromap.states.size;
}

/* States are new, and then begin where the last new ones ended, or those of a triangle before. */
static enum bvhd_status check_foreign(const struct canonical *canonical, uint32_t index, struct bvhd_error *error)
{
    const struct canonical_geometry *geometry = &canonical->geometries[index];
    uint64_t end = 0;
    for (uint32_t i = 0; i < geometry->primitive_count; i++) {
        const struct micromap_triangle *triangle = &geometry->micro_triangles[i];
        const struct place where = place("geometries[%u].triangles[%u]", index, i);
        if (!micromap_usage_is_valid(triangle->format, triangle->level))
            return form_corrupt(error, where.text, "its level or its format is out of range");
        const uint64_t last = (uint64_t)triangle->offset + bytes_of(triangle);
        if (triangle->offset > end || (triangle->offset < end && last > end) || last > geometry->vertex_count)
            return form_corrupt(error, where.text, "its states are not the next ones, nor those of one before");
        unsigned char states[1] = {geometry->states[triangle->offset]};
        clear_padding(triangle, states);
        if (states[0] != geometry->states[triangle->offset])
            return form_corrupt(error, where.text, "bits beyond its states are not 0");
        end = last > end ? last : end;
    }
    return end == geometry->vertex_count ? BVHD_OK
                                         : form_corrupt_row(error, index, "vertexCount", "states that are not used");
}

const struct input_kind input_micromap = {
    .version = CANONICAL_VERSION_MICROMAP,
    .corners = 1,
    .check_memory = check_memory,
    .view = view,
    .prepare = prepare_micromap,
    .beside = beside,
    .check_foreign = check_foreign,
};
