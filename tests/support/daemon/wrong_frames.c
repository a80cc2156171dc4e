/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/support/daemon/wrong_frames.h"

#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <unistd.h>

#include "proto/base/vertex_element.h"

enum { POOL_SIZE = 1 << 20, PAYLOAD_SIZE = 60 * 1024, MOST_ITEMS = 4096, SLOT = 16 * 1024 };

/* Values around limits of fields, of types, and of sizes. */
static const uint64_t odd_values[] = {
    0,          1,          2,          3,          4,           5,          7,          8,          12,
    16,         24,         31,         32,         48,          64,         79,         80,         81,
    95,         96,         160,        97,         100,         106,        255,        256,        1024,
    4095,       4096,       4097,       65535,      65536,       0xffffff,   0x1000000,  0x1fffffff, 0x20000000,
    0x7fffffff, 0x80000000, 0xfffffff8, 0xffffffff, 0x100000000, 1000165000, 1000429004, 1000429005, 1000623000,
    1000478000, 61440,      1ull << 40, 1ull << 62, 1ull << 63,  ~0ull - 7,  ~0ull,
};
enum { ODD_VALUES = sizeof odd_values / sizeof *odd_values };

uint64_t wrong_next(struct wrong_frames *wrong)
{
    uint64_t mixed = wrong->state += 0x9e3779b97f4a7c15;
    mixed = (mixed ^ mixed >> 30) * 0xbf58476d1ce4e5b9;
    mixed = (mixed ^ mixed >> 27) * 0x94d049bb133111eb;
    return mixed ^ mixed >> 31;
}

uint64_t wrong_below(struct wrong_frames *wrong, uint64_t bound)
{
    return wrong_next(wrong) % bound;
}

static bool one_in(struct wrong_frames *wrong, uint64_t n)
{
    return wrong_below(wrong, n) == 0;
}

static uint64_t odd_value(struct wrong_frames *wrong)
{
    return one_in(wrong, 8) ? wrong_next(wrong) : odd_values[wrong_below(wrong, ODD_VALUES)];
}

/* ---- payloads ---- */

/*
 * The kinds of geometry, bytes of their primitives without indices, and strides. Kinds of top levels have their
 * reference somewhere in these bytes.
 */
static const struct kind_bytes {
    uint32_t type;
    uint64_t each, stride;
    uint32_t reference; /* 0: none */
    uint32_t flags; /* that the build needs */
} kinds[] = {
    {GEOMETRY_TRIANGLES, 36, 12, 0, 0},
    {GEOMETRY_AABBS, 24, 24, 0, 0},
    {GEOMETRY_INSTANCES, 64, 0, 56, 0},
    {GEOMETRY_SPHERES, 16, 16, 0, 0},
    {GEOMETRY_SWEPT_SPHERES, 32, 16, 0, 0},
    {GEOMETRY_MOVING_TRIANGLES, 36, 12, 0, BUILD_MOTION},
    {GEOMETRY_MOVING_INSTANCES, 160, 0, 64, BUILD_MOTION},
};
enum { KINDS = sizeof kinds / sizeof *kinds };

/* Writes the valid rows and data of one geometry of this kind. Returns their size in bytes. */
static uint64_t write_payload(struct wrong_frames *wrong, const struct kind_bytes *kind, unsigned char *at)
{
    uint32_t count = (uint32_t)wrong_below(wrong, 60) + 1, references = kind->reference ? 4 : 0;
    uint64_t data = ROWS_GEOMETRY_SIZE + references * ROWS_REFERENCE_SIZE, each = kind->each;
    struct geometry_row row = {.type = kind->type, .primitive_count = count, .data = {data, count * each}};
    row.vertex_format = 106;
    row.max_vertex = count * 3 - 1;
    row.index_type = INDEX_NONE;
    row.stride = row.radius_stride = kind->stride;
    row.radius_format = RADIUS_FLOAT32;
    row.end_caps_mode = count % 2;
    row.radii = (struct row_span){data + 12, count * each - 12};
    row.end_positions = row.data;
    memcpy(at, &row, sizeof row);
    for (uint32_t i = 0; i < references; i++) {
        struct reference_row reference = {.handle = i + 1, .kind = REFERENCE_BLAS, .bounds = {0, 0, 0, 1, 1, 1}};
        memcpy(at + sizeof row + i * sizeof reference, &reference, sizeof reference);
    }
    for (uint64_t i = 0; i < count * each; i += 4) {
        float value = (float)wrong_below(wrong, 1000) / 16.0f;
        memcpy(at + data + i, &value, sizeof value);
    }
    for (uint32_t i = 0; references > 0 && i < count; i++) {
        if (kind->type == GEOMETRY_MOVING_INSTANCES)
            bytes_put64(at + data + i * each, MOTION_STATIC); /* and flags of 0 */
        bytes_put64(at + data + i * each + kind->reference, i % references + 1);
    }
    return data + count * each;
}

