/* SPDX-License-Identifier: Apache-2.0 */
/* address.h - the places where a daemon's socket may be. */
#ifndef BVHD_ADDRESS_H
#define BVHD_ADDRESS_H

#include <stdbool.h>
#include <stdint.h>

enum { ADDRESS_MAX_PATHS = 2 };

/* The paths to try; address_finish() frees them. */
struct address {
    char *paths[ADDRESS_MAX_PATHS]; /* in the order in which they are tried; from library_memory */
    uint32_t count;
};

/*
 * Uses `explicit_path` if it is given (not NULL or empty), else $BVHD_SOCKET, else both $XDG_RUNTIME_DIR/bvhd.sock and
 * /run/bvhd/bvhd.sock. Returns false without memory.
 */
bool address_init(struct address *address, const char *explicit_path);

void address_finish(struct address *address);

#endif
