/* SPDX-License-Identifier: Apache-2.0 */
/* test_heap.c - tests that free memory between blocks goes back to the system, and that the heap's end stays small. */
#include "tests/support/unit.h"

#include <time.h>
#include <unistd.h>

#include "daemon/system/heap.h"
#include "proto/base/clock.h"
#include "proto/base/memory.h"
#include "tests/support/daemon/process_view.h"

/* Sanitizers have heaps of their own. */
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define OWN_HEAP 0
#elif defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer)
#define OWN_HEAP 0
#endif
#endif
#ifndef OWN_HEAP
#define OWN_HEAP 1
#endif

enum { BLOCKS = 400, SIZE = 60000, ALL = BLOCKS * SIZE };

static struct memory memory;
static void *blocks[BLOCKS], *pins[BLOCKS];

static void allocate_one(int i)
{
    blocks[i] = memory_alloc(&memory, SIZE);
    assert_non_null(blocks[i]);
    memset(blocks[i], 1, SIZE);
}

static void free_all(void **list)
{
    for (int i = 0; i < BLOCKS; i++)
        memory_free(&memory, list[i]);
}

/* Blocks in use keep the memory between them in the heap, until it is trimmed. */
static void free_pages_go_back(void **state)
{
    (void)state;
    for (int i = 0; i < BLOCKS; i++) {
        allocate_one(i);
        pins[i] = memory_alloc(&memory, 100);
        assert_non_null(pins[i]);
    }
    uint64_t before = process_private_bytes(getpid());
    free_all(blocks);
    for (double begin = clock_ms(); OWN_HEAP && process_private_bytes(getpid()) > before - ALL / 2;) {
        heap_trim();
        assert_true(clock_ms() - begin < 30000);
        nanosleep(&(struct timespec){.tv_nsec = 1000000}, NULL);
    }
    free_all(pins);
}

/* A small budget means a small heap as soon as nothing is in use. */
static void the_end_stays_small(void **state)
{
    (void)state;
    heap_limit(16 << 20, 4);
    uint64_t before = process_private_bytes(getpid());
    for (int i = 0; i < BLOCKS; i++)
        allocate_one(i);
    free_all(blocks);
    uint64_t after = process_private_bytes(getpid());
    assert_true(!OWN_HEAP || after < before + ALL / 4);
    heap_limit(UINT64_MAX, 0);
}

int main(void)
{
    static const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_end_stays_small),
        cmocka_unit_test(free_pages_go_back),
    };
    memory_init(&memory, UINT64_MAX);
    memory_keep();
    return cmocka_run_group_tests(tests, NULL, NULL);
}