static void spoil_payload(struct wrong_frames *wrong, unsigned char *at, uint64_t size)
{
    uint64_t where = one_in(wrong, 3) ? wrong_below(wrong, size - 8) : wrong_below(wrong, ROWS_GEOMETRY_SIZE / 4) * 4;
    if (where >= 40 && where % 8 == 0)
        bytes_put64(at + where, odd_value(wrong));
    else
        bytes_put32(at + where, (uint32_t)odd_value(wrong));
}

/* ---- items ---- */

static void spoil_item(struct wrong_frames *wrong, struct control_item *item)
{
    uint32_t *const narrow[] = {&item->type,           &item->flags,          &item->mode,
                                &item->quality,        &item->target,         &item->layout_flags,
                                &item->geometry_count, &item->geometry_size,  &item->reference_count,
                                &item->reference_size, &item->payload_source, &item->memfd};
    uint64_t *const wide[] = {&item->destination, &item->source, &item->payload_offset, &item->payload_size};
    uint64_t which = wrong_below(wrong, 17);
    uint32_t bits = (uint32_t)odd_value(wrong);
    if (which == 16)
        memcpy(&item->rays_per_primitive, &bits, sizeof bits);
    else if (which < 12)
        *narrow[which] = (uint32_t)odd_value(wrong);
    else
        *wide[which - 12] = odd_value(wrong);
}

/* Returns where payloads of this source are written. The sealed memfd already has payloads. */
static unsigned char *place_of(struct wrong_frames *wrong, enum control_source source)
{
    return source == SOURCE_POOL ? wrong->pool : wrong->payloads;
}

static struct control_item make_item(struct wrong_frames *wrong, enum control_source source)
{
    uint64_t slots = source == SOURCE_INLINE ? PAYLOAD_SIZE / SLOT : POOL_SIZE / SLOT,
             offset = wrong_below(wrong, slots) * SLOT;
    const struct kind_bytes *kind = &kinds[wrong_below(wrong, KINDS)];
    uint64_t size = SLOT;
    if (source != SOURCE_MEMFD) {
        size = write_payload(wrong, kind, place_of(wrong, source) + offset);
        if (one_in(wrong, 3))
            spoil_payload(wrong, place_of(wrong, source) + offset, size);
    }
    struct control_item item = raw_item(offset, size, source);
    item.type = kind->reference ? STRUCTURE_TOP : STRUCTURE_BOTTOM;
    item.flags = kind->flags;
    item.geometry_size = ROWS_GEOMETRY_SIZE;
    item.reference_count = kind->reference ? 4 : 0;
    item.quality = (uint32_t)wrong_below(wrong, 5);
    item.destination = one_in(wrong, 4) ? wrong_below(wrong, 3) : 0;
    if (one_in(wrong, 3))
        spoil_item(wrong, &item);
    return item;
}

/* ---- frames ---- */

/* A frame before it is sent. */
struct draft {
    struct raw_frame frame;
    int descriptors[6];
};

static void drop_draft(struct raw_client *client, struct draft *draft)
{
    memory_free(&client->memory, (void *)(uintptr_t)draft->frame.control.data);
}

static void add_descriptors(struct wrong_frames *wrong, struct draft *draft, uint32_t count)
{
    for (uint32_t i = 0; i < count && i < 6; i++)
        draft->descriptors[i] = one_in(wrong, 4)   ? wrong->wild_file
                                : one_in(wrong, 4) ? wrong->pool_file
                                                   : wrong->sealed_file;
    draft->frame.descriptors = draft->descriptors;
    draft->frame.descriptor_count = count;
    draft->frame.header.descriptors = (uint8_t)count;
}

static void draft_build(struct wrong_frames *wrong, struct raw_client *client, struct draft *draft)
{
    static struct control_item items[MOST_ITEMS];
    struct control_build build = {.priority = (int32_t)wrong_below(wrong, 3) - 1, .items = items};
    build.item_count = (uint32_t)(one_in(wrong, 50) ? wrong_below(wrong, MOST_ITEMS + 1) : wrong_below(wrong, 20));
    enum control_source source = (enum control_source)wrong_below(wrong, 3);
    if (source == SOURCE_MEMFD)
        build.memfd_count = (uint32_t)wrong_below(wrong, 4) + 1;
    for (uint32_t i = 0; i < build.memfd_count; i++)
        build.memfd_sizes[i] = one_in(wrong, 8) ? odd_value(wrong) : POOL_SIZE;
    for (uint32_t i = 0; i < build.item_count; i++)
        items[i] = make_item(wrong, source);
    if (source == SOURCE_INLINE)
        draft->frame.inline_bytes = (struct bytes){wrong->payloads, PAYLOAD_SIZE};
    add_descriptors(wrong, draft, build.memfd_count);
    control_pack_build(&build, &client->memory, &draft->frame.control, NULL);
}

