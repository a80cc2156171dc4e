/* SPDX-License-Identifier: Apache-2.0 */
#include "client/exchange.h"

#include "client/library.h"

enum { SLOT_BITS = 16, FIRST_SLOTS = 16, MAX_SLOTS = 1 << SLOT_BITS };

struct exchange *exchange_create(enum frame_type type, uint32_t capacity)
{
    uint64_t size;
    struct exchange *exchange = NULL;
    if (bytes_mul(capacity, sizeof exchange->entries[0], &size) && bytes_add(size, sizeof *exchange, &size))
        exchange = memory_alloc(&library_memory, size);
    if (exchange)
        *exchange = (struct exchange){.type = type, .expects = true};
    return exchange;
}

void exchange_drop_frame(struct exchange *exchange)
{
    memory_free(&library_memory, (void *)(uintptr_t)exchange->control.data);
    memory_free(&library_memory, (void *)(uintptr_t)exchange->inline_bytes.data);
    exchange->control = exchange->inline_bytes = (struct bytes){NULL, 0};
    exchange->descriptor_count = 0;
}

void exchange_destroy(struct exchange *exchange)
{
    if (!exchange)
        return;
    exchange_drop_frame(exchange);
    memory_free(&library_memory, exchange);
}

void exchange_seal(struct exchange *exchange, uint64_t request)
{
    struct frame_header header = {
        .type = (uint16_t)exchange->type,
        .descriptors = (uint8_t)exchange->descriptor_count,
        .control_size = (uint32_t)exchange->control.size,
        .inline_size = (uint32_t)exchange->inline_bytes.size,
        .request = request,
    };
    frame_header_write(&header, exchange->header);
}

uint64_t exchange_frame_size(const struct exchange *exchange)
{
    return FRAME_HEADER_SIZE + exchange->control.size + exchange->inline_bytes.size;
}

void exchange_table_init(struct exchange_table *table)
{
    *table = (struct exchange_table){NULL, 0, 0, 0};
}

void exchange_table_finish(struct exchange_table *table)
{
    memory_free(&library_memory, table->slots);
    exchange_table_init(table);
}

static bool grow(struct exchange_table *table)
{
    uint32_t capacity = table->capacity ? table->capacity * 2 : FIRST_SLOTS;
    if (capacity > MAX_SLOTS)
        return false;
    struct exchange **slots = memory_resize(&library_memory, table->slots, (uint64_t)capacity * sizeof *slots);
    if (!slots)
        return false;
    for (uint32_t i = table->capacity; i < capacity; i++)
        slots[i] = NULL;
    table->slots = slots;
    table->capacity = capacity;
    return true;
}

/*
 * A number is the serial number of the exchange and its slot in the lower bits. The search for a free slot starts at
 * the serial number's own slot.
 */
bool exchange_table_add(struct exchange_table *table, struct exchange *exchange)
{
    if (table->count == table->capacity && !grow(table))
        return false;
    uint64_t serial = ++table->serial;
    uint32_t slot = (uint32_t)serial & (table->capacity - 1);
    while (table->slots[slot])
        slot = (slot + 1) & (table->capacity - 1);
    table->slots[slot] = exchange;
    table->count++;
    exchange->number = serial << SLOT_BITS | slot;
    return true;
}

struct exchange *exchange_table_find(const struct exchange_table *table, uint64_t number)
{
    uint64_t slot = number & (MAX_SLOTS - 1);
    struct exchange *exchange = slot < table->capacity ? table->slots[slot] : NULL;
    return exchange && exchange->number == number ? exchange : NULL;
}

void exchange_table_remove(struct exchange_table *table, struct exchange *exchange)
{
    table->slots[exchange->number & (MAX_SLOTS - 1)] = NULL;
    table->count--;
    exchange->number = 0;
}

bool exchange_is_prepared(const struct exchange *exchange)
{
    return exchange->type == FRAME_BUILD && exchange->unprepared < exchange->count;
}
