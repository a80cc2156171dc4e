/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_memory.c - tests blocks, budgets, injected failures, budgets within budgets, and their use from several threads.
 */
#include "tests/support/unit.h"

#include <pthread.h>
#include <sys/resource.h>

#include "proto/base/memory.h"
#include "proto/base/status.h"

/*
 * Sizes on both sides of every boundary inside memory.c: a cache line, the 4 MiB from which blocks are mapped, a
 * mapping's last page.
 */
static const uint64_t sizes[] = {1, 63, 64, 65, 4096, 100000, 4194303, 4194304, 4198336, 4198337, 8388608, 10000003};

enum { SIZE_COUNT = sizeof sizes / sizeof sizes[0] };

/* Every 61st byte is written: each line and each page has some of them, and the test stays quick. */
enum { STEP = 61 };

static void fill(unsigned char *block, uint64_t size, unsigned seed)
{
    for (uint64_t i = 0; i < size; i += STEP)
        block[i] = (unsigned char)(i * 7 + i / 251 + seed);
}

static int filled(const unsigned char *block, uint64_t size, unsigned seed)
{
    for (uint64_t i = 0; i < size; i += STEP)
        if (block[i] != (unsigned char)(i * 7 + i / 251 + seed))
            return 0;
    return 1;
}

static void blocks_are_aligned_and_counted(void **state)
{
    (void)state;
    struct memory memory;
    memory_init(&memory, UINT64_MAX);
    unsigned char *blocks[SIZE_COUNT];
    uint64_t sum = 0;
    for (int i = 0; i < SIZE_COUNT; i++) {
        blocks[i] = memory_alloc(&memory, sizes[i]);
        assert_non_null(blocks[i]);
        assert_int_equal((uintptr_t)blocks[i] % 64, 0);
        fill(blocks[i], sizes[i], (unsigned)i);
        sum += sizes[i];
        assert_int_equal(memory.live, sum);
        assert_int_equal(memory.peak, sum);
    }
    uint64_t peak = sum;
    for (int i = 0; i < SIZE_COUNT; i++) {
        assert_true(filled(blocks[i], sizes[i], (unsigned)i));
        memory_free(&memory, blocks[i]);
        sum -= sizes[i];
        assert_int_equal(memory.live, sum);
    }
    assert_int_equal(memory.live, 0);
    assert_int_equal(memory.peak, peak);
}

static void resize_keeps_contents(void **state)
{
    (void)state;
    struct memory memory;
    memory_init(&memory, UINT64_MAX);
    for (int i = 0; i < SIZE_COUNT; i++)
        for (int j = 0; j < SIZE_COUNT; j++) {
            unsigned char *block = memory_resize(&memory, NULL, sizes[i]);
            assert_non_null(block);
            fill(block, sizes[i], 3);
            block = memory_resize(&memory, block, sizes[j]);
            assert_non_null(block);
            assert_int_equal((uintptr_t)block % 64, 0);
            assert_true(filled(block, sizes[i] < sizes[j] ? sizes[i] : sizes[j], 3));
            block[sizes[j] - 1] = 1; /* the new end is writable */
            assert_int_equal(memory.live, sizes[j]);
            memory_free(&memory, block);
            assert_int_equal(memory.live, 0);
        }
}

static void growing_step_by_step_keeps_contents(void **state)
{
    (void)state;
    struct memory memory;
    memory_init(&memory, UINT64_MAX);
    uint64_t size = 1000, before = 0;
    unsigned char *block = NULL;
    for (int i = 0; i < 20; i++, before = size, size += size / 2 + 1) {
        block = memory_resize(&memory, block, size);
        assert_non_null(block);
        assert_true(filled(block, before, 9));
        fill(block, size, 9);
    }
    memory_free(&memory, block);
    assert_int_equal(memory.live, 0);
}

