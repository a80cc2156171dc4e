/* SPDX-License-Identifier: Apache-2.0 */
/* test_payload.c - tests which descriptors are accepted as payloads, and that their bytes are read safely. */
#include "tests/support/unit.h"

#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <pthread.h>
#include <stdbool.h>
#include <sys/eventfd.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <unistd.h>

#include "daemon/service/payload.h"
#include "tests/support/daemon/test_memfd.h"

#ifndef MFD_EXEC
#define MFD_EXEC 16U
#endif
#ifndef F_SEAL_EXEC
#define F_SEAL_EXEC 32
#endif

enum { POOL_SEALS = F_SEAL_SHRINK | F_SEAL_GROW, MEMFD_SEALS = POOL_SEALS | F_SEAL_WRITE | F_SEAL_SEAL };

enum kind { POOL, MEMFD, KINDS };

static const int seals_of[KINDS] = {POOL_SEALS, MEMFD_SEALS};

static struct memory memory;

static int set_up(void **state)
{
    (void)state;
    memory_init(&memory, UINT64_MAX);
    return 0;
}

static int nothing_is_left(void **state)
{
    (void)state;
    return memory.live != 0;
}

static enum bvhd_status open_kind(enum kind kind, const struct payload_file *file, struct payload **ret_payload,
                                  struct bvhd_error *error)
{
    return kind == POOL ? payload_open_pool(file, ret_payload, error) : payload_open_memfd(file, ret_payload, error);
}

static struct payload_file describe(int descriptor, uint64_t size)
{
    return (struct payload_file){
        .descriptor = descriptor, .size = size, .max_size = 64 << 20, .where = "items[3].payload", .memory = &memory};
}

/* The file is refused with `text` in the reason, its descriptor is closed, and nothing is kept. */
static void expect_refused_file(enum kind kind, const struct payload_file *file, enum bvhd_status status,
                                const char *text)
{
    struct payload *payload = (struct payload *)&memory;
    struct bvhd_error error = {.status = BVHD_OK};
    assert_int_equal(open_kind(kind, file, &payload, &error), status);
    assert_ptr_equal(payload, &memory);
    assert_int_equal(error.status, status);
    assert_string_equal(error.where, file->where);
    if (!strstr(error.text, text))
        fail_msg("\"%s\" instead of \"%s\"", error.text, text);
    assert_int_equal(memory.live, 0);
}

static void wait_until_closed(int descriptor)
{
    for (int i = 0; i < 5000 && fcntl(descriptor, F_GETFD) >= 0; i++)
        usleep(1000);
    assert_int_equal(fcntl(descriptor, F_GETFD), -1);
}

static void expect_refused(enum kind kind, int descriptor, uint64_t size, enum bvhd_status status, const char *text)
{
    struct payload_file file = describe(descriptor, size);
    expect_refused_file(kind, &file, status, text);
    wait_until_closed(descriptor);
}

static void expect_filled(struct bytes bytes, uint64_t size)
{
    assert_int_equal(bytes.size, size);
    for (uint64_t i = 0; i < size; i++)
        if (bytes.data[i] != test_memfd_byte(i))
            fail_msg("byte %" PRIu64 " differs", i);
}

static struct payload *expect_opened(enum kind kind, int descriptor, uint64_t size)
{
    struct payload_file file = describe(descriptor, size);
    struct payload *payload = NULL;
    struct bvhd_error error = {.text = ""};
    enum bvhd_status status = open_kind(kind, &file, &payload, &error);
    if (status != BVHD_OK)
        fail_msg("kind %d: %s", kind, error.text);
    assert_int_equal(fcntl(descriptor, F_GETFD), -1);
    assert_int_equal((uintptr_t)payload_bytes(payload).data % 16, 0);
    expect_filled(payload_bytes(payload), size);
    return payload;
}

static bool is_mapped(const void *address)
{
    return msync((void *)(uintptr_t)address, 1, MS_ASYNC) == 0;
}

