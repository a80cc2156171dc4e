/* SPDX-License-Identifier: Apache-2.0 */
/*
 * control.h - packs and unpacks the control messages of frames as plain structs. No other code uses protobuf.
 *
 * Each message has two functions. pack makes bytes in `memory`, which the caller frees; a message whose fields are all
 * 0 has no bytes, and `data` is NULL. unpack makes the plain struct in one block from `memory`, which the caller frees
 * as a whole (memory_free(memory, message)). Strings are cut to the size of their field, control characters in them
 * become spaces, and they always end in NUL; a string with a NUL inside ends there. Doubles and floats keep their bits.
 * Unknown fields are ignored.
 *
 * Unpacking a message of n bytes allocates two blocks from `memory` at the same time: 2 n + CONTROL_HEAP_FIXED / 2
 * bytes for everything that protobuf allocates, and at most the same for the plain struct. Together that is
 * CONTROL_HEAP_RATIO times n and the fixed part, however hostile the bytes are, and nothing is allocated elsewhere.
 * Honest messages need far less. The schema bounds the nesting, because no message contains itself.
 *
 * Errors of unpacking: BVHD_CORRUPT if the bytes are not a message of this kind, BVHD_TOO_LARGE if the message needs
 * more than its heap or exceeds the constants below, BVHD_UNSUPPORTED if rows have fields that this version does not
 * know, BVHD_NO_MEMORY. Unpacking does not judge values, unless a number would not fit its C type: unknown status and
 * rule numbers pass unchanged. Packing fails with BVHD_TOO_LARGE and BVHD_NO_MEMORY.
 */
#ifndef BVHD_CONTROL_H
#define BVHD_CONTROL_H

#include <stdbool.h>

#include "proto/base/bytes.h"
#include "proto/base/device_format.h"
#include "proto/base/geometry.h"
#include "proto/base/memory.h"
#include "proto/base/status.h"
#include "proto/base/summary.h"

enum {
    CONTROL_VERSION = 1,
    CONTROL_MAX_ITEMS = 4096, /* items of BUILD, CANCEL, PREPARED and PROGRESS, keys of GET */
    CONTROL_DONE = 1000, /* thousandths of a build that is done */
    CONTROL_MAX_MEMFDS = 4, /* in one BUILD */
    CONTROL_MAX_COUNTERS = 128,
    CONTROL_MAX_CLIENTS = 4096, /* in one CLIENT_LIST */
    CONTROL_NAME_SIZE = 64,
    CONTROL_PATH_SIZE = 1024,
    CONTROL_HEAP_RATIO = 4,
    CONTROL_HEAP_FIXED = 32 * 1024,
};

/* FRAME_HELLO: the versions of the protocol that the client speaks. */
struct control_hello {
    uint32_t version_min, version_max;
    char software[CONTROL_NAME_SIZE]; /* for logs: "libbvhd 0.1.0" */
    uint32_t progress_ms; /* how often the client wants PROGRESS of a request, at most; 0: never */
    bool releases; /* the client sends RELEASED when it does not hold a result any more */
};

/*
 * FRAME_WELCOME: the version that both sides speak from now on, and the daemon's limits. A client treats a limit of 0
 * as unknown.
 */
struct control_welcome {
    uint32_t version;
    char software[CONTROL_NAME_SIZE];
    uint32_t credits; /* items that may be under way on this connection; each RESULT returns one credit */
    uint32_t max_items; /* in one request */
    uint32_t max_control, max_inline; /* bytes in one frame */
    uint64_t max_pool; /* bytes; 0: the daemon takes no pool */
    uint64_t max_payload; /* bytes in one item */
    uint64_t max_held; /* bytes of results in descriptors that a client which sends RELEASED should hold at most */
    uint32_t builders; /* bits 1 << BUILDER_ of what items may ask for; 0: an older daemon, with BUILDER_OWN alone */
    bool updates; /* items may have MODE_UPDATE; false: an older daemon, which refuses them */
    bool micromaps; /* items may be opacity micromaps, and have them on triangles; false: the daemon refuses both */
};

/* FRAME_POOL: offers the client's pool, which is the frame's descriptor. */
struct control_pool {
    uint64_t size;
};

/* Where an item's payload is: inline in the frame, in the pool, or in one of the frame's memfds. */
enum control_source { SOURCE_INLINE = 0, SOURCE_POOL = 1, SOURCE_MEMFD = 2 };

/*
 * One structure to build or to update. Its fields are those of build_input (geometry.h) and rows_shape (rows.h);
 * nothing is checked yet.
 */
struct control_item {
    uint32_t type, flags, mode;
    uint32_t quality, target, layout_flags;
    uint64_t destination, source;
    uint32_t geometry_count, geometry_size;
    uint32_t reference_count, reference_size;
    uint32_t payload_source; /* SOURCE_ */
    uint32_t memfd; /* SOURCE_MEMFD: the index of the request's descriptor */
    uint64_t payload_offset, payload_size; /* within the source */
    struct device_format device; /* for a native target */
    float rays_per_primitive;
    uint32_t builder; /* BUILDER_ */
    struct key source_key; /* of an update; all 0: not given */
};

/* Returns what the item asks for, unchecked, and without the rows of its payload, which rows_read adds. */
struct build_input control_item_input(const struct control_item *item);

/*
 * FRAME_BUILD: requests several structures. A priority beyond PRIORITY_LOW .. PRIORITY_HIGH counts as the nearest one.
 */
enum { PRIORITY_LOW = -1, PRIORITY_NORMAL = 0, PRIORITY_HIGH = 1 };

