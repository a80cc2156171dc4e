/* SPDX-License-Identifier: Apache-2.0 */
/* The small control messages; control_build.c and control_result.c have the others. */
#include "proto/wire/control_codec.h"

#include "proto/wire/bvhd.pb-c.h"

enum bvhd_status control_pack_hello(const struct control_hello *hello, struct memory *memory, struct bytes *ret_bytes,
                                    struct bvhd_error *error)
{
    Bvhd__Hello message;
    bvhd__hello__init(&message);
    message.version_min = hello->version_min;
    message.version_max = hello->version_max;
    message.software = control_constant(hello->software);
    message.progress_ms = hello->progress_ms;
    message.releases = hello->releases;
    return control_encode(&message.base, memory, ret_bytes, error);
}

static void fill_hello(const void *from, void *ret_plain)
{
    const Bvhd__Hello *message = from;
    struct control_hello *hello = ret_plain;
    hello->version_min = message->version_min;
    hello->version_max = message->version_max;
    control_copy_text(message->software, sizeof hello->software, hello->software);
    hello->progress_ms = message->progress_ms;
    hello->releases = message->releases != 0;
}

static const struct control_kind hello_kind = {"hello", &bvhd__hello__descriptor, sizeof(struct control_hello), NULL,
                                               fill_hello};
CONTROL_UNPACK(hello, struct control_hello)

enum bvhd_status control_pack_welcome(const struct control_welcome *welcome, struct memory *memory,
                                      struct bytes *ret_bytes, struct bvhd_error *error)
{
    Bvhd__Welcome message;
    bvhd__welcome__init(&message);
    message.version = welcome->version;
    message.software = control_constant(welcome->software);
    message.credits = welcome->credits;
    message.max_items = welcome->max_items;
    message.max_control = welcome->max_control;
    message.max_inline = welcome->max_inline;
    message.max_pool = welcome->max_pool;
    message.max_payload = welcome->max_payload;
    message.max_held = welcome->max_held;
    message.builders = welcome->builders;
    message.updates = welcome->updates;
    message.micromaps = welcome->micromaps;
    return control_encode(&message.base, memory, ret_bytes, error);
}

static void fill_welcome(const void *from, void *ret_plain)
{
    const Bvhd__Welcome *message = from;
    struct control_welcome *welcome = ret_plain;
    welcome->version = message->version;
    control_copy_text(message->software, sizeof welcome->software, welcome->software);
    welcome->credits = message->credits;
    welcome->max_items = message->max_items;
    welcome->max_control = message->max_control;
    welcome->max_inline = message->max_inline;
    welcome->max_pool = message->max_pool;
    welcome->max_payload = message->max_payload;
    welcome->max_held = message->max_held;
    welcome->builders = message->builders;
    welcome->updates = message->updates != 0;
    welcome->micromaps = message->micromaps != 0;
}

static const struct control_kind welcome_kind = {"welcome", &bvhd__welcome__descriptor, sizeof(struct control_welcome),
                                                 NULL, fill_welcome};
CONTROL_UNPACK(welcome, struct control_welcome)

enum bvhd_status control_pack_released(const struct control_released *released, struct memory *memory,
                                       struct bytes *ret_bytes, struct bvhd_error *error)
{
    Bvhd__Released message;
    bvhd__released__init(&message);
    message.bytes = released->bytes;
    return control_encode(&message.base, memory, ret_bytes, error);
}

static void fill_released(const void *from, void *ret_plain)
{
    const Bvhd__Released *message = from;
    struct control_released *released = ret_plain;
    released->bytes = message->bytes;
}

static const struct control_kind released_kind = {"released", &bvhd__released__descriptor,
                                                  sizeof(struct control_released), NULL, fill_released};
CONTROL_UNPACK(released, struct control_released)

enum bvhd_status control_pack_pool(const struct control_pool *pool, struct memory *memory, struct bytes *ret_bytes,
                                   struct bvhd_error *error)
{
    Bvhd__Pool message;
    bvhd__pool__init(&message);
    message.size = pool->size;
    return control_encode(&message.base, memory, ret_bytes, error);
}

static void fill_pool(const void *from, void *ret_plain)
{
    const Bvhd__Pool *message = from;
    struct control_pool *pool = ret_plain;
    pool->size = message->size;
}

static const struct control_kind pool_kind = {"pool", &bvhd__pool__descriptor, sizeof(struct control_pool), NULL,
                                              fill_pool};
CONTROL_UNPACK(pool, struct control_pool)

enum bvhd_status control_pack_busy(const struct control_busy *busy, struct memory *memory, struct bytes *ret_bytes,
                                   struct bvhd_error *error)
{
    Bvhd__Busy message;
    bvhd__busy__init(&message);
    message.retry_ms = busy->retry_ms;
    return control_encode(&message.base, memory, ret_bytes, error);
}

static void fill_busy(const void *from, void *ret_plain)
{
    const Bvhd__Busy *message = from;
    struct control_busy *busy = ret_plain;
    busy->retry_ms = message->retry_ms;
}

static const struct control_kind busy_kind = {"busy", &bvhd__busy__descriptor, sizeof(struct control_busy), NULL,
                                              fill_busy};
CONTROL_UNPACK(busy, struct control_busy)

enum bvhd_status control_pack_counters(const struct control_counters *counters, struct memory *memory,
                                       struct bytes *ret_bytes, struct bvhd_error *error)
{
    if (counters->count > CONTROL_MAX_COUNTERS)
        return bvhd_error_set(error, BVHD_TOO_LARGE, "counters", "%u of them", counters->count);
    Bvhd__Counter rows[CONTROL_MAX_COUNTERS];
    Bvhd__Counter *pointers[CONTROL_MAX_COUNTERS];
    for (uint32_t i = 0; i < counters->count; i++) {
        bvhd__counter__init(&rows[i]);
        rows[i].name = control_constant(counters->counters[i].name);
        rows[i].value = counters->counters[i].value;
        pointers[i] = &rows[i];
    }
    Bvhd__Counters message;
    bvhd__counters__init(&message);
    message.n_counters = counters->count;
    message.counters = pointers;
    message.version = control_constant(counters->version);
    return control_encode(&message.base, memory, ret_bytes, error);
}

static enum bvhd_status check_counters(const void *from, uint64_t *ret_extra, struct bvhd_error *error)
{
    const Bvhd__Counters *message = from;
    if (message->n_counters > CONTROL_MAX_COUNTERS)
        return bvhd_error_set(error, BVHD_TOO_LARGE, "counters", "%zu of them", message->n_counters);
    *ret_extra = message->n_counters * sizeof(struct control_counter);
    return BVHD_OK;
}

static void fill_counters(const void *from, void *ret_plain)
{
    const Bvhd__Counters *message = from;
    struct control_counters *counters = ret_plain;
    counters->count = (uint32_t)message->n_counters;
    counters->counters = (struct control_counter *)(counters + 1);
    control_copy_text(message->version, sizeof counters->version, counters->version);
    for (uint32_t i = 0; i < counters->count; i++) {
        struct control_counter *counter = &counters->counters[i];
        memset(counter, 0, sizeof *counter);
        control_copy_text(message->counters[i]->name, sizeof counter->name, counter->name);
        counter->value = message->counters[i]->value;
    }
}

static const struct control_kind counters_kind = {"counters", &bvhd__counters__descriptor,
                                                  sizeof(struct control_counters), check_counters, fill_counters};
CONTROL_UNPACK(counters, struct control_counters)
