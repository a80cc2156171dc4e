/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_blob.c - tests that blobs cannot be changed by anybody, that they are counted, and that failures leave nothing.
 */
#include "tests/support/unit.h"

#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <pthread.h>
#include <signal.h>
#include <stdbool.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include "daemon/service/blob.h"

/* Sizes on both sides of every border: inline, written at the end, mapped; whole pages and others. */
static const uint64_t sizes[] = {1,
                                 64,
                                 1000,
                                 BLOB_INLINE_MAX - 1,
                                 BLOB_INLINE_MAX,
                                 BLOB_INLINE_MAX + 1,
                                 100000,
                                 1 << 20,
                                 BLOB_MAPPED_MIN - 1,
                                 BLOB_MAPPED_MIN,
                                 BLOB_MAPPED_MIN + 1,
                                 5000000};

enum { SIZE_COUNT = sizeof sizes / sizeof sizes[0], DESCRIPTORS = 1000 };

static struct memory memory;
static struct descriptors descriptors;
static struct blob_account account;

/* Other threads may still be closing large files of the previous test. */
static void wait_until_all_is_closed(void)
{
    for (int i = 0; i < 5000 && descriptors_left(&descriptors) < descriptors.limit; i++)
        usleep(1000);
}

static int set_up(void **state)
{
    (void)state;
    memory_init(&memory, UINT64_MAX);
    descriptors = (struct descriptors){.limit = DESCRIPTORS};
    wait_until_all_is_closed();
    blob_account_init(&account, &memory, &descriptors);
    return 0;
}

static bool nothing_is_held(void)
{
    return memory.live == 0 && descriptors.used == 0 && account.live_bytes == 0 && account.live_blobs == 0;
}

static int tear_down(void **state)
{
    (void)state;
    return nothing_is_held() ? 0 : -1;
}

static unsigned char expected_byte(uint64_t at)
{
    return (unsigned char)(at * 2654435761u >> 13 | 1);
}

static void fill(unsigned char *bytes, uint64_t size)
{
    for (uint64_t i = 0; i < size; i++)
        bytes[i] = expected_byte(i);
}

static void expect_filled(const unsigned char *bytes, uint64_t size)
{
    for (uint64_t i = 0; i < size; i++)
        if (bytes[i] != expected_byte(i))
            fail_msg("byte %" PRIu64 " differs", i);
}

/* All tests run twice: with blobs that builds write, and with blobs of bytes that come in pieces. */
static bool in_pieces;

static enum bvhd_status append_pieces(struct blob_writer *writer, uint64_t size, struct bvhd_error *error)
{
    enum bvhd_status status = blob_writer_begin(writer, size, NULL, error);
    if (status != BVHD_OK)
        return status;
    unsigned char *bytes = malloc(size);
    assert_non_null(bytes);
    fill(bytes, size);
    for (uint64_t at = 0, piece = 1; status == BVHD_OK && at < size; at += piece) {
        piece = size - at < 2 * piece ? size - at : 2 * piece;
        status = blob_writer_append(writer, bytes + at, piece, error);
    }
    free(bytes);
    return status;
}

static enum bvhd_status write_in_pieces(uint64_t size, struct blob **ret_blob, struct bvhd_error *error)
{
    struct blob_writer writer;
    blob_writer_init(&writer, &account);
    enum bvhd_status status = append_pieces(&writer, size, error);
    if (status == BVHD_OK)
        return blob_writer_finish(&writer, ret_blob, error);
    blob_writer_discard(&writer);
    return status;
}

static enum bvhd_status write_blob(uint64_t size, struct blob **ret_blob, struct bvhd_error *error)
{
    if (in_pieces)
        return write_in_pieces(size, ret_blob, error);
    struct blob_writer writer;
    blob_writer_init(&writer, &account);
    unsigned char *bytes = writer.output.allocate(&writer.output, size);
    if (!bytes) {
        *error = writer.error;
        return error->status;
    }
    assert_int_equal((uintptr_t)bytes % 64, 0);
    fill(bytes, size);
    return blob_writer_finish(&writer, ret_blob, error);
}

