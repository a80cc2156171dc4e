/* SPDX-License-Identifier: Apache-2.0 */
/*
 * control_codec.h - what all control messages share: the conversion between protobuf's messages and plain structs. Only
 * control*.c includes it.
 */
#ifndef BVHD_CONTROL_CODEC_H
#define BVHD_CONTROL_CODEC_H

#include <protobuf-c/protobuf-c.h>

#include "proto/wire/control.h"

/* How one kind of message is converted to a plain struct. */
struct control_kind {
    const char *name; /* for errors: "hello" */
    const ProtobufCMessageDescriptor *descriptor;
    uint64_t size; /* of the plain struct */
    /*
     * Checks the message's values, and sets *ret_extra to the number of bytes that the struct needs after itself. NULL:
     * all values fit, and no extra bytes are needed.
     */
    enum bvhd_status (*check)(const void *message, uint64_t *ret_extra, struct bvhd_error *error);
    void (*fill)(const void *message, void *ret_plain); /* the plain struct is zeroed before, its extra bytes are not */
};

/* Unpacks bytes into a new plain struct of this kind. */
enum bvhd_status control_decode(const struct control_kind *kind, struct bytes bytes, struct memory *memory,
                                void **ret_plain, struct bvhd_error *error);

/* Packs a filled message into bytes, which the caller frees (see control_pack_...). */
enum bvhd_status control_encode(const ProtobufCMessage *message, struct memory *memory, struct bytes *ret_bytes,
                                struct bvhd_error *error);

/* Copies a text into `size` bytes, the final NUL included: cuts it to fit, and turns control characters into spaces. */
void control_copy_text(const char *from, size_t size, char *ret_text);

/* Casts const away, because protobuf's structs have none; nothing is written through the pointer. */
static inline void *control_constant(const void *pointer)
{
    return (void *)(uintptr_t)pointer;
}

static inline uint64_t control_double_bits(double value)
{
    uint64_t bits;
    memcpy(&bits, &value, sizeof bits);
    return bits;
}

static inline double control_bits_double(uint64_t bits)
{
    double value;
    memcpy(&value, &bits, sizeof value);
    return value;
}

/* Defines control_unpack_NAME, which uses `NAME_kind`. */
#define CONTROL_UNPACK(name, type)                                                                                     \
    enum bvhd_status control_unpack_##name(struct bytes bytes, struct memory *memory, type **ret_message,              \
                                           struct bvhd_error *error)                                                   \
    {                                                                                                                  \
        void *plain;                                                                                                   \
        enum bvhd_status status = control_decode(&name##_kind, bytes, memory, &plain, error);                          \
        if (status == BVHD_OK)                                                                                         \
            *ret_message = plain;                                                                                      \
        return status;                                                                                                 \
    }

#endif
