/* SPDX-License-Identifier: Apache-2.0 */
/*
 * control_codec.h - between protobuf's messages and plain structs: what all control messages share. For control*.c
 * alone.
 */
#ifndef BVHD_CONTROL_CODEC_H
#define BVHD_CONTROL_CODEC_H

#include <protobuf-c/protobuf-c.h>

#include "proto/wire/control.h"

/* How one kind of message becomes a plain struct. */
struct control_kind {
    const char *name; /* for errors: "hello" */
    const ProtobufCMessageDescriptor *descriptor;
    uint64_t size; /* of the plain struct */
    /*
     * What of the message's values does not fit; NULL: everything does. *ret_extra: bytes that the struct needs after
     * itself.
     */
    enum bvhd_status (*check)(const void *message, uint64_t *ret_extra, struct bvhd_error *error);
    void (*fill)(const void *message, void *ret_plain); /* the plain struct is zeroed, its extra bytes are not */
};

enum bvhd_status control_decode(const struct control_kind *kind, struct bytes bytes, struct memory *memory,
                                void **ret_plain, struct bvhd_error *error);

/* As control_pack_...: the bytes of a filled message. */
enum bvhd_status control_encode(const ProtobufCMessage *message, struct memory *memory, struct bytes *ret_bytes,
                                struct bvhd_error *error);

/* `size` bytes for a text, its NUL among them. */
void control_copy_text(const char *from, size_t size, char *ret_text);

/* protobuf's structs have no const; nothing is written through the pointer. */
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

/* Defines control_unpack_NAME by `NAME_kind`. */
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
