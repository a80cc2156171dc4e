/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_control.c - tests that control messages are packed and unpacked without loss, and that hostile values are
 * refused. test_control_hostile.c has messages that are made to be expensive.
 */
#include "tests/support/unit.h"

#include "tests/support/proto/messages.h"

static struct memory memory = {.limit = UINT64_MAX, .fail_after = -1};
static struct messages all;

#define PACK(name, message) (control_pack_##name(message, &memory, &packed, NULL))

static void *unpack(const struct messages_kind *kind, struct bytes bytes)
{
    void *message = NULL;
    struct bvhd_error error;
    if (kind->unpack(bytes, &memory, &message, &error) != BVHD_OK)
        fail_msg("%s: %s: %s", kind->name, error.where, error.text);
    assert_non_null(message);
    return message;
}

static const struct messages_kind *kind_of(const char *name)
{
    for (int i = 0; i < MESSAGES_KINDS; i++)
        if (strcmp(messages_kinds[i].name, name) == 0)
            return &messages_kinds[i];
    return NULL;
}

/* Packs and unpacks a message, and frees the bytes. */
static void *there_and_back(const char *name, const void *message)
{
    const struct messages_kind *kind = kind_of(name);
    struct bytes packed;
    assert_int_equal(kind->pack(message, &memory, &packed, NULL), BVHD_OK);
    void *back = unpack(kind, packed);
    messages_free(packed, &memory);
    return back;
}

/* Structs without relevant padding are compared as bytes: both were zeroed first. */
static void compare_plain(const char *name, const void *message, size_t size)
{
    void *back = there_and_back(name, message);
    assert_memory_equal(back, message, size);
    memory_free(&memory, back);
    assert_int_equal(memory.live, 0);
}

static void plain_messages_come_back(void **state)
{
    (void)state;
    messages_fill(&all);
    compare_plain("hello", &all.hello, sizeof all.hello);
    compare_plain("welcome", &all.welcome, sizeof all.welcome);
    compare_plain("pool", &all.pool, sizeof all.pool);
    compare_plain("error", &all.error, sizeof all.error);
    compare_plain("busy", &all.busy, sizeof all.busy);
    compare_plain("clients", &all.clients, sizeof all.clients);
    compare_plain("cache", &all.cache, sizeof all.cache);
    compare_plain("cache_state", &all.cache_state, sizeof all.cache_state);
    compare_plain("released", &all.released, sizeof all.released);
}

static void builds_come_back(void **state)
{
    (void)state;
    messages_fill(&all);
    for (int32_t priority = -3; priority < 4; priority++) {
        all.build.priority = priority == 3 ? INT32_MIN : priority;
        struct control_build *back = there_and_back("build", &all.build);
        assert_int_equal(back->priority, all.build.priority);
        assert_int_equal(back->deadline_ms, all.build.deadline_ms);
        assert_int_equal(back->memfd_count, 3);
        assert_memory_equal(back->memfd_sizes, all.build.memfd_sizes, sizeof all.build.memfd_sizes);
        assert_int_equal(back->item_count, MESSAGES_ITEMS);
        for (int i = 0; i < MESSAGES_ITEMS; i++) {
            const struct control_item *a = &back->items[i], *b = &all.build_items[i];
            assert_true(a->type == b->type && a->flags == b->flags && a->mode == b->mode);
            assert_true(a->destination == b->destination && a->source == b->source);
            assert_true(a->quality == b->quality && a->target == b->target && a->layout_flags == b->layout_flags);
            assert_true(a->geometry_count == b->geometry_count && a->geometry_size == b->geometry_size);
            assert_true(a->reference_count == b->reference_count && a->reference_size == b->reference_size);
            assert_true(a->payload_source == b->payload_source && a->memfd == b->memfd);
            assert_true(a->payload_offset == b->payload_offset && a->payload_size == b->payload_size);
            assert_memory_equal(&a->device, &b->device, sizeof a->device);
            assert_true(a->rays_per_primitive == b->rays_per_primitive && a->builder == b->builder);
            assert_true(key_equal(&a->source_key, &b->source_key));
        }
        memory_free(&memory, back);
    }
    assert_int_equal(memory.live, 0);
}