static void draft_get(struct wrong_frames *wrong, struct raw_client *client, struct draft *draft)
{
    static struct key keys[MOST_ITEMS];
    struct control_get get = {
        (uint32_t)(one_in(wrong, 20) ? wrong_below(wrong, MOST_ITEMS + 1) : wrong_below(wrong, 8)), keys};
    for (uint32_t i = 0; i < get.key_count; i++)
        keys[i] = wrong->keys[wrong_below(wrong, WRONG_KEYS)];
    control_pack_get(&get, &client->memory, &draft->frame.control, NULL);
}

static void draft_cancel(struct wrong_frames *wrong, struct raw_client *client, struct draft *draft)
{
    static uint32_t numbers[MOST_ITEMS];
    struct control_items items = {(uint32_t)(one_in(wrong, 2) ? 0 : wrong_below(wrong, 8)), numbers};
    for (uint32_t i = 0; i < items.count; i++)
        numbers[i] = (uint32_t)(one_in(wrong, 100) ? odd_value(wrong) : 0);
    draft->frame.header.request = client->last_request - wrong_below(wrong, 4);
    control_pack_items(&items, &client->memory, &draft->frame.control, NULL);
}

static void draft_pool(struct wrong_frames *wrong, struct raw_client *client, struct draft *draft)
{
    struct control_pool pool = {one_in(wrong, 4) ? odd_value(wrong) : POOL_SIZE};
    add_descriptors(wrong, draft, one_in(wrong, 20) ? 2 : 1);
    if (!one_in(wrong, 4))
        draft->descriptors[0] = wrong->pool_file;
    control_pack_pool(&pool, &client->memory, &draft->frame.control, NULL);
}

static void draft_other(struct wrong_frames *wrong, struct draft *draft)
{
    draft->frame.header.type =
        (uint16_t)(one_in(wrong, 20) ? wrong_below(wrong, 80) : FRAME_STATS + wrong_below(wrong, 2));
    if (one_in(wrong, 50))
        add_descriptors(wrong, draft, 1);
}

static void make_draft(struct wrong_frames *wrong, struct raw_client *client, struct draft *draft)
{
    uint64_t which = wrong_below(wrong, 20);
    draft->frame.header.request = ++client->last_request;
    draft->frame.header.type = which < 10   ? FRAME_BUILD
                               : which < 13 ? FRAME_GET
                               : which < 16 ? FRAME_CANCEL
                                            : FRAME_POOL;
    if (which < 10)
        draft_build(wrong, client, draft);
    else if (which < 13)
        draft_get(wrong, client, draft);
    else if (which < 16)
        draft_cancel(wrong, client, draft);
    else if (which < 17)
        draft_pool(wrong, client, draft);
    else
        draft_other(wrong, draft);
}

/* Changes some bytes of a frame. It is called rarely, because most changes end the connection. */
static void spoil_bytes(struct wrong_frames *wrong, unsigned char *bytes, size_t size)
{
    uint64_t area = one_in(wrong, 2) ? FRAME_HEADER_SIZE : size, changes = wrong_below(wrong, 4) + 1;
    for (uint64_t i = 0; i < changes; i++)
        bytes[wrong_below(wrong, area)] = (unsigned char)wrong_next(wrong);
}

static bool send_draft(struct wrong_frames *wrong, struct raw_client *client, const struct draft *draft)
{
    size_t size;
    unsigned char *bytes = raw_frame_bytes(&draft->frame, &size);
    bool breaks = one_in(wrong, 60), ends = one_in(wrong, 100);
    if (breaks)
        spoil_bytes(wrong, bytes, size);
    uint32_t count = draft->frame.descriptor_count;
    if (one_in(wrong, 100))
        count = (uint32_t)wrong_below(wrong, 6);
    int descriptors[6];
    for (int i = 0; i < 6; i++)
        descriptors[i] = (uint32_t)i < draft->frame.descriptor_count ? draft->descriptors[i] : wrong->wild_file;
    bool sent = raw_send(client, bytes, ends ? wrong_below(wrong, size) + 1 : size, descriptors, count);
    free(bytes);
    return sent && !ends;
}

