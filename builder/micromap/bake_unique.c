/* SPDX-License-Identifier: Apache-2.0 */
/* bake_unique.c - tables of triangles by their coordinates and by their states. */
#include "builder/micromap/bake_unique.h"

#include <string.h>

#include "proto/base/place.h"

/* Places of items, by hash; 0 is empty, and item i is i + 1. */
struct table {
    uint32_t *places;
    uint32_t mask;
};

static enum bvhd_status table_init(struct table *table, uint32_t count, struct memory *memory, struct bvhd_error *error)
{
    uint64_t size = 16;
    while (size < 2 * (uint64_t)count)
        size *= 2;
    table->places = memory_array(memory, size, sizeof *table->places);
    if (!table->places)
        return bvhd_error_no_memory(error, "triangles", "no memory for a table of %u triangles", count);
    memset(table->places, 0, size * sizeof *table->places);
    table->mask = (uint32_t)(size - 1);
    return BVHD_OK;
}

static uint64_t mix(uint64_t hash, uint64_t word)
{
    hash = (hash ^ word) * UINT64_C(0x9e3779b97f4a7c15);
    return hash ^ hash >> 29;
}

uint64_t bake_unique_hash(const void *bytes, uint64_t size)
{
    const unsigned char *at = bytes;
    uint64_t hash = size;
    for (; size >= 8; size -= 8, at += 8)
        hash = mix(hash, bytes_get64(at));
    uint64_t rest = 0;
    memcpy(&rest, at, size);
    return mix(mix(hash, rest), 0);
}

/* Reads the coordinates of triangle i, and no index twice. */
static enum bvhd_status read_triangle(const struct bake_request *request, uint32_t i, float ret_coordinates[3][2],
                                      struct bvhd_error *error)
{
    for (uint32_t corner = 0; corner < 3; corner++) {
        const uint64_t at = 3 * (uint64_t)i + corner;
        const uint64_t index = request->indices ? bytes_get32(request->indices + at) : at;
        if (index >= request->coordinate_count)
            return bvhd_error_set(error, BVHD_INVALID, place("triangles[%u]", i).text,
                                  "index %llu of %u texture coordinates", (unsigned long long)index,
                                  request->coordinate_count);
        memcpy(ret_coordinates[corner], request->coordinates[index], sizeof ret_coordinates[corner]);
    }
    return BVHD_OK;
}

/* Returns the item with these coordinates, a new one if there is none. */
static uint32_t find_triangle(struct bake_uniques *uniques, const struct table *table, float coordinates[3][2])
{
    const size_t size = 3 * sizeof coordinates[0];
    uint32_t at = (uint32_t)bake_unique_hash(coordinates, size) & table->mask;
    for (unsigned probe = 0; table->places[at] != 0; probe++, at = (at + 1) & table->mask) {
        const uint32_t item = table->places[at] - 1;
        if (memcmp(uniques->items[item].coordinates, coordinates, size) == 0)
            return item;
        if (probe >= SHARE_PROBES_MAX)
            break;
    }
    const uint32_t item = uniques->count++;
    if (table->places[at] == 0)
        table->places[at] = item + 1;
    uniques->items[item] = (struct bake_unique){0};
    memcpy(uniques->items[item].coordinates, coordinates, size);
    return item;
}

static enum bvhd_status gather(const struct bake_request *request, const struct build_context *context,
                               struct bake_uniques *uniques, const struct table *table, struct bvhd_error *error)
{
    for (uint32_t i = 0; i < request->triangle_count; i++) {
        float coordinates[3][2], weight = request->weights ? request->weights[i] : 1;
        if (parallel_cancelled_at(context->cancel, i))
            return bvhd_error_set(error, BVHD_CANCELLED, "triangles", "cancelled");
        const enum bvhd_status status = read_triangle(request, i, coordinates, error);
        if (status != BVHD_OK)
            return status;
        if (!(weight >= 0 && weight < 1e30f))
            return bvhd_error_set(error, BVHD_INVALID, place("weights[%u]", i).text, "a weight is at least 0");
        uniques->of[i] = find_triangle(uniques, table, coordinates);
        uniques->items[uniques->of[i]].uses++;
        uniques->items[uniques->of[i]].weight += (double)weight;
    }
    return BVHD_OK;
}