static void lists_come_back(void **state)
{
    (void)state;
    messages_fill(&all);
    struct control_get *get = there_and_back("get", &all.get);
    assert_int_equal(get->key_count, MESSAGES_ITEMS);
    assert_memory_equal(get->keys, all.keys, sizeof all.keys);
    memory_free(&memory, get);
    struct control_items *items = there_and_back("items", &all.items);
    assert_int_equal(items->count, MESSAGES_ITEMS);
    assert_memory_equal(items->items, all.numbers, sizeof all.numbers);
    memory_free(&memory, items);
    struct control_progress *progress = there_and_back("progress", &all.progress);
    assert_int_equal(progress->count, MESSAGES_ITEMS);
    assert_memory_equal(progress->items, all.numbers, sizeof all.numbers);
    assert_memory_equal(progress->thousandths, all.thousandths, sizeof all.thousandths);
    memory_free(&memory, progress);
    struct control_counters *counters = there_and_back("counters", &all.counters);
    assert_int_equal(counters->count, MESSAGES_COUNTERS);
    assert_memory_equal(counters->counters, all.rows, sizeof all.rows);
    assert_string_equal(counters->version, all.counters.version);
    memory_free(&memory, counters);
    assert_int_equal(memory.live, 0);
}

static void clients_come_back(void **state)
{
    (void)state;
    messages_fill(&all);
    struct control_client_list *list = there_and_back("client_list", &all.client_list);
    assert_int_equal(list->total, all.client_list.total);
    assert_int_equal(list->hidden, all.client_list.hidden);
    assert_int_equal(list->count, MESSAGES_CLIENTS);
    for (uint32_t i = 0; i < MESSAGES_CLIENTS; i++) {
        const struct control_client *a = &list->clients[i], *b = &all.client_rows[i];
        assert_true(a->connection == b->connection && a->uid == b->uid && a->pid == b->pid);
        assert_true(a->connected_ms == b->connected_ms && a->busy_ms == b->busy_ms);
        assert_true(a->memory_bytes == b->memory_bytes && a->result_bytes == b->result_bytes);
        assert_true(a->pool_bytes == b->pool_bytes && a->requests == b->requests && a->items == b->items);
        assert_true(a->waiting == b->waiting && a->threads == b->threads && a->descriptors == b->descriptors);
        assert_string_equal(a->software, b->software);
    }
    memory_free(&memory, list);
    assert_int_equal(memory.live, 0);
}

/* Doubles keep every bit: NaN, infinities, negative zero. */
static void results_come_back(void **state)
{
    (void)state;
    messages_fill(&all);
    struct control_result *back = there_and_back("result", &all.result);
    assert_int_equal(back->item, 9);
    assert_int_equal(back->error.status, BVHD_OK);
    assert_memory_equal(&back->key, &all.result.key, sizeof back->key);
    assert_true(back->size == all.result.size && back->origin == all.result.origin);
    assert_memory_equal(&back->queued_ms, &all.result.queued_ms, sizeof(double));
    assert_memory_equal(&back->prepare_ms, &all.result.prepare_ms, sizeof(double));
    assert_memory_equal(&back->build_ms, &all.result.build_ms, sizeof(double));
    assert_memory_equal(&back->summary, &all.result.summary, sizeof back->summary);
    memory_free(&memory, back);
    all.result.error = all.error;
    back = there_and_back("result", &all.result);
    assert_memory_equal(&back->error, &all.error, sizeof all.error);
    struct summary none = {0};
    assert_memory_equal(&back->summary, &none, sizeof none);
    assert_true(back->size == 0 && back->origin == ORIGIN_NONE && back->item == 9);
    assert_memory_equal(&back->prepare_ms, &all.result.prepare_ms, sizeof(double));
    memory_free(&memory, back);
    assert_int_equal(memory.live, 0);
}

/* Messages whose fields are all 0 have no bytes, and no bytes unpack to such messages. */
static void empty_messages_have_no_bytes(void **state)
{
    (void)state;
    static const struct messages zero;
    for (int i = 0; i < MESSAGES_KINDS; i++) {
        const struct messages_kind *kind = &messages_kinds[i];
        bool result = strcmp(kind->name, "result") == 0; /* a result must have a key */
        struct bytes packed = {(const unsigned char *)"x", 1};
        void *back = NULL;
        assert_int_equal(kind->pack((const unsigned char *)&zero + kind->member, &memory, &packed, NULL), BVHD_OK);
        assert_int_equal(packed.size == 0 && packed.data == NULL, !result);
        assert_int_equal(kind->unpack((struct bytes){NULL, 0}, &memory, &back, NULL), result ? BVHD_CORRUPT : BVHD_OK);
        memory_free(&memory, back);
        messages_free(packed, &memory);
        assert_int_equal(memory.live, 0);
    }
    struct control_items none = {0}, *items = there_and_back("items", &none);
    assert_int_equal(items->count, 0);
    memory_free(&memory, items);
}

