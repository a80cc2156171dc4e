/* SPDX-License-Identifier: Apache-2.0 */
/*
 * control.h - the control messages of frames, as plain structs: the only door to protobuf.
 *
 * Each message has pack (into bytes from `memory`, which the caller frees; without a field that differs from 0 they are
 * none, and `data` is NULL) and unpack. An unpacked message lies in one block from `memory`, freed by the caller as a
 * whole (memory_free(memory, message)). Strings are cut to what they are for, control characters in them become spaces,
 * and they always end in NUL; one with a NUL inside ends there. Doubles and floats keep their bits. Unknown fields are
 * ignored.
 *
 * Unpacking a message of n bytes takes two blocks from `memory` at once: 2 n + CONTROL_HEAP_FIXED / 2 bytes for all
 * that protobuf makes of it, and for the plain struct what it needs, at most as much. Together that is
 * CONTROL_HEAP_RATIO times n and the fixed part, however hostile the bytes are, and nothing is allocated elsewhere.
 * Honest messages stay far below. Nesting ends at the schema's depth: no message contains itself.
 *
 * BVHD_CORRUPT: not a message of this kind. BVHD_TOO_LARGE: more than its heap, or more than the constants below allow.
 * BVHD_UNSUPPORTED: rows with fields that this version does not know. BVHD_NO_MEMORY. Values are not judged here,
 * except where a number would not fit its C type: status and rule numbers that this version does not know come through
 * as they are. Packing fails with BVHD_TOO_LARGE and BVHD_NO_MEMORY.
 */
#ifndef BVHD_CONTROL_H
#define BVHD_CONTROL_H

#include "proto/base/bytes.h"
#include "proto/base/device_format.h"
#include "proto/base/geometry.h"
#include "proto/base/memory.h"
#include "proto/base/status.h"

enum {
    CONTROL_VERSION = 1,
    CONTROL_MAX_ITEMS = 4096, /* items of BUILD, CANCEL, PREPARED, keys of GET */
    CONTROL_MAX_MEMFDS = 4, /* of BUILD */
    CONTROL_MAX_COUNTERS = 128,
    CONTROL_NAME_SIZE = 64,
    CONTROL_HEAP_RATIO = 4,
    CONTROL_HEAP_FIXED = 32 * 1024,
};

/* FRAME_HELLO: which versions of the protocol the client speaks. */
struct control_hello {
    uint32_t version_min, version_max;
    char software[CONTROL_NAME_SIZE]; /* for logs: "libbvhd 0.1.0" */
};

/*
 * FRAME_WELCOME: the version that both speak from now on, and what the daemon allows. A client treats a limit of 0 as
 * "not said".
 */
struct control_welcome {
    uint32_t version;
    char software[CONTROL_NAME_SIZE];
    uint32_t credits; /* items that may be under way on this connection; a RESULT gives one back */
    uint32_t max_items; /* of one request */
    uint32_t max_control, max_inline; /* bytes of one frame */
    uint64_t max_pool; /* bytes; 0: no pool */
    uint64_t max_payload; /* bytes of one item */
};

/* FRAME_POOL. */
struct control_pool {
    uint64_t size;
};

enum control_source { SOURCE_INLINE = 0, SOURCE_POOL = 1, SOURCE_MEMFD = 2 };

/* One structure to build. Fields as in geometry.h's build_input, rows.h's rows_shape; nothing is checked yet. */
struct control_item {
    uint32_t type, flags, mode;
    uint64_t destination, source;
    uint32_t quality, target, layout_flags;
    uint32_t geometry_count, geometry_size;
    uint32_t reference_count, reference_size;
    uint32_t payload_source; /* SOURCE_ */
    uint32_t memfd; /* which of the request's */
    uint64_t payload_offset, payload_size; /* within the source */
    struct device_format device; /* of a native target */
    float rays_per_primitive;
};

/* FRAME_BUILD. Priorities: PRIORITY_LOW .. PRIORITY_HIGH, others count as the nearest. */
enum { PRIORITY_LOW = -1, PRIORITY_NORMAL = 0, PRIORITY_HIGH = 1 };

struct control_build {
    int32_t priority;
    uint32_t memfd_count; /* the frame's descriptors */
    uint64_t memfd_sizes[CONTROL_MAX_MEMFDS];
    uint32_t item_count;
    struct control_item *items;
};

/* FRAME_GET. */
struct control_get {
    uint32_t key_count;
    struct key *keys;
};

/* FRAME_CANCEL and FRAME_PREPARED. Without any: all items of the request (CANCEL only). */
struct control_items {
    uint32_t count;
    uint32_t *items;
};

/* Where a result came from. */
enum result_origin { ORIGIN_NONE = 0, ORIGIN_BUILT = 1, ORIGIN_COALESCED = 2, ORIGIN_MEMORY = 3, ORIGIN_DISK = 4 };

/* What is known about a structure beside its bytes. Meanings as in build.h's build_stats. */
struct control_summary {
    uint64_t primitives, triangles, instances, inactive, degenerate, skipped, refs, peak_bytes;
    uint32_t depth, target;
    double sah, build_ms;
    char method[CONTROL_NAME_SIZE];
    float bounds[6];
    uint32_t quality; /* QUALITY_: that was built */
    float slabs[20]; /* slabs.h: minima, maxima */
};

/* FRAME_RESULT. The bytes come inline, or as the frame's descriptor. */
struct control_result {
    uint32_t item;
    struct bvhd_error error; /* status BVHD_OK: the rest is set; otherwise the times alone */
    struct key key;
    uint64_t size;
    uint32_t origin; /* ORIGIN_ */
    double queued_ms, prepare_ms, build_ms; /* of this item; a build that was not its own counts 0 */
    struct control_summary summary;
};

/* FRAME_BUSY. */
struct control_busy {
    uint32_t retry_ms;
};

/* FRAME_COUNTERS. */
struct control_counter {
    char name[CONTROL_NAME_SIZE];
    uint64_t value;
};

struct control_counters {
    uint32_t count;
    struct control_counter *counters;
};

/* FRAME_DONE, PING, PONG, STATS and GOODBYE have empty control messages; FRAME_ERROR's is a struct bvhd_error. */

#define CONTROL_MESSAGE(name, type)                                                                                    \
    enum bvhd_status control_pack_##name(const type *message, struct memory *memory, struct bytes *ret_bytes,          \
                                         struct bvhd_error *error);                                                    \
    enum bvhd_status control_unpack_##name(struct bytes bytes, struct memory *memory, type **ret_message,              \
                                           struct bvhd_error *error);

CONTROL_MESSAGE(hello, struct control_hello)
CONTROL_MESSAGE(welcome, struct control_welcome)
CONTROL_MESSAGE(pool, struct control_pool)
CONTROL_MESSAGE(build, struct control_build)
CONTROL_MESSAGE(get, struct control_get)
CONTROL_MESSAGE(items, struct control_items)
CONTROL_MESSAGE(result, struct control_result)
CONTROL_MESSAGE(error, struct bvhd_error)
CONTROL_MESSAGE(busy, struct control_busy)
CONTROL_MESSAGE(counters, struct control_counters)

#endif
