/* SPDX-License-Identifier: Apache-2.0 */
/*
 * entry_header.h - the beginning of a file of the store. All numbers are little-endian:
 *
 *      0   8  magic: 89 'b' 'v' 'h' 'd' 0d 0a 1a
 *      8   4  format: ENTRY_FORMAT
 *     12   4  bytes of the summary
 *     16   8  bytes of the payload
 *     24  32  key
 *     56  16  checksum: XXH3-128 of all other bytes of the file, in order; its low half first
 *     72      summary, then the payload; the file ends with it
 *
 * The checksum protects against damage and not against forgery; the directory's owner and mode do that.
 */
#ifndef BVHD_ENTRY_HEADER_H
#define BVHD_ENTRY_HEADER_H

#include "builder/store/store.h"

enum { ENTRY_FORMAT = 1, ENTRY_HEADER = 72, ENTRY_HEAD_MAX = ENTRY_HEADER + STORE_SUMMARY_MAX };

struct entry_checksum {
    uint64_t low, high;
};

/* A checksum under way, on the heap of libxxhash. `state` is NULL when there was no memory. */
struct entry_hash {
    void *state;
};

/*
 * Begin a sum with the bytes of a header that it covers, add further bytes, and return the sum. entry_hash_begin
 * returns false without memory; end with entry_hash_finish in any case.
 */
bool entry_hash_begin(struct entry_hash *hash, const unsigned char header[ENTRY_HEADER]);
void entry_hash_add(struct entry_hash *hash, struct bytes piece);
struct entry_checksum entry_hash_get(const struct entry_hash *hash);
void entry_hash_finish(struct entry_hash *hash);

/* Writes everything but the checksum, which entry_header_seal writes. */
void entry_header_write(const struct store_entry *entry, unsigned char ret_header[ENTRY_HEADER]);
void entry_header_seal(unsigned char header[ENTRY_HEADER], struct entry_checksum checksum);
struct entry_checksum entry_header_checksum(const unsigned char header[ENTRY_HEADER]);

/*
 * Reads the beginning of a file of `file_size` bytes: its first ENTRY_HEAD_MAX bytes or more, or all of it. The summary
 * points into `head`. BVHD_CORRUPT, with the offset and the rule, unless header, name and size of the file agree; `key`
 * is what the file's name says. The checksum is not looked at.
 */
enum bvhd_status entry_header_read(struct bytes head, uint64_t file_size, const struct key *key,
                                   struct store_entry *ret_entry, struct bvhd_error *error);

#endif
