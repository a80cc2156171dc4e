/* SPDX-License-Identifier: Apache-2.0 */
/*
 * frame.h - turns the bytes of a socket into frames, without any I/O. PROTOCOL.md has the table of the header's bytes.
 *
 * A frame is a header of FRAME_HEADER_SIZE bytes, a control message (control.h), inline bytes, and the descriptors that
 * it declares. A sender passes the descriptors of a frame with a sendmsg that starts at the frame's first byte. The
 * kernel ends a read after the bytes that carried descriptors, so the read that delivers descriptors also delivers at
 * least the first byte of their frame, possibly after bytes of earlier frames.
 *
 * The parser queues descriptors in the order of arrival, and a complete frame claims as many as it declares. The frame
 * is wrong if fewer have come. It is also wrong if one is left whose read ended within this frame or before it, because
 * that descriptor cannot belong to a later frame. So an unfinished frame cannot hold more than it declares. After a
 * wrong frame no byte can be trusted, so the connection has to end.
 */
#ifndef BVHD_FRAME_H
#define BVHD_FRAME_H

#include "proto/base/bytes.h"
#include "proto/base/memory.h"
#include "proto/base/status.h"

enum {
    FRAME_HEADER_SIZE = 32,
    FRAME_MAX_DESCRIPTORS = 4, /* per frame */
    FRAME_QUEUE = 32, /* descriptors that may wait for their frames */
    FRAME_MAX_CONTROL = 1024 * 1024,
    FRAME_MAX_INLINE = 64 * 1024,
    FRAME_KEEP = 32 * 1024, /* the largest buffer that a parser keeps while no frame is under way */
};

/* The types of frames. The numbers are wire ABI. Types from 64 on go from the daemon to the client. */
enum frame_type {
    FRAME_HELLO = 1, /* a client's first frame; its layout never changes */
    FRAME_POOL = 2, /* one descriptor: the pool, in which payloads may lie */
    FRAME_BUILD = 3, /* requests structures */
    FRAME_GET = 4, /* requests results by key */
    FRAME_CANCEL = 5, /* cancels items of the request with the same number */
    FRAME_STATS = 6, /* requests the daemon's counters */
    FRAME_PING = 7, /* requests a sign of life */
    FRAME_RELEASED = 8, /* the client does not hold some results any more */
    FRAME_CACHE = 9, /* shows, trims or clears the caches */
    FRAME_CLIENTS = 10, /* requests the list of the daemon's clients */
    FRAME_WELCOME = 64, /* answers HELLO; its layout never changes */
    FRAME_DONE = 65, /* answers POOL */
    FRAME_ERROR = 66, /* answers a request as a whole; number 0: ends the connection */
    FRAME_BUSY = 67, /* refuses a request for now: send it again later */
    FRAME_PREPARED = 68, /* the payloads of these items are not needed any more */
    FRAME_RESULT = 69, /* the result of one item of BUILD or GET */
    FRAME_COUNTERS = 70, /* answers STATS */
    FRAME_PONG = 71, /* answers PING */
    FRAME_GOODBYE = 72, /* the daemon takes no new requests and finishes those that it has */
    FRAME_PROGRESS = 73, /* how far builds of items are, for clients that have asked for it in HELLO */
    FRAME_CACHE_STATE = 74, /* answers CACHE */
    FRAME_CLIENT_LIST = 75, /* answers CLIENTS */
};

/* The fields of a frame's header. */
struct frame_header {
    uint16_t type;
    uint8_t descriptors;
    uint32_t control_size;
    uint32_t inline_size;
    uint64_t request; /* chosen by the client, not 0 and not in use; 0: the frame is about the connection */
};

/* Writes the header's bytes. */
void frame_header_write(const struct frame_header *header, unsigned char ret_bytes[FRAME_HEADER_SIZE]);

/*
 * A complete frame. Its bytes belong to the parser and live until the next call on it; its descriptors belong to the
 * receiver, who closes them.
 */
struct frame {
    struct frame_header header;
    struct bytes control;
    struct bytes inline_bytes;
    int descriptors[FRAME_MAX_DESCRIPTORS]; /* the first header.descriptors entries are valid */
};

/* The state of receiving frames from one socket. */
struct frame_parser {
    struct memory *memory;
    uint32_t max_control, max_inline;
    uint64_t ahead; /* the size of a buffer that has to grow, at least; 0: as the frame needs */
    unsigned char *buffer;
    uint64_t capacity, begin, end; /* bytes [begin, end) of the buffer are not parsed yet */
    uint64_t fed; /* bytes of the stream that have arrived so far */
    int descriptors[FRAME_QUEUE];
    uint64_t arrived[FRAME_QUEUE]; /* for each descriptor: the position in the stream where its read ended */
    uint32_t descriptor_count;
    enum bvhd_status broken; /* the status of the first wrong frame; nothing is parsed afterwards */
};

/*
 * Starts a parser that allocates from `memory`, which must outlive it. The limits are at most FRAME_MAX_CONTROL and
 * FRAME_MAX_INLINE.
 */
void frame_parser_init(struct frame_parser *parser, struct memory *memory, uint32_t max_control, uint32_t max_inline);

/*
 * For a receiver of many large frames: the first frame that does not fit makes the buffer at least `size` bytes large,
 * which it then stays, so that one read brings several frames. It is called before the first read.
 */
void frame_parser_read_ahead(struct frame_parser *parser, uint64_t size);

/* Frees the buffer and closes the descriptors that no frame has claimed. NULL is allowed. */
void frame_parser_finish(struct frame_parser *parser);

/*
 * Returns the place for the next bytes from the socket: at least one byte, as many as the current frame still needs,
 * and some more if no frame is under way. The buffer grows only when a header has passed its checks, and only to the
 * size that this header announces or to that of frame_parser_read_ahead. Call this when frame_parser_next finds no
 * frame. BVHD_NO_MEMORY leaves everything as it was; after a wrong frame the call returns that frame's status.
 */
enum bvhd_status frame_parser_space(struct frame_parser *parser, unsigned char **ret_at, uint64_t *ret_size,
                                    struct bvhd_error *error);

/* Returns how large the buffer will be after the next call above. */
uint64_t frame_parser_wanted(const struct frame_parser *parser);

/*
 * Tells the parser that `size` bytes were written there, and that `count` descriptors came with them. The parser owns
 * the descriptors, also when it fails: with BVHD_TOO_LARGE if more than FRAME_QUEUE are waiting.
 */
enum bvhd_status frame_parser_feed(struct frame_parser *parser, uint64_t size, const int *descriptors, uint32_t count,
                                   struct bvhd_error *error);

/*
 * Takes the next complete frame; *ret_found says whether there is one. If there is none and no other has begun, a
 * buffer of more than FRAME_KEEP bytes is freed, unless it is no larger than frame_parser_read_ahead wants it.
 * BVHD_CORRUPT (magic, reserved fields, a descriptor that no frame claims, a frame whose descriptors have not come) and
 * BVHD_TOO_LARGE are final. `error` names the field: "frame.magic".
 */
enum bvhd_status frame_parser_next(struct frame_parser *parser, struct frame *ret_frame, bool *ret_found,
                                   struct bvhd_error *error);

#endif
