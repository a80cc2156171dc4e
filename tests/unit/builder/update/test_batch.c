/* SPDX-License-Identifier: Apache-2.0 */
/* test_batch.c - tests that a batch builds and updates each entry by itself, and shares equal ones. */
#include "tests/support/unit.h"

#include "builder/update/batch.h"
#include "tests/support/builder/builders.h"
#include "tests/support/builder/inputs.h"
#include "builder/format/portable.h"

enum { ITEMS = 7 };

struct fixture {
    struct memory memory;
    struct limits limits;
    struct build_context context;
    struct test_input tests[ITEMS];
    struct build_input inputs[ITEMS];
    struct batch_item items[ITEMS];
};

/*
 * Seven inputs: triangles, boxes, instances; the triangles again; invalid triangles; the boxes with other flags; the
 * boxes again.
 */
static void fill(struct fixture *f)
{
    memory_init(&f->memory, UINT64_MAX);
    f->limits = limits_default();
    f->context = (struct build_context){.memory = &f->memory, .parallel = &parallel_serial};
    inputs_triangles(&f->tests[0]);
    inputs_aabbs(&f->tests[1]);
    inputs_instances(&f->tests[2]);
    inputs_triangles(&f->tests[3]);
    inputs_triangles(&f->tests[4]);
    f->tests[4].geometries[0].triangles.vertex_stride = 18;
    inputs_aabbs(&f->tests[5]);
    f->tests[5].input.flags = BUILD_ALLOW_UPDATE;
    inputs_aabbs(&f->tests[6]);
    for (int i = 0; i < ITEMS; i++)
        f->tests[i].input.options.builder = builders_asked();
    for (int i = 0; i < ITEMS; i++)
        f->inputs[i] = f->tests[i].input;
}

static void items_stand_alone_and_equal_ones_are_built_once(void **state)
{
    (void)state;
    struct fixture f;
    fill(&f);
    assert_int_equal(batch_build(f.inputs, ITEMS, &f.limits, &f.context, f.items, NULL), BVHD_OK);
    for (int i = 0; i < ITEMS; i++) {
        const struct batch_item *item = &f.items[i];
        struct portable_view view;
        if (i == 4) {
            assert_int_equal(item->status, BVHD_INVALID);
            assert_int_equal(item->error.status, BVHD_INVALID);
            assert_int_not_equal(item->error.vuid, BVHD_VUID_NONE);
            assert_non_null(strstr(item->error.where, "infos[4].geometries[0]"));
            assert_null(item->blob);
            continue;
        }
        assert_int_equal(item->status, BVHD_OK);
        assert_int_equal(portable_open((struct bytes){item->blob, item->size}, &f.memory, &view, NULL), BVHD_OK);
        assert_int_equal(item->coalesced, i == 3 || i == 6);
        assert_int_equal(view.header->primitive_count, item->summary.primitives);
        assert_true(item->summary.peak_bytes > 0);
    }
    assert_true(key_equal(&f.items[0].key, &f.items[3].key));
    assert_ptr_equal(f.items[0].blob, f.items[3].blob);
    assert_ptr_equal(f.items[1].blob, f.items[6].blob);
    assert_false(key_equal(&f.items[1].key, &f.items[5].key));
    assert_int_equal(f.items[0].summary.triangles, 5);
    assert_int_equal(f.items[1].summary.inactive, 1);
    assert_int_equal(f.items[2].summary.instances, 4);
    assert_int_equal(f.items[6].summary.primitives, 3);
    batch_finish(f.items, ITEMS, &f.memory);
    assert_int_equal(f.memory.live, 0);
}

static void rules_between_entries_are_applied(void **state)
{
    (void)state;
    struct fixture f;
    fill(&f);
    f.inputs[0].destination = 8;
    f.inputs[1].destination = 8;
    assert_int_equal(batch_build(f.inputs, ITEMS, &f.limits, &f.context, f.items, NULL), BVHD_OK);
    int failed = 0;
    for (int i = 0; i < 2; i++)
        failed += f.items[i].status == BVHD_INVALID && f.items[i].error.vuid != BVHD_VUID_NONE;
    assert_true(failed >= 1);
    assert_int_equal(f.items[2].status, BVHD_OK);
    batch_finish(f.items, ITEMS, &f.memory);
    assert_int_equal(f.memory.live, 0);
}