/* Another thread unmaps large mappings, so this may take a moment. */
static void wait_until_unmapped(const void *address)
{
    for (int i = 0; i < 5000 && is_mapped(address); i++)
        usleep(1000);
    assert_false(is_mapped(address));
}

static void files_are_read_where_they_lie(void **state)
{
    (void)state;
    static const uint64_t sizes[] = {1, 4095, 4096, 4097, 5000, 65536, (1 << 20) + 1};
    for (enum kind kind = 0; kind < KINDS; kind++)
        for (size_t i = 0; i < sizeof sizes / sizeof sizes[0]; i++) {
            struct payload *payload = expect_opened(kind, test_memfd_sealed(sizes[i], seals_of[kind]), sizes[i]);
            const void *address = payload_bytes(payload).data;
            assert_ptr_equal(payload_ref(payload), payload);
            payload_unref(payload);
            assert_true(is_mapped(address));
            payload_unref(payload);
            wait_until_unmapped(address);
        }
    payload_unref(NULL);
}

static void a_descriptor_that_only_reads_is_enough(void **state)
{
    (void)state;
    for (enum kind kind = 0; kind < KINDS; kind++) {
        int owner = test_memfd_sealed(10000, seals_of[kind]);
        payload_unref(expect_opened(kind, test_memfd_reopen(owner, O_RDONLY), 10000));
        close(owner);
    }
}

static void a_descriptor_that_cannot_read_is_refused(void **state)
{
    (void)state;
    for (enum kind kind = 0; kind < KINDS; kind++) {
        int owner = test_memfd_sealed(10000, seals_of[kind]);
        expect_refused(kind, test_memfd_reopen(owner, O_WRONLY), 10000, BVHD_INVALID, "not open for reading");
        expect_refused(kind, test_memfd_reopen(owner, O_PATH), 10000, BVHD_INVALID, "not open for reading");
        close(owner);
        expect_refused(kind, open("/", O_PATH | O_DIRECTORY | O_CLOEXEC), 10000, BVHD_INVALID, "not open for reading");
        expect_refused(kind, -1, 10000, BVHD_IO, "not open");
        expect_refused(kind, 12345, 10000, BVHD_IO, "not open");
    }
}

static void declared_and_real_size_must_be_equal(void **state)
{
    (void)state;
    static const uint64_t declared[] = {1, 4999, 5001, 8192, 10000};
    for (enum kind kind = 0; kind < KINDS; kind++) {
        for (size_t i = 0; i < sizeof declared / sizeof declared[0]; i++)
            expect_refused(kind, test_memfd_sealed(5000, seals_of[kind]), declared[i], BVHD_INVALID,
                           "has 5000 bytes, not the ");
        expect_refused(kind, test_memfd_sealed(5000, seals_of[kind]), 0, BVHD_INVALID, "has no bytes");
        expect_refused(kind, test_memfd_sealed(0, seals_of[kind]), 0, BVHD_INVALID, "has no bytes");
        expect_refused(kind, test_memfd_sealed(0, seals_of[kind]), 4096, BVHD_INVALID,
                       "has 0 bytes, not the 4096 declared");
    }
}

static void sizes_over_the_limit_are_refused(void **state)
{
    (void)state;
    static const uint64_t huge[] = {(64 << 20) + 1, UINT64_C(1) << 32, UINT64_C(1) << 63, UINT64_MAX};
    for (enum kind kind = 0; kind < KINDS; kind++) {
        for (size_t i = 0; i < sizeof huge / sizeof huge[0]; i++)
            expect_refused(kind, test_memfd_sealed(5000, seals_of[kind]), huge[i], BVHD_TOO_LARGE,
                           "the most is 67108864");
        struct payload_file file = describe(test_memfd_sealed(5000, seals_of[kind]), 5000);
        file.max_size = 4999;
        expect_refused_file(kind, &file, BVHD_TOO_LARGE, "5000 bytes, the most is 4999");
        file = describe(test_memfd_sealed(5000, seals_of[kind]), 5000);
        file.max_size = 5000;
        struct payload *payload;
        assert_int_equal(open_kind(kind, &file, &payload, NULL), BVHD_OK);
        payload_unref(payload);
    }
}

