/* SPDX-License-Identifier: Apache-2.0 */
/* test_cache.c - tests that the cache keeps what was used last within its budgets, also against a simple model. */
#include "tests/support/unit.h"

#include <inttypes.h>
#include <stdbool.h>

#include "daemon/service/cache.h"
#include "tests/support/random.h"

enum {
    SMALL = 1000,
    LARGE = BLOB_INLINE_MAX + 1,
    SMALL_COST = SMALL + CACHE_OVERHEAD,
    LARGE_COST = 17 * CACHE_PAGE + CACHE_OVERHEAD
};

static struct memory memory, cache_memory;
static struct descriptors descriptors;
static struct blob_account account;

static int set_up(void **state)
{
    (void)state;
    memory_init(&memory, UINT64_MAX);
    memory_init(&cache_memory, UINT64_MAX);
    descriptors = (struct descriptors){.limit = 1000};
    blob_account_init(&account, &memory, &descriptors);
    return 0;
}

static int tear_down(void **state)
{
    (void)state;
    return memory.live || cache_memory.live || descriptors.used || account.live_blobs ? -1 : 0;
}

/* The first eight bytes of a key are its place in the table. */
static struct key key_of(uint64_t hash, uint64_t number)
{
    struct key key = {{0}};
    bytes_put64(key.bytes, hash);
    bytes_put64(key.bytes + 24, number);
    return key;
}

static struct key number_key(uint64_t number)
{
    return key_of(number * 0x9e3779b97f4a7c15u, number);
}

/* A blob can always be made: the limit of descriptors is for the cache, which keeps few of them while it is low. */
static struct blob *make_blob(struct key key, uint64_t size)
{
    struct blob_writer writer;
    struct blob *blob = NULL;
    const uint32_t limit = descriptors.limit;
    descriptors.limit = 4 * DESCRIPTORS_RESERVE;
    blob_writer_init(&writer, &account);
    unsigned char *bytes = writer.output.allocate(&writer.output, size);
    if (!bytes)
        fail_msg("%s", writer.error.text);
    memset(bytes, 1, size);
    assert_int_equal(blob_writer_finish(&writer, &blob, NULL), BVHD_OK);
    descriptors.limit = limit;
    blob->key = key;
    return blob;
}

/* Puts a blob as the end of a build does: afterwards only the cache has a ref, or nobody. */
static void put(struct cache *cache, struct key key, uint64_t size)
{
    struct blob *blob = make_blob(key, size);
    cache_put(cache, blob);
    blob_unref(blob);
}

struct answer {
    unsigned calls;
    struct blob *blob;
};

static void remember(void *context, struct blob *blob)
{
    struct answer *answer = context;
    answer->calls++;
    answer->blob = blob;
}

static struct blob *get(struct cache *cache, struct key key)
{
    struct answer answer = {0};
    cache_get(cache, &key, remember, &answer);
    assert_int_equal(answer.calls, 1);
    if (answer.blob)
        assert_true(key_equal(&answer.blob->key, &key));
    return answer.blob;
}

static void what_was_put_is_found(void **state)
{
    (void)state;
    struct cache *cache = cache_create(1 << 20, &cache_memory);
    assert_null(get(cache, number_key(1)));
    struct blob *blob = make_blob(number_key(1), SMALL);
    cache_put(cache, blob);
    assert_int_equal(blob->refs, 2);
    assert_ptr_equal(get(cache, number_key(1)), blob);
    assert_int_equal(blob->refs, 2);
    assert_null(get(cache, number_key(2)));
    blob_unref(blob);
    assert_int_equal(account.live_blobs, 1);
    cache_destroy(cache);
    assert_int_equal(account.live_blobs, 0);
    cache_destroy(NULL);
}

/* Keys that differ in any one byte are different. */
static void similar_keys_are_different(void **state)
{
    (void)state;
    struct cache *cache = cache_create(1 << 20, &cache_memory);
    struct key key = number_key(1);
    put(cache, key, SMALL);
    for (int i = 0; i < KEY_SIZE; i++) {
        struct key other = key;
        other.bytes[i] ^= 0x10;
        assert_null(get(cache, other));
    }
    assert_non_null(get(cache, key));
    cache_destroy(cache);
}

static void a_known_key_is_not_put_again(void **state)
{
    (void)state;
    struct cache *cache = cache_create(1 << 20, &cache_memory);
    struct blob *first = make_blob(number_key(1), SMALL), *second = make_blob(number_key(1), LARGE);
    cache_put(cache, first);
    cache_put(cache, second);
    cache_put(cache, first);
    assert_ptr_equal(get(cache, number_key(1)), first);
    assert_int_equal(first->refs, 2);
    assert_int_equal(second->refs, 1);
    assert_int_equal(cache_load(cache).entries, 1);
    blob_unref(first);
    blob_unref(second);
    cache_destroy(cache);
}

