/* SPDX-License-Identifier: Apache-2.0 */
#include "daemon/service/cache.h"

#include "proto/base/container_of.h"
#include "proto/base/list.h"

struct entry {
    struct blob *blob; /* a ref */
    uint64_t cost; /* bytes, overhead included */
    uint64_t used; /* the cache's clock at its last use */
    struct list_link link; /* in the order of its kind */
};

/* Entries in the order of their last use: the first one is the least recently used. */
struct order {
    struct list list;
    uint64_t count;
};

/*
 * A hash table with open addressing and linear probing. It has no marks for deleted slots: later slots move up. Keys
 * are cryptographic hashes themselves.
 */
struct slot {
    uint64_t hash;
    struct entry *entry; /* NULL: free */
};

struct table {
    struct slot *slots; /* NULL while there are none */
    uint64_t capacity; /* 0 or a power of two */
    uint64_t count;
};

/*
 * Blobs in memory and blobs with a descriptor have an order each, so that the least recently used of either kind is
 * known. The field `used` compares entries of different kinds.
 */
enum kind { IN_MEMORY, WITH_DESCRIPTOR, KINDS };

/*
 * There is one table for each highest byte of a hash, so that growing a table moves few entries and does not stop the
 * loop.
 */
enum { TABLES = 256, FIRST_CAPACITY = 8 };

struct cache {
    struct memory *memory;
    struct table tables[TABLES];
    struct order orders[KINDS];
    uint64_t budget, bytes, evicted, clock;
    uint64_t forgotten; /* the clock at the last cache_clear: entries that have not been used since are forgotten */
};

struct cache *cache_create(uint64_t budget, struct memory *memory)
{
    struct cache *cache = memory_alloc(memory, sizeof *cache);
    if (cache)
        *cache = (struct cache){.memory = memory, .budget = budget};
    return cache;
}

static uint64_t count_entries(const struct cache *cache)
{
    return cache->orders[IN_MEMORY].count + cache->orders[WITH_DESCRIPTOR].count;
}

static uint64_t hash_of(const struct key *key)
{
    return bytes_get64(key->bytes);
}

static struct table *table_of(struct cache *cache, const struct key *key)
{
    return &cache->tables[hash_of(key) >> 56];
}

/* Returns the slot that holds `key`, or the free slot where it would go. A table with slots always has a free one. */
static uint64_t find_slot(const struct table *table, const struct key *key)
{
    uint64_t hash = hash_of(key), mask = table->capacity - 1, at = hash & mask;
    for (; table->slots[at].entry; at = (at + 1) & mask)
        if (table->slots[at].hash == hash && key_equal(&table->slots[at].entry->blob->key, key))
            break;
    return at;
}

static struct entry *find(struct cache *cache, const struct key *key)
{
    struct table *table = table_of(cache, key);
    return table->slots ? table->slots[find_slot(table, key)].entry : NULL;
}

static bool is_forgotten(const struct cache *cache, const struct entry *entry)
{
    return entry->used <= cache->forgotten;
}

static struct order *order_of(struct cache *cache, const struct entry *entry)
{
    return &cache->orders[entry->blob->descriptor >= 0 ? WITH_DESCRIPTOR : IN_MEMORY];
}

static void link_most_recent(struct cache *cache, struct entry *entry)
{
    struct order *order = order_of(cache, entry);
    entry->used = ++cache->clock;
    list_append(&order->list, &entry->link);
    order->count++;
}

static void unlink_entry(struct cache *cache, struct entry *entry)
{
    struct order *order = order_of(cache, entry);
    list_remove(&order->list, &entry->link);
    order->count--;
}

/* NULL if there is none. */
static struct entry *least_recent_of(const struct order *order)
{
    return order->list.first ? container_of(order->list.first, struct entry, link) : NULL;
}

/* Frees a slot, and moves entries up that were inserted behind it because it was taken. */
static void clear_slot(struct table *table, uint64_t gap)
{
    uint64_t mask = table->capacity - 1;
    for (uint64_t at = (gap + 1) & mask; table->slots[at].entry; at = (at + 1) & mask) {
        uint64_t home = table->slots[at].hash & mask;
        if (((at - home) & mask) < ((at - gap) & mask))
            continue;
        table->slots[gap] = table->slots[at];
        gap = at;
    }
    table->slots[gap] = (struct slot){.entry = NULL};
    table->count--;
}

static void drop(struct cache *cache, struct entry *entry)
{
    unlink_entry(cache, entry);
    cache->bytes -= entry->cost;
    blob_unref(entry->blob);
    memory_free(cache->memory, entry);
}

static void evict(struct cache *cache, struct entry *entry)
{
    struct table *table = table_of(cache, &entry->blob->key);
    clear_slot(table, find_slot(table, &entry->blob->key));
    drop(cache, entry);
    cache->evicted++;
}

void cache_destroy(struct cache *cache)
{
    if (!cache)
        return;
    for (int kind = 0; kind < KINDS; kind++)
        while (cache->orders[kind].count > 0)
            drop(cache, least_recent_of(&cache->orders[kind]));
    for (int i = 0; i < TABLES; i++)
        memory_free(cache->memory, cache->tables[i].slots);
    memory_free(cache->memory, cache);
}

