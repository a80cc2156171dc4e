/* SPDX-License-Identifier: Apache-2.0 */
/* test_address.c - tests the places where a client looks for its daemon, their order, and whom it trusts there. */
#include "tests/support/unit.h"

#include <sys/stat.h>
#include <unistd.h>

#include "client/address.h"
#include "client/library.h"
#include "client/search.h"

/* A folder of this test, and the folder for this user's sockets in it, which does not exist yet. */
struct folders {
    char base[64], own[96];
};

static void start(struct folders *folders)
{
    snprintf(folders->base, sizeof folders->base, "/tmp/bvhd-address-XXXXXX");
    assert_non_null(mkdtemp(folders->base));
    snprintf(folders->own, sizeof folders->own, "%s/bvhd-%u", folders->base, (unsigned)geteuid());
    unsetenv("BVHD_SOCKET");
    unsetenv("XDG_RUNTIME_DIR");
    setenv("TMPDIR", folders->base, 1);
}

static void stop(const struct folders *folders)
{
    assert_int_equal(rmdir(folders->base), 0);
    assert_int_equal(library_memory.live, 0);
}

static void expect_place(const struct address *address, uint32_t index, const char *folder, const char *name)
{
    char path[160];
    snprintf(path, sizeof path, "%s%s", folder, name);
    assert_string_equal(address->places[index].path, path);
}

static void test_named(void **state)
{
    (void)state;
    struct folders folders;
    struct address address;
    start(&folders);
    setenv("BVHD_SOCKET", "/a/b", 1);
    assert_true(address_init(&address, "/x/y"));
    assert_true(address.is_named && address.count == 1);
    expect_place(&address, 0, "/x/y", "");
    address_finish(&address);
    assert_true(address_init(&address, ""));
    assert_true(address.is_named && address.count == 1);
    expect_place(&address, 0, "/a/b", "");
    address_finish(&address);
    unsetenv("BVHD_SOCKET");
    stop(&folders);
}

/* The user's own socket comes before that of the machine, wherever it is. */
static void test_order(void **state)
{
    (void)state;
    struct folders folders;
    struct address address;
    start(&folders);
    assert_true(address_init(&address, NULL));
    assert_true(!address.is_named && address.count == 2);
    expect_place(&address, 0, folders.own, "/bvhd.sock");
    assert_string_equal(address.places[0].own_directory, folders.own);
    expect_place(&address, 1, ADDRESS_SYSTEM_SOCKET, "");
    address_finish(&address);
    setenv("XDG_RUNTIME_DIR", folders.base, 1);
    assert_true(address_init(&address, NULL));
    expect_place(&address, 0, folders.base, "/bvhd.sock");
    assert_null(address.places[0].own_directory);
    expect_place(&address, 1, ADDRESS_SYSTEM_SOCKET, "");
    address_finish(&address);
    const char *const unusable[] = {"", "relative", "/nowhere/at/all", "/dev/null"};
    for (size_t i = 0; i < sizeof unusable / sizeof unusable[0]; i++) {
        setenv("XDG_RUNTIME_DIR", unusable[i], 1);
        assert_true(address_init(&address, NULL));
        expect_place(&address, 0, folders.own, "/bvhd.sock");
        address_finish(&address);
    }
    unsetenv("XDG_RUNTIME_DIR");
    setenv("TMPDIR", "relative", 1);
    assert_true(address_init(&address, NULL));
    assert_memory_equal(address.places[0].path, "/tmp/bvhd-", 10);
    address_finish(&address);
    stop(&folders);
}

static void test_is_own(void **state)
{
    (void)state;
    struct folders folders;
    char link[128];
    start(&folders);
    snprintf(link, sizeof link, "%s/link", folders.base);
    assert_false(address_is_own(folders.own));
    assert_int_equal(mkdir(folders.own, 0700), 0);
    assert_true(address_is_own(folders.own));
    assert_int_equal(symlink(folders.own, link), 0);
    assert_false(address_is_own(link));
    assert_int_equal(chmod(folders.own, 0710), 0);
    assert_false(address_is_own(folders.own));
    assert_false(address_is_own("/dev/null"));
    if (geteuid() == 0) {
        assert_int_equal(chmod(folders.own, 0700), 0);
        assert_int_equal(chown(folders.own, 1, 1), 0);
        assert_false(address_is_own(folders.own));
    }
    unlink(link);
    rmdir(folders.own);
    stop(&folders);
}

/* The error names each place, why it is none, and what to do. */
static void test_reasons(void **state)
{
    (void)state;
    struct folders folders;
    struct address address;
    struct connection *connection = NULL;
    struct bvhd_error error;
    if (access(ADDRESS_SYSTEM_SOCKET, F_OK) == 0)
        skip(); /* this machine has a daemon */
    start(&folders);
    assert_true(address_init(&address, NULL));
    assert_int_equal(search_connect(&address, 0, &connection, &error), BVHD_UNAVAILABLE);
    assert_string_equal(error.where, address.places[0].path);
    assert_memory_equal(error.text, "No such file or directory; /run/bvhd/bvhd.sock: No such file or directory; ", 75);
    assert_non_null(strstr(error.text, "; start bvhd, or build without it (bvhd_client_options.local, "));
    assert_non_null(strstr(error.text, "bvhctl --local"));
    assert_int_equal(mkdir(folders.own, 0700), 0);
    assert_int_equal(chmod(folders.own, 0777), 0);
    assert_int_equal(search_connect(&address, 0, &connection, &error), BVHD_UNAVAILABLE);
    assert_non_null(strstr(error.text, "its directory does not belong to this user alone; /run"));
    assert_non_null(strstr(error.text, "bvhctl --local"));
    address_finish(&address);
    rmdir(folders.own);
    char long_path[200] = "/";
    memset(long_path + 1, 'x', sizeof long_path - 2);
    assert_true(address_init(&address, long_path));
    assert_int_equal(search_connect(&address, 0, &connection, &error), BVHD_INVALID);
    address_finish(&address);
    setenv("TMPDIR", long_path, 1); /* such a place is none, unless it was named */
    assert_true(address_init(&address, NULL));
    assert_int_equal(search_connect(&address, 0, &connection, &error), BVHD_UNAVAILABLE);
    assert_non_null(strstr(error.text, "/run/bvhd/bvhd.sock: No such file"));
    address_finish(&address);
    assert_null(connection);
    stop(&folders);
}

static void test_no_memory(void **state)
{
    (void)state;
    struct folders folders;
    struct address address;
    start(&folders);
    for (int64_t fails = 0; fails < 4; fails++) {
        library_memory.fail_after = fails;
        bool made = address_init(&address, NULL);
        assert_int_equal(made, fails == 3);
        library_memory.fail_after = -1;
        address_finish(&address);
        assert_int_equal(library_memory.live, 0);
    }
    stop(&folders);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_named),   cmocka_unit_test(test_order),     cmocka_unit_test(test_is_own),
        cmocka_unit_test(test_reasons), cmocka_unit_test(test_no_memory),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