static void the_budget_counts_pages_and_overhead(void **state)
{
    (void)state;
    struct cache *cache = cache_create(SMALL_COST + LARGE_COST, &cache_memory);
    put(cache, number_key(1), SMALL);
    assert_int_equal(cache_load(cache).bytes, SMALL_COST);
    put(cache, number_key(2), LARGE);
    assert_int_equal(cache_load(cache).bytes, SMALL_COST + LARGE_COST);
    assert_int_equal(cache_load(cache).budget, SMALL_COST + LARGE_COST);
    assert_int_equal(cache_load(cache).evicted, 0);
    put(cache, number_key(3), 1);
    assert_int_equal(cache_load(cache).evicted, 1);
    assert_null(get(cache, number_key(1)));
    assert_non_null(get(cache, number_key(2)));
    assert_int_equal(cache_load(cache).bytes, LARGE_COST + 1 + CACHE_OVERHEAD);
    cache_destroy(cache);
}

/* CACHE_OVERHEAD covers the entry, its slot and the blob, with the headers of their memory blocks. */
static void the_overhead_covers_the_structs(void **state)
{
    (void)state;
    enum { COUNT = 5000 };
    struct cache *cache = cache_create(UINT64_MAX, &cache_memory);
    for (uint64_t i = 0; i < COUNT; i++)
        put(cache, number_key(i), 1);
    assert_true(memory.live + cache_memory.live < COUNT * (uint64_t)CACHE_OVERHEAD / 2);
    assert_true(cache_load(cache).bytes >= memory.live + cache_memory.live + COUNT * 5 * 64);
    cache_destroy(cache);
}

static void the_least_recently_used_goes_first(void **state)
{
    (void)state;
    struct cache *cache = cache_create(3 * SMALL_COST, &cache_memory);
    for (uint64_t i = 1; i <= 3; i++)
        put(cache, number_key(i), SMALL);
    assert_non_null(get(cache, number_key(1)));
    put(cache, number_key(4), SMALL);
    assert_null(get(cache, number_key(2)));
    put(cache, number_key(5), SMALL);
    assert_null(get(cache, number_key(3)));
    assert_non_null(get(cache, number_key(1)));
    put(cache, number_key(6), 2 * SMALL_COST - CACHE_OVERHEAD);
    assert_null(get(cache, number_key(4)));
    assert_null(get(cache, number_key(5)));
    assert_non_null(get(cache, number_key(1)));
    assert_int_equal(cache_load(cache).entries, 2);
    assert_int_equal(cache_load(cache).evicted, 4);
    cache_destroy(cache);
}

/*
 * A large result pushes out thousands of small ones, in several calls and the least recently used first, and is kept
 * itself.
 */
static void many_go_in_portions(void **state)
{
    (void)state;
    enum { COUNT = 3 * CACHE_TRIM_MOST };
    uint64_t budget = (uint64_t)COUNT * SMALL_COST;
    struct cache *cache = cache_create(budget, &cache_memory);
    for (unsigned i = 0; i < COUNT; i++)
        put(cache, number_key(i), SMALL);
    assert_false(cache_trim(cache));
    assert_int_equal(cache_load(cache).entries, COUNT);

    uint64_t size = budget - CACHE_OVERHEAD - 2 * CACHE_PAGE;
    put(cache, number_key(COUNT), size);
    assert_int_equal(cache_load(cache).evicted, CACHE_TRIM_MOST);
    assert_true(cache_load(cache).bytes > budget);
    assert_null(get(cache, number_key(CACHE_TRIM_MOST - 1)));
    assert_non_null(get(cache, number_key(COUNT - 1)));

    while (cache_trim(cache))
        assert_int_equal(cache_load(cache).evicted % CACHE_TRIM_MOST, 0);
    assert_true(cache_load(cache).bytes <= budget);
    assert_non_null(get(cache, number_key(COUNT)));
    cache_destroy(cache);
}

static void what_is_too_large_pushes_nothing_out(void **state)
{
    (void)state;
    struct cache *cache = cache_create(2 * SMALL_COST, &cache_memory);
    put(cache, number_key(1), SMALL);
    put(cache, number_key(2), SMALL);
    put(cache, number_key(3), 2 * SMALL_COST - CACHE_OVERHEAD + 1);
    put(cache, number_key(4), LARGE);
    assert_null(get(cache, number_key(3)));
    assert_null(get(cache, number_key(4)));
    assert_non_null(get(cache, number_key(1)));
    assert_non_null(get(cache, number_key(2)));
    cache_destroy(cache);
}