static void nothing_to_do(void **state)
{
    (void)state;
    struct fixture f;
    fill(&f);
    assert_int_equal(batch_build(f.inputs, 0, &f.limits, &f.context, f.items, NULL), BVHD_OK);
    batch_finish(f.items, 0, &f.memory);
    batch_finish(NULL, 0, &f.memory);
    assert_int_equal(f.memory.live, 0);
}

/* A failed allocation hits the whole batch or one item; all other items are the same as without it. */
static void failing_allocations_hit_one_item(void **state)
{
    (void)state;
    struct fixture f, whole;
    fill(&whole);
    assert_int_equal(batch_build(whole.inputs, ITEMS, &whole.limits, &whole.context, whole.items, NULL), BVHD_OK);
    int failures = 1;
    for (int64_t n = 0; failures > 0; n++) {
        fill(&f);
        failures = 0;
        f.memory.fail_after = n;
        enum bvhd_status status = batch_build(f.inputs, ITEMS, &f.limits, &f.context, f.items, NULL);
        if (status != BVHD_OK) {
            assert_int_equal(status, BVHD_NO_MEMORY);
            assert_int_equal(f.memory.live, 0);
            failures = 1;
            continue;
        }
        for (int i = 0; i < ITEMS; i++) {
            if (i == 4 || f.items[i].status == BVHD_OK) {
                assert_int_equal(f.items[i].size, whole.items[i].size);
                assert_memory_equal(f.items[i].blob, whole.items[i].blob, f.items[i].size);
                continue;
            }
            assert_int_equal(f.items[i].status, BVHD_NO_MEMORY);
            assert_int_equal(f.items[i].error.status, BVHD_NO_MEMORY);
            failures++;
        }
        assert_true(failures <= 1);
        batch_finish(f.items, ITEMS, &f.memory);
        assert_int_equal(f.memory.live, 0);
        assert_true(n < 1000);
    }
    batch_finish(whole.items, ITEMS, &whole.memory);
}

/* An item's peak counts its own memory only, whatever else is allocated. */
static void peaks_are_of_one_item(void **state)
{
    (void)state;
    struct fixture f, alone;
    fill(&f);
    fill(&alone);
    void *beside = memory_alloc(&f.memory, 1 << 20);
    assert_int_equal(batch_build(f.inputs, ITEMS, &f.limits, &f.context, f.items, NULL), BVHD_OK);
    for (int i = 0; i < 3; i++) {
        assert_int_equal(batch_build(&alone.inputs[i], 1, &alone.limits, &alone.context, alone.items, NULL), BVHD_OK);
        assert_true(alone.items[0].summary.peak_bytes >= alone.items[0].size);
        assert_int_equal(f.items[i].summary.peak_bytes, alone.items[0].summary.peak_bytes);
        batch_finish(alone.items, 1, &alone.memory);
    }
    memory_free(&f.memory, beside);
    batch_finish(f.items, ITEMS, &f.memory);
    assert_int_equal(f.memory.live, 0);
}

static uint64_t last_done, last_total;

static void watch(void *context, uint64_t done, uint64_t total)
{
    (void)context;
    assert_true(done >= last_done && done <= total);
    assert_true(last_total == 0 || total == last_total);
    last_done = done;
    last_total = total;
}

/* Progress is that of the batch: it never goes back, and its total stays. */
static void progress_counts_all_items(void **state)
{
    (void)state;
    struct fixture f;
    fill(&f);
    f.context.progress = watch;
    last_done = last_total = 0;
    assert_int_equal(batch_build(f.inputs, ITEMS, &f.limits, &f.context, f.items, NULL), BVHD_OK);
    assert_true(last_total > ITEMS);
    assert_true(last_done > last_total / 2);
    batch_finish(f.items, ITEMS, &f.memory);
}