/* Without a limit, sizes near the maximum of a file or of the address space are refused as well. */
static void absurd_sizes_do_no_harm(void **state)
{
    (void)state;
    static const uint64_t absurd[] = {UINT64_C(1) << 63, UINT64_MAX - 4095, UINT64_MAX};
    for (enum kind kind = 0; kind < KINDS; kind++)
        for (size_t i = 0; i < sizeof absurd / sizeof absurd[0]; i++) {
            struct payload_file file = describe(test_memfd_sealed(5000, seals_of[kind]), absurd[i]);
            file.max_size = UINT64_MAX;
            expect_refused_file(kind, &file, BVHD_INVALID, "has 5000 bytes");
        }
    struct payload_file file = describe(test_memfd_empty(INT64_MAX), INT64_MAX);
    file.max_size = UINT64_MAX;
    test_memfd_seal(file.descriptor, POOL_SEALS);
    expect_refused_file(POOL, &file, BVHD_NO_MEMORY, "cannot be mapped");
    file.descriptor = test_memfd_empty(INT64_MAX);
    test_memfd_seal(file.descriptor, MEMFD_SEALS);
    expect_refused_file(MEMFD, &file, BVHD_INVALID, "has a hole at byte 0");
}

static const char *missing_seal(enum kind kind, int seals)
{
    if (!(seals & F_SEAL_SHRINK))
        return "not sealed against shrinking";
    if (!(seals & F_SEAL_GROW))
        return "not sealed against growing";
    if (kind == POOL)
        return seals & F_SEAL_WRITE ? "sealed against writing" : NULL;
    if (!(seals & F_SEAL_WRITE))
        return "not sealed against writing";
    return seals & F_SEAL_SEAL ? NULL : "not sealed against more seals";
}

static void every_set_of_seals_is_judged(void **state)
{
    (void)state;
    static const int each[] = {F_SEAL_SEAL, F_SEAL_SHRINK, F_SEAL_GROW, F_SEAL_WRITE, F_SEAL_FUTURE_WRITE};
    for (enum kind kind = 0; kind < KINDS; kind++)
        for (int set = 0; set < 32; set++) {
            int seals = 0;
            for (int i = 0; i < 5; i++)
                seals |= set & 1 << i ? each[i] : 0;
            const char *missing = missing_seal(kind, seals);
            int descriptor = test_memfd_sealed(5000, seals);
            if (missing)
                expect_refused(kind, descriptor, 5000, BVHD_INVALID, missing);
            else
                payload_unref(expect_opened(kind, descriptor, 5000));
        }
}

static void a_seal_of_the_mode_does_no_harm(void **state)
{
    (void)state;
    for (enum kind kind = 0; kind < KINDS; kind++)
        for (unsigned flags = 0; flags <= MFD_EXEC; flags += MFD_EXEC) {
            int descriptor = memfd_create("test", MFD_CLOEXEC | MFD_ALLOW_SEALING | flags);
            if (descriptor < 0) {
                print_message("the kernel knows no executable memfds\n");
                skip();
            }
            test_memfd_write(descriptor, 0, 5000);
            if (fcntl(descriptor, F_ADD_SEALS, F_SEAL_EXEC) == 0 && kind == MEMFD)
                test_memfd_seal(descriptor, MEMFD_SEALS);
            /* Sealing the mode of an executable file also seals its contents, so it cannot be a pool. */
            int seals = fcntl(descriptor, F_GET_SEALS);
            if (kind == POOL && !(seals & F_SEAL_WRITE))
                test_memfd_seal(descriptor, POOL_SEALS);
            if (kind == POOL && seals & F_SEAL_WRITE)
                expect_refused(kind, descriptor, 5000, BVHD_INVALID, "sealed against writing");
            else
                payload_unref(expect_opened(kind, descriptor, 5000));
        }
}

