/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/scene/weld.h"

#include <string.h>

#include "client/bvhctl/scene/import_round.h"

/* A hash table of vertices, with open addressing. It grows with the vertices that stay, so that it fits into caches. */
struct table {
    struct memory *memory;
    const float *positions;
    uint32_t *slots; /* vertex + 1; 0: free */
    uint64_t size;
};

static uint64_t hash_position(const float *position)
{
    uint32_t bits[3];
    memcpy(bits, position, sizeof bits);
    uint64_t hash = (bits[0] | (uint64_t)bits[1] << 32) * UINT64_C(0x9e3779b97f4a7c15);
    hash = (hash ^ hash >> 32 ^ bits[2]) * UINT64_C(0xd6e8feb86659fd93);
    return hash ^ hash >> 32;
}

/* Finds the slot of the vertex at this place, or the free one where it belongs. */
static uint32_t *find_slot(const struct table *table, const float *position)
{
    uint64_t slot = hash_position(position) & (table->size - 1);
    while (table->slots[slot] &&
           memcmp(table->positions + 3 * (size_t)(table->slots[slot] - 1), position, 3 * sizeof *position) != 0)
        slot = (slot + 1) & (table->size - 1);
    return &table->slots[slot];
}

/* Makes a larger table of the first `count` vertices, which are distinct. */
static bool grow(struct table *table, uint32_t count)
{
    uint64_t size = table->size ? table->size * 4 : 1024;
    uint32_t *slots = memory_array(table->memory, size, sizeof *slots);
    if (!slots)
        return false;
    memset(slots, 0, size * sizeof *slots);
    memory_free(table->memory, table->slots);
    table->slots = slots;
    table->size = size;
    for (uint32_t i = 0; i < count; i++)
        *find_slot(table, table->positions + 3 * (size_t)i) = i + 1;
    return true;
}

/*
 * Moves the vertices that stay to the front. ret_welded has the new number of each. Returns false when there is no
 * memory; vertices in front of *ret_kept were moved then.
 */
static bool weld_vertices(struct table *table, struct import_mesh *mesh, uint32_t *ret_welded, uint32_t *ret_kept)
{
    uint32_t kept = 0;
    for (uint32_t i = 0; i < mesh->vertex_count; i++) {
        const float *position = mesh->positions + 3 * (size_t)i;
        if (2 * (uint64_t)kept >= table->size && !grow(table, kept))
            return false;
        uint32_t *slot = find_slot(table, position);
        ret_welded[i] = *slot ? *slot - 1 : kept;
        if (*slot)
            continue;
        memmove(mesh->positions + 3 * (size_t)kept, position, 3 * sizeof *position);
        *slot = ++kept;
    }
    *ret_kept = kept;
    return true;
}

bool weld_mesh(struct import_mesh *mesh, struct memory *memory)
{
    uint32_t kept = 0, *welded = memory_array(memory, (uint64_t)mesh->vertex_count + 1, sizeof *welded);
    struct table table = {.memory = memory, .positions = mesh->positions};
    bool ok = welded && weld_vertices(&table, mesh, welded, &kept);
    if (ok && kept < mesh->vertex_count) {
        for (uint64_t i = 0; i < import_corner_count(mesh); i++)
            mesh->indices[i] = welded[mesh->indices[i]];
        mesh->vertex_count = kept;
    }
    memory_free(memory, table.slots);
    memory_free(memory, welded);
    return ok;
}

bool weld_import(struct import *import)
{
    for (uint32_t i = 0; i < import->mesh_count; i++)
        if (import->meshes[i].shape == IMPORT_TRIANGLES && !weld_mesh(&import->meshes[i], import->memory))
            return false;
    return true;
}
