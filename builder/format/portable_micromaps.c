/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/format/portable_micromaps.h"

void portable_micromaps_count(const struct canonical *canonical, struct portable_header *header)
{
    if (header->version < PORTABLE_MICROMAP_VERSION)
        return;
    header->micromap_count = canonical->reference_count;
    header->micromap_index_count = header->primitive_count;
}

void portable_micromaps_place(struct portable_header *header)
{
    header->micromap_offset = bytes_align(header->body_size, 16);
    header->body_size =
        header->micromap_offset + portable_micromaps_bound(header->micromap_count, header->micromap_index_count);
}

uint32_t portable_micromaps_of(const struct canonical_geometry *geometry)
{
    return !geometry->has_micromaps ? 0 : geometry->micromap > 0 ? geometry->micromap : PORTABLE_NO_MICROMAP;
}

/* Triangles whose state is final, and those without micromaps, have no index. */
static void write_indices(const struct canonical_geometry *geometry, uint32_t *ret_indices)
{
    const uint32_t *indices = geometry->micromap_indices;
    const bool resolves = geometry->resolves_micromaps;
    if (!indices) {
        memset(ret_indices, 0, (size_t)geometry->primitive_count * sizeof *ret_indices);
        return;
    }
    for (uint32_t i = 0; i < geometry->primitive_count; i++) {
        const bool is_final =
            resolves && (indices[i] == MICROMAP_FULLY_OPAQUE || indices[i] == MICROMAP_FULLY_TRANSPARENT);
        ret_indices[i] = is_final ? 0 : indices[i];
    }
}

void portable_micromaps_write(const struct canonical *canonical, const struct portable_header *header,
                              unsigned char *body)
{
    if (header->version < PORTABLE_MICROMAP_VERSION)
        return;
    unsigned char *at = body + header->micromap_offset;
    const uint64_t geometry_end =
        header->geometry_offset + (uint64_t)header->geometry_count * sizeof(struct portable_geometry);
    memset(body + geometry_end, 0, header->micromap_offset - geometry_end);
    for (uint32_t i = 0; i < header->micromap_count; i++, at += sizeof(struct portable_micromap)) {
        const struct canonical_reference *reference = &canonical->references[i];
        struct portable_micromap row = {.handle = i, .triangle_count = reference->triangle_count};
        memcpy(row.key, reference->key.bytes, sizeof row.key);
        memcpy(at, &row, sizeof row);
    }
    for (uint32_t i = 0; i < header->geometry_count; i++) {
        write_indices(&canonical->geometries[i], (uint32_t *)(void *)at);
        at += (uint64_t)canonical->geometries[i].primitive_count * sizeof(uint32_t);
    }
}

uint64_t portable_micromaps_bound(uint64_t micromaps, uint64_t primitives)
{
    return micromaps * sizeof(struct portable_micromap) + primitives * sizeof(uint32_t);
}
