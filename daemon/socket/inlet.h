/* SPDX-License-Identifier: Apache-2.0 */
/*
 * inlet.h - reads a client's socket into its frame parser, and counts descriptors before they arrive. Loop thread only.
 *
 * If the process had no descriptors left, the kernel would drop those that come with a message, and the daemon could
 * not tell an honest client from one that breaks the protocol. So nothing is read unless INLET_DESCRIPTORS more
 * descriptors can be opened.
 */
#ifndef BVHD_INLET_H
#define BVHD_INLET_H

#include "daemon/system/descriptors.h"
#include "proto/wire/frame.h"

enum {
    /* the most descriptors that one read accepts; more at once break the protocol */
    INLET_DESCRIPTORS = 16,
    /* the most bytes of a control message before HELLO is answered; inline bytes are not allowed until then */
    INLET_FIRST_CONTROL = 4096,
};

struct inlet {
    int socket; /* non-blocking; it belongs to the caller of inlet_init */
    struct descriptors *descriptors; /* where descriptors that arrive are counted */
    struct frame_parser parser;
};

enum inlet_result {
    INLET_DATA, /* bytes were read, and there may be more */
    INLET_LAST, /* bytes were read, and the socket is empty now */
    INLET_NOTHING, /* there is nothing to read now */
    INLET_SHORT, /* descriptors or memory are short: the caller has to try again soon */
    INLET_END, /* the client is gone */
    INLET_BROKEN, /* the client broke the protocol; the error says how */
};

/* `socket`, `descriptors` and `memory` (for the parser) have to outlive the inlet. */
void inlet_init(struct inlet *inlet, int socket, struct descriptors *descriptors, struct memory *memory);

/* Closes the descriptors that belong to no complete frame, and frees the parser's memory. `inlet` may be NULL. */
void inlet_finish(struct inlet *inlet);

/* Called when HELLO was answered: from now on frames may have the full size of the protocol. */
void inlet_open(struct inlet *inlet);

/* Reads from the socket once. *ret_size is the number of bytes read, or 0. `error` is set with INLET_BROKEN only. */
enum inlet_result inlet_receive(struct inlet *inlet, uint64_t *ret_size, struct bvhd_error *error);

/*
 * Reads from the socket once, and discards the bytes and descriptors: for a client that broke the protocol. It can be
 * called after inlet_finish.
 */
enum inlet_result inlet_discard(struct inlet *inlet);

/*
 * Returns the next complete frame, as frame_parser_next does. The frame's descriptors now belong to the caller, who has
 * to close them and to give back their count (descriptors_give).
 */
enum bvhd_status inlet_next(struct inlet *inlet, struct frame *ret_frame, bool *ret_found, struct bvhd_error *error);

/* Returns whether a frame has arrived in part. */
bool inlet_is_mid_frame(const struct inlet *inlet);

#endif
