/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/scene/import_hash.h"

#include <string.h>

#include "client/bvhctl/scene/import_round.h"

static uint64_t mix(uint64_t hash, uint64_t word)
{
    hash = (hash ^ word) * 0x9e3779b97f4a7c15u;
    return hash ^ hash >> 29;
}

static uint64_t mix_bytes(uint64_t hash, const void *data, uint64_t size)
{
    const unsigned char *at = data;
    uint64_t word;
    hash = mix(hash, size);
    for (; size >= sizeof word; size -= sizeof word, at += sizeof word) {
        memcpy(&word, at, sizeof word);
        hash = mix(hash, word);
    }
    word = 0;
    if (size)
        memcpy(&word, at, size);
    return mix(hash, word);
}

static uint64_t mix_text(uint64_t hash, const char *text)
{
    return mix_bytes(hash, text, strlen(text));
}

static uint64_t mix_mesh(uint64_t hash, const struct import_mesh *mesh)
{
    hash = mix_text(mix_text(hash, mesh->name), mesh->material);
    hash = mix_bytes(hash, mesh->colour, mesh->has_colour ? sizeof mesh->colour : 0);
    hash = mix_bytes(mix(hash, mesh->shape), mesh->positions, mesh->vertex_count * UINT64_C(12));
    hash = mix_bytes(hash, mesh->radii, mesh->radii ? mesh->vertex_count * UINT64_C(4) : 0);
    return mix_bytes(hash, mesh->indices, import_corner_count(mesh) * 4);
}

uint64_t import_hash(const struct import *import)
{
    uint64_t hash = mix(mix(import->mesh_count, import->bottom_count), import->instance_count);
    for (uint32_t i = 0; i < import->mesh_count; i++)
        hash = mix_mesh(hash, &import->meshes[i]);
    for (uint32_t i = 0; i < import->bottom_count; i++) {
        const struct import_bottom *bottom = &import->bottoms[i];
        hash = mix_bytes(mix_text(hash, bottom->name), bottom->meshes, bottom->mesh_count * sizeof *bottom->meshes);
    }
    for (uint32_t i = 0; i < import->instance_count; i++) {
        const struct import_instance *instance = &import->instances[i];
        hash = mix(hash, instance->bottom * UINT64_C(2) + instance->skipped);
        hash = mix_text(hash, import_names_get(&import->node_names, instance->name));
        hash = mix_bytes(hash, instance->transform, sizeof instance->transform);
    }
    for (int i = 0; i < IMPORT_COUNT_KINDS; i++)
        hash = mix(hash, import_counts_get(&import->counts, i));
    return hash;
}
