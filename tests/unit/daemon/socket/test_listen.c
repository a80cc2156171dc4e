/* SPDX-License-Identifier: Apache-2.0 */
/* test_listen.c - tests binding a path, replacing stale sockets, races between daemons, and sockets handed over. */
#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <sys/file.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include "tests/support/unit.h"

#include "daemon/socket/listen.h"

static char directory[] = "/tmp/bvhd-listen-XXXXXX";
static char path[64];

static int make_directory(void **state)
{
    (void)state;
    if (!mkdtemp(directory))
        return -1;
    snprintf(path, sizeof path, "%s/s", directory);
    return 0;
}

static int remove_directory(void **state)
{
    (void)state;
    return rmdir(directory); /* fails if a test has left a file */
}

static int connect_to(const char *where)
{
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    strcpy(address.sun_path, where);
    int client = socket(AF_UNIX, SOCK_STREAM, 0),
        result = connect(client, (struct sockaddr *)&address, sizeof address) ? errno : 0;
    close(client);
    return result;
}

static bool exists(void)
{
    struct stat about;
    return lstat(path, &about) == 0;
}

static void test_bind(void **state)
{
    struct listener listener;
    struct stat about;
    (void)state;
    mode_t mask = umask(0);
    assert_int_equal(listen_bind(path, &listener, NULL), BVHD_OK);
    assert_int_equal(umask(mask), 0);
    assert_int_equal(lstat(path, &about), 0);
    assert_true(S_ISSOCK(about.st_mode));
    assert_int_equal(about.st_mode & 07777, 0600);
    assert_true(fcntl(listener.socket, F_GETFD) & FD_CLOEXEC);
    assert_true(fcntl(listener.socket, F_GETFL) & O_NONBLOCK);
    assert_int_equal(connect_to(path), 0);
    listen_close(&listener);
    assert_false(exists());
    listen_close(&listener);
    listen_close(NULL);
}

static void test_in_use(void **state)
{
    struct listener listener, second = {.socket = 4711};
    struct bvhd_error error;
    (void)state;
    assert_int_equal(listen_bind(path, &listener, NULL), BVHD_OK);
    assert_int_equal(listen_bind(path, &second, &error), BVHD_BUSY);
    assert_string_equal(error.where, path);
    assert_non_null(strstr(error.text, "address in use"));
    assert_int_equal(second.socket, 4711);
    assert_int_equal(connect_to(path), 0);
    listen_close(&listener);
}

static void test_stale(void **state)
{
    struct listener dead, listener;
    (void)state;
    assert_int_equal(listen_bind(path, &dead, NULL), BVHD_OK);
    close(dead.socket); /* leaves the file, as a killed daemon does */
    assert_int_equal(connect_to(path), ECONNREFUSED);
    assert_int_equal(listen_bind(path, &listener, NULL), BVHD_OK);
    assert_int_equal(connect_to(path), 0);
    listen_close(&listener);
}

static void test_no_socket(void **state)
{
    struct listener listener;
    struct bvhd_error error;
    (void)state;
    close(open(path, O_CREAT | O_WRONLY, 0600));
    assert_int_equal(listen_bind(path, &listener, &error), BVHD_INVALID);
    assert_true(exists());
    unlink(path);
    assert_int_equal(mkdir(path, 0700), 0);
    assert_int_equal(listen_bind(path, &listener, &error), BVHD_INVALID);
    rmdir(path);
    assert_int_equal(symlink("/etc/passwd", path), 0);
    assert_int_equal(listen_bind(path, &listener, &error), BVHD_INVALID);
    unlink(path);
    int datagrams = socket(AF_UNIX, SOCK_DGRAM, 0);
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    strcpy(address.sun_path, path);
    assert_int_equal(bind(datagrams, (struct sockaddr *)&address, sizeof address), 0);
    assert_int_equal(listen_bind(path, &listener, &error), BVHD_IO);
    assert_true(exists());
    close(datagrams);
    unlink(path);
}

/* When the file was removed and replaced by another one, listen_close leaves that in place. */
static void test_removes_only_its_own(void **state)
{
    struct listener first, second;
    (void)state;
    assert_int_equal(listen_bind(path, &first, NULL), BVHD_OK);
    unlink(path);
    assert_int_equal(listen_bind(path, &second, NULL), BVHD_OK);
    listen_close(&first);
    assert_int_equal(connect_to(path), 0);
    listen_close(&second);
    assert_false(exists());
}

static void test_paths(void **state)
{
    char far[LISTEN_PATH_SIZE + 1];
    struct listener listener;
    struct bvhd_error error;
    (void)state;
    size_t used = (size_t)snprintf(far, sizeof far, "%s/", directory);
    memset(far + used, 'x', sizeof far - used);
    far[LISTEN_PATH_SIZE] = 0;
    assert_int_equal(listen_bind(far, &listener, &error), BVHD_INVALID);
    assert_non_null(strstr(error.text, "107"));
    far[LISTEN_PATH_SIZE - 1] = 0; /* 107 bytes */
    assert_int_equal(listen_bind(far, &listener, &error), BVHD_OK);
    assert_int_equal(connect_to(far), 0);
    listen_close(&listener);
    assert_int_equal(listen_bind("", &listener, &error), BVHD_INVALID);
    assert_int_equal(listen_bind("/no/such/place/s", &listener, &error), BVHD_IO);
    assert_non_null(strstr(error.text, "No such file"));
}