static void set_flag(void *context, uint64_t done, uint64_t total)
{
    (void)done, (void)total;
    atomic_store((atomic_bool *)context, true);
}

/* Once the batch is cancelled, no item is begun; those that were built stay. */
static void a_cancelled_batch_begins_nothing(void **state)
{
    (void)state;
    struct fixture f;
    atomic_bool cancel = false;
    fill(&f);
    f.context.cancel = &cancel;
    f.context.progress = set_flag;
    f.context.progress_context = &cancel;
    assert_int_equal(batch_build(f.inputs, ITEMS, &f.limits, &f.context, f.items, NULL), BVHD_OK);
    for (int i = 1; i < ITEMS; i++) {
        assert_int_equal(f.items[i].status, BVHD_CANCELLED);
        assert_int_equal(f.items[i].error.status, f.items[i].status);
        assert_true(f.items[i].prepare_ms == 0);
    }
    batch_finish(f.items, ITEMS, &f.memory);
    assert_int_equal(f.memory.live, 0);
}

/* A cache in memory. */
struct memory_cache {
    struct batch_cache cache;
    uint32_t count, hits;
    struct key keys[ITEMS];
    struct bytes blobs[ITEMS], records[ITEMS];
    struct summary summaries[ITEMS];
    bool changes_target; /* what it returns is not what was asked for */
};

static unsigned char *copy(struct memory *memory, struct bytes bytes)
{
    unsigned char *block = memory_alloc(memory, bytes.size);
    return block ? memcpy(block, bytes.data, bytes.size) : NULL;
}

/* Without memory it has nothing. */
static bool cache_get(struct batch_cache *batch, const struct key *key, bool wants_record, struct memory *memory,
                      struct batch_cached *ret_cached)
{
    struct memory_cache *cache = (struct memory_cache *)batch;
    for (uint32_t i = 0; i < cache->count; i++) {
        if (!key_equal(key, &cache->keys[i]))
            continue;
        if (wants_record && cache->records[i].size == 0)
            return false;
        struct bytes record = {wants_record ? copy(memory, cache->records[i]) : NULL, cache->records[i].size};
        unsigned char *blob = copy(memory, cache->blobs[i]);
        if (!blob || (wants_record && !record.data)) {
            memory_free(memory, blob);
            memory_free(memory, (void *)(uintptr_t)record.data);
            return false;
        }
        *ret_cached = (struct batch_cached){blob, cache->blobs[i].size, record, cache->summaries[i]};
        if (cache->changes_target)
            ret_cached->summary.target = TARGET_LAVAPIPE;
        cache->hits++;
        return true;
    }
    return false;
}

static struct bytes keep(struct bytes bytes)
{
    return (struct bytes){bytes.size ? memcpy(malloc(bytes.size), bytes.data, bytes.size) : NULL, bytes.size};
}

static void cache_put(struct batch_cache *batch, const struct key *key, struct bytes blob, struct bytes record,
                      const struct summary *summary)
{
    struct memory_cache *cache = (struct memory_cache *)batch;
    assert_true(cache->count < ITEMS);
    cache->keys[cache->count] = *key;
    cache->blobs[cache->count] = keep(blob);
    cache->records[cache->count] = keep(record);
    cache->summaries[cache->count++] = *summary;
}

/* Drops all but the first `count` entries. */
static void cache_drop(struct memory_cache *cache, uint32_t count)
{
    while (cache->count > count) {
        cache->count--;
        free((void *)(uintptr_t)cache->blobs[cache->count].data);
        free((void *)(uintptr_t)cache->records[cache->count].data);
    }
}

static void run_cached(struct memory_cache *cache, struct fixture *f)
{
    fill(f);
    const struct batch_call call = {f->inputs, ITEMS, &f->limits, &cache->cache, NULL};
    assert_int_equal(batch_run(&call, &f->context, f->items, NULL), BVHD_OK);
}