static void only_memfds_are_taken(void **state)
{
    (void)state;
    for (enum kind kind = 0; kind < KINDS; kind++) {
        int pair[2];
        assert_int_equal(pipe2(pair, O_CLOEXEC), 0);
        expect_refused(kind, pair[0], 5000, BVHD_INVALID, "not a memfd");
        expect_refused(kind, pair[1], 5000, BVHD_INVALID, "not open for reading");
        assert_int_equal(socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, pair), 0);
        expect_refused(kind, pair[0], 5000, BVHD_INVALID, "not a memfd");
        expect_refused(kind, pair[1], 5000, BVHD_INVALID, "not a memfd");
        expect_refused(kind, open("/", O_RDONLY | O_DIRECTORY | O_CLOEXEC), 4096, BVHD_INVALID, "not a memfd");
        expect_refused(kind, open("/dev/zero", O_RDWR | O_CLOEXEC), 4096, BVHD_INVALID, "not a memfd");
        expect_refused(kind, open("/dev/null", O_RDWR | O_CLOEXEC), 4096, BVHD_INVALID, "not a memfd");
        expect_refused(kind, open("/proc/self/status", O_RDONLY | O_CLOEXEC), 4096, BVHD_INVALID, "not a memfd");
        expect_refused(kind, eventfd(0, EFD_CLOEXEC), 4096, BVHD_INVALID, "not a memfd");
    }
}

/* Files of no file system are accepted. Those of tmpfs have seals too, but not the needed ones. */
static void expect_file_refused(enum kind kind, const char *folder, bool *ret_tried)
{
    char path[100];
    snprintf(path, sizeof path, "%s/bvhd-test-payload-XXXXXX", folder);
    int descriptor = mkostemp(path, O_CLOEXEC);
    *ret_tried = descriptor >= 0;
    if (descriptor < 0)
        return;
    unlink(path);
    test_memfd_write(descriptor, 0, 5000);
    bool has_seals = fcntl(descriptor, F_GET_SEALS) >= 0;
    expect_refused(kind, descriptor, 5000, BVHD_INVALID, has_seals ? "not sealed against shrinking" : "not a memfd");
}

static void files_on_disk_and_in_tmpfs_are_refused(void **state)
{
    (void)state;
    for (enum kind kind = 0; kind < KINDS; kind++) {
        bool tried;
        expect_file_refused(kind, "/tmp", &tried);
        assert_true(tried);
        expect_file_refused(kind, "/dev/shm", &tried);
        if (!tried)
            print_message("no files in /dev/shm\n");
        expect_file_refused(kind, "/var/tmp", &tried);
        if (!tried)
            print_message("no files in /var/tmp\n");
    }
}

static void huge_pages_are_refused(void **state)
{
    (void)state;
    for (enum kind kind = 0; kind < KINDS; kind++) {
        int descriptor = memfd_create("test", MFD_CLOEXEC | MFD_ALLOW_SEALING | MFD_HUGETLB);
        if (descriptor < 0) {
            print_message("no huge page files here: %s\n", strerror(errno));
            skip();
        }
        assert_int_equal(ftruncate(descriptor, 32 << 20), 0);
        test_memfd_seal(descriptor, seals_of[kind]);
        expect_refused(kind, descriptor, 32 << 20, BVHD_INVALID, "made of huge pages");
    }
}

enum { PAGE = 4096, PAGES = 40, SPARSE_SIZE = PAGES * PAGE - 100 };

static void a_hole_anywhere_is_found(void **state)
{
    (void)state;
    for (uint64_t hole = 0; hole < PAGES; hole++) {
        int descriptor = test_memfd_empty(SPARSE_SIZE);
        uint64_t after = (hole + 1) * PAGE;
        test_memfd_write(descriptor, 0, hole * PAGE);
        test_memfd_write(descriptor, after, SPARSE_SIZE);
        test_memfd_seal(descriptor, MEMFD_SEALS);
        char text[60];
        snprintf(text, sizeof text, "has a hole at byte %" PRIu64, hole * PAGE);
        expect_refused(MEMFD, descriptor, SPARSE_SIZE, BVHD_INVALID, text);
    }
}

