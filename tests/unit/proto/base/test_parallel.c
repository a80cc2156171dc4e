/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_parallel.c - tests that loops run every task once, that chunks cover the whole, and that cancelled loops stop.
 */
#include "tests/support/unit.h"

#include "proto/base/parallel.h"

struct record {
    size_t seen[10];
    size_t count;
};

static void note(void *context, size_t index)
{
    struct record *record = context;
    record->seen[record->count++] = index;
}

static void serial_runs_all_in_order(void **state)
{
    (void)state;
    struct record record = {.count = 0};
    parallel_for(&parallel_serial, 10, note, &record);
    assert_int_equal(record.count, 10);
    for (size_t i = 0; i < 10; i++)
        assert_int_equal(record.seen[i], i);
    assert_int_equal(parallel_serial.threads, 1);
}

static void nothing_to_do_is_nothing_done(void **state)
{
    (void)state;
    struct record record = {.count = 0};
    parallel_for(&parallel_serial, 0, note, &record);
    assert_int_equal(record.count, 0);
}

/* Chunks follow each other without a gap, cover everything, and are full except for the last. */
static void chunks_cover_the_whole(void **state)
{
    (void)state;
    for (size_t total = 0; total < 50; total++)
        for (size_t chunk = 1; chunk < 60; chunk++) {
            size_t reached = 0, count = parallel_chunks(chunk, total);
            assert_int_equal(count, (total + chunk - 1) / chunk);
            for (size_t i = 0; i < count; i++) {
                size_t begin, end;
                parallel_chunk(i, chunk, total, &begin, &end);
                assert_int_equal(begin, reached);
                assert_true(end > begin && end - begin <= chunk);
                assert_true(end - begin == chunk || i == count - 1);
                reached = end;
            }
            assert_int_equal(reached, total);
        }
}

static void chunks_reach_the_largest_size(void **state)
{
    (void)state;
    size_t begin, end;
    parallel_chunk(1, SIZE_MAX / 2 + 1, SIZE_MAX, &begin, &end);
    assert_true(begin == SIZE_MAX / 2 + 1 && end == SIZE_MAX);
    assert_int_equal(parallel_chunks(SIZE_MAX / 2 + 1, SIZE_MAX), 2);
    assert_int_equal(parallel_chunks(SIZE_MAX, SIZE_MAX), 1);
}

struct stopping {
    struct record record;
    atomic_bool cancel;
    size_t at;
};

static void note_and_stop(void *context, size_t index)
{
    struct stopping *stopping = context;
    note(&stopping->record, index);
    if (index == stopping->at)
        atomic_store(&stopping->cancel, true);
}

static void a_cancelled_loop_begins_no_more_tasks(void **state)
{
    (void)state;
    for (size_t at = 0; at < 10; at++) {
        struct stopping stopping = {.at = at};
        assert_false(parallel_for_until(&parallel_serial, &stopping.cancel, 10, note_and_stop, &stopping));
        assert_int_equal(stopping.record.count, at + 1);
        assert_false(parallel_for_until(&parallel_serial, &stopping.cancel, 10, note_and_stop, &stopping));
        assert_int_equal(stopping.record.count, at + 1);
    }
    struct stopping whole = {.at = 10};
    assert_true(parallel_for_until(&parallel_serial, &whole.cancel, 10, note_and_stop, &whole));
    assert_int_equal(whole.record.count, 10);
    struct record record = {.count = 0};
    assert_true(parallel_for_until(&parallel_serial, NULL, 10, note, &record));
    assert_int_equal(record.count, 10);
}

int main(void)
{
    static const struct CMUnitTest tests[] = {
        cmocka_unit_test(serial_runs_all_in_order),
        cmocka_unit_test(nothing_to_do_is_nothing_done),
        cmocka_unit_test(chunks_cover_the_whole),
        cmocka_unit_test(chunks_reach_the_largest_size),
        cmocka_unit_test(a_cancelled_loop_begins_no_more_tasks),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
