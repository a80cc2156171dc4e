/* SPDX-License-Identifier: Apache-2.0 */
/* messages.h - a table of the kinds of control messages, and a filled sample of each. For tests of the wire. */
#ifndef BVHD_TEST_MESSAGES_H
#define BVHD_TEST_MESSAGES_H

#include <math.h>

#include "proto/wire/control.h"

enum { MESSAGES_ITEMS = 5, MESSAGES_COUNTERS = 3, MESSAGES_CLIENTS = 2 };

struct messages {
    struct control_hello hello;
    struct control_released released;
    struct control_welcome welcome;
    struct control_pool pool;
    struct control_build build;
    struct control_item build_items[MESSAGES_ITEMS];
    struct control_get get;
    struct key keys[MESSAGES_ITEMS];
    struct control_items items;
    uint32_t numbers[MESSAGES_ITEMS];
    struct control_progress progress;
    uint32_t thousandths[MESSAGES_ITEMS];
    struct control_result result;
    struct bvhd_error error;
    struct control_busy busy;
    struct control_counters counters;
    struct control_counter rows[MESSAGES_COUNTERS];
    struct control_clients clients;
    struct control_client_list client_list;
    struct control_client client_rows[MESSAGES_CLIENTS];
    struct control_cache cache;
    struct control_cache_state cache_state;
};

/* Fills every field with a unique value. */
static inline void messages_fill(struct messages *all)
{
    memset(all, 0, sizeof *all);
    /* Assigning whole structs could change the padding, and tests compare all bytes. */
    all->hello.version_min = 1;
    all->hello.version_max = 7;
    strcpy(all->hello.software, "libbvhd 0.1.0");
    all->hello.progress_ms = 200;
    all->hello.releases = true;
    all->welcome.version = 3;
    strcpy(all->welcome.software, "bvhd 0.1.0");
    all->welcome.credits = 64;
    all->welcome.max_items = 4096;
    all->welcome.max_control = 1 << 20;
    all->welcome.max_inline = 1 << 16;
    all->welcome.max_pool = UINT64_C(64) << 20;
    all->welcome.max_payload = UINT64_MAX;
    all->welcome.max_held = 12345678901;
    all->welcome.builders = 3;
    all->welcome.updates = true;
    all->welcome.micromaps = true;
    all->released.bytes = UINT64_MAX - 5;
    all->pool.size = UINT64_C(1) << 40;
    all->build =
        (struct control_build){PRIORITY_LOW, 3, {1, UINT64_MAX, 3}, MESSAGES_ITEMS, all->build_items, 4000000000};
    for (uint32_t i = 0; i < MESSAGES_ITEMS; i++) {
        uint32_t n = 100 * i;
        all->build_items[i] = (struct control_item){
            n + 1,  n + 2,  n + 3,  n + 6,  n + 7,          n + 8,  UINT64_MAX - n,     n + 5,         n + 9,
            n + 10, n + 11, n + 12, n + 13, UINT32_MAX - n, n + 15, UINT64_MAX - 2 * n, {{0}, {0}, 0}, 0.25f * (float)n,
            n + 20, {{0}}};
        memset(&all->build_items[i].source_key, (int)n + 21, sizeof all->build_items[i].source_key);
        memset(all->build_items[i].device.driver_uuid, (int)n + 17, 16);
        memset(all->build_items[i].device.compatibility_uuid, (int)n + 18, 16);
        all->build_items[i].device.variant = UINT32_MAX - n - 19;
        memset(&all->keys[i], (int)(0x11 * i), sizeof all->keys[i]);
        all->numbers[i] = i * 1000003;
        all->thousandths[i] = i * CONTROL_DONE / (MESSAGES_ITEMS - 1);
    }
    all->get = (struct control_get){MESSAGES_ITEMS, all->keys};
    all->items = (struct control_items){MESSAGES_ITEMS, all->numbers};
    all->progress = (struct control_progress){MESSAGES_ITEMS, all->numbers, all->thousandths};
    bvhd_error_rule(&all->error, BVHD_VUID_03774, "infos[2].geometries[3].aabbs.data", "%d bytes do not hold the boxes",
                    17);
    all->result = (struct control_result){
        .item = 9, .size = 12345678901, .origin = ORIGIN_COALESCED, .queued_ms = 0.5, .prepare_ms = -0.0};
    memset(&all->result.key, 0xc3, sizeof all->result.key);
    all->result.build_ms = NAN;
    all->result.summary = (struct summary){.primitives = 11,
                                           .triangles = 12,
                                           .instances = 13,
                                           .inactive = 14,
                                           .degenerate = 15,
                                           .skipped = 16,
                                           .refs = 17,
                                           .peak_bytes = UINT64_MAX,
                                           .depth = 18,
                                           .target = TARGET_PORTABLE,
                                           .quality = QUALITY_HIGH,
                                           .refits = 21,
                                           .sah = -0.0,
                                           .build_ms = INFINITY,
                                           .method = "spatial",
                                           .bounds = {{-0.0f, NAN, -INFINITY}, {1, 2, 3}},
                                           .decay = -0.0};
    for (int i = 0; i < SLABS_COUNT; i++) {
        all->result.summary.slabs.min[i] = (float)i - 7.5f;
        all->result.summary.slabs.max[i] = (float)i + 2.5f;
    }
    all->busy.retry_ms = 250;
    all->counters = (struct control_counters){MESSAGES_COUNTERS, all->rows, "0.1.0"};
    all->rows[0] = (struct control_counter){"builds_started", 1};
    all->rows[1] = (struct control_counter){"hits_memory", 0};
    all->rows[2] =
        (struct control_counter){"a name that is as long as a name can be without losing its end", UINT64_MAX};
    all->clients.all = true;
    all->client_list = (struct control_client_list){5, 3, MESSAGES_CLIENTS, all->client_rows};
    for (uint32_t i = 0; i < MESSAGES_CLIENTS; i++) {
        uint32_t n = 100 * i;
        all->client_rows[i] = (struct control_client){
            UINT64_MAX - n, UINT32_MAX - n, -1 - (int32_t)i, n + 1, n + 2, n + 3,  n + 4,
            n + 5,          n + 6,          n + 7,           n + 8, n + 9, n + 10, "bvhctl 0.1.0"};
    }
    all->cache = (struct control_cache){CACHE_TRIM, UINT64_C(10) << 30};
    strcpy(all->cache_state.directory, "/var/lib/bvhd");
    all->cache_state.counted = true;
    all->cache_state.entries = 200000;
    all->cache_state.bytes = UINT64_C(9) << 30;
    all->cache_state.budget = UINT64_MAX;
    all->cache_state.memory_entries = 7;
    all->cache_state.memory_bytes = 8;
    all->cache_state.memory_budget = 9;
}