struct control_build {
    int32_t priority;
    uint32_t memfd_count; /* number of the frame's descriptors */
    uint64_t memfd_sizes[CONTROL_MAX_MEMFDS];
    uint32_t item_count;
    struct control_item *items;
    uint32_t deadline_ms; /* after that time items without a result are cancelled; 0: never */
};

/* FRAME_RELEASED: the bytes of results that came in descriptors, and that the client does not hold any more. */
struct control_released {
    uint64_t bytes;
};

/* FRAME_GET: requests results by key. */
struct control_get {
    uint32_t key_count;
    struct key *keys;
};

/* FRAME_CANCEL and FRAME_PREPARED. A CANCEL without items means all items of the request. */
struct control_items {
    uint32_t count;
    uint32_t *items;
};

/* FRAME_PROGRESS: how far the builds of some items of a request are. */
struct control_progress {
    uint32_t count;
    uint32_t *items;
    uint32_t *thousandths; /* of each item: 0 .. CONTROL_DONE */
};

/* Where a result came from. */
enum result_origin { ORIGIN_NONE = 0, ORIGIN_BUILT = 1, ORIGIN_COALESCED = 2, ORIGIN_MEMORY = 3, ORIGIN_DISK = 4 };

/* FRAME_RESULT. The bytes come inline or in the frame's descriptor. */
struct control_result {
    uint32_t item;
    struct bvhd_error error; /* if the status is not BVHD_OK, only the times are set */
    struct key key;
    uint64_t size;
    uint32_t origin; /* ORIGIN_ */
    double queued_ms, prepare_ms, build_ms; /* of this item; 0 for a build that another request caused */
    struct summary summary;
};

/* FRAME_BUSY: when to send the request again. */
struct control_busy {
    uint32_t retry_ms;
};

/* FRAME_COUNTERS: the daemon's counters. */
struct control_counter {
    char name[CONTROL_NAME_SIZE];
    uint64_t value;
};

struct control_counters {
    uint32_t count;
    struct control_counter *counters;
    char version[CONTROL_NAME_SIZE]; /* of the daemon: "0.1.0"; "": an older daemon, which does not say */
};

/* FRAME_CLIENTS: requests the list of the clients that the sender may see. */
struct control_clients {
    bool all; /* refuse the request if the sender may not see all of them */
};

/* One connection of the daemon, and what it holds there. */
struct control_client {
    uint64_t connection; /* its number, as in log lines */
    uint32_t uid;
    int32_t pid;
    uint64_t connected_ms; /* since it was accepted */
    uint64_t busy_ms; /* time that threads have worked for it */
    uint64_t memory_bytes; /* promised to its items under way, inline payloads, and an unfinished frame */
    uint64_t result_bytes; /* of results that it has not read, or still holds */
    uint64_t pool_bytes; /* of its pool */
    uint32_t requests, items; /* under way */
    uint32_t waiting; /* those of its items, and of the builds for them, that wait for memory */
    uint32_t threads; /* that work for it now */
    uint32_t descriptors; /* that the daemon holds for it */
    char software[CONTROL_NAME_SIZE]; /* as in its HELLO; "": it has sent none */
};

/* FRAME_CLIENT_LIST: the clients that the receiver may see, at most CONTROL_MAX_CLIENTS of them. */
struct control_client_list {
    uint32_t total; /* connections of the daemon */
    uint32_t hidden; /* those that belong to users whose connections the receiver may not see */
    uint32_t count;
    struct control_client *clients;
};

/* FRAME_CACHE: what to do with the caches. TRIM is for the one on disk, CLEAR for both. */
enum control_cache_action { CACHE_SHOW = 0, CACHE_TRIM = 1, CACHE_CLEAR = 2 };

struct control_cache {
    uint32_t action; /* CACHE_ */
    uint64_t bytes; /* TRIM: the most that are left */
};

/* FRAME_CACHE_STATE: what the caches on disk and in memory hold, after the action. */
struct control_cache_state {
    char directory[CONTROL_PATH_SIZE]; /* an absolute path; "": nothing is kept on disk, and the next four are 0 */
    bool counted; /* the directory has been read; before, `entries` and `bytes` are only what this daemon has written */
    uint64_t entries, bytes, budget; /* on disk */
    uint64_t memory_entries, memory_bytes, memory_budget;
};

/* The control messages of FRAME_DONE, PING, PONG, STATS and GOODBYE are empty; FRAME_ERROR has a struct bvhd_error. */

#define CONTROL_MESSAGE(name, type)                                                                                    \
    enum bvhd_status control_pack_##name(const type *message, struct memory *memory, struct bytes *ret_bytes,          \
                                         struct bvhd_error *error);                                                    \
    enum bvhd_status control_unpack_##name(struct bytes bytes, struct memory *memory, type **ret_message,              \
                                           struct bvhd_error *error);

CONTROL_MESSAGE(hello, struct control_hello)
CONTROL_MESSAGE(welcome, struct control_welcome)
CONTROL_MESSAGE(pool, struct control_pool)
CONTROL_MESSAGE(build, struct control_build)
CONTROL_MESSAGE(released, struct control_released)
CONTROL_MESSAGE(get, struct control_get)
CONTROL_MESSAGE(items, struct control_items)
CONTROL_MESSAGE(progress, struct control_progress)
CONTROL_MESSAGE(result, struct control_result)
CONTROL_MESSAGE(error, struct bvhd_error)
CONTROL_MESSAGE(busy, struct control_busy)
CONTROL_MESSAGE(counters, struct control_counters)
CONTROL_MESSAGE(cache, struct control_cache)
CONTROL_MESSAGE(cache_state, struct control_cache_state)
CONTROL_MESSAGE(clients, struct control_clients)
CONTROL_MESSAGE(client_list, struct control_client_list)

#endif
