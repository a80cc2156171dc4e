/* SPDX-License-Identifier: Apache-2.0 */
/*
 * address.h - the places where a daemon's socket may be, for the library and for bvhctl.
 *
 * A socket that is named, by the program or by $BVHD_SOCKET, is the only place. Otherwise the user's own daemon comes
 * first, then that of the machine. The user's socket is in $XDG_RUNTIME_DIR if that is a directory of this user, else
 * in the directory bvhd-UID of $TMPDIR or /tmp. The latter is used only while it belongs to this user and nobody else
 * may access it, because another owner could answer on the socket.
 */
#ifndef BVHD_ADDRESS_H
#define BVHD_ADDRESS_H

#include <stdbool.h>
#include <stdint.h>

#include "proto/base/memory.h"

enum { ADDRESS_MAX_PLACES = 2 };

/* The socket of the machine's daemon. */
#define ADDRESS_SYSTEM_SOCKET "/run/bvhd/bvhd.sock"

/* One place: the path of the socket, and the directory that has to be the user's own (NULL: any directory will do). */
struct address_place {
    char *path, *own_directory; /* from library_memory */
};

/* The places in the order in which they are tried; address_finish() frees them. */
struct address {
    struct address_place places[ADDRESS_MAX_PLACES];
    uint32_t count;
    bool is_named; /* the program or $BVHD_SOCKET has named the only place */
};

/* Lists the places; the program names one by `explicit_path` unless it is NULL or "". Returns false without memory. */
bool address_init(struct address *address, const char *explicit_path);

void address_finish(struct address *address);

/*
 * Returns the directory of the user's own socket, a path from `memory`; NULL without memory. *ret_is_runtime: it is
 * $XDG_RUNTIME_DIR, which exists; otherwise it need not exist, and address_is_own has to be asked before each use.
 */
char *address_user_directory(struct memory *memory, bool *ret_is_runtime);

/* Returns whether the path is a directory (not a link to one) that this user owns and nobody else may access. */
bool address_is_own(const char *directory);

#endif