static struct blob *make_blob(uint64_t size)
{
    struct blob *blob = NULL;
    struct bvhd_error error = {.text = ""};
    if (write_blob(size, &blob, &error) != BVHD_OK)
        fail_msg("%" PRIu64 " bytes: %s", size, error.text);
    return blob;
}

static void expect_file(int descriptor, uint64_t size)
{
    struct stat file;
    assert_int_equal(fstat(descriptor, &file), 0);
    assert_int_equal(file.st_size, size);
    assert_int_equal(lseek(descriptor, 0, SEEK_HOLE), size);
    assert_int_equal(fcntl(descriptor, F_GETFD), FD_CLOEXEC);
    unsigned char *mapping = mmap(NULL, size, PROT_READ, MAP_PRIVATE, descriptor, 0);
    assert_ptr_not_equal(mapping, MAP_FAILED);
    expect_filled(mapping, size);
    munmap(mapping, size);
}

static void bytes_arrive_in_memory_or_in_a_file(void **state)
{
    (void)state;
    for (int i = 0; i < SIZE_COUNT; i++) {
        bool is_small = sizes[i] <= BLOB_INLINE_MAX;
        struct blob *blob = make_blob(sizes[i]);
        assert_int_equal(blob->size, sizes[i]);
        assert_ptr_equal(blob->account, &account);
        assert_int_equal(blob->bytes != NULL, is_small);
        assert_int_equal(blob->descriptor >= 0, !is_small);
        if (is_small)
            expect_filled(blob->bytes, sizes[i]);
        else
            expect_file(blob->descriptor, sizes[i]);
        blob_unref(blob);
        assert_true(nothing_is_held());
    }
    blob_unref(NULL);
}

static void everything_is_counted(void **state)
{
    (void)state;
    uint64_t bytes = 0;
    uint32_t files = 0;
    struct blob *blobs[SIZE_COUNT];
    for (int i = 0; i < SIZE_COUNT; i++) {
        blobs[i] = make_blob(sizes[i]);
        bytes += sizes[i];
        files += sizes[i] > BLOB_INLINE_MAX;
        assert_int_equal(account.live_bytes, bytes);
        assert_int_equal(account.live_blobs, i + 1);
        assert_int_equal(descriptors.used, files);
    }
    for (int i = 0; i < SIZE_COUNT; i++) {
        blob_ref(blobs[i]);
        blob_unref(blobs[i]);
        assert_int_equal(account.live_blobs, SIZE_COUNT - i);
        blob_unref(blobs[i]);
        bytes -= sizes[i];
        assert_int_equal(account.live_bytes, bytes);
    }
}