/* ---- what comes back ---- */

static void note_key(struct wrong_frames *wrong, struct raw_client *client, const struct frame *frame)
{
    struct control_result *result = raw_result(client, frame);
    if (result && result->error.status == BVHD_OK)
        wrong->keys[wrong->key_count++ % WRONG_KEYS] = result->key;
    memory_free(&client->memory, result);
}

static bool take_answers(struct wrong_frames *wrong, struct raw_client *client)
{
    struct frame frame;
    bool closed = false;
    while (raw_receive(client, 0, &frame, &closed)) {
        if (frame.header.type == FRAME_RESULT)
            note_key(wrong, client, &frame);
        for (int i = 0; i < frame.header.descriptors; i++)
            close(frame.descriptors[i]);
        if (frame.header.type == FRAME_ERROR && frame.header.request == 0)
            return false;
    }
    return !closed;
}

/* Changes the pool while the daemon may be reading it. */
static void disturb_pool(struct wrong_frames *wrong)
{
    uint64_t at = wrong_below(wrong, POOL_SIZE / 4096) * 4096;
    if (one_in(wrong, 2))
        fallocate(wrong->pool_file, FALLOC_FL_PUNCH_HOLE | FALLOC_FL_KEEP_SIZE, (off_t)at, 64 * 1024);
    else
        memset(wrong->pool + at, (int)wrong_next(wrong), 4096);
    if (ftruncate(wrong->pool_file, 0) == 0)
        abort(); /* The pool is sealed against shrinking. */
}

bool wrong_send(struct wrong_frames *wrong, struct raw_client *client)
{
    struct draft draft = {.frame = {.header = {.type = 0}}};
    make_draft(wrong, client, &draft);
    bool sent = send_draft(wrong, client, &draft);
    drop_draft(client, &draft);
    if (one_in(wrong, 4))
        disturb_pool(wrong);
    bool reads = !one_in(wrong, 3);
    return sent && (!reads || take_answers(wrong, client)) && !one_in(wrong, 200);
}

bool wrong_connect(struct wrong_frames *wrong, struct raw_client *client, const char *path)
{
    const struct timeval patience = {.tv_usec = 100 * 1000};
    if (!raw_connect(client, path))
        return false;
    setsockopt(client->socket, SOL_SOCKET, SO_SNDTIMEO, &patience, sizeof patience);
    struct control_hello hello = {.version_min = CONTROL_VERSION, .version_max = CONTROL_VERSION, .software = "wrong"};
    struct raw_frame greeting = {.header = {.type = FRAME_HELLO}};
    if (one_in(wrong, 50))
        return true;
    control_pack_hello(&hello, &client->memory, &greeting.control, NULL);
    bool sent = raw_send_frame(client, &greeting);
    memory_free(&client->memory, (void *)(uintptr_t)greeting.control.data);
    if (sent && !one_in(wrong, 4)) {
        struct draft draft = {.frame = {.header = {.type = FRAME_POOL, .request = ++client->last_request}}};
        draft_pool(wrong, client, &draft);
        sent = raw_send_frame(client, &draft.frame);
        drop_draft(client, &draft);
    }
    if (!sent)
        raw_close(client);
    return sent;
}

void wrong_init(struct wrong_frames *wrong, uint64_t seed)
{
    *wrong = (struct wrong_frames){.state = seed * 0x2545f4914f6cdd1d, .payload_size = PAYLOAD_SIZE};
    wrong->payloads = calloc(1, PAYLOAD_SIZE + SLOT);
    wrong->pool_file = memfd_create("wrong-pool", MFD_CLOEXEC | MFD_ALLOW_SEALING);
    wrong->wild_file = memfd_create("wild", MFD_CLOEXEC | MFD_ALLOW_SEALING);
    if (!wrong->payloads || ftruncate(wrong->pool_file, POOL_SIZE) ||
        fcntl(wrong->pool_file, F_ADD_SEALS, F_SEAL_SHRINK | F_SEAL_GROW))
        exit(1);
    wrong->pool = mmap(NULL, POOL_SIZE, PROT_READ | PROT_WRITE, MAP_SHARED, wrong->pool_file, 0);
    for (uint64_t at = 0; at < POOL_SIZE; at += SLOT)
        write_payload(wrong, &kinds[at / SLOT % KINDS], wrong->pool + at);
    wrong->sealed_file = raw_memfd(wrong->pool, POOL_SIZE, F_SEAL_SHRINK | F_SEAL_GROW | F_SEAL_WRITE | F_SEAL_SEAL);
}