/*
 * Checks how a string is unpacked. Field 3 of Hello and field 4 of Error are strings that an untrusted peer may have
 * sent.
 */
static void check_text(const char *sent, size_t length, const char *want)
{
    unsigned char bytes[1000] = {3 << 3 | 2, (unsigned char)(0x80 | (length & 0x7f)), (unsigned char)(length >> 7)};
    memcpy(bytes + 3, sent, length);
    struct control_hello *hello = unpack(kind_of("hello"), (struct bytes){bytes, 3 + length});
    assert_string_equal(hello->software, want);
    memory_free(&memory, hello);
}

static void texts_are_cut_and_cleaned(void **state)
{
    (void)state;
    char text[900], want[CONTROL_NAME_SIZE];
    memset(text, 'a', sizeof text);
    memset(want, 'a', sizeof want);
    want[63] = '\0';
    check_text(text, 63, want);
    check_text(text, 64, want);
    check_text(text, 900, want);
    memcpy(text + 60, "\xe2\x82\xac", 3);
    memcpy(want + 60, "\xe2\x82\xac", 3);
    check_text(text, 900, want);
    memcpy(text + 61, "\xe2\x82\xac", 3);
    want[60] = 'a';
    text[60] = 'a';
    want[61] = '\0';
    check_text(text, 900, want);
    memset(text, 0x80, sizeof text); /* there is no character at which to cut */
    check_text(text, 900, "");
    check_text("a\nb\tc\x7f\x1b[31m", 11, "a b c  [31m");
    check_text("two\0parts", 9, "two");
}

/* Fields of a newer peer, at the end and at the beginning, of every wire type. */
static void unknown_fields_are_ignored(void **state)
{
    (void)state;
    static const unsigned char fields[] = {
        0x80, 0x7d, 0x96, 0x01, /* field 2000, varint */
        0x81, 0x7d, 1,    2,    3,   4,   5, 6, 7, 8, /* 64 bits */
        0x82, 0x7d, 3,    'a',  'b', 'c', /* bytes */
        0x85, 0x7d, 1,    2,    3,   4, /* 32 bits */
    };
    for (int i = 0; i < MESSAGES_KINDS; i++) {
        const struct messages_kind *kind = &messages_kinds[i];
        struct bytes packed = messages_sample(kind, &memory), again;
        unsigned char *longer = malloc(packed.size + 2 * sizeof fields);
        memcpy(longer, fields, sizeof fields);
        memcpy(longer + sizeof fields, packed.data, packed.size);
        memcpy(longer + sizeof fields + packed.size, fields, sizeof fields);
        void *message = unpack(kind, (struct bytes){longer, packed.size + 2 * sizeof fields});
        assert_int_equal(kind->pack(message, &memory, &again, NULL), BVHD_OK);
        assert_int_equal(again.size, packed.size);
        assert_memory_equal(again.data, packed.data, packed.size);
        memory_free(&memory, message);
        messages_free(packed, &memory);
        messages_free(again, &memory);
        free(longer);
        assert_int_equal(memory.live, 0);
    }
}

