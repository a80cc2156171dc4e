/* SPDX-License-Identifier: Apache-2.0 */
/*
 * inlet.h - reads a client's socket into its frame parser, and counts descriptors before they arrive. Loop thread only.
 *
 * No descriptor of a client may be closed on the loop, because that can block for as long as its owner likes
 * (release.h). The kernel closes those itself, within the daemon's call, that come with a message and find no room. So
 * nothing is read unless as many descriptors can be opened as any message brings, and those that arrive are charged to
 * the client's user. The user's clients have to wait while it has no room for INLET_DESCRIPTORS more.
 */
#ifndef BVHD_INLET_H
#define BVHD_INLET_H

#include "daemon/system/descriptor_share.h"
#include "proto/wire/frame.h"

enum {
    /* the most descriptors that one read accepts: those of a frame; more at once break the protocol */
    INLET_DESCRIPTORS = FRAME_MAX_DESCRIPTORS,
    /* the most bytes of a control message before HELLO is answered; inline bytes are not allowed until then */
    INLET_FIRST_CONTROL = 4096,
};

struct inlet {
    int socket; /* non-blocking; it belongs to the caller of inlet_init */
    struct descriptor_share *share; /* what descriptors that arrive are charged to */
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

/* `socket`, `share` and `memory` (for the parser) have to outlive the inlet. */
void inlet_init(struct inlet *inlet, int socket, struct descriptor_share *share, struct memory *memory);

/* Closes the descriptors that belong to no complete frame, and frees the parser's memory. `inlet` may be NULL. */
void inlet_finish(struct inlet *inlet);

/* Called when HELLO was answered: from now on frames may have the full size of the protocol. */
void inlet_open(struct inlet *inlet);

/* Returns how large the buffer for frames is, and how large it will be after the next read. */
uint64_t inlet_capacity(const struct inlet *inlet);
uint64_t inlet_wanted(const struct inlet *inlet);

/* Reads from the socket once. *ret_size is the number of bytes read, or 0. `error` is set with INLET_BROKEN only. */
enum inlet_result inlet_receive(struct inlet *inlet, uint64_t *ret_size, struct bvhd_error *error);

/*
 * Reads up to `size` bytes from a socket once, and discards descriptors that come with them: for clients that do not
 * speak in frames. *ret_size is the number of bytes with INLET_DATA only. inlet_discard discards the bytes, too: for a
 * client that broke the protocol.
 */
enum inlet_result inlet_read(int socket, struct descriptor_share *share, void *bytes, uint64_t size,
                             uint64_t *ret_size);
enum inlet_result inlet_discard(int socket, struct descriptor_share *share);

/*
 * Ends a connection in both directions, so that the client sees the end, and closes the socket, which is counted and
 * charged to `share`. What is unread in the socket is discarded first: a socket without descriptors in it is closed at
 * once. Only one in which too many are left goes to release_descriptor.
 */
void inlet_close_socket(int socket, struct descriptor_share *share);

/*
 * Returns the next complete frame, as frame_parser_next does. The frame's descriptors now belong to the caller, who has
 * to close them and to give them back to the share.
 */
enum bvhd_status inlet_next(struct inlet *inlet, struct frame *ret_frame, bool *ret_found, struct bvhd_error *error);

/* Returns whether a frame has arrived in part. If so, *ret_begin is where it begins in the client's stream. */
bool inlet_is_mid_frame(const struct inlet *inlet, uint64_t *ret_begin);

#endif
