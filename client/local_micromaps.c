/* SPDX-License-Identifier: Apache-2.0 */
#include "client/local_micromaps.h"

#include "builder/format/portable_micromap.h"
#include "client/library.h"
#include "client/local_sources.h"
#include "proto/base/place.h"

struct local_micromap {
    struct key key;
    struct bvhd_blob *blob; /* a reference; NULL: it is not here */
};

struct local_micromaps {
    uint32_t count;
    struct local_micromap rows[];
};

static uint32_t count_named(const struct build_input *input)
{
    uint32_t count = 0;
    for (uint32_t i = 0; i < input->reference_count; i++)
        count += input->references[i].kind == REFERENCE_MICROMAP;
    return count;
}

bool local_micromaps_find(const struct build_input *input, struct local_micromaps **ret_micromaps)
{
    const uint32_t count = count_named(input);
    struct local_micromaps *micromaps = NULL;
    *ret_micromaps = NULL;
    if (count == 0)
        return true;
    uint64_t size;
    if (bytes_mul(count, sizeof micromaps->rows[0], &size) && bytes_add(size, sizeof *micromaps, &size))
        micromaps = memory_alloc(&library_memory, size);
    if (!micromaps)
        return false;
    micromaps->count = 0;
    for (uint32_t i = 0; i < input->reference_count; i++) {
        const struct reference *reference = &input->references[i];
        if (reference->kind == REFERENCE_MICROMAP)
            micromaps->rows[micromaps->count++] =
                (struct local_micromap){reference->key, local_sources_find(&reference->key)};
    }
    *ret_micromaps = micromaps;
    return true;
}

/* Returns the blob of a key; NULL: it is not here. References are few, or in the order of the rows. */
static struct bvhd_blob *blob_of(const struct local_micromaps *micromaps, uint32_t *at, const struct key *key)
{
    for (uint32_t tried = 0; micromaps && tried < micromaps->count; tried++) {
        const struct local_micromap *row = &micromaps->rows[*at];
        *at = (*at + 1) % micromaps->count;
        if (key_equal(&row->key, key))
            return row->blob;
    }
    return NULL;
}

static bool is_micromap(struct bytes blob)
{
    return bytes_reach(blob.size, PORTABLE_MICROMAP_BODY, 0, 0, sizeof(struct portable_micromap_header)) &&
           bytes_get32(blob.data + PORTABLE_MICROMAP_BODY) == PORTABLE_MICROMAP_MAGIC;
}

enum bvhd_status local_micromaps_give(const struct local_micromaps *micromaps, struct reference *references,
                                      uint32_t count, uint32_t index, struct bvhd_error *error)
{
    uint32_t at = 0;
    for (uint32_t i = 0; i < count; i++) {
        struct bvhd_blob *blob = NULL;
        if (references[i].kind == REFERENCE_MICROMAP && references[i].has_key)
            blob = blob_of(micromaps, &at, &references[i].key);
        references[i].blob = (struct bytes){bvhd_blob_data(blob), bvhd_blob_size(blob)};
        if (blob && !is_micromap(references[i].blob))
            return bvhd_error_set(error, BVHD_INVALID, place("infos[%u].references[%u]", index, i).text,
                                  "the key is that of a structure which is no opacity micromap");
    }
    return BVHD_OK;
}

void local_micromaps_destroy(struct local_micromaps *micromaps)
{
    for (uint32_t i = 0; micromaps && i < micromaps->count; i++)
        bvhd_blob_unref(micromaps->rows[i].blob);
    memory_free(&library_memory, micromaps);
}
