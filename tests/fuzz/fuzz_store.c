/* SPDX-License-Identifier: Apache-2.0 */
/*
 * fuzz_store.c - fuzzes the readers of the header of a file in the cache on disk, and of the summary after it: each is
 * refused with a place, or its parts are those of the file, and the writer writes the same bytes.
 *
 * The input is a byte, which is odd if the file's name is what the header says, and has bit 1 if the size of the file
 * is what the header says; four bytes that say how many more bytes the file has otherwise; and the beginning of the
 * file.
 */
#include "tests/fuzz/fuzz.h"

#include <string.h>

#include "builder/store/entry_header.h"
#include "builder/summary.h"

enum { NAMED = 1, SIZED = 2, BEFORE = 5 };

/* Returns the size of the file that the header speaks of, if it is one that a file with this beginning can have. */
static uint64_t repaired_size(struct bytes head, uint64_t size)
{
    uint64_t parts;
    if (head.size < ENTRY_HEADER ||
        !bytes_add(ENTRY_HEADER + (uint64_t)bytes_get32(head.data + 12), bytes_get64(head.data + 16), &parts))
        return size;
    return parts < head.size ? size : parts;
}

static void check_entry(struct bytes head, uint64_t size, const struct key *key, const struct store_entry *entry)
{
    unsigned char header[ENTRY_HEADER];
    FUZZ_CHECK(entry->summary.size <= STORE_SUMMARY_MAX && entry->summary.data == head.data + ENTRY_HEADER);
    FUZZ_CHECK(entry->summary.size <= head.size - ENTRY_HEADER);
    FUZZ_CHECK(entry->size == size - ENTRY_HEADER - entry->summary.size);
    FUZZ_CHECK(key_equal(&entry->key, key));
    entry_header_write(entry, header);
    entry_header_seal(header, entry_header_checksum(head.data));
    FUZZ_CHECK(memcmp(header, head.data, ENTRY_HEADER) == 0);
}

static void check_summary(struct bytes bytes)
{
    unsigned char again[SUMMARY_SIZE];
    struct summary summary;
    struct bvhd_error error = {0};
    enum bvhd_status status = summary_read(bytes, &summary, &error);
    FUZZ_CHECK(status == BVHD_OK || (status == BVHD_CORRUPT && error.status == status && error.where[0]));
    if (status != BVHD_OK)
        return;
    summary_write(&summary, again);
    FUZZ_CHECK(bytes.size == SUMMARY_SIZE && memcmp(again, bytes.data, SUMMARY_SIZE) == 0);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    if (size < BEFORE)
        return 0;
    struct bytes head = {data + BEFORE, size - BEFORE};
    struct key key = {{0}};
    struct store_entry entry;
    struct bvhd_error error = {0};
    uint64_t file_size = head.size + bytes_get32(data + 1);
    if ((data[0] & NAMED) && head.size >= ENTRY_HEADER)
        memcpy(key.bytes, head.data + 24, KEY_SIZE);
    if (data[0] & SIZED)
        file_size = repaired_size(head, file_size);
    enum bvhd_status status = entry_header_read(head, file_size, &key, &entry, &error);
    FUZZ_CHECK(status == BVHD_OK || (status == BVHD_CORRUPT && error.status == status && error.where[0]));
    FUZZ_CHECK(status == BVHD_OK || error.text[0]);
    if (status == BVHD_OK) {
        check_entry(head, file_size, &key, &entry);
        check_summary(entry.summary);
    }
    return 0;
}

/*
 * Samples are whole files with summaries of several sizes, one of which can be read, without a payload and with one,
 * named and sized or not.
 */
size_t fuzz_sample(uint32_t index, uint8_t *ret_bytes)
{
    static const uint32_t sizes[] = {0, 1, SUMMARY_SIZE, STORE_SUMMARY_MAX};
    const struct summary about = {.target = TARGET_PORTABLE, .method = "ploc", .quality = QUALITY_BALANCED};
    uint32_t summary = sizes[index / 4 % 4], payload = index & 1 ? 100 : 0;
    unsigned char *file = ret_bytes + BEFORE;
    if (index >= 16)
        return 0;
    memset(ret_bytes, 0, FUZZ_ROOM);
    ret_bytes[0] = index & 2 ? NAMED | SIZED : NAMED;
    if (summary == SUMMARY_SIZE)
        summary_write(&about, file + ENTRY_HEADER);
    struct store_entry entry = {.summary = {file + ENTRY_HEADER, summary}, .size = payload};
    memset(entry.key.bytes, (int)index, KEY_SIZE);
    entry_header_write(&entry, file);
    return BEFORE + ENTRY_HEADER + summary + payload;
}