/* A message that is cut anywhere is refused, or its last fields are missing. */
static void truncations_hold_nothing(void **state)
{
    (void)state;
    for (int i = 0; i < MESSAGES_KINDS; i++) {
        const struct messages_kind *kind = &messages_kinds[i];
        struct bytes packed = messages_sample(kind, &memory);
        uint32_t corrupt = 0;
        for (uint64_t size = 0; size < packed.size; size++) {
            unsigned char *exact = malloc(size ? size : 1);
            memcpy(exact, packed.data, size);
            void *message = NULL;
            struct bvhd_error error;
            enum bvhd_status status = kind->unpack((struct bytes){exact, size}, &memory, &message, &error);
            assert_true(status == BVHD_OK || status == BVHD_CORRUPT);
            assert_int_equal(message != NULL, status == BVHD_OK);
            corrupt += status == BVHD_CORRUPT;
            memory_free(&memory, message);
            free(exact);
        }
        assert_true(corrupt >= packed.size / 2);
        unsigned char *longer = malloc(packed.size + 1); /* one byte more starts a field that does not end */
        memcpy(longer, packed.data, packed.size);
        longer[packed.size] = 0x80;
        void *message;
        assert_int_equal(kind->unpack((struct bytes){longer, packed.size + 1}, &memory, &message, NULL), BVHD_CORRUPT);
        free(longer);
        messages_free(packed, &memory);
        assert_int_equal(memory.live, 0);
    }
}

static void numbers_that_nobody_knows_come_through(void **state)
{
    (void)state;
    messages_fill(&all);
    all.error.status = (enum bvhd_status)4000000000u;
    all.error.vuid = (enum bvhd_vuid)3000000000u;
    compare_plain("error", &all.error, sizeof all.error);
    all.result.error = all.error;
    all.result.origin = UINT32_MAX;
    struct control_result *back = there_and_back("result", &all.result);
    assert_true((uint32_t)back->error.status == 4000000000u && (uint32_t)back->error.vuid == 3000000000u);
    assert_string_equal(bvhd_vuid_string(back->error.vuid), "");
    assert_string_equal(bvhd_status_name(back->error.status), "UNKNOWN");
    memory_free(&memory, back);
}

/* Builds fields as another implementation might send them. */
struct writing {
    unsigned char *bytes;
    uint64_t size;
};

static void put_varint(struct writing *writing, uint64_t value)
{
    for (; value >= 0x80; value >>= 7)
        writing->bytes[writing->size++] = (unsigned char)(0x80 | (value & 0x7f));
    writing->bytes[writing->size++] = (unsigned char)value;
}

/* Appends a field of `size` bytes, all equal to `fill`. */
static void put_block(struct writing *writing, uint32_t field, uint64_t size, int fill)
{
    put_varint(writing, field << 3 | 2);
    put_varint(writing, size);
    memset(writing->bytes + writing->size, fill, size);
    writing->size += size;
}

static void refuse(const char *name, struct writing *writing, enum bvhd_status want, const char *where)
{
    void *message = NULL;
    struct bvhd_error error = {0};
    assert_int_equal(kind_of(name)->unpack((struct bytes){writing->bytes, writing->size}, &memory, &message, &error),
                     want);
    if (want == BVHD_OK)
        memory_free(&memory, message);
    else
        assert_string_equal(error.where, where);
    assert_int_equal(memory.live, 0);
    writing->size = 0;
}

static void put_items(struct writing *writing, uint32_t item_size, uint64_t bytes, int fill)
{
    put_varint(writing, 3 << 3);
    put_varint(writing, item_size);
    put_block(writing, 4, bytes, fill);
}