static void without_budget_nothing_is_kept(void **state)
{
    (void)state;
    struct cache *cache = cache_create(0, &cache_memory);
    put(cache, number_key(1), 1);
    assert_null(get(cache, number_key(1)));
    assert_int_equal(cache_load(cache).entries + cache_load(cache).bytes + cache_load(cache).evicted, 0);
    cache_destroy(cache);
}

static void who_holds_a_blob_keeps_it(void **state)
{
    (void)state;
    struct cache *cache = cache_create(SMALL_COST, &cache_memory);
    put(cache, number_key(1), SMALL);
    struct blob *held = blob_ref(get(cache, number_key(1)));
    put(cache, number_key(2), SMALL);
    assert_null(get(cache, number_key(1)));
    assert_int_equal(held->refs, 1);
    assert_int_equal(held->bytes[SMALL - 1], 1);
    cache_destroy(cache);
    blob_unref(held);
}

static void put_another(void *context, struct blob *blob)
{
    struct cache *cache = context;
    put(cache, number_key(2), SMALL);
    assert_null(get(cache, number_key(1)));
    assert_int_equal(blob->bytes[SMALL - 1], 1);
    assert_true(key_equal(&blob->key, (const struct key[]){number_key(1)}));
}

static void an_answer_outlives_its_entry(void **state)
{
    (void)state;
    struct cache *cache = cache_create(SMALL_COST, &cache_memory);
    put(cache, number_key(1), SMALL);
    struct key key = number_key(1);
    cache_get(cache, &key, put_another, cache);
    assert_int_equal(account.live_blobs, 1);
    cache_destroy(cache);
}

/* If only descriptors are short, blobs without one are not evicted, however cold they are. */
static void descriptors_are_shared_with_others(void **state)
{
    (void)state;
    descriptors.limit = 41;
    struct cache *cache = cache_create(UINT64_MAX, &cache_memory);
    put(cache, number_key(0), SMALL);
    for (uint64_t i = 1; i <= 20; i++)
        put(cache, number_key(i), LARGE);
    assert_int_equal(descriptors.used, 20);
    assert_int_equal(cache_load(cache).evicted, 0);
    assert_non_null(get(cache, number_key(1)));
    put(cache, number_key(21), LARGE);
    assert_int_equal(descriptors.used, 20);
    assert_int_equal(cache_load(cache).evicted, 1);
    assert_null(get(cache, number_key(2)));
    assert_non_null(get(cache, number_key(1)));
    assert_non_null(get(cache, number_key(0)));
    cache_destroy(cache);
}

static void with_hardly_a_descriptor_none_is_kept(void **state)
{
    (void)state;
    struct blob *blob = make_blob(number_key(1), LARGE);
    descriptors.limit = 1;
    struct cache *cache = cache_create(UINT64_MAX, &cache_memory);
    cache_put(cache, blob);
    assert_int_equal(cache_load(cache).entries, 0);
    blob_unref(blob);
    cache_destroy(cache);
}

static void creating_needs_memory(void **state)
{
    (void)state;
    cache_memory.fail_after = 0;
    assert_null(cache_create(1000, &cache_memory));
    cache_destroy(cache_create(1000, &cache_memory));
}

/* If any allocation fails, even that of a growing table, one blob is not kept and all others stay. */
static void what_finds_no_memory_is_not_kept(void **state)
{
    (void)state;
    enum { COUNT = 400 };
    struct cache *cache = cache_create(COUNT * (uint64_t)SMALL_COST, &cache_memory);
    uint64_t kept = 0;
    bool is_kept[COUNT];
    for (uint64_t i = 0; i < COUNT; i++) {
        cache_memory.fail_after = (int64_t)(i % 3);
        put(cache, number_key(i), SMALL);
        is_kept[i] = get(cache, number_key(i)) != NULL;
        kept += is_kept[i];
        if (i % 3 == 0)
            assert_false(is_kept[i]);
        assert_int_equal(cache_load(cache).entries, kept);
        assert_int_equal(cache_load(cache).bytes, kept * SMALL_COST);
    }
    cache_memory.fail_after = -1;
    assert_true(kept > COUNT / 3);
    assert_int_equal(cache_load(cache).evicted, 0);
    for (uint64_t i = 0; i < COUNT; i++)
        assert_int_equal(get(cache, number_key(i)) != NULL, is_kept[i]);
    cache_destroy(cache);
}