static void nothing_is_not_a_block(void **state)
{
    (void)state;
    struct memory memory;
    memory_init(&memory, UINT64_MAX);
    assert_null(memory_alloc(&memory, 0));
    assert_null(memory_array(&memory, 0, 8));
    assert_null(memory_array(&memory, 8, 0));
    assert_null(memory_resize(&memory, NULL, 0));
    memory_free(&memory, NULL);
    assert_int_equal(memory.live, 0);

    char *block = memory_alloc(&memory, 10);
    strcpy(block, "stays");
    assert_null(memory_resize(&memory, block, 0));
    assert_string_equal(block, "stays");
    assert_int_equal(memory.live, 10);
    memory_free(&memory, block);
}

static void absurd_sizes_fail(void **state)
{
    (void)state;
    static const uint64_t absurd[] = {UINT64_MAX,      UINT64_MAX - 1, UINT64_MAX - 63,        UINT64_MAX - 64,
                                      UINT64_MAX - 65, UINT64_MAX / 2, UINT64_MAX - (2 << 20), UINT64_MAX - (4 << 20)};
    struct memory memory;
    memory_init(&memory, UINT64_MAX);
    char *small = memory_alloc(&memory, 5), *large = memory_alloc(&memory, 5 << 20);
    strcpy(small, "stay");
    strcpy(large, "also");
    for (size_t i = 0; i < sizeof absurd / sizeof absurd[0]; i++) {
        assert_null(memory_alloc(&memory, absurd[i]));
        assert_null(memory_resize(&memory, small, absurd[i]));
        assert_null(memory_resize(&memory, large, absurd[i]));
        assert_int_equal(memory.live, 5 + (5 << 20));
    }
    assert_null(memory_array(&memory, UINT64_C(1) << 32, UINT64_C(1) << 32));
    assert_null(memory_array(&memory, UINT64_MAX, 2));
    assert_null(memory_array(&memory, (UINT64_C(1) << 61) + 1, 8)); /* 8 after wrapping around */
    assert_string_equal(small, "stay");
    assert_string_equal(large, "also");
    memory_free(&memory, small);
    memory_free(&memory, large);
    assert_int_equal(memory.live, 0);
}

static void the_limit_is_kept(void **state)
{
    (void)state;
    struct memory memory;
    memory_init(&memory, 1000);
    char *a = memory_alloc(&memory, 600);
    assert_non_null(a);
    assert_null(memory_alloc(&memory, 401));
    char *b = memory_alloc(&memory, 400);
    assert_non_null(b);
    assert_null(memory_alloc(&memory, 1));
    assert_int_equal(memory.live, 1000);
    memory_free(&memory, a);
    a = memory_alloc(&memory, 600);
    assert_non_null(a);
    memory_free(&memory, a);
    memory_free(&memory, b);
    assert_int_equal(memory.live, 0);
    assert_int_equal(memory.peak, 1000);
}

/*
 * The old and the new block count together while bytes are copied; a mapping that moves its pages counts only the
 * difference.
 */
static void a_resize_over_the_limit_changes_nothing(void **state)
{
    (void)state;
    struct memory memory;
    memory_init(&memory, 24 << 20);
    for (uint64_t size = 1 << 20; size <= 16 << 20; size *= 16) {
        unsigned char *block = memory_alloc(&memory, size);
        fill(block, size, 1);
        assert_null(memory_resize(&memory, block, (24 << 20) + 1));
        assert_int_equal(memory.live, size);
        assert_true(filled(block, size, 1));
        memory_free(&memory, block);
    }
    assert_true(memory.peak <= memory.limit);
}

static void the_chosen_allocation_fails(void **state)
{
    (void)state;
    struct memory memory;
    memory_init(&memory, UINT64_MAX);
    for (int n = 0; n < 6; n++) {
        memory.fail_after = n;
        for (int i = 0; i < 10; i++) {
            void *block = i % 2 ? memory_alloc(&memory, 8) : memory_array(&memory, 2, 3000000);
            assert_int_equal(block == NULL, i == n);
            memory_free(&memory, block);
        }
        assert_true(memory.fail_after < 0);
    }
}