/* As many blocks are reserved behind the end as are missing before it, so the count of blocks is right. */
static void blocks_beyond_the_end_fill_no_hole(void **state)
{
    (void)state;
    int descriptor = test_memfd_empty(SPARSE_SIZE);
    assert_int_equal(fallocate(descriptor, FALLOC_FL_KEEP_SIZE, PAGES * PAGE, PAGES * PAGE), 0);
    test_memfd_write(descriptor, 0, PAGE);
    test_memfd_seal(descriptor, MEMFD_SEALS);
    expect_refused(MEMFD, descriptor, SPARSE_SIZE, BVHD_INVALID, "has a hole at byte 4096");
}

static void reserved_pages_are_holes(void **state)
{
    (void)state;
    int descriptor = test_memfd_empty(SPARSE_SIZE);
    assert_int_equal(fallocate(descriptor, 0, 0, SPARSE_SIZE), 0);
    test_memfd_write(descriptor, 0, 2 * PAGE);
    test_memfd_seal(descriptor, MEMFD_SEALS);
    expect_refused(MEMFD, descriptor, SPARSE_SIZE, BVHD_INVALID, "has a hole at byte 8192");
}

/* The sender shares the file offset and may have moved it. */
static void the_file_offset_does_not_matter(void **state)
{
    (void)state;
    for (enum kind kind = 0; kind < KINDS; kind++) {
        int descriptor = test_memfd_sealed(5000, seals_of[kind]);
        assert_int_equal(lseek(descriptor, 4999, SEEK_SET), 4999);
        payload_unref(expect_opened(kind, descriptor, 5000));
    }
}

static void a_pool_may_have_holes_and_changes(void **state)
{
    (void)state;
    int descriptor = test_memfd_empty(SPARSE_SIZE), owner = dup(descriptor);
    unsigned char *written = mmap(NULL, SPARSE_SIZE, PROT_READ | PROT_WRITE, MAP_SHARED, owner, 0);
    test_memfd_seal(descriptor, POOL_SEALS | F_SEAL_FUTURE_WRITE);
    struct payload_file file = describe(descriptor, SPARSE_SIZE);
    struct payload *pool;
    assert_int_equal(payload_open_pool(&file, &pool, NULL), BVHD_OK);
    const volatile unsigned char *seen = payload_bytes(pool).data;
    assert_int_equal(seen[5 * PAGE], 0);
    for (uint64_t i = 0; i < SPARSE_SIZE; i++)
        written[i] = test_memfd_byte(i);
    expect_filled(payload_bytes(pool), SPARSE_SIZE);
    written[PAGES * PAGE - 1] = 7; /* in the last page, behind the end of the payload */
    expect_filled(payload_bytes(pool), SPARSE_SIZE);
    munmap(written, SPARSE_SIZE);
    close(owner);
    expect_filled(payload_bytes(pool), SPARSE_SIZE);
    payload_unref(pool);
}

/* Pages that the owner removes read as zero; there is no fault that would end the process. */
static void a_pool_may_be_emptied_under_the_reader(void **state)
{
    (void)state;
    int descriptor = test_memfd_sealed(SPARSE_SIZE, POOL_SEALS), owner = dup(descriptor);
    struct payload *pool = expect_opened(POOL, descriptor, SPARSE_SIZE);
    assert_int_equal(fallocate(owner, FALLOC_FL_PUNCH_HOLE | FALLOC_FL_KEEP_SIZE, 0, PAGES * PAGE), 0);
    assert_int_equal(ftruncate(owner, 0), -1);
    struct bytes bytes = payload_bytes(pool);
    for (uint64_t i = 0; i < bytes.size; i++)
        if (((const volatile unsigned char *)bytes.data)[i] != 0)
            fail_msg("byte %" PRIu64 " is still there", i);
    payload_unref(pool);
    close(owner);
}

