/* SPDX-License-Identifier: Apache-2.0 */
/* test_store_get.c - tests what store_get makes of damaged files, of what is no file, and of receivers that refuse. */
#include "tests/support/unit.h"

#include "tests/support/scratch.h"

#include "tests/support/builder/store_bed.h"

/* Changes a byte of the entry's file. */
static void damage(uint32_t number, off_t at)
{
    unsigned char byte;
    int file = bed_file(number, O_RDWR);
    assert_int_equal(pread(file, &byte, 1, at), 1);
    byte ^= 0x10;
    assert_int_equal(pwrite(file, &byte, 1, at), 1);
    close(file);
}

static void expect_damaged(uint32_t number, const char *rule)
{
    struct bvhd_error error = {0};
    uint64_t before = store_state(bed_store).damaged;
    assert_int_equal(bed_get(number, &error), BVHD_NOT_FOUND);
    assert_non_null(strstr(error.text, rule));
    assert_int_equal(store_state(bed_store).damaged, before + 1);
    assert_int_equal(bed_get(number, &error), BVHD_NOT_FOUND);
    assert_int_equal(store_state(bed_store).damaged, before + 1);
    bed_put(number, 100);
    assert_true(bed_has(number));
}

static void damage_is_set_aside(void **state)
{
    (void)state;
    static const struct {
        off_t at;
        const char *rule;
    } cases[] = {{0, "begin"}, {8, "format"},    {15, "summary"}, {20, "size"},
                 {30, "key"},  {60, "checksum"}, {75, "checksum"}};
    for (uint32_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        bed_put(i, 70000);
        damage(i, cases[i].at);
        expect_damaged(i, cases[i].rule);
    }
    bed_put(50, 200000);
    damage(50, 199000);
    expect_damaged(50, "checksum");
    assert_int_equal(bed_shell(0, "ls development-test1/damaged | wc -l"), 8);
}

static void damaged_files_are_few(void **state)
{
    (void)state;
    for (uint32_t i = 0; i < 40; i++) {
        bed_put(i, 100);
        damage(i, 80);
        assert_false(bed_has(i));
    }
    assert_int_equal(bed_shell(0, "ls development-test1/damaged | wc -l"), 16);
    struct store_state at = store_state(bed_store);
    assert_int_equal(at.entries, 0);
    assert_int_equal(at.bytes, 16 * 4096);
    bed_close();
    bed_open(64 * 20000);
    bed_put(1, 30000);
    damage(1, 80);
    assert_false(bed_has(1));
    assert_int_equal(bed_shell(0, "ls development-test1/damaged | wc -l"), 0);
}

static void what_is_no_file_is_set_aside(void **state)
{
    (void)state;
    static const char *const commands[] = {"rm $E && ln -s /dev/zero $E", "rm $E && mkfifo $E", "rm $E && mkdir $E",
                                           "rm $E && ln -s nothing $E", "chmod 620 $E"};
    for (int i = 0; i < 5; i++) {
        bed_put(1, 100);
        bed_shell(1, commands[i]);
        expect_damaged(1, "no file that only its owner may write");
    }
    if (geteuid() == 0) {
        bed_shell(1, "chown 12345 $E");
        expect_damaged(1, "no file that only its owner may write");
    }
}

static void a_shard_may_be_anything(void **state)
{
    (void)state;
    struct bvhd_error error = {0};
    bed_put(1, 100);
    bed_shell(1, "S=${E%/*} && mv $S moved && ln -s ../moved $S");
    assert_int_equal(bed_get(1, &error), BVHD_NOT_FOUND);
    assert_int_equal(bed_try_put(1, 100, &error), BVHD_IO);
    assert_true(error.where[0] && error.text[0]);
    bed_shell(1, "S=${E%/*} && rm $S && touch $S");
    assert_int_equal(bed_get(1, &error), BVHD_NOT_FOUND);
    assert_int_equal(store_state(bed_store).damaged, 0);
    assert_int_equal(store_state(bed_store).write_errors, 1);
}