static void a_failed_resize_keeps_the_block(void **state)
{
    (void)state;
    struct memory memory;
    memory_init(&memory, UINT64_MAX);
    for (int i = 0; i < SIZE_COUNT; i++)
        for (int j = 0; j < SIZE_COUNT; j += 3) {
            unsigned char *block = memory_alloc(&memory, sizes[i]);
            block[0] = 42;
            memory.fail_after = 0;
            assert_null(memory_resize(&memory, block, sizes[j]));
            assert_int_equal(memory.live, sizes[i]);
            assert_int_equal(block[0], 42);
            unsigned char *again = memory_resize(&memory, block, sizes[j]);
            assert_non_null(again);
            assert_int_equal(again[0], 42);
            memory_free(&memory, again);
        }
    assert_int_equal(memory.live, 0);
}

enum { THREADS = 4, ROUNDS = 2000 };

static void *churn(void *context)
{
    struct memory *memory = context;
    uintptr_t failures = 0;
    for (unsigned i = 0; i < ROUNDS; i++) {
        unsigned char *block = memory_alloc(memory, 1 + i * 37 % 5000);
        failures += block == NULL;
        if (!block)
            continue;
        block[0] = 1;
        unsigned char *larger = memory_resize(memory, block, 10000);
        failures += larger == NULL;
        memory_free(memory, larger ? larger : block);
    }
    return (void *)failures;
}

static uintptr_t churn_in_threads(struct memory *memory)
{
    pthread_t threads[THREADS];
    uintptr_t failures = 0;
    for (int i = 0; i < THREADS; i++)
        assert_int_equal(pthread_create(&threads[i], NULL, churn, memory), 0);
    for (int i = 0; i < THREADS; i++) {
        void *result;
        pthread_join(threads[i], &result);
        failures += (uintptr_t)result;
    }
    return failures;
}

static void threads_share_a_budget(void **state)
{
    (void)state;
    struct memory memory;
    memory_init(&memory, UINT64_MAX);
    assert_int_equal(churn_in_threads(&memory), 0);
    assert_int_equal(memory.live, 0);
    assert_true(memory.peak >= 10001 && memory.peak <= THREADS * 15000);

    memory_init(&memory, 18000);
    churn_in_threads(&memory);
    assert_int_equal(memory.live, 0);
    assert_true(memory.peak <= 18000);

    memory_init(&memory, UINT64_MAX);
    memory.fail_after = 1234;
    assert_int_equal(churn_in_threads(&memory), 1); /* exactly one allocation fails, in whichever thread */
    assert_int_equal(memory.live, 0);
}

static void a_child_counts_in_its_parent(void **state)
{
    (void)state;
    struct memory parent, child, grandchild;
    memory_init(&parent, UINT64_MAX);
    memory_init_within(&child, &parent, UINT64_MAX);
    memory_init_within(&grandchild, &child, UINT64_MAX);
    void *own = memory_alloc(&parent, 1000), *inner = memory_alloc(&grandchild, 200),
         *large = memory_alloc(&child, 5 << 20);
    assert_int_equal(grandchild.live, 200);
    assert_int_equal(child.live, 200 + (5 << 20));
    assert_int_equal(parent.live, 1200 + (5 << 20));
    large = memory_resize(&child, large, 6 << 20);
    inner = memory_resize(&grandchild, inner, 300);
    assert_int_equal(child.live, 300 + (6 << 20));
    assert_int_equal(parent.live, 1300 + (6 << 20));
    memory_free(&child, large);
    memory_free(&grandchild, inner);
    assert_int_equal(grandchild.live + child.live, 0);
    assert_int_equal(parent.live, 1000);
    assert_int_equal(grandchild.peak, 500);
    assert_true(child.peak >= 500 + (6 << 20)); /* more, because large blocks are copied */
    assert_int_equal(parent.peak, child.peak + 1000);
    memory_free(&parent, own);
}

