/* SPDX-License-Identifier: Apache-2.0 */
/*
 * frame.h - bytes in, frames out: what travels on the socket, without any I/O. PROTOCOL.md has the table of the
 * header's bytes.
 *
 * A frame is a header of FRAME_HEADER_SIZE bytes, a control message (control.h), inline bytes, and the descriptors that
 * it declares. Who sends a frame with descriptors starts a sendmsg with its first byte. The read that brings them then
 * brings a byte of their frame, after whatever came before it: a read ends after the bytes that carried descriptors.
 * They are queued in the order of arrival; a frame that is complete claims as many as it declares. That they are too
 * few shows then, and so does one too many: its read ended within this frame or before it. Once a frame is wrong
 * nothing after it can be trusted: the connection has to end.
 */
#ifndef BVHD_FRAME_H
#define BVHD_FRAME_H

#include "proto/base/bytes.h"
#include "proto/base/memory.h"
#include "proto/base/status.h"

enum {
    FRAME_HEADER_SIZE = 32,
    FRAME_MAX_DESCRIPTORS = 4, /* that one frame may declare */
    FRAME_QUEUE = 32, /* descriptors that may wait for their frames */
    FRAME_MAX_CONTROL = 1024 * 1024,
    FRAME_MAX_INLINE = 64 * 1024,
};

/* Numbers are wire ABI. From 64 on they go from the daemon to the client. */
enum frame_type {
    FRAME_HELLO = 1, /* the first frame of a client; its layout never changes */
    FRAME_POOL = 2, /* one descriptor: the memory that payloads may lie in */
    FRAME_BUILD = 3,
    FRAME_GET = 4, /* results by key */
    FRAME_CANCEL = 5, /* of the request with the same number */
    FRAME_STATS = 6,
    FRAME_PING = 7,
    FRAME_WELCOME = 64, /* answers HELLO; its layout never changes */
    FRAME_DONE = 65, /* answers POOL */
    FRAME_ERROR = 66, /* answers a request as a whole; number 0: the connection, which then ends */
    FRAME_BUSY = 67, /* the request was not taken: send it again later */
    FRAME_PREPARED = 68, /* payloads of these items are not needed any more */
    FRAME_RESULT = 69, /* of one item of BUILD or GET */
    FRAME_COUNTERS = 70, /* answers STATS */
    FRAME_PONG = 71, /* answers PING */
    FRAME_GOODBYE = 72, /* the daemon takes no new requests; what it has it finishes */
};

struct frame_header {
    uint16_t type;
    uint8_t descriptors;
    uint32_t control_size;
    uint32_t inline_size;
    uint64_t request; /* chosen by the client, not 0, not in use; 0: about the connection */
};

/* Writes the header. */
void frame_header_write(const struct frame_header *header, unsigned char ret_bytes[FRAME_HEADER_SIZE]);

/*
 * A complete frame. Its bytes lie in the parser and live until the next call; its descriptors are the receiver's to
 * close.
 */
struct frame {
    struct frame_header header;
    struct bytes control;
    struct bytes inline_bytes;
    int descriptors[FRAME_MAX_DESCRIPTORS]; /* header.descriptors of them */
};

struct frame_parser {
    struct memory *memory;
    uint32_t max_control, max_inline;
    unsigned char *buffer;
    uint64_t capacity, begin, end; /* bytes [begin, end) of the buffer are not parsed yet */
    uint64_t fed; /* bytes of the stream so far */
    int descriptors[FRAME_QUEUE];
    uint64_t arrived[FRAME_QUEUE]; /* with each: where in the stream its read ended */
    uint32_t descriptor_count;
    enum bvhd_status broken; /* what the first wrong frame said; nothing is parsed afterwards */
};

/*
 * Allocates from `memory`, which must outlive the parser. The limits are at most FRAME_MAX_CONTROL and
 * FRAME_MAX_INLINE.
 */
void frame_parser_init(struct frame_parser *parser, struct memory *memory, uint32_t max_control, uint32_t max_inline);

/* Frees the buffer, closes the descriptors that nobody has claimed. NULL-safe. */
void frame_parser_finish(struct frame_parser *parser);

/*
 * Where the next bytes from the socket go: at least one byte, as many as the frame that is under way wants, and some
 * more when none is. Grows the buffer only as far as the bytes of a header that passed its checks ask for, and lets a
 * large one go when nothing is left in it. To be called when frame_parser_next has found no more. BVHD_NO_MEMORY leaves
 * everything as it was; after a wrong frame it says what that said.
 */
enum bvhd_status frame_parser_space(struct frame_parser *parser, unsigned char **ret_at, uint64_t *ret_size,
                                    struct bvhd_error *error);

/*
 * `size` bytes were written there, and `count` descriptors came with them; the parser owns those, also when it fails:
 * BVHD_TOO_LARGE with more than FRAME_QUEUE waiting.
 */
enum bvhd_status frame_parser_feed(struct frame_parser *parser, uint64_t size, const int *descriptors, uint32_t count,
                                   struct bvhd_error *error);

/*
 * The next complete frame: *ret_found says whether there is one. BVHD_CORRUPT (magic, reserved fields, a descriptor
 * that no frame claims, a frame whose descriptors have not come) and BVHD_TOO_LARGE are final. `error` names the field:
 * "frame.magic".
 */
enum bvhd_status frame_parser_next(struct frame_parser *parser, struct frame *ret_frame, bool *ret_found,
                                   struct bvhd_error *error);

#endif