static void a_memfd_stays_as_it_is(void **state)
{
    (void)state;
    int descriptor = test_memfd_sealed(SPARSE_SIZE, MEMFD_SEALS), owner = dup(descriptor);
    struct payload *payload = expect_opened(MEMFD, descriptor, SPARSE_SIZE);
    assert_int_equal(pwrite(owner, "x", 1, 0), -1);
    assert_int_equal(fallocate(owner, FALLOC_FL_PUNCH_HOLE | FALLOC_FL_KEEP_SIZE, 0, PAGE), -1);
    assert_int_equal(ftruncate(owner, 1), -1);
    close(owner);
    expect_filled(payload_bytes(payload), SPARSE_SIZE);
    payload_unref(payload);
}

static void copies_are_private(void **state)
{
    (void)state;
    static const uint64_t sizes[] = {0, 1, 63, 64, 65, 65536};
    static unsigned char source[65536];
    for (size_t i = 0; i < sizeof sizes / sizeof sizes[0]; i++) {
        for (uint64_t j = 0; j < sizes[i]; j++)
            source[j] = test_memfd_byte(j);
        struct payload *payload;
        struct bytes bytes = {.data = sizes[i] ? source : NULL, .size = sizes[i]};
        assert_int_equal(payload_copy(bytes, &memory, &payload, NULL), BVHD_OK);
        memset(source, 0, sizeof source);
        assert_int_equal((uintptr_t)payload_bytes(payload).data % 16, 0);
        expect_filled(payload_bytes(payload), sizes[i]);
        assert_true(memory.live > sizes[i]);
        payload_unref(payload_ref(payload));
        payload_unref(payload);
        assert_int_equal(memory.live, 0);
    }
}

static void copies_need_memory(void **state)
{
    (void)state;
    static const uint64_t absurd[] = {UINT64_MAX, UINT64_MAX - 63, UINT64_MAX - 64, UINT64_MAX - 65, UINT64_C(1) << 62};
    struct payload *payload = (struct payload *)&memory;
    struct bvhd_error error;
    for (size_t i = 0; i < sizeof absurd / sizeof absurd[0]; i++) {
        struct bytes bytes = {.data = (const unsigned char *)"", .size = absurd[i]};
        assert_int_equal(payload_copy(bytes, &memory, &payload, &error), BVHD_NO_MEMORY);
    }
    memory.limit = 1000;
    static const unsigned char source[1000];
    assert_int_equal(payload_copy((struct bytes){source, 1000}, &memory, &payload, &error), BVHD_NO_MEMORY);
    memory.limit = UINT64_MAX;
    memory.fail_after = 0;
    assert_int_equal(payload_copy((struct bytes){source, 10}, &memory, &payload, &error), BVHD_NO_MEMORY);
    assert_ptr_equal(payload, &memory);
}

static void every_allocation_may_fail(void **state)
{
    (void)state;
    for (enum kind kind = 0; kind < KINDS; kind++) {
        enum bvhd_status status = BVHD_NO_MEMORY;
        int failures = -1;
        while (status != BVHD_OK) {
            int descriptor = test_memfd_sealed(5000, seals_of[kind]);
            struct payload_file file = describe(descriptor, 5000);
            struct payload *payload = NULL;
            struct bvhd_error error;
            memory.fail_after = ++failures;
            status = open_kind(kind, &file, &payload, &error);
            memory.fail_after = -1;
            assert_int_equal(fcntl(descriptor, F_GETFD), -1);
            assert_int_equal(payload == NULL, status != BVHD_OK);
            payload_unref(payload);
            assert_int_equal(memory.live, 0);
        }
        assert_true(failures > 0);
    }
}

enum { THREADS = 4, ROUNDS = 5000 };

