/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/store/entry_header.h"

#include <stdio.h>
#ifdef BVHD_XXHASH_DISPATCH
/* With it, long pieces take a third of the time: the library uses AVX2 or AVX-512 where the processor has them. */
#include <xxh_x86dispatch.h>
#else
#include <xxhash.h>
#endif

enum { AT_FORMAT = 8, AT_SUMMARY = 12, AT_PAYLOAD = 16, AT_KEY = 24, AT_CHECKSUM = 56 };

static const unsigned char magic[8] = {0x89, 'b', 'v', 'h', 'd', '\r', '\n', 0x1a};

bool entry_hash_begin(struct entry_hash *hash, const unsigned char header[ENTRY_HEADER])
{
    hash->state = XXH3_createState();
    if (!hash->state)
        return false;
    XXH3_128bits_reset(hash->state);
    entry_hash_add(hash, (struct bytes){header, AT_CHECKSUM});
    return true;
}

void entry_hash_add(struct entry_hash *hash, struct bytes piece)
{
    XXH3_128bits_update(hash->state, piece.data, piece.size);
}

struct entry_checksum entry_hash_get(const struct entry_hash *hash)
{
    XXH128_hash_t sum = XXH3_128bits_digest(hash->state);
    return (struct entry_checksum){sum.low64, sum.high64};
}

void entry_hash_finish(struct entry_hash *hash)
{
    XXH3_freeState(hash->state);
    hash->state = NULL;
}

void entry_header_write(const struct store_entry *entry, unsigned char ret_header[ENTRY_HEADER])
{
    memcpy(ret_header, magic, sizeof magic);
    bytes_put32(ret_header + AT_FORMAT, ENTRY_FORMAT);
    bytes_put32(ret_header + AT_SUMMARY, (uint32_t)entry->summary.size);
    bytes_put64(ret_header + AT_PAYLOAD, entry->size);
    memcpy(ret_header + AT_KEY, entry->key.bytes, KEY_SIZE);
}

void entry_header_seal(unsigned char header[ENTRY_HEADER], struct entry_checksum checksum)
{
    bytes_put64(header + AT_CHECKSUM, checksum.low);
    bytes_put64(header + AT_CHECKSUM + 8, checksum.high);
}

struct entry_checksum entry_header_checksum(const unsigned char header[ENTRY_HEADER])
{
    return (struct entry_checksum){bytes_get64(header + AT_CHECKSUM), bytes_get64(header + AT_CHECKSUM + 8)};
}

static enum bvhd_status damaged(struct bvhd_error *error, int at, const char *text)
{
    char where[32];
    snprintf(where, sizeof where, "byte %d", at);
    return bvhd_error_set(error, BVHD_CORRUPT, where, "%s", text);
}

enum bvhd_status entry_header_read(struct bytes head, uint64_t file_size, const struct key *key,
                                   struct store_entry *ret_entry, struct bvhd_error *error)
{
    if (head.size < ENTRY_HEADER)
        return damaged(error, (int)head.size, "the file ends within its header");
    if (memcmp(head.data, magic, sizeof magic) != 0)
        return damaged(error, 0, "the file does not begin as an entry does");
    if (bytes_get32(head.data + AT_FORMAT) != ENTRY_FORMAT)
        return damaged(error, AT_FORMAT, "the format is not known");
    uint64_t summary = bytes_get32(head.data + AT_SUMMARY), payload = bytes_get64(head.data + AT_PAYLOAD);
    if (summary > STORE_SUMMARY_MAX || ENTRY_HEADER + summary > head.size)
        return damaged(error, AT_SUMMARY, "the summary is larger than the file or than a summary may be");
    if (payload != file_size - ENTRY_HEADER - summary)
        return damaged(error, AT_PAYLOAD, "the size of the file is not that of its parts");
    if (memcmp(head.data + AT_KEY, key->bytes, KEY_SIZE) != 0)
        return damaged(error, AT_KEY, "the key is not that of the file's name");
    *ret_entry = (struct store_entry){*key, {head.data + ENTRY_HEADER, summary}, payload};
    return BVHD_OK;
}