static void test_relative_path(void **state)
{
    struct listener listener;
    (void)state;
    char *before = getcwd(NULL, 0);
    assert_int_equal(chdir(directory), 0);
    assert_int_equal(listen_bind("s", &listener, NULL), BVHD_OK);
    assert_true(exists());
    listen_close(&listener);
    assert_int_equal(chdir(before), 0);
    free(before);
}

static void *bind_too(void *context)
{
    struct listener *listener = context;
    *listener = (struct listener){.socket = -1};
    listen_bind(path, listener, NULL);
    return NULL;
}

/* Many threads bind the path of a stale socket at the same time: exactly one succeeds, and listens. */
static void test_race(void **state)
{
    enum { RACERS = 8, ROUNDS = 20 };
    (void)state;
    for (int round = 0; round < ROUNDS; round++) {
        struct listener dead, listeners[RACERS];
        pthread_t threads[RACERS];
        int winners = 0;
        assert_int_equal(listen_bind(path, &dead, NULL), BVHD_OK);
        close(dead.socket);
        for (int i = 0; i < RACERS; i++)
            assert_int_equal(pthread_create(&threads[i], NULL, bind_too, &listeners[i]), 0);
        for (int i = 0; i < RACERS; i++)
            pthread_join(threads[i], NULL);
        for (int i = 0; i < RACERS; i++)
            winners += listeners[i].socket >= 0;
        assert_int_equal(winners, 1);
        assert_int_equal(connect_to(path), 0);
        for (int i = 0; i < RACERS; i++)
            listen_close(&listeners[i]);
        assert_false(exists());
    }
}

/* A lock on the directory, which anybody can take who may read it, keeps no daemon from starting. */
static void test_locked_directory(void **state)
{
    struct listener listener;
    (void)state;
    int other = open(directory, O_RDONLY | O_DIRECTORY);
    assert_int_equal(flock(other, LOCK_EX), 0);
    assert_int_equal(listen_bind(path, &listener, NULL), BVHD_OK);
    listen_close(&listener);
    close(other);
}

/* What others may have put in the lock's place is refused by name, and stays. A lock that is left is used. */
static void test_lock_of_others(void **state)
{
    char lock[80];
    struct listener listener;
    struct bvhd_error error;
    (void)state;
    snprintf(lock, sizeof lock, "%s.listen.lock", path);
    close(open(lock, O_CREAT | O_WRONLY, 0600));
    assert_int_equal(chmod(lock, 0666), 0);
    assert_int_equal(listen_bind(path, &listener, &error), BVHD_BUSY);
    assert_string_equal(error.where, lock);
    assert_int_equal(chmod(lock, 0600), 0);
    assert_int_equal(listen_bind(path, &listener, NULL), BVHD_OK);
    assert_int_equal(access(lock, F_OK), -1);
    listen_close(&listener);
    assert_int_equal(mkfifo(lock, 0600), 0);
    assert_int_equal(listen_bind(path, &listener, &error), BVHD_BUSY);
    unlink(lock);
    assert_int_equal(symlink("/dev/null", lock), 0);
    assert_int_equal(listen_bind(path, &listener, &error), BVHD_IO);
    unlink(lock);
}

static void test_adopt(void **state)
{
    struct listener bound, listener;
    struct bvhd_error error;
    int pair[2];
    (void)state;
    assert_int_equal(listen_bind(path, &bound, NULL), BVHD_OK);
    fcntl(bound.socket, F_SETFL, 0);
    fcntl(bound.socket, F_SETFD, 0);
    assert_int_equal(listen_adopt(bound.socket, &listener, &error), BVHD_OK);
    assert_true(fcntl(listener.socket, F_GETFD) & FD_CLOEXEC);
    assert_true(fcntl(listener.socket, F_GETFL) & O_NONBLOCK);
    listen_close(&listener);
    assert_true(exists()); /* the file belongs to the service manager */
    unlink(path);
    int file = open("/dev/null", O_RDONLY), datagrams = socket(AF_UNIX, SOCK_DGRAM, 0),
        packets = socket(AF_UNIX, SOCK_SEQPACKET, 0), fresh = socket(AF_UNIX, SOCK_STREAM, 0);
    socketpair(AF_UNIX, SOCK_STREAM, 0, pair);
    const int wrong[] = {file, datagrams, packets, fresh, pair[0], 9999};
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++)
        assert_int_equal(listen_adopt(wrong[i], &listener, &error), BVHD_INVALID);
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong - 1; i++)
        assert_int_equal(close(wrong[i]), 0);
    close(pair[1]);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_bind),           cmocka_unit_test(test_in_use),
        cmocka_unit_test(test_stale),          cmocka_unit_test(test_no_socket),
        cmocka_unit_test(test_paths),          cmocka_unit_test(test_removes_only_its_own),
        cmocka_unit_test(test_race),           cmocka_unit_test(test_relative_path),
        cmocka_unit_test(test_adopt),          cmocka_unit_test(test_locked_directory),
        cmocka_unit_test(test_lock_of_others),
    };
    return cmocka_run_group_tests(tests, make_directory, remove_directory);
}