static void no_memory_for_more_keeps_what_it_has(void **state)
{
    (void)state;
    struct cache *cache = cache_create(UINT64_MAX, &cache_memory);
    for (uint64_t i = 0; i < 10; i++)
        put(cache, number_key(i), 1);
    cache_memory.limit = cache_memory.live;
    put(cache, number_key(10), 1);
    assert_null(get(cache, number_key(10)));
    for (uint64_t i = 0; i < 10; i++)
        assert_non_null(get(cache, number_key(i)));
    cache_destroy(cache);
}

static void many_are_found(void **state)
{
    (void)state;
    enum { COUNT = 20000 };
    struct cache *cache = cache_create(UINT64_MAX, &cache_memory);
    for (uint64_t i = 0; i < COUNT; i++)
        put(cache, number_key(i), 1);
    assert_int_equal(cache_load(cache).entries, COUNT);
    for (uint64_t i = 0; i < COUNT; i++)
        assert_non_null(get(cache, number_key(i)));
    for (uint64_t i = COUNT; i < 2 * COUNT; i++)
        assert_null(get(cache, number_key(i)));
    cache_destroy(cache);
}

/* Tables grow only with the number of entries that they hold at the same time. */
static void turnover_takes_no_memory(void **state)
{
    (void)state;
    enum { COUNT = 30000 };
    struct cache *cache = cache_create(10 * (1 + CACHE_OVERHEAD), &cache_memory);
    for (uint64_t i = 0; i < COUNT; i++)
        put(cache, number_key(i), 1);
    assert_int_equal(cache_load(cache).entries, 10);
    assert_int_equal(cache_load(cache).evicted, COUNT - 10);
    assert_true(cache_memory.peak < 64 * 1024);
    cache_destroy(cache);
}

/* A model of the cache, as simple as possible: an array with the most recently used entry last. */
enum { MODEL_KEYS = 300, MODEL_STEPS = 30000 };

struct model_entry {
    uint64_t number, cost;
    bool has_descriptor;
};

struct model {
    struct model_entry entries[MODEL_KEYS];
    uint64_t count, bytes, evicted, budget, share;
};

static uint64_t model_find(const struct model *model, uint64_t number)
{
    uint64_t i = 0;
    while (i < model->count && model->entries[i].number != number)
        i++;
    return i;
}

static struct model_entry model_remove(struct model *model, uint64_t at)
{
    struct model_entry entry = model->entries[at];
    memmove(&model->entries[at], &model->entries[at + 1], (model->count - at - 1) * sizeof entry);
    model->count--;
    model->bytes -= entry.cost;
    return entry;
}

static void model_append(struct model *model, struct model_entry entry)
{
    model->entries[model->count++] = entry;
    model->bytes += entry.cost;
}

static bool model_get(struct model *model, uint64_t number)
{
    uint64_t at = model_find(model, number);
    if (at == model->count)
        return false;
    model_append(model, model_remove(model, at));
    return true;
}

static void model_evict(struct model *model, bool only_descriptors)
{
    uint64_t at = 0;
    while (only_descriptors && !model->entries[at].has_descriptor)
        at++;
    model_remove(model, at);
    model->evicted++;
}

static uint64_t model_descriptors(const struct model *model)
{
    uint64_t count = 0;
    for (uint64_t i = 0; i < model->count; i++)
        count += model->entries[i].has_descriptor;
    return count;
}

static void model_put(struct model *model, uint64_t number, uint64_t size)
{
    struct model_entry entry = {
        .number = number, .cost = size + CACHE_OVERHEAD, .has_descriptor = size > BLOB_INLINE_MAX};
    if (entry.has_descriptor)
        entry.cost = (size + 4095) / 4096 * 4096 + CACHE_OVERHEAD;
    if (entry.cost > model->budget || model_find(model, number) < model->count)
        return;
    while (entry.has_descriptor && model_descriptors(model) >= model->share)
        model_evict(model, true);
    while (model->bytes + entry.cost > model->budget)
        model_evict(model, false);
    model_append(model, entry);
}

struct scenario {
    uint64_t budget;
    uint32_t limit; /* of descriptors */
    uint64_t hash_mask; /* with few different hashes there are long runs of slots, also across the end of the table */
    uint64_t hash_base;
};

static struct key scenario_key(const struct scenario *scenario, uint64_t number)
{
    uint64_t hash = number * 0x9e3779b97f4a7c15u >> 7;
    return key_of((hash & scenario->hash_mask) + scenario->hash_base, number);
}

static uint64_t random_below(struct random *random, uint64_t end)
{
    return random_next(random) % end;
}