/* One kind of message, with untyped members of struct messages. */
struct messages_kind {
    const char *name;
    size_t member;
    enum bvhd_status (*pack)(const void *message, struct memory *memory, struct bytes *ret_bytes,
                             struct bvhd_error *error);
    enum bvhd_status (*unpack)(struct bytes bytes, struct memory *memory, void **ret_message, struct bvhd_error *error);
};

#define MESSAGES_KIND(name)                                                                                            \
    static inline enum bvhd_status messages_pack_##name(const void *message, struct memory *memory,                    \
                                                        struct bytes *ret_bytes, struct bvhd_error *error)             \
    {                                                                                                                  \
        return control_pack_##name(message, memory, ret_bytes, error);                                                 \
    }                                                                                                                  \
    static inline enum bvhd_status messages_unpack_##name(struct bytes bytes, struct memory *memory,                   \
                                                          void **ret_message, struct bvhd_error *error)                \
    {                                                                                                                  \
        __typeof__(((struct messages *)NULL)->name) *message = NULL;                                                   \
        enum bvhd_status status = control_unpack_##name(bytes, memory, &message, error);                               \
        if (status == BVHD_OK)                                                                                         \
            *ret_message = message;                                                                                    \
        return status;                                                                                                 \
    }

MESSAGES_KIND(hello)
MESSAGES_KIND(welcome)
MESSAGES_KIND(pool)
MESSAGES_KIND(released)
MESSAGES_KIND(build)
MESSAGES_KIND(get)
MESSAGES_KIND(items)
MESSAGES_KIND(progress)
MESSAGES_KIND(result)
MESSAGES_KIND(error)
MESSAGES_KIND(busy)
MESSAGES_KIND(counters)
MESSAGES_KIND(clients)
MESSAGES_KIND(client_list)
MESSAGES_KIND(cache)
MESSAGES_KIND(cache_state)

#define MESSAGES_ROW(name)                                                                                             \
    {                                                                                                                  \
#name, offsetof(struct messages, name), messages_pack_##name, messages_unpack_##name                           \
    }
static const struct messages_kind messages_kinds[] = {
    MESSAGES_ROW(hello),       MESSAGES_ROW(welcome), MESSAGES_ROW(pool),        MESSAGES_ROW(build),
    MESSAGES_ROW(get),         MESSAGES_ROW(items),   MESSAGES_ROW(progress),    MESSAGES_ROW(result),
    MESSAGES_ROW(error),       MESSAGES_ROW(busy),    MESSAGES_ROW(counters),    MESSAGES_ROW(clients),
    MESSAGES_ROW(client_list), MESSAGES_ROW(cache),   MESSAGES_ROW(cache_state), MESSAGES_ROW(released),
};
enum { MESSAGES_KINDS = sizeof messages_kinds / sizeof messages_kinds[0] };

/* Returns the packed sample of a kind. */
static inline struct bytes messages_sample(const struct messages_kind *kind, struct memory *memory)
{
    static struct messages all;
    struct bytes bytes = {NULL, 0};
    messages_fill(&all);
    kind->pack((const unsigned char *)&all + kind->member, memory, &bytes, NULL);
    return bytes;
}

static inline void messages_free(struct bytes bytes, struct memory *memory)
{
    memory_free(memory, (void *)(uintptr_t)bytes.data);
}

#endif