static void counts_and_sizes_are_checked(void **state)
{
    (void)state;
    struct writing writing = {malloc(4 << 20), 0};
    put_items(&writing, 80, 80 * CONTROL_MAX_ITEMS, 7);
    refuse("build", &writing, BVHD_OK, "");
    put_items(&writing, 80, 80 * (CONTROL_MAX_ITEMS + 1), 7);
    refuse("build", &writing, BVHD_TOO_LARGE, "build.items");
    put_items(&writing, 80, 81, 7);
    refuse("build", &writing, BVHD_CORRUPT, "build.items");
    put_items(&writing, 79, 79, 7);
    refuse("build", &writing, BVHD_CORRUPT, "build.items");
    put_items(&writing, 4097, 4097, 0);
    refuse("build", &writing, BVHD_TOO_LARGE, "build.items");
    put_items(&writing, 4096, 8192, 0);
    refuse("build", &writing, BVHD_OK, "");
    put_items(&writing, 120, 120 * CONTROL_MAX_ITEMS, 7);
    refuse("build", &writing, BVHD_OK, "");
    put_items(&writing, 124, 5 * 124, 7);
    refuse("build", &writing, BVHD_OK, "");
    put_items(&writing, 128, 5 * 128, 7);
    refuse("build", &writing, BVHD_UNSUPPORTED, "infos[0]");
    put_items(&writing, 160, 5 * 160, 0);
    writing.bytes[writing.size - 32] = 1; /* of the source's key, which is known */
    refuse("build", &writing, BVHD_OK, "");
    put_items(&writing, 160, 5 * 160, 0);
    writing.bytes[writing.size - 36] = 1; /* reserved */
    refuse("build", &writing, BVHD_UNSUPPORTED, "infos[4]");
    put_items(&writing, 161, 5 * 161, 0);
    writing.bytes[writing.size - 1] = 1;
    refuse("build", &writing, BVHD_UNSUPPORTED, "infos[4]");
    put_items(&writing, 128, 5 * 128, 0);
    writing.bytes[writing.size - 4] = 1;
    refuse("build", &writing, BVHD_UNSUPPORTED, "infos[4]");
    put_block(&writing, 4, 80, 0); /* the size of the rows is not declared */
    refuse("build", &writing, BVHD_CORRUPT, "build.items");
    put_block(&writing, 2, 4 * 8, 0);
    refuse("build", &writing, BVHD_OK, "");
    put_block(&writing, 2, 5 * 8, 0);
    refuse("build", &writing, BVHD_TOO_LARGE, "build.memfds");
    put_block(&writing, 1, CONTROL_MAX_ITEMS * KEY_SIZE, 0);
    refuse("get", &writing, BVHD_OK, "");
    put_block(&writing, 1, (CONTROL_MAX_ITEMS + 1) * KEY_SIZE, 0);
    refuse("get", &writing, BVHD_TOO_LARGE, "get.keys");
    put_block(&writing, 1, KEY_SIZE - 1, 0);
    refuse("get", &writing, BVHD_CORRUPT, "get.keys");
    put_block(&writing, 1, CONTROL_MAX_ITEMS * 4, 0);
    refuse("items", &writing, BVHD_OK, "");
    put_block(&writing, 1, (CONTROL_MAX_ITEMS + 1) * 4, 0);
    refuse("items", &writing, BVHD_TOO_LARGE, "items");
    put_block(&writing, 1, CONTROL_MAX_ITEMS * 4, 1);
    put_block(&writing, 2, CONTROL_MAX_ITEMS * 4, 0);
    refuse("progress", &writing, BVHD_OK, "");
    put_block(&writing, 1, (CONTROL_MAX_ITEMS + 1) * 4, 1);
    put_block(&writing, 2, (CONTROL_MAX_ITEMS + 1) * 4, 0);
    refuse("progress", &writing, BVHD_TOO_LARGE, "progress.items");
    put_block(&writing, 1, 8, 0);
    put_block(&writing, 2, 4, 0);
    refuse("progress", &writing, BVHD_CORRUPT, "progress.thousandths");
    put_block(&writing, 1, 4, 0);
    put_block(&writing, 2, 4, 4);
    refuse("progress", &writing, BVHD_CORRUPT, "progress.thousandths");
    for (int i = 0; i < CONTROL_MAX_COUNTERS; i++)
        put_block(&writing, 1, 0, 0);
    refuse("counters", &writing, BVHD_OK, "");
    for (int i = 0; i < CONTROL_MAX_COUNTERS + 1; i++)
        put_block(&writing, 1, 0, 0);
    refuse("counters", &writing, BVHD_TOO_LARGE, "counters");
    put_block(&writing, 6, KEY_SIZE, 0);
    refuse("result", &writing, BVHD_OK, "");
    put_block(&writing, 6, KEY_SIZE + 1, 0);
    refuse("result", &writing, BVHD_CORRUPT, "result.key");
    put_block(&writing, 6, KEY_SIZE, 0);
    put_block(&writing, 29, 20, 0);
    refuse("result", &writing, BVHD_CORRUPT, "result.bounds");
    put_block(&writing, 6, KEY_SIZE, 0);
    put_block(&writing, 31, 80, 0);
    refuse("result", &writing, BVHD_OK, "");
    put_block(&writing, 6, KEY_SIZE, 0);
    put_block(&writing, 31, 76, 0);
    refuse("result", &writing, BVHD_CORRUPT, "result.slabs");
    free(writing.bytes);
}

static void put_clients(struct writing *writing, uint32_t client_size, uint64_t bytes, int fill)
{
    put_varint(writing, 1 << 3);
    put_varint(writing, client_size);
    put_block(writing, 2, bytes, fill);
}

