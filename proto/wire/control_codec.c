/* SPDX-License-Identifier: Apache-2.0 */
#include "proto/wire/control_codec.h"

#include <inttypes.h>

/*
 * The block in which protobuf allocates while it unpacks one message. It is filled from its beginning to its end and
 * freed as a whole. Memory that protobuf frees in between is not used again, so that no message can make it take more
 * than the block.
 */
struct scratch {
    unsigned char *block;
    uint64_t size, used;
    bool exhausted;
};

enum { SCRATCH_ALIGNMENT = 8 };

static void *scratch_alloc(void *data, size_t size)
{
    struct scratch *scratch = data;
    uint64_t end;
    if (!bytes_add(scratch->used, size, &end) || end > scratch->size) {
        scratch->exhausted = true;
        return NULL;
    }
    void *block = scratch->block + scratch->used;
    uint64_t aligned = bytes_align(end, SCRATCH_ALIGNMENT);
    scratch->used = aligned < scratch->size ? aligned : scratch->size;
    return block;
}

static void scratch_free(void *data, void *block)
{
    (void)data;
    (void)block;
}

/* Computes half of what unpacking `size` bytes may allocate; false if that overflows. */
static bool heap_share(uint64_t size, uint64_t *ret_share)
{
    uint64_t share;
    if (!bytes_mul(size, CONTROL_HEAP_RATIO / 2, &share) || !bytes_add(share, CONTROL_HEAP_FIXED / 2, &share))
        return false;
    *ret_share = share;
    return true;
}

static enum bvhd_status too_large(const struct control_kind *kind, struct bvhd_error *error)
{
    return bvhd_error_set(error, BVHD_TOO_LARGE, kind->name, "unpacks to far more than its bytes");
}

/* Makes the plain struct of a message that has been unpacked. */
static enum bvhd_status make_plain(const struct control_kind *kind, const ProtobufCMessage *message, uint64_t share,
                                   struct memory *memory, void **ret_plain, struct bvhd_error *error)
{
    uint64_t extra = 0, size;
    enum bvhd_status status = kind->check ? kind->check(message, &extra, error) : BVHD_OK;
    if (status != BVHD_OK)
        return status;
    if (!bytes_add(kind->size, extra, &size) || size > share)
        return too_large(kind, error);
    void *plain = memory_alloc(memory, size);
    if (!plain)
        return bvhd_error_no_memory(error, kind->name, "%" PRIu64 " bytes", size);
    memset(plain, 0, kind->size);
    kind->fill(message, plain);
    *ret_plain = plain;
    return BVHD_OK;
}

enum bvhd_status control_decode(const struct control_kind *kind, struct bytes bytes, struct memory *memory,
                                void **ret_plain, struct bvhd_error *error)
{
    uint64_t share;
    if (!heap_share(bytes.size, &share))
        return too_large(kind, error);
    struct scratch scratch = {.block = memory_alloc(memory, share), .size = share};
    if (!scratch.block)
        return bvhd_error_no_memory(error, kind->name, "%" PRIu64 " bytes", share);
    ProtobufCAllocator allocator = {scratch_alloc, scratch_free, &scratch};
    const uint8_t *data = bytes.size ? bytes.data : (const uint8_t *)"";
    ProtobufCMessage *message = protobuf_c_message_unpack(kind->descriptor, &allocator, bytes.size, data);
    enum bvhd_status status;
    if (message)
        status = make_plain(kind, message, share, memory, ret_plain, error);
    else if (scratch.exhausted)
        status = too_large(kind, error);
    else
        status = bvhd_error_set(error, BVHD_CORRUPT, kind->name, "not a message of this kind");
    memory_free(memory, scratch.block);
    return status;
}

enum bvhd_status control_encode(const ProtobufCMessage *message, struct memory *memory, struct bytes *ret_bytes,
                                struct bvhd_error *error)
{
    size_t size = protobuf_c_message_get_packed_size(message);
    if (size == 0) {
        *ret_bytes = (struct bytes){NULL, 0};
        return BVHD_OK;
    }
    unsigned char *block = memory_alloc(memory, size);
    if (!block)
        return bvhd_error_no_memory(error, "control", "%zu bytes", size);
    protobuf_c_message_pack(message, block);
    *ret_bytes = (struct bytes){block, size};
    return BVHD_OK;
}

/* Returns where to cut, which is never in the middle of a UTF-8 character. */
static size_t cut_length(const char *text, size_t limit)
{
    size_t length = strnlen(text, limit + 1);
    if (length <= limit)
        return length;
    for (length = limit; length > 0 && ((unsigned char)text[length] & 0xc0) == 0x80; length--)
        ;
    return length;
}

void control_copy_text(const char *from, size_t size, char *ret_text)
{
    size_t length = cut_length(from, size - 1);
    for (size_t i = 0; i < length; i++)
        ret_text[i] = (unsigned char)from[i] < 0x20 || from[i] == 0x7f ? ' ' : from[i];
    ret_text[length] = '\0';
}