static void a_cache_keeps_results_and_no_errors(void **state)
{
    (void)state;
    struct memory_cache cache = {.cache = {cache_get, cache_put}};
    struct fixture first, second;
    run_cached(&cache, &first);
    assert_int_equal(cache.count, 4);
    assert_int_equal(cache.hits, 0);
    run_cached(&cache, &second);
    assert_int_equal(cache.count, 4);
    assert_int_equal(cache.hits, 4);
    for (int i = 0; i < ITEMS; i++) {
        const struct batch_item *built = &first.items[i], *taken = &second.items[i];
        assert_int_equal(built->status, taken->status);
        assert_false(built->cached);
        assert_int_equal(taken->cached, taken->status == BVHD_OK && !taken->coalesced);
        if (built->status != BVHD_OK)
            continue;
        assert_int_equal(built->size, taken->size);
        assert_memory_equal(built->blob, taken->blob, built->size);
        assert_true(taken->build_ms == 0 && taken->summary.build_ms == built->summary.build_ms);
        assert_int_equal(built->summary.primitives, taken->summary.primitives);
    }
    batch_finish(first.items, ITEMS, &first.memory);
    batch_finish(second.items, ITEMS, &second.memory);
    assert_int_equal(atomic_load(&second.memory.live), 0);
    cache.changes_target = true;
    cache_drop(&cache, 1);
    run_cached(&cache, &second);
    assert_false(second.items[0].cached);
    assert_int_equal(cache.count, 5);
    batch_finish(second.items, ITEMS, &second.memory);
    assert_int_equal(atomic_load(&second.memory.live), 0);
    cache_drop(&cache, 0);
}

/* ---- updates ---- */

enum { BOXES = 5 }; /* the input with ALLOW_UPDATE */

struct held {
    struct batch_held held;
    const struct batch_item *items;
    int count;
};

static const struct batch_item *find(struct batch_held *held, const struct key *key)
{
    const struct batch_item *items = ((struct held *)held)->items;
    for (int i = 0; i < ((struct held *)held)->count; i++)
        if (items[i].blob && key_equal(&items[i].key, key))
            return &items[i];
    return NULL;
}

/* Moves the boxes of an updatable input by `step`, and updates the structure with that key. */
static void update(struct fixture *f, const struct key *source, float step, struct batch_cache *cache,
                   struct batch_held *held)
{
    fill(f);
    struct build_input *input = &f->inputs[BOXES];
    for (int axis = 0; axis < 6; axis++)
        f->tests[BOXES].boxes[0][axis] += step;
    input->mode = MODE_UPDATE;
    input->source = 7;
    input->source_key = *source;
    const struct batch_call call = {input, 1, &f->limits, cache, held};
    assert_int_equal(batch_run(&call, &f->context, f->items, NULL), BVHD_OK);
}

static void expect_update(const struct batch_item *item, uint32_t refits)
{
    assert_int_equal(item->status, BVHD_OK);
    assert_int_equal(item->summary.refits, refits);
    assert_true(item->summary.decay > 0 && item->record.size > 0 && !item->cached);
}