/* Rows of a newer daemon are longer. A software without a NUL is cut, and takes no bytes from the next row. */
static void client_rows_are_checked(void **state)
{
    (void)state;
    struct writing writing = {malloc(4 << 20), 0};
    put_clients(&writing, 144, 144 * CONTROL_MAX_CLIENTS, 7);
    refuse("client_list", &writing, BVHD_OK, "");
    put_clients(&writing, 144, 144 * (CONTROL_MAX_CLIENTS + 1), 7);
    refuse("client_list", &writing, BVHD_TOO_LARGE, "client_list.clients");
    put_clients(&writing, 144, 145, 7);
    refuse("client_list", &writing, BVHD_CORRUPT, "client_list.clients");
    put_clients(&writing, 143, 143, 7);
    refuse("client_list", &writing, BVHD_CORRUPT, "client_list.clients");
    put_clients(&writing, 4097, 4097, 7);
    refuse("client_list", &writing, BVHD_TOO_LARGE, "client_list.clients");
    put_block(&writing, 2, 144, 7); /* the size of the rows is not declared */
    refuse("client_list", &writing, BVHD_CORRUPT, "client_list.clients");
    put_clients(&writing, 160, 3 * 160, 'a');
    struct control_client_list *list = unpack(kind_of("client_list"), (struct bytes){writing.bytes, writing.size});
    assert_int_equal(list->count, 3);
    for (uint32_t i = 0; i < list->count; i++)
        assert_int_equal(strlen(list->clients[i].software), CONTROL_NAME_SIZE - 1);
    memory_free(&memory, list);
    struct control_client_list many = {.count = CONTROL_MAX_CLIENTS + 1};
    struct bytes packed;
    assert_int_equal(control_pack_client_list(&many, &memory, &packed, NULL), BVHD_TOO_LARGE);
    assert_int_equal(memory.live, 0);
    free(writing.bytes);
}

/*
 * Item rows of every size that some version may send: the fields that they have are read, those that they lack are 0,
 * and no row takes bytes from the next one.
 */
static void older_rows_lack_their_end(void **state)
{
    (void)state;
    enum { ROWS = 3 };
    unsigned char whole[160];
    for (size_t i = 0; i < sizeof whole; i++)
        whole[i] = i >= 124 && i < 128 ? 0 : (unsigned char)(i + 1);
    for (uint32_t size = 80; size <= 192; size += 4) {
        struct writing writing = {malloc(1000), 0};
        uint32_t known = size < sizeof whole ? size : sizeof whole;
        put_items(&writing, size, (uint64_t)ROWS * size, 0);
        for (uint32_t row = 0; row < ROWS; row++)
            memcpy(writing.bytes + writing.size - (uint64_t)(row + 1) * size, whole, known);
        struct control_build *build = unpack(kind_of("build"), (struct bytes){writing.bytes, writing.size});
        assert_int_equal(build->item_count, ROWS);
        for (uint32_t row = 0; row < ROWS; row++) {
            struct device_format want = {{0}, {0}, 0};
            memcpy(&want, whole + 80, (known < 116 ? known : 116) - 80);
            assert_memory_equal(&build->items[row].device, &want, sizeof want);
            float rays = 0;
            if (known >= 120)
                memcpy(&rays, whole + 116, sizeof rays);
            assert_true(build->items[row].rays_per_primitive == rays);
            assert_int_equal(build->items[row].builder, known >= 124 ? 0x7c7b7a79 : 0);
            struct key source = {{0}};
            if (known > 128)
                memcpy(&source, whole + 128, known - 128);
            assert_true(key_equal(&build->items[row].source_key, &source));
            assert_int_equal(build->items[row].type, 0x04030201);
            assert_true(build->items[row].payload_size == UINT64_C(0x504f4e4d4c4b4a49));
        }
        memory_free(&memory, build);
        free(writing.bytes);
    }
    assert_int_equal(memory.live, 0);
}