static void either_limit_refuses(void **state)
{
    (void)state;
    struct memory parent, child;
    memory_init(&parent, 1000);
    memory_init_within(&child, &parent, 600);
    void *own = memory_alloc(&parent, 500);
    assert_null(memory_alloc(&child, 601)); /* over the child's limit */
    assert_null(memory_alloc(&child, 501)); /* over the parent's limit */
    assert_int_equal(child.live + child.peak, 0); /* a refused allocation counts nowhere */
    assert_int_equal(parent.live, 500);
    assert_int_equal(parent.peak, 500);
    void *block = memory_alloc(&child, 500);
    assert_non_null(block);
    assert_null(memory_resize(&child, block, 600));
    assert_int_equal(child.live, 500);
    assert_int_equal(parent.live, 1000);
    memory_free(&parent, own);
    assert_null(memory_alloc(&child, 101));
    memory_free(&child, block);
    assert_int_equal(parent.live, 0);
}

static void a_large_block_that_may_not_grow_stays_counted(void **state)
{
    (void)state;
    struct memory parent, child;
    memory_init(&parent, 8 << 20);
    memory_init_within(&child, &parent, UINT64_MAX);
    void *block = memory_alloc(&child, 5 << 20);
    assert_null(memory_resize(&child, block, 9 << 20));
    assert_int_equal(child.live, 5 << 20);
    assert_int_equal(parent.live, 5 << 20);
    memory_free(&child, block);
    assert_int_equal(parent.live + child.live, 0);
}

static void failures_of_a_parent_reach_its_children(void **state)
{
    (void)state;
    struct memory parent, child;
    memory_init(&parent, UINT64_MAX);
    memory_init_within(&child, &parent, UINT64_MAX);
    parent.fail_after = 1;
    void *block = memory_alloc(&child, 8);
    assert_non_null(block);
    assert_null(memory_alloc(&child, 8));
    child.fail_after = 0;
    assert_null(memory_resize(&child, block, 16));
    void *own = memory_alloc(&parent, 8);
    assert_non_null(own);
    assert_int_equal(child.live, 8);
    assert_int_equal(parent.live, 16);
    memory_free(&child, block);
    memory_free(&parent, own);
}

static void blocks_are_handed_up(void **state)
{
    (void)state;
    struct memory parent, child;
    memory_init(&parent, UINT64_MAX);
    memory_init_within(&child, &parent, 100);
    void *block = memory_alloc(&child, 100);
    memory_hand_up(&child, block);
    memory_hand_up(&child, NULL);
    assert_int_equal(child.live, 0);
    assert_int_equal(child.peak, 100);
    assert_int_equal(parent.live, 100);
    memory_free(&parent, block);
    assert_int_equal(parent.live, 0);
}

static void *churn_within(void *context)
{
    struct memory child;
    memory_init_within(&child, context, 12000);
    churn(&child);
    return (void *)(uintptr_t)(atomic_load(&child.live) + (atomic_load(&child.peak) > 12000));
}

static void children_share_a_parent(void **state)
{
    (void)state;
    struct memory parent;
    memory_init(&parent, 30000);
    pthread_t threads[THREADS];
    void *result;
    for (int i = 0; i < THREADS; i++)
        assert_int_equal(pthread_create(&threads[i], NULL, churn_within, &parent), 0);
    for (int i = 0; i < THREADS; i++) {
        pthread_join(threads[i], &result);
        assert_null(result);
    }
    assert_int_equal(parent.live, 0);
    assert_true(parent.peak <= 30000);
}

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
enum { OWN_HEAP = 0 };
#elif defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer)
enum { OWN_HEAP = 0 };
#else
enum { OWN_HEAP = 1 };
#endif
#else
enum { OWN_HEAP = 1 };
#endif