/* Emulators of other processors ignore advice: on private memory MADV_REMOVE fails on every real system. */
static bool advice_is_ignored(void)
{
    void *private = mmap(NULL, 4096, PROT_READ, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    assert_ptr_not_equal(private, MAP_FAILED);
    bool is_ignored = madvise(private, 4096, MADV_REMOVE) == 0;
    munmap(private, 4096);
    return is_ignored;
}

/* Tries everything that a process can do to change a file through a descriptor. */
static void expect_unchangeable(int descriptor)
{
    assert_int_equal(pwrite(descriptor, "x", 1, 0), -1);
    assert_int_equal(ftruncate(descriptor, 10), -1);
    assert_int_equal(ftruncate(descriptor, 100 << 20), -1);
    assert_int_equal(fallocate(descriptor, FALLOC_FL_PUNCH_HOLE | FALLOC_FL_KEEP_SIZE, 0, 4096), -1);
    assert_int_equal(fallocate(descriptor, 0, 0, 100 << 20), -1);
    assert_int_equal(fallocate(descriptor, FALLOC_FL_KEEP_SIZE, 64 << 20, 4096), -1);
    assert_int_equal(fcntl(descriptor, F_ADD_SEALS, F_SEAL_FUTURE_WRITE), -1);
    assert_ptr_equal(mmap(NULL, 4096, PROT_READ | PROT_WRITE, MAP_SHARED, descriptor, 0), MAP_FAILED);
    void *shared = mmap(NULL, 4096, PROT_READ, MAP_SHARED, descriptor, 0);
    if (shared != MAP_FAILED) {
        assert_int_equal(mprotect(shared, 4096, PROT_READ | PROT_WRITE), -1);
        assert_true(madvise(shared, 4096, MADV_REMOVE) == -1 || advice_is_ignored());
        munmap(shared, 4096);
    }
}

static void change_private_mapping(int descriptor)
{
    unsigned char *mapping = mmap(NULL, 4096, PROT_READ | PROT_WRITE, MAP_PRIVATE, descriptor, 0);
    assert_ptr_not_equal(mapping, MAP_FAILED);
    memset(mapping, 0, 4096);
    munmap(mapping, 4096);
}

static int reopen(int descriptor, int flags)
{
    char path[40];
    snprintf(path, sizeof path, "/proc/self/fd/%d", descriptor);
    return open(path, flags | O_CLOEXEC);
}

static void holders_can_do_no_harm(void **state)
{
    (void)state;
    static const int modes[] = {O_RDONLY, O_WRONLY, O_RDWR, O_RDWR | O_TRUNC, O_RDWR | O_APPEND};
    for (int i = 0; i < SIZE_COUNT; i++) {
        if (sizes[i] <= BLOB_INLINE_MAX)
            continue;
        struct blob *blob = make_blob(sizes[i]);
        int seals = fcntl(blob->descriptor, F_GET_SEALS),
            needed = F_SEAL_SHRINK | F_SEAL_GROW | F_SEAL_WRITE | F_SEAL_SEAL;
        assert_int_equal(seals & needed, needed);
        expect_unchangeable(blob->descriptor);
        change_private_mapping(blob->descriptor);
        fchmod(blob->descriptor, 0777);
        for (size_t j = 0; j < sizeof modes / sizeof modes[0]; j++) {
            int again = reopen(blob->descriptor, modes[j]);
            if (again < 0)
                continue;
            expect_unchangeable(again);
            close(again);
        }
        expect_file(blob->descriptor, sizes[i]);
        blob_unref(blob);
    }
}

/* Returns 0 if another user can open the file again for reading, and cannot do more. */
static int try_as_somebody_else(int descriptor)
{
    if (setgid(65534) != 0 || setuid(65534) != 0 || prctl(PR_SET_DUMPABLE, 1) != 0)
        return 2;
    if (reopen(descriptor, O_RDONLY) < 0)
        return 3;
    if (reopen(descriptor, O_RDWR) >= 0 || reopen(descriptor, O_WRONLY) >= 0)
        return 4;
    return fchmod(descriptor, 0777) != 0 ? 0 : 5;
}

static void others_cannot_open_it_for_writing(void **state)
{
    (void)state;
    if (geteuid() != 0) {
        print_message("needs root, to be somebody else\n");
        skip();
    }
    struct blob *blob = make_blob(100000);
    pid_t child = fork();
    if (child == 0)
        _exit(try_as_somebody_else(blob->descriptor));
    int status;
    assert_int_equal(waitpid(child, &status, 0), child);
    assert_true(WIFEXITED(status));
    assert_int_equal(WEXITSTATUS(status), 0);
    blob_unref(blob);
}

static void what_is_discarded_is_gone(void **state)
{
    (void)state;
    for (int i = 0; i < SIZE_COUNT; i++) {
        struct blob_writer writer;
        blob_writer_init(&writer, &account);
        blob_writer_discard(&writer);
        unsigned char *bytes = writer.output.allocate(&writer.output, sizes[i]);
        assert_int_equal(account.live_bytes, sizes[i]);
        bytes[sizes[i] - 1] = 1;
        blob_writer_discard(&writer);
        assert_true(nothing_is_held());
        blob_writer_discard(&writer);

        bytes = writer.output.allocate(&writer.output, sizes[i]); /* a build that fails discards its output by itself */
        assert_non_null(bytes);
        writer.output.discard(&writer.output, bytes);
        assert_true(nothing_is_held());
        blob_writer_discard(&writer);

        struct blob *blob;
        assert_non_null(writer.output.allocate(&writer.output, sizes[i]));
        assert_int_equal(blob_writer_finish(&writer, &blob, NULL), BVHD_OK);
        blob_writer_discard(&writer);
        assert_int_equal(account.live_blobs, 1);
        blob_unref(blob);
        assert_true(nothing_is_held());

        assert_int_equal(blob_writer_begin(&writer, sizes[i], NULL, NULL), BVHD_OK); /* a source that ends too early */
        assert_int_equal(blob_writer_append(&writer, "x", 1, NULL), BVHD_OK);
        blob_writer_discard(&writer);
        assert_true(nothing_is_held());
    }
}

/* Lets one memfd of about that size become ready. */
static void prepare(struct ready_memfds *ready, uint64_t size)
{
    struct memfd memfd;
    ready_memfds_enter(ready);
    assert_false(ready_memfds_take(ready, size, &memfd));
    ready_memfds_leave(ready);
    ready_memfds_prepare(ready);
    for (int i = 0; i < 60000 && ready_memfds_load(ready).count == 0; i++)
        usleep(1000);
    assert_int_equal(ready_memfds_load(ready).count, 1);
}

/* Writes some bytes where the blob has room for them, and others elsewhere. */
static void append_to_ready(struct blob_writer *writer, const unsigned char *bytes, uint64_t size)
{
    for (uint64_t at = 0, piece; at < size; at += piece) {
        piece = size - at < 50000 ? size - at : 50000;
        unsigned char *room = blob_writer_room(writer, piece);
        assert_non_null(room);
        if (at % 100000 == 0)
            memcpy(room, bytes + at, piece);
        assert_int_equal(blob_writer_append(writer, at % 100000 == 0 ? room : bytes + at, piece, NULL), BVHD_OK);
    }
}

static void a_memfd_that_was_ready_becomes_a_blob(void **state)
{
    (void)state;
    static const uint64_t lengths[] = {READY_SIZE_MIN, 300001, 1 << 20, 5000000};
    static unsigned char bytes[5000000];
    fill(bytes, sizeof bytes);
    for (int i = 0; i < 8; i++) {
        const struct ready_options options = {&memory, &descriptors, 8 << 20, 0, 1000000};
        struct ready_memfds *ready;
        struct blob_writer writer;
        struct blob *blob;
        assert_int_equal(ready_memfds_create(&options, &ready, NULL), BVHD_OK);
        prepare(ready, lengths[i / 2]);
        ready_memfds_enter(ready);
        blob_writer_init(&writer, &account);
        assert_int_equal(blob_writer_begin(&writer, lengths[i / 2], ready, NULL), BVHD_OK);
        assert_int_equal(ready_memfds_load(ready).count, 0);
        assert_int_equal(descriptors.used, 1);
        append_to_ready(&writer, bytes, lengths[i / 2]);
        if (i % 2 == 0) {
            assert_int_equal(blob_writer_finish(&writer, &blob, NULL), BVHD_OK);
            expect_file(blob->descriptor, lengths[i / 2]);
            expect_unchangeable(blob->descriptor);
            blob_unref(blob);
        }
        blob_writer_discard(&writer);
        ready_memfds_destroy(ready);
        assert_true(nothing_is_held());
    }
}

static void without_descriptors_it_is_busy(void **state)
{
    (void)state;
    struct blob *blob = NULL;
    struct bvhd_error error;
    descriptors.limit = DESCRIPTORS_RESERVE;
    assert_int_equal(write_blob(BLOB_INLINE_MAX + 1, &blob, &error), BVHD_BUSY);
    assert_int_equal(write_blob(BLOB_MAPPED_MIN, &blob, &error), BVHD_BUSY);
    assert_null(blob);
    assert_true(nothing_is_held());
    blob_unref(make_blob(BLOB_INLINE_MAX));
    descriptors.limit = DESCRIPTORS_RESERVE + 1;
    struct blob *first = make_blob(BLOB_INLINE_MAX + 1);
    assert_int_equal(write_blob(BLOB_INLINE_MAX + 1, &blob, &error), BVHD_BUSY);
    blob_unref(first);
    blob_unref(make_blob(BLOB_INLINE_MAX + 1));
}

static void sizes_that_cannot_be(void **state)
{
    (void)state;
    static const uint64_t absurd[] = {0, UINT64_C(1) << 63, UINT64_MAX - 4095, UINT64_MAX};
    for (size_t i = 0; i < sizeof absurd / sizeof absurd[0]; i++) {
        struct blob *blob = NULL;
        struct bvhd_error error;
        assert_int_equal(write_blob(absurd[i], &blob, &error), BVHD_NO_MEMORY);
        assert_null(blob);
        assert_true(nothing_is_held());
    }
}

static void every_allocation_may_fail(void **state)
{
    (void)state;
    for (int i = 0; i < SIZE_COUNT; i++) {
        enum bvhd_status status = BVHD_NO_MEMORY;
        int failures = -1;
        while (status != BVHD_OK) {
            struct blob *blob = NULL;
            struct bvhd_error error;
            memory.fail_after = ++failures;
            status = write_blob(sizes[i], &blob, &error);
            memory.fail_after = -1;
            assert_true(status == BVHD_OK || status == BVHD_NO_MEMORY);
            assert_int_equal(blob == NULL, status != BVHD_OK);
            blob_unref(blob);
            assert_true(nothing_is_held());
        }
        assert_int_equal(failures, sizes[i] < (in_pieces ? BLOB_INLINE_MAX + 1 : BLOB_MAPPED_MIN) ? 2 : 1);
    }
}

static int first_free_descriptor(void)
{
    int descriptor = dup(0);
    close(descriptor);
    return descriptor;
}

/* The process may be out of descriptors although the count has some left. */
static void the_system_may_have_no_descriptors(void **state)
{
    (void)state;
    struct rlimit before;
    assert_int_equal(getrlimit(RLIMIT_NOFILE, &before), 0);
    struct rlimit none = {.rlim_cur = (rlim_t)first_free_descriptor(), .rlim_max = before.rlim_max};
    for (int i = 0; i < SIZE_COUNT; i++) {
        struct blob *blob = NULL;
        struct bvhd_error error;
        setrlimit(RLIMIT_NOFILE, &none);
        enum bvhd_status status = write_blob(sizes[i], &blob, &error);
        setrlimit(RLIMIT_NOFILE, &before);
        assert_int_equal(status, sizes[i] <= BLOB_INLINE_MAX ? BVHD_OK : BVHD_IO);
        blob_unref(blob);
        assert_true(nothing_is_held());
    }
}

/* The system refuses the write in the middle, or refuses to reserve pages. */
static void the_system_may_refuse_pages(void **state)
{
    (void)state;
    struct rlimit before;
    assert_int_equal(getrlimit(RLIMIT_FSIZE, &before), 0);
    struct rlimit low = {.rlim_cur = BLOB_INLINE_MAX, .rlim_max = before.rlim_max};
    void (*handler)(int) = signal(SIGXFSZ, SIG_IGN);
    int descriptor = first_free_descriptor();
    for (int i = 0; i < SIZE_COUNT; i++) {
        struct blob *blob = NULL;
        struct bvhd_error error;
        setrlimit(RLIMIT_FSIZE, &low);
        enum bvhd_status status = write_blob(sizes[i], &blob, &error);
        setrlimit(RLIMIT_FSIZE, &before);
        assert_int_equal(status, sizes[i] <= BLOB_INLINE_MAX ? BVHD_OK : BVHD_IO);
        blob_unref(blob);
        assert_true(nothing_is_held());
        assert_int_equal(first_free_descriptor(), descriptor);
    }
    signal(SIGXFSZ, handler);
}

enum { THREADS = 4, ROUNDS = 20000 };

/* Takes a ref, reads and drops it, many times. The last unref of all threads frees the blob. */
static void *hold_and_read(void *context)
{
    struct blob *blob = context;
    uintptr_t wrong = 0;
    for (uint64_t i = 0; i < ROUNDS; i++) {
        struct blob *held = blob_ref(blob);
        uint64_t at = i * 7919 % held->size;
        wrong += held->bytes && held->bytes[at] != expected_byte(at);
        wrong += held->summary.build_ms != 7;
        blob_unref(held);
    }
    blob_unref(blob);
    return (void *)wrong;
}

static void any_thread_may_let_go_last(void **state)
{
    (void)state;
    for (int i = 0; i < SIZE_COUNT; i += 3) {
        struct blob *blob = make_blob(sizes[i]);
        blob->summary.build_ms = 7;
        pthread_t threads[THREADS];
        for (int j = 0; j < THREADS; j++)
            assert_int_equal(pthread_create(&threads[j], NULL, hold_and_read, blob_ref(blob)), 0);
        blob_unref(blob);
        for (int j = 0; j < THREADS; j++) {
            void *wrong;
            pthread_join(threads[j], &wrong);
            assert_null(wrong);
        }
        assert_true(nothing_is_held());
    }
}

static void *write_many(void *context)
{
    (void)context;
    uintptr_t failures = 0;
    for (int i = 0; i < 200; i++) {
        struct blob *blob;
        struct bvhd_error error;
        if (write_blob(sizes[i % (SIZE_COUNT - 4)], &blob, &error) == BVHD_OK)
            blob_unref(blob);
        else
            failures++;
    }
    return (void *)failures;
}

static void writers_share_an_account(void **state)
{
    (void)state;
    pthread_t threads[THREADS];
    for (int i = 0; i < THREADS; i++)
        assert_int_equal(pthread_create(&threads[i], NULL, write_many, NULL), 0);
    for (int i = 0; i < THREADS; i++) {
        void *failures;
        pthread_join(threads[i], &failures);
        assert_null(failures);
    }
}

int main(void)
{
    static const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(bytes_arrive_in_memory_or_in_a_file, set_up, tear_down),
        cmocka_unit_test_setup_teardown(everything_is_counted, set_up, tear_down),
        cmocka_unit_test_setup_teardown(holders_can_do_no_harm, set_up, tear_down),
        cmocka_unit_test_setup_teardown(others_cannot_open_it_for_writing, set_up, tear_down),
        cmocka_unit_test_setup_teardown(what_is_discarded_is_gone, set_up, tear_down),
        cmocka_unit_test_setup_teardown(without_descriptors_it_is_busy, set_up, tear_down),
        cmocka_unit_test_setup_teardown(sizes_that_cannot_be, set_up, tear_down),
        cmocka_unit_test_setup_teardown(every_allocation_may_fail, set_up, tear_down),
        cmocka_unit_test_setup_teardown(the_system_may_have_no_descriptors, set_up, tear_down),
        cmocka_unit_test_setup_teardown(the_system_may_refuse_pages, set_up, tear_down),
        cmocka_unit_test_setup_teardown(any_thread_may_let_go_last, set_up, tear_down),
        cmocka_unit_test_setup_teardown(writers_share_an_account, set_up, tear_down),
    };
    static const struct CMUnitTest ready_tests[] = {
        cmocka_unit_test_setup_teardown(a_memfd_that_was_ready_becomes_a_blob, set_up, tear_down),
    };
    int failures = cmocka_run_group_tests_name("built", tests, NULL, NULL);
    in_pieces = true;
    failures += cmocka_run_group_tests_name("in pieces", tests, NULL, NULL);
    return failures + cmocka_run_group_tests_name("in ready memfds", ready_tests, NULL, NULL);
}
