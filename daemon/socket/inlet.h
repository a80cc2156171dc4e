/* SPDX-License-Identifier: Apache-2.0 */
/*
 * inlet.h - from a client's socket into its frame parser, with descriptors that are counted before they arrive. Loop
 * thread only.
 *
 * With no descriptors left the kernel would drop those that a message brings, and an honest sender could not be told
 * from a wrong one. So nothing is read unless INLET_DESCRIPTORS more can be opened.
 */
#ifndef BVHD_INLET_H
#define BVHD_INLET_H

#include "daemon/system/descriptors.h"
#include "proto/wire/frame.h"

enum {
    INLET_DESCRIPTORS = 16, /* that one read takes; more at once are a broken protocol */
    INLET_FIRST_CONTROL =
        4096, /* before HELLO was answered a control message has at most so many bytes, and there are no inline ones */
};

struct inlet {
    int socket; /* non-blocking; the owner's */
    struct descriptors *descriptors;
    struct frame_parser parser;
};

enum inlet_result {
    INLET_DATA, /* bytes were read, and there may be more */
    INLET_LAST, /* bytes were read, all that there were */
    INLET_NOTHING, /* there is nothing to read now */
    INLET_SHORT, /* of descriptors or memory: try again soon */
    INLET_END, /* the client is gone */
    INLET_BROKEN, /* it broke the protocol; the error says how */
};

void inlet_init(struct inlet *inlet, int socket, struct descriptors *descriptors, struct memory *memory);

/* Closes the descriptors that no frame has claimed. NULL-safe. */
void inlet_finish(struct inlet *inlet);

/* HELLO was answered: frames of any size from now on. */
void inlet_open(struct inlet *inlet);

/* One read from the socket. *ret_size: its bytes, 0 if there were none. */
enum inlet_result inlet_receive(struct inlet *inlet, uint64_t *ret_size, struct bvhd_error *error);

/*
 * The same for a client that broke it: bytes and descriptors go nowhere. INLET_DATA, NOTHING or END; also after
 * inlet_finish.
 */
enum inlet_result inlet_throw_away(struct inlet *inlet);

/* As frame_parser_next; the frame's descriptors are counted, and are the caller's to close and to give back. */
enum bvhd_status inlet_next(struct inlet *inlet, struct frame *ret_frame, bool *ret_found, struct bvhd_error *error);

/* Whether a frame has begun to arrive. */
bool inlet_has_part(const struct inlet *inlet);

#endif