/* Returns how many pages the process requested while it allocated and freed 12 MB. */
static long faults_of_a_round(struct memory *memory)
{
    enum { BLOCKS = 30, SIZE = 400000 };
    void *blocks[BLOCKS];
    struct rusage before, after;
    getrusage(RUSAGE_SELF, &before);
    for (int i = 0; i < BLOCKS; i++) {
        blocks[i] = memory_alloc(memory, SIZE);
        assert_non_null(blocks[i]);
        memset(blocks[i], 1, SIZE);
    }
    for (int i = 0; i < BLOCKS; i++)
        memory_free(memory, blocks[i]);
    getrusage(RUSAGE_SELF, &after);
    return after.ru_minflt - before.ru_minflt;
}

static void a_kept_heap_asks_for_pages_once(void **state)
{
    (void)state;
#ifdef __GLIBC__
    struct memory memory;
    memory_init(&memory, UINT64_MAX);
    memory_keep();
    if (!OWN_HEAP)
        return;
    faults_of_a_round(&memory);
    for (int i = 0; i < 5; i++)
        assert_true(faults_of_a_round(&memory) < 300);
#endif
}

static void a_shortage_is_explained(void **state)
{
    (void)state;
    struct memory parent, child;
    struct bvhd_error error, other = {.status = BVHD_IO, .text = "broken"};
    memory_init(&parent, 3 << 20);
    memory_init_within(&child, &parent, UINT64_MAX);
    bvhd_error_no_memory(&error, "", "no memory for a tree");
    memory_explain(&child, &error);
    assert_string_equal(error.text, "no memory for a tree"); /* the budget is not the reason */
    void *block = memory_alloc(&child, 2 << 20);
    assert_null(memory_alloc(&child, 3 << 19));
    memory_explain(&child, &other);
    assert_string_equal(other.text, "broken");
    for (int i = 0; i < 2; i++) {
        memory_explain(&child, &error);
        assert_string_equal(error.text, "no memory for a tree; it needs at least 3.5 MiB, and the limit is 3.0 MiB");
    }
    memory_free(&child, block);
    assert_null(memory_alloc(&parent, UINT64_MAX));
    bvhd_error_no_memory(&error, "", "%s", "");
    memory_explain(&parent, &error);
    assert_true(strncmp(error.text, "it needs at least ", 18) == 0);
    memory_explain(&parent, NULL);
}

static void the_machine_is_explained(void **state)
{
    (void)state;
    struct memory memory;
    struct bvhd_error error;
    memory_init(&memory, UINT64_MAX);
    assert_null(memory_alloc(&memory, UINT64_MAX / 2));
    bvhd_error_no_memory(&error, "", "no memory");
    memory_explain(&memory, &error);
    assert_non_null(strstr(error.text, ", more than the machine has"));
}

int main(void)
{
    static const struct CMUnitTest tests[] = {
        cmocka_unit_test(blocks_are_aligned_and_counted),
        cmocka_unit_test(resize_keeps_contents),
        cmocka_unit_test(growing_step_by_step_keeps_contents),
        cmocka_unit_test(nothing_is_not_a_block),
        cmocka_unit_test(absurd_sizes_fail),
        cmocka_unit_test(the_limit_is_kept),
        cmocka_unit_test(a_resize_over_the_limit_changes_nothing),
        cmocka_unit_test(the_chosen_allocation_fails),
        cmocka_unit_test(a_failed_resize_keeps_the_block),
        cmocka_unit_test(threads_share_a_budget),
        cmocka_unit_test(a_child_counts_in_its_parent),
        cmocka_unit_test(either_limit_refuses),
        cmocka_unit_test(a_large_block_that_may_not_grow_stays_counted),
        cmocka_unit_test(failures_of_a_parent_reach_its_children),
        cmocka_unit_test(blocks_are_handed_up),
        cmocka_unit_test(children_share_a_parent),
        cmocka_unit_test(a_shortage_is_explained),
        cmocka_unit_test(the_machine_is_explained),
        cmocka_unit_test(a_kept_heap_asks_for_pages_once),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