/* Takes a ref, reads and drops it, many times. The last unref of all threads unmaps the payload. */
static void *hold_and_read(void *context)
{
    struct payload *payload = context;
    uintptr_t wrong = 0;
    for (uint64_t i = 0; i < ROUNDS; i++) {
        struct payload *held = payload_ref(payload);
        struct bytes bytes = payload_bytes(held);
        uint64_t at = i * 7919 % bytes.size;
        wrong += bytes.data[at] != test_memfd_byte(at);
        payload_unref(held);
    }
    payload_unref(payload);
    return (void *)wrong;
}

static void read_in_threads(struct payload *payload)
{
    pthread_t threads[THREADS];
    for (int i = 0; i < THREADS; i++)
        assert_int_equal(pthread_create(&threads[i], NULL, hold_and_read, payload_ref(payload)), 0);
    payload_unref(payload);
    for (int i = 0; i < THREADS; i++) {
        void *wrong;
        pthread_join(threads[i], &wrong);
        assert_null(wrong);
    }
    assert_int_equal(memory.live, 0);
}

static void any_thread_may_let_go_last(void **state)
{
    (void)state;
    for (enum kind kind = 0; kind < KINDS; kind++)
        read_in_threads(expect_opened(kind, test_memfd_sealed(SPARSE_SIZE, seals_of[kind]), SPARSE_SIZE));
    static unsigned char source[10000];
    for (uint64_t i = 0; i < sizeof source; i++)
        source[i] = test_memfd_byte(i);
    struct payload *payload;
    assert_int_equal(payload_copy((struct bytes){source, sizeof source}, &memory, &payload, NULL), BVHD_OK);
    read_in_threads(payload);
}

int main(void)
{
    static const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(files_are_read_where_they_lie, set_up, nothing_is_left),
        cmocka_unit_test_setup_teardown(a_descriptor_that_only_reads_is_enough, set_up, nothing_is_left),
        cmocka_unit_test_setup_teardown(a_descriptor_that_cannot_read_is_refused, set_up, nothing_is_left),
        cmocka_unit_test_setup_teardown(declared_and_real_size_must_be_equal, set_up, nothing_is_left),
        cmocka_unit_test_setup_teardown(sizes_over_the_limit_are_refused, set_up, nothing_is_left),
        cmocka_unit_test_setup_teardown(absurd_sizes_do_no_harm, set_up, nothing_is_left),
        cmocka_unit_test_setup_teardown(every_set_of_seals_is_judged, set_up, nothing_is_left),
        cmocka_unit_test_setup_teardown(a_seal_of_the_mode_does_no_harm, set_up, nothing_is_left),
        cmocka_unit_test_setup_teardown(only_memfds_are_taken, set_up, nothing_is_left),
        cmocka_unit_test_setup_teardown(files_on_disk_and_in_tmpfs_are_refused, set_up, nothing_is_left),
        cmocka_unit_test_setup_teardown(huge_pages_are_refused, set_up, nothing_is_left),
        cmocka_unit_test_setup_teardown(a_hole_anywhere_is_found, set_up, nothing_is_left),
        cmocka_unit_test_setup_teardown(blocks_beyond_the_end_fill_no_hole, set_up, nothing_is_left),
        cmocka_unit_test_setup_teardown(reserved_pages_are_holes, set_up, nothing_is_left),
        cmocka_unit_test_setup_teardown(the_file_offset_does_not_matter, set_up, nothing_is_left),
        cmocka_unit_test_setup_teardown(a_pool_may_have_holes_and_changes, set_up, nothing_is_left),
        cmocka_unit_test_setup_teardown(a_pool_may_be_emptied_under_the_reader, set_up, nothing_is_left),
        cmocka_unit_test_setup_teardown(a_memfd_stays_as_it_is, set_up, nothing_is_left),
        cmocka_unit_test_setup_teardown(copies_are_private, set_up, nothing_is_left),
        cmocka_unit_test_setup_teardown(copies_need_memory, set_up, nothing_is_left),
        cmocka_unit_test_setup_teardown(every_allocation_may_fail, set_up, nothing_is_left),
        cmocka_unit_test_setup_teardown(any_thread_may_let_go_last, set_up, nothing_is_left),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