void cache_resize(struct cache *cache, uint64_t budget)
{
    cache->budget = budget;
}

/* The ref of this function keeps the blob if the callback puts another one, for which this one is evicted. */
void cache_get(struct cache *cache, const struct key *key, cache_answer answer, void *context)
{
    struct entry *entry = find(cache, key);
    if (!entry || is_forgotten(cache, entry)) {
        answer(context, NULL);
        return;
    }
    unlink_entry(cache, entry);
    link_most_recent(cache, entry);
    struct blob *blob = blob_ref(entry->blob);
    answer(context, blob);
    blob_unref(blob);
}

static uint64_t cost_of(const struct blob *blob)
{
    uint64_t cost;
    if (!bytes_add(blob->size, CACHE_OVERHEAD + CACHE_PAGE, &cost) || !bytes_add(cost, blob->record.size, &cost))
        return UINT64_MAX;
    return CACHE_OVERHEAD + blob->record.size +
           (blob->descriptor >= 0 ? bytes_align(blob->size, CACHE_PAGE) : blob->size);
}

/* The most descriptors that entries may hold; `blob` is any of the blobs. */
static uint64_t descriptor_share(const struct blob *blob)
{
    return blob->account->descriptors->limit / 2;
}

static bool fits(const struct cache *cache, const struct blob *blob)
{
    return cost_of(blob) <= cache->budget && (blob->descriptor < 0 || descriptor_share(blob) > 0);
}

static void move_slots(const struct table *from, struct table *to)
{
    uint64_t mask = to->capacity - 1;
    for (uint64_t i = 0; i < from->capacity; i++) {
        if (!from->slots[i].entry)
            continue;
        uint64_t at = from->slots[i].hash & mask;
        while (to->slots[at].entry)
            at = (at + 1) & mask;
        to->slots[at] = from->slots[i];
    }
}

/* Makes room for one more entry, so that at least a quarter of the slots stays free. False without memory. */
static bool reserve_slot(struct table *table, struct memory *memory)
{
    if (table->count < table->capacity / 4 * 3)
        return true;
    struct table grown = {.capacity = table->capacity ? table->capacity * 2 : FIRST_CAPACITY, .count = table->count};
    grown.slots = memory_array(memory, grown.capacity, sizeof *grown.slots);
    if (!grown.slots)
        return false;
    memset(grown.slots, 0, grown.capacity * sizeof *grown.slots);
    move_slots(table, &grown);
    memory_free(memory, table->slots);
    *table = grown;
    return true;
}

static void insert(struct table *table, struct entry *entry)
{
    const struct key *key = &entry->blob->key;
    table->slots[find_slot(table, key)] = (struct slot){.hash = hash_of(key), .entry = entry};
    table->count++;
}

static struct entry *least_recent(const struct cache *cache)
{
    struct entry *a = least_recent_of(&cache->orders[IN_MEMORY]), *b = least_recent_of(&cache->orders[WITH_DESCRIPTOR]);
    if (!a || !b)
        return a ? a : b;
    return a->used < b->used ? a : b;
}

/* Returns the entry to evict next, or NULL. It is never the newest one, which fits the budgets by itself. */
static struct entry *surplus(const struct cache *cache)
{
    const struct order *holders = &cache->orders[WITH_DESCRIPTOR];
    struct entry *holder = least_recent_of(holders);
    if (holder && holders->count > descriptor_share(holder->blob))
        return holder;
    struct entry *oldest = least_recent(cache);
    bool is_surplus = oldest && (cache->bytes > cache->budget || is_forgotten(cache, oldest));
    return is_surplus ? oldest : NULL;
}

bool cache_trim(struct cache *cache)
{
    struct entry *entry = surplus(cache);
    for (int i = 0; entry && i < CACHE_TRIM_MOST; i++) {
        evict(cache, entry);
        entry = surplus(cache);
    }
    return entry != NULL;
}

void cache_clear(struct cache *cache)
{
    cache->forgotten = cache->clock;
}

/* Evicts the entry of that key if it is forgotten, so that it is not in the way of a new one. */
static void evict_forgotten(struct cache *cache, const struct key *key)
{
    struct entry *entry = find(cache, key);
    if (entry && is_forgotten(cache, entry))
        evict(cache, entry);
}

void cache_put(struct cache *cache, struct blob *blob)
{
    struct table *table = table_of(cache, &blob->key);
    evict_forgotten(cache, &blob->key);
    if (!fits(cache, blob) || find(cache, &blob->key) || !reserve_slot(table, cache->memory))
        return;
    struct entry *entry = memory_alloc(cache->memory, sizeof *entry);
    if (!entry)
        return;
    *entry = (struct entry){.blob = blob_ref(blob), .cost = cost_of(blob)};
    insert(table, entry);
    cache->bytes += entry->cost;
    link_most_recent(cache, entry);
    cache_trim(cache);
}

struct cache_load cache_load(const struct cache *cache)
{
    return (struct cache_load){
        .entries = count_entries(cache), .bytes = cache->bytes, .evicted = cache->evicted, .budget = cache->budget};
}
