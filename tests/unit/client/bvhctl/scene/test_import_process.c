/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_import_process.c - tests that what assimp reads in other processes is bounded in time and memory, and that tiny
 * broken files of all its formats are refused soon, or read.
 */
#include "tests/support/unit.h"

#include <signal.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include <assimp/cimport.h>

#include "client/bvhctl/scene/import.h"
#include "client/bvhctl/scene/import_limits.h"
#include "tests/support/random.h"
#include "tests/support/scratch.h"

/* Returns how a limited process ends that spins for `milliseconds` of processor time. */
static int spin(unsigned factor, uint64_t file_size, long milliseconds)
{
    pid_t child = fork();
    if (child == 0) {
        import_limits_set(factor);
        import_limits_allow(file_size);
        struct timespec now;
        do {
            clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
        } while (now.tv_sec * 1000 + now.tv_nsec / 1000000 < milliseconds);
        _exit(0);
    }
    int status;
    assert_int_equal(waitpid(child, &status, 0), child);
    return WIFSIGNALED(status) ? WTERMSIG(status) : 0;
}

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
enum { IS_SLOW = 1 };
#elif defined(__has_feature)
enum { IS_SLOW = __has_feature(address_sanitizer) || __has_feature(thread_sanitizer) };
#else
enum { IS_SLOW = 0 };
#endif

static void test_time(void **state)
{
    (void)state;
    assert_int_equal(spin(1, 35, 60), 0);
    if (IS_SLOW)
        return;
    assert_int_equal(spin(1, 35, 1200), SIGPROF);
    assert_int_equal(spin(1, 1000000, 700), 0); /* limits are not exact on virtual machines */
    assert_int_equal(spin(4, 35, 250), 0);
    assert_int_equal(spin(1, 4096, 250), 0);
    assert_int_equal(spin(1, UINT64_MAX, 700), 0);
}

/* Returns whether a limited process gets `size` bytes. */
static bool takes(uint64_t file_size, size_t size)
{
    pid_t child = fork();
    if (child == 0) {
        import_limits_set(1);
        import_limits_allow(file_size);
        _exit(mmap(NULL, size, PROT_READ, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0) == MAP_FAILED);
    }
    int status;
    assert_int_equal(waitpid(child, &status, 0), child);
    return status == 0;
}