enum bvhd_status bake_unique_gather(const struct bake_request *request, const struct build_context *context,
                                    struct bake_uniques *ret_uniques, struct bvhd_error *error)
{
    const uint32_t count = request->triangle_count;
    struct table table = {0};
    enum bvhd_status status = table_init(&table, count, context->memory, error);
    if (status != BVHD_OK)
        return status;
    struct bake_uniques uniques = {0};
    uniques.items = memory_array(context->memory, count, sizeof *uniques.items);
    uniques.of = memory_array(context->memory, count, sizeof *uniques.of);
    if (count > 0 && (!uniques.items || !uniques.of))
        status = bvhd_error_no_memory(error, "triangles", "no memory for %u triangles", count);
    else
        status = gather(request, context, &uniques, &table, error);
    memory_free(context->memory, table.places);
    if (status != BVHD_OK) {
        bake_unique_finish(&uniques, context->memory);
        return status;
    }
    *ret_uniques = uniques;
    return BVHD_OK;
}

/* Returns the earlier item with the same states as item i, whose states are at `states`; i itself if there is none. */
static uint32_t find_states(const struct bake_uniques *uniques, const struct table *table, uint32_t i,
                            const unsigned char *data, const unsigned char *states, uint32_t size)
{
    const struct bake_unique *own = &uniques->items[i];
    uint32_t at = (uint32_t)(own->hash >> 16) & table->mask;
    for (unsigned probe = 0; table->places[at] != 0; probe++, at = (at + 1) & table->mask) {
        const struct bake_unique *other = &uniques->items[table->places[at] - 1];
        if (other->hash == own->hash && other->level == own->level && memcmp(data + other->offset, states, size) == 0)
            return table->places[at] - 1;
        if (probe >= SHARE_PROBES_MAX)
            return i;
    }
    table->places[at] = i + 1;
    return i;
}

enum bvhd_status bake_unique_share(struct bake_uniques *uniques, enum micro_format format, unsigned char *data,
                                   const struct build_context *context, uint64_t *ret_size, uint32_t *ret_count,
                                   struct bvhd_error *error)
{
    struct table table = {0};
    enum bvhd_status status = table_init(&table, uniques->count, context->memory, error);
    if (status != BVHD_OK)
        return status;
    uint64_t filled = 0;
    uint32_t count = 0;
    for (uint32_t i = 0; i < uniques->count && status == BVHD_OK; i++) {
        struct bake_unique *item = &uniques->items[i];
        if (parallel_cancelled_at(context->cancel, i))
            status = bvhd_error_set(error, BVHD_CANCELLED, "triangles", "cancelled");
        if (item->index < 0)
            continue;
        const uint32_t size = micro_triangle_bytes(format, item->level);
        const uint32_t same = find_states(uniques, &table, i, data, data + item->offset, size);
        if (same == i) {
            memmove(data + filled, data + item->offset, size);
            item->offset = filled;
            item->index = (int32_t)count++;
            filled += size;
        } else {
            item->offset = uniques->items[same].offset;
            item->index = uniques->items[same].index;
        }
    }
    memory_free(context->memory, table.places);
    if (status != BVHD_OK)
        return status;
    *ret_size = filled;
    *ret_count = count;
    return BVHD_OK;
}

void bake_unique_finish(struct bake_uniques *uniques, struct memory *memory)
{
    memory_free(memory, uniques->items);
    memory_free(memory, uniques->of);
    *uniques = (struct bake_uniques){0};
}