/* What the receiver answers is passed on; only what it finds damaged is set aside. */
static void a_receiver_may_refuse(void **state)
{
    (void)state;
    struct key key = bed_key(1);
    struct bvhd_error error = {0};
    bed_put(1, 100);
    for (int at = 0; at < 4; at++) {
        enum bvhd_status status = at < 2 ? BVHD_NO_MEMORY : BVHD_CORRUPT;
        struct bed_sink sink = {.sink = {bed_sink_begin, bed_sink_room, bed_sink_write}};
        *(at % 2 ? &sink.begin_status : &sink.write_status) = status;
        assert_int_equal(store_get(bed_store, &key, bed_parallel, &sink.sink, &error),
                         at < 2 ? BVHD_NO_MEMORY : BVHD_NOT_FOUND);
        assert_non_null(strstr(error.text, "refused"));
        assert_int_equal(store_state(bed_store).damaged, at < 2 ? 0 : at - 1);
        free(sink.bytes);
        if (at >= 2)
            bed_put(1, 100);
        assert_true(bed_has(1));
    }
}

/* Pieces arrive where the receiver has room for them, or in memory of the store: all but the first. */
static void a_receiver_may_have_no_room(void **state)
{
    (void)state;
    struct key key = bed_key(1);
    struct bvhd_error error = {0};
    unsigned char *bytes[2];
    bed_put(1, 300000);
    for (int i = 0; i < 2; i++) {
        struct bed_sink sink = {.sink = {bed_sink_begin, bed_sink_room, bed_sink_write}, .has_no_room = i == 1};
        assert_int_equal(store_get(bed_store, &key, bed_parallel, &sink.sink, &error), BVHD_OK);
        assert_int_equal(sink.got, 300000);
        bytes[i] = sink.bytes;
    }
    assert_memory_equal(bytes[0], bytes[1], 300000);
    free(bytes[0]);
    free(bytes[1]);
}

/* Files that change while they are read: one that becomes shorter, one that vanishes, and one that was mended. */
static enum bvhd_status shorten(struct store_sink *sink, const struct store_entry *entry, struct bvhd_error *error)
{
    int file = bed_file(1, O_RDWR);
    assert_int_equal(ftruncate(file, 100000), 0);
    close(file);
    return bed_sink_begin(sink, entry, error);
}

static enum bvhd_status vanish(struct store_sink *sink, const struct store_entry *entry, struct bvhd_error *error)
{
    assert_int_equal(store_clear(bed_store, error), BVHD_OK);
    return bed_sink_begin(sink, entry, error);
}

static enum bvhd_status mend(struct store_sink *sink, const struct store_entry *entry, struct bvhd_error *error)
{
    bed_put(1, 150000);
    return bed_sink_begin(sink, entry, error);
}

static enum bvhd_status get_while(enum bvhd_status (*begin)(struct store_sink *, const struct store_entry *,
                                                            struct bvhd_error *))
{
    struct bed_sink sink = {.sink = {begin, bed_sink_room, bed_sink_write}};
    struct key key = bed_key(1);
    struct bvhd_error error = {0};
    enum bvhd_status status = store_get(bed_store, &key, bed_parallel, &sink.sink, &error);
    free(sink.bytes);
    return status;
}

static void files_may_change_meanwhile(void **state)
{
    (void)state;
    bed_put(1, 150000);
    assert_int_equal(get_while(shorten), BVHD_NOT_FOUND);
    assert_int_equal(store_state(bed_store).damaged, 1);
    bed_put(1, 150000);
    assert_int_equal(get_while(vanish), BVHD_OK);
    bed_put(1, 150000);
    damage(1, 149000);
    assert_int_equal(get_while(mend), BVHD_NOT_FOUND);
    assert_int_equal(store_state(bed_store).damaged, 2);
    assert_true(bed_has(1));
}

/* The most threads that read one entry. */
enum { READERS = 4 };

struct bed_call {
    parallel_task task;
    void *context;
    size_t index;
};

static void *run_call(void *argument)
{
    const struct bed_call *call = argument;
    call->task(call->context, call->index);
    return NULL;
}

static int calls_made;

/* Each task runs on a thread of its own. */
static void run_on_threads(const struct parallel *self, size_t count, parallel_task task, void *context)
{
    pthread_t threads[READERS];
    struct bed_call calls[READERS];
    assert_int_equal(count, self->threads < 2 * READERS ? self->threads / 2 : READERS);
    calls_made++;
    for (size_t i = 0; i < count; i++) {
        calls[i] = (struct bed_call){task, context, i};
        assert_int_equal(pthread_create(&threads[i], NULL, run_call, &calls[i]), 0);
    }
    for (size_t i = 0; i < count; i++)
        pthread_join(threads[i], NULL);
}