/* The source is a result that is held, one of the cache, or nowhere; the cache gets no updates. */
static void updates_start_from_what_is_held_or_cached(void **state)
{
    (void)state;
    struct memory_cache cache = {.cache = {cache_get, cache_put}};
    struct fixture built, held_one, cached_one, second, lost;
    run_cached(&cache, &built);
    const uint32_t count = cache.count;
    struct held held = {{find}, built.items, ITEMS};
    const struct key *key = &built.items[BOXES].key;
    update(&held_one, key, 1, NULL, &held.held);
    expect_update(&held_one.items[0], 1);
    assert_memory_not_equal(held_one.items[0].blob, built.items[BOXES].blob, built.items[BOXES].size);
    update(&cached_one, key, 1, &cache.cache, NULL);
    expect_update(&cached_one.items[0], 1);
    assert_true(key_equal(&cached_one.items[0].key, &held_one.items[0].key));
    assert_int_equal(cached_one.items[0].size, held_one.items[0].size);
    assert_memory_equal(cached_one.items[0].blob, held_one.items[0].blob, held_one.items[0].size);
    held = (struct held){{find}, cached_one.items, 1};
    update(&second, &cached_one.items[0].key, 2, &cache.cache, &held.held);
    expect_update(&second.items[0], 2);
    assert_int_equal(cache.count, count);
    update(&lost, &cached_one.items[0].key, 2, &cache.cache, NULL);
    assert_int_equal(lost.items[0].status, BVHD_SOURCE_LOST);
    assert_string_equal(lost.items[0].error.where, "infos[0].srcAccelerationStructure");
    struct fixture *all[] = {&built, &held_one, &cached_one, &second, &lost};
    for (size_t i = 0; i < sizeof all / sizeof *all; i++) {
        batch_finish(all[i]->items, i ? 1 : ITEMS, &all[i]->memory);
        assert_int_equal(atomic_load(&all[i]->memory.live), 0);
    }
    cache_drop(&cache, 0);
}

/* A source without ALLOW_UPDATE has no record: that is told where it is held. */
static void sources_must_be_updatable(void **state)
{
    (void)state;
    struct fixture built, refused;
    fill(&built);
    assert_int_equal(batch_build(built.inputs, ITEMS, &built.limits, &built.context, built.items, NULL), BVHD_OK);
    struct held held = {{find}, built.items, ITEMS};
    update(&refused, &built.items[1].key, 1, NULL, &held.held);
    assert_int_equal(refused.items[0].status, BVHD_INVALID);
    assert_int_equal(refused.items[0].error.vuid, BVHD_VUID_03667);
    update(&refused, &built.items[BOXES].key, 1, NULL, NULL);
    assert_int_equal(refused.items[0].status, BVHD_SOURCE_LOST);
    batch_finish(built.items, ITEMS, &built.memory);
    assert_int_equal(atomic_load(&built.memory.live), 0);
}

/* Without memory for a source that is read, it is lost, which has the caller build. */
static void failing_allocations_of_updates_leave_nothing(void **state)
{
    (void)state;
    struct memory_cache cache = {.cache = {cache_get, cache_put}};
    struct fixture built, f;
    run_cached(&cache, &built);
    enum bvhd_status status = BVHD_NO_MEMORY;
    for (int64_t n = 0; status != BVHD_OK; n++) {
        fill(&f);
        f.inputs[BOXES].mode = MODE_UPDATE;
        f.inputs[BOXES].source = 7;
        f.inputs[BOXES].source_key = built.items[BOXES].key;
        f.memory.fail_after = n;
        const struct batch_call call = {&f.inputs[BOXES], 1, &f.limits, &cache.cache, NULL};
        status = batch_run(&call, &f.context, f.items, NULL);
        if (status == BVHD_OK) {
            status = f.items[0].status;
            batch_finish(f.items, 1, &f.memory);
        }
        assert_true(status == BVHD_OK || status == BVHD_NO_MEMORY || status == BVHD_SOURCE_LOST);
        assert_int_equal(atomic_load(&f.memory.live), 0);
        assert_true(n < 1000);
    }
    batch_finish(built.items, ITEMS, &built.memory);
    cache_drop(&cache, 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(items_stand_alone_and_equal_ones_are_built_once),
        cmocka_unit_test(rules_between_entries_are_applied),
        cmocka_unit_test(nothing_to_do),
        cmocka_unit_test(failing_allocations_hit_one_item),
        cmocka_unit_test(progress_counts_all_items),
        cmocka_unit_test(a_cancelled_batch_begins_nothing),
        cmocka_unit_test(peaks_are_of_one_item),
        cmocka_unit_test(a_cache_keeps_results_and_no_errors),
        cmocka_unit_test(updates_start_from_what_is_held_or_cached),
        cmocka_unit_test(sources_must_be_updatable),
        cmocka_unit_test(failing_allocations_of_updates_leave_nothing),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