/* The largest message that is allowed, with the longest names, fits into its heap. */
static void the_largest_messages_fit(void **state)
{
    (void)state;
    static struct control_counter rows[CONTROL_MAX_COUNTERS + 1];
    for (int i = 0; i <= CONTROL_MAX_COUNTERS; i++) {
        memset(rows[i].name, 'x', sizeof rows[i].name - 1);
        rows[i].value = UINT64_MAX;
    }
    for (size_t length = 1; length < CONTROL_NAME_SIZE; length += 2) {
        for (int i = 0; i <= CONTROL_MAX_COUNTERS; i++)
            rows[i].name[length] = '\0';
        struct control_counters counters = {.count = CONTROL_MAX_COUNTERS, .counters = rows},
                                *back = there_and_back("counters", &counters);
        for (int i = 0; i < CONTROL_MAX_COUNTERS; i++) {
            assert_string_equal(back->counters[i].name, rows[i].name);
            assert_true(back->counters[i].value == UINT64_MAX);
        }
        memory_free(&memory, back);
        for (int i = 0; i <= CONTROL_MAX_COUNTERS; i++)
            rows[i].name[length] = 'x';
    }
    struct bytes packed;
    assert_int_equal(PACK(counters, (&(struct control_counters){.count = CONTROL_MAX_COUNTERS + 1, .counters = rows})),
                     BVHD_TOO_LARGE);
    struct control_item *items = calloc(CONTROL_MAX_ITEMS + 1, sizeof *items);
    struct control_build build = {.item_count = CONTROL_MAX_ITEMS, .items = items};
    memory_free(&memory, there_and_back("build", &build));
    build.item_count++;
    assert_int_equal(PACK(build, &build), BVHD_TOO_LARGE);
    build = (struct control_build){.memfd_count = CONTROL_MAX_MEMFDS + 1};
    assert_int_equal(PACK(build, &build), BVHD_TOO_LARGE);
    assert_int_equal(PACK(get, (&(struct control_get){CONTROL_MAX_ITEMS + 1, NULL})), BVHD_TOO_LARGE);
    assert_int_equal(PACK(items, (&(struct control_items){CONTROL_MAX_ITEMS + 1, NULL})), BVHD_TOO_LARGE);
    assert_int_equal(PACK(progress, (&(struct control_progress){CONTROL_MAX_ITEMS + 1, NULL, NULL})), BVHD_TOO_LARGE);
    free(items);
    assert_int_equal(memory.live, 0);
}

static void failing_allocations_hold_nothing(void **state)
{
    (void)state;
    for (int i = 0; i < MESSAGES_KINDS; i++) {
        const struct messages_kind *kind = &messages_kinds[i];
        /* The bytes, and two blocks to unpack them; lists of structs are rows first. */
        int needed = 3 + (strcmp(kind->name, "build") == 0 || strcmp(kind->name, "client_list") == 0);
        enum bvhd_status status = BVHD_NO_MEMORY;
        messages_fill(&all);
        for (int failures = 0; status == BVHD_NO_MEMORY; failures++) {
            struct bytes packed = {NULL, 0};
            void *message = NULL;
            atomic_store(&memory.fail_after, failures);
            status = kind->pack((const unsigned char *)&all + kind->member, &memory, &packed, NULL);
            if (status == BVHD_OK)
                status = kind->unpack(packed, &memory, &message, NULL);
            assert_true(status == BVHD_OK || status == BVHD_NO_MEMORY);
            assert_int_equal(status == BVHD_OK, failures >= needed);
            memory_free(&memory, message);
            messages_free(packed, &memory);
            assert_int_equal(memory.live, 0);
        }
    }
    atomic_store(&memory.fail_after, -1);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(plain_messages_come_back),
        cmocka_unit_test(builds_come_back),
        cmocka_unit_test(lists_come_back),
        cmocka_unit_test(clients_come_back),
        cmocka_unit_test(client_rows_are_checked),
        cmocka_unit_test(results_come_back),
        cmocka_unit_test(empty_messages_have_no_bytes),
        cmocka_unit_test(texts_are_cut_and_cleaned),
        cmocka_unit_test(unknown_fields_are_ignored),
        cmocka_unit_test(truncations_hold_nothing),
        cmocka_unit_test(numbers_that_nobody_knows_come_through),
        cmocka_unit_test(counts_and_sizes_are_checked),
        cmocka_unit_test(older_rows_lack_their_end),
        cmocka_unit_test(the_largest_messages_fit),
        cmocka_unit_test(failing_allocations_hold_nothing),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