/* Skips a test of limits of memory where the system has none: emulators of other processors ignore them. */
static void need_memory_limits(void)
{
    pid_t child = fork();
    if (child == 0) {
        struct rlimit limit = {(size_t)512 << 20, (size_t)512 << 20};
        bool is_set = setrlimit(RLIMIT_AS, &limit) == 0;
        void *place = mmap(NULL, (size_t)1 << 30, PROT_READ, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
        _exit(is_set && place != MAP_FAILED);
    }
    int status;
    assert_int_equal(waitpid(child, &status, 0), child);
    if (status != 0) {
        print_message("the system does not limit memory\n");
        skip();
    }
}

static void test_memory(void **state)
{
    (void)state;
    assert_true(takes(35, (size_t)400 << 20));
    if (IS_SLOW)
        return;
    need_memory_limits();
    assert_false(takes(35, (size_t)600 << 20));
    assert_true(takes(1 << 20, (size_t)600 << 20));
    assert_true(takes(UINT64_MAX, (size_t)8 << 30));
}

/* A process without limits is not changed. */
static void test_unlimited(void **state)
{
    (void)state;
    import_limits_allow(UINT64_MAX);
    void *place = mmap(NULL, (size_t)2 << 30, PROT_READ, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
    assert_true(place != MAP_FAILED);
    munmap(place, (size_t)2 << 30);
}

/* Imports `size` bytes as a file with that extension. It is read or refused, and no memory is kept. */
static void import_bytes(const char *extension, const void *data, size_t size)
{
    char path[64];
    struct memory memory;
    struct import import;
    struct bvhd_error error = {0};
    struct timespec begin, end;
    snprintf(path, sizeof path, "tiny%s", extension);
    FILE *file = fopen(path, "wb");
    assert_non_null(file);
    assert_int_equal(fwrite(data, 1, size, file), size);
    fclose(file);
    memory_init(&memory, UINT64_MAX);
    clock_gettime(CLOCK_MONOTONIC, &begin);
    enum bvhd_status status = import_scene(path, NULL, &memory, &import, &error);
    clock_gettime(CLOCK_MONOTONIC, &end);
    if (end.tv_sec - begin.tv_sec > 30) /* this machine may have other work, but not so much */
        fail_msg("%s took %ld s", path, (long)(end.tv_sec - begin.tv_sec));
    if (!status)
        import_finish(&import);
    else
        assert_true(error.text[0]);
    assert_int_equal(memory.live, 0);
    remove(path);
}

/* The first bytes of formats, by which importers recognise them, with numbers behind that are too large. */
static const char *const beginnings[] = {
    "",
    "solid x\nfacet",
    "OFF\n99999999 9 9\n",
    "xof 0303txt 0032",
    "MZ",
    "IDPO",
    "MD5Version 10\n",
    "ply\n",
    "BLENDER_v263",
    "Kaydara FBX Binary ",
    "FORM",
    "3DMF",
    "HIERARCHY\n",
    "<?xml?><mesh>",
    "M3DF",
    "TERRAGENTERRAIN ",
    "ISO-10303-21;\n",
    "AC3Db\n",
    "nff\n",
    "0\nSECTION\n",
    "Caligari V00.01ALH",
};

static void test_tiny_files(void **state)
{
    (void)state;
    struct aiString list = {0}; /* the list is appended to what is there */
    struct random random = {11};
    aiGetExtensionList(&list); /* "*.3ds;*.obj;..." */
    int formats = 0;
    for (char *rest = NULL, *word = strtok_r(list.data, ";", &rest); word; word = strtok_r(NULL, ";", &rest)) {
        unsigned char bytes[35];
        const char *begin = beginnings[random_next(&random) % (sizeof beginnings / sizeof beginnings[0])];
        for (size_t i = 0; i < sizeof bytes; i++)
            bytes[i] = i % 4 == 3 ? 0x7f : 0xff;
        memcpy(bytes, begin, strlen(begin) < sizeof bytes ? strlen(begin) : sizeof bytes);
        import_bytes(word + 1, bytes, sizeof bytes);
        formats++;
    }
    assert_true(formats > 30);
}

/* Large files are read by both processes at the same time. */
static void test_large_files(void **state)
{
    (void)state;
    enum { LINES = 40000 };
    static const char comment[] = "# a line that only makes the file longer\n",
                      garbage[] = "0123456789 0123456789 012345\n";
    struct memory memory;
    struct import import;
    struct bvhd_error error = {0};
    FILE *good = fopen("large.obj", "wb"), *bad = fopen("large.off", "wb");
    fputs("v 0 0 0\nv 1 0 0\nv 0 1 0\n", good);
    fputs("OFF\n3 1 0\n", bad);
    for (int i = 0; i < LINES; i++) {
        fputs(comment, good);
        fputs(garbage, bad);
    }
    fputs("f 1 2 3\n", good);
    fclose(good);
    fclose(bad);
    memory_init(&memory, UINT64_MAX);
    if (import_scene("large.obj", NULL, &memory, &import, &error))
        fail_msg("%s: %s", error.where, error.text);
    assert_int_equal(import.triangle_count, 1);
    import_finish(&import);
    if (import_scene("large.off", NULL, &memory, &import, &error) == BVHD_OK)
        import_finish(&import);
    assert_int_equal(memory.live, 0);
    assert_int_equal(waitpid(-1, NULL, WNOHANG), -1); /* no child is left */
}

/* The importer says what is wrong; a crash or a lack of time is never called a broken file. */
static void test_words(void **state)
{
    (void)state;
    struct memory memory;
    struct import import;
    struct bvhd_error error = {0};
    memory_init(&memory, UINT64_MAX);
    FILE *file = fopen("empty.stl", "wb");
    fclose(file);
    assert_int_equal(import_scene("empty.stl", NULL, &memory, &import, &error), BVHD_UNSUPPORTED);
    assert_null(strstr(error.text, "crashed"));
    assert_int_equal(import_scene("empty.stl", "a scene", &memory, &import, &error), BVHD_NOT_FOUND);
    assert_non_null(strstr(error.text, "a scene"));
}

/* Messages about limits say what was needed, and what the limit is. */
static void test_limits_in_words(void **state)
{
    (void)state;
    struct memory memory;
    struct import import;
    struct bvhd_error error = {0};
    memory_init(&memory, UINT64_MAX);
    if (IS_SLOW)
        return; /* there is no limit of memory then */
    need_memory_limits();
    FILE *large = fopen("large.off", "wb"), *endless = fopen("endless.smd", "wb");
    fputs("OFF\n200000000 9 9\n0 0 0\n", large);
    fputs("version 1\n\nnodes", endless);
    fclose(large);
    fclose(endless);
    assert_int_equal(import_scene("large.off", NULL, &memory, &import, &error), BVHD_UNSUPPORTED);
    assert_string_equal(error.text, "assimp needs more than 537 MB, which is the limit for a file of its size");
    assert_int_equal(import_scene("endless.smd", NULL, &memory, &import, &error), BVHD_UNSUPPORTED);
    if (strstr(error.text, "too long")) { /* assimp 5.4 finds out that the file is broken */
        assert_non_null(strstr(error.text, "assimp took too long: it was ended after 0."));
        assert_non_null(strstr(error.text, " s of processor time, which is the limit"));
    }
}

/* Bones alone are no triangles: assimp could make a mesh of them, which is not in the file. */
static void test_bones(void **state)
{
    (void)state;
    static const char text[] = "HIERARCHY\nROOT Hips\n{\nOFFSET 0 0 0\nCHANNELS 3 Xposition Yposition Zposition\n"
                               "End Site\n{\nOFFSET 0 5 0\n}\n}\nMOTION\nFrames: 1\nFrame Time: 0.1\n0 0 0\n";
    struct memory memory;
    struct import import;
    struct bvhd_error error = {0};
    memory_init(&memory, UINT64_MAX);
    FILE *file = fopen("bones.bvh", "wb");
    fputs(text, file);
    fclose(file);
    assert_int_equal(import_scene("bones.bvh", NULL, &memory, &import, &error), BVHD_INVALID);
    assert_string_equal(error.text, "no triangles in it");
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_time),
        cmocka_unit_test(test_memory),
        cmocka_unit_test(test_unlimited),
        cmocka_unit_test(test_tiny_files),
        cmocka_unit_test(test_large_files),
        cmocka_unit_test(test_words),
        cmocka_unit_test(test_limits_in_words),
        cmocka_unit_test(test_bones),
    };
    return cmocka_run_group_tests_name("import_process", tests, scratch_enter, scratch_remove);
}