/* Entries below, at and above the limits of what is read at a time, whole, damaged at their ends, and shortened. */
static void several_threads_may_read(void **state)
{
    static const struct {
        uint32_t size;
        int calls; /* in which several threads read */
    } cases[] = {{100, 0}, {270000, 0}, {271000, 1}, {(4 << 20) - 100, 1}, {(4 << 20) + 9000, 1}, {9500000, 3}};
    uint32_t damaged = 0;
    (void)state;
    for (unsigned count = 4; count <= 4 * READERS; count *= 2) {
        const struct parallel threads = {count, run_on_threads};
        bed_parallel = &threads;
        for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
            bed_put(1, cases[i].size);
            calls_made = 0;
            assert_true(bed_has(1));
            assert_int_equal(calls_made, cases[i].calls);
            damage(1, cases[i].size);
            assert_false(bed_has(1));
            assert_int_equal(store_state(bed_store).damaged, ++damaged);
        }
        bed_put(1, 3500000);
        assert_int_equal(get_while(shorten), BVHD_NOT_FOUND);
        assert_int_equal(store_state(bed_store).damaged, ++damaged);
    }
    bed_parallel = &parallel_serial;
}

/* The bytes are the same then, also for a receiver without room. */
static void several_threads_read_the_same(void **state)
{
    static const struct parallel threads = {2 * READERS, run_on_threads};
    bed_parallel = &threads;
    a_receiver_may_have_no_room(state);
    bed_parallel = &parallel_serial;
}

static unsigned char *room_once(struct store_sink *sink, uint64_t size)
{
    return size > STORE_PIECE ? bed_sink_room(sink, size) : NULL;
}

/* A receiver that is asked for room for several pieces is not asked again for room for each of them. */
static void room_for_several_pieces_is_given_once(void **state)
{
    static const struct parallel threads = {2 * READERS, run_on_threads};
    struct bed_sink sink = {.sink = {bed_sink_begin, room_once, bed_sink_write}};
    const struct key key = bed_key(1);
    struct bvhd_error error = {0};
    unsigned char *payload = bed_payload(1, 300000);
    (void)state;
    bed_put(1, 300000);
    assert_int_equal(store_get(bed_store, &key, &threads, &sink.sink, &error), BVHD_OK);
    assert_int_equal(sink.got, 300000);
    assert_memory_equal(sink.bytes, payload, 300000);
    free(sink.bytes);
    free(payload);
}

static time_t time_of(uint32_t number)
{
    struct stat about;
    int file = bed_file(number, O_RDONLY);
    assert_int_equal(fstat(file, &about), 0);
    close(file);
    return about.st_mtime;
}

static void a_hit_refreshes_the_time(void **state)
{
    (void)state;
    bed_put(1, 100);
    const time_t now = time(NULL);
    bed_age(1, STORE_REFRESH_SECONDS + 1);
    assert_true(bed_has(1));
    assert_true(time_of(1) >= now);
    bed_age(1, -1000000);
    assert_true(bed_has(1));
    assert_true(time_of(1) < now + 500000);
    bed_age(1, 5);
    const time_t recent = time_of(1);
    if (bed_has(1) && time(NULL) - recent < STORE_REFRESH_SECONDS)
        assert_int_equal(time_of(1), recent);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(damage_is_set_aside, bed_begin, bed_end),
        cmocka_unit_test_setup_teardown(damaged_files_are_few, bed_begin, bed_end),
        cmocka_unit_test_setup_teardown(what_is_no_file_is_set_aside, bed_begin, bed_end),
        cmocka_unit_test_setup_teardown(a_shard_may_be_anything, bed_begin, bed_end),
        cmocka_unit_test_setup_teardown(a_receiver_may_have_no_room, bed_begin, bed_end),
        cmocka_unit_test_setup_teardown(a_receiver_may_refuse, bed_begin, bed_end),
        cmocka_unit_test_setup_teardown(files_may_change_meanwhile, bed_begin, bed_end),
        cmocka_unit_test_setup_teardown(several_threads_may_read, bed_begin, bed_end),
        cmocka_unit_test_setup_teardown(several_threads_read_the_same, bed_begin, bed_end),
        cmocka_unit_test_setup_teardown(room_for_several_pieces_is_given_once, bed_begin, bed_end),
        cmocka_unit_test_setup_teardown(a_hit_refreshes_the_time, bed_begin, bed_end),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