static uint64_t random_size(struct random *random)
{
    static const uint64_t sizes[] = {1, 500, 3000, 20000, BLOB_INLINE_MAX, LARGE, LARGE + 4000, 300000};
    return sizes[random_below(random, sizeof sizes / sizeof sizes[0])];
}

static void compare_loads(const struct cache *cache, const struct model *model, int step)
{
    struct cache_load load = cache_load(cache);
    if (load.entries != model->count || load.bytes != model->bytes || load.evicted != model->evicted)
        fail_msg("step %d: %" PRIu64 " entries, %" PRIu64 " bytes, %" PRIu64 " evicted instead of %" PRIu64 ", %" PRIu64
                 ", %" PRIu64,
                 step, load.entries, load.bytes, load.evicted, model->count, model->bytes, model->evicted);
}

static void follow_model(const struct scenario *scenario)
{
    static struct model model;
    struct random random = {.state = scenario->budget};
    descriptors.limit = scenario->limit;
    model = (struct model){.budget = scenario->budget, .share = scenario->limit / 2};
    struct cache *cache = cache_create(scenario->budget, &cache_memory);
    for (int step = 0; step < MODEL_STEPS; step++) {
        uint64_t number = random_below(&random, MODEL_KEYS);
        struct key key = scenario_key(scenario, number);
        if (random_below(&random, 8) == 0) {
            uint64_t size = random_size(&random);
            put(cache, key, size);
            model_put(&model, number, size);
        } else {
            assert_int_equal(get(cache, key) != NULL, model_get(&model, number));
        }
        compare_loads(cache, &model, step);
    }
    for (uint64_t number = 0; number < MODEL_KEYS; number++)
        assert_int_equal(get(cache, scenario_key(scenario, number)) != NULL, model_find(&model, number) < model.count);
    cache_destroy(cache);
}

static void it_behaves_like_a_list(void **state)
{
    (void)state;
    static const struct scenario scenarios[] = {
        {.budget = 1000000, .limit = 1000, .hash_mask = UINT64_MAX},
        {.budget = 8000000, .limit = 60, .hash_mask = UINT64_MAX},
        {.budget = UINT64_MAX, .limit = 34, .hash_mask = 3, .hash_base = UINT64_MAX - 2},
        {.budget = 3000000, .limit = 1000, .hash_mask = 15, .hash_base = 56},
        {.budget = 500000, .limit = 1000, .hash_mask = 0},
    };
    for (size_t i = 0; i < sizeof scenarios / sizeof scenarios[0]; i++)
        follow_model(&scenarios[i]);
}

int main(void)
{
    static const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(what_was_put_is_found, set_up, tear_down),
        cmocka_unit_test_setup_teardown(similar_keys_are_different, set_up, tear_down),
        cmocka_unit_test_setup_teardown(a_known_key_is_not_put_again, set_up, tear_down),
        cmocka_unit_test_setup_teardown(the_budget_counts_pages_and_overhead, set_up, tear_down),
        cmocka_unit_test_setup_teardown(the_overhead_covers_the_structs, set_up, tear_down),
        cmocka_unit_test_setup_teardown(the_least_recently_used_goes_first, set_up, tear_down),
        cmocka_unit_test_setup_teardown(many_go_in_portions, set_up, tear_down),
        cmocka_unit_test_setup_teardown(what_is_too_large_pushes_nothing_out, set_up, tear_down),
        cmocka_unit_test_setup_teardown(without_budget_nothing_is_kept, set_up, tear_down),
        cmocka_unit_test_setup_teardown(who_holds_a_blob_keeps_it, set_up, tear_down),
        cmocka_unit_test_setup_teardown(an_answer_outlives_its_entry, set_up, tear_down),
        cmocka_unit_test_setup_teardown(descriptors_are_shared_with_others, set_up, tear_down),
        cmocka_unit_test_setup_teardown(with_hardly_a_descriptor_none_is_kept, set_up, tear_down),
        cmocka_unit_test_setup_teardown(creating_needs_memory, set_up, tear_down),
        cmocka_unit_test_setup_teardown(what_finds_no_memory_is_not_kept, set_up, tear_down),
        cmocka_unit_test_setup_teardown(no_memory_for_more_keeps_what_it_has, set_up, tear_down),
        cmocka_unit_test_setup_teardown(many_are_found, set_up, tear_down),
        cmocka_unit_test_setup_teardown(turnover_takes_no_memory, set_up, tear_down),
        cmocka_unit_test_setup_teardown(it_behaves_like_a_list, set_up, tear_down),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
