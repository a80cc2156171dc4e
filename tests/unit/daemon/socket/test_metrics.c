/* SPDX-License-Identifier: Apache-2.0 */
/* test_metrics.c - tests the socket for monitoring: right and wrong requests, slow and hostile clients. */
#include "tests/support/unit.h"

#include <errno.h>
#include <poll.h>
#include <stdlib.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include "daemon/socket/metrics.h"
#include "tests/support/scratch.h"

enum { LARGE = 4 << 20, ROOM = LARGE + 1024, SHORT_MS = 100, LONG_MS = 60000 };

static struct bed {
    uv_loop_t loop;
    struct descriptors descriptors;
    struct memory memory;
    struct metrics metrics;
    char path[96];
    uint64_t body_size; /* of answers; 0: there is no memory for them */
} bed;

static char *make_body(void *context, struct memory *memory, uint64_t *ret_size)
{
    (void)context;
    char *body = bed.body_size > 0 ? memory_alloc(memory, bed.body_size) : NULL;
    for (uint64_t i = 0; body && i < bed.body_size; i++)
        body[i] = (char)('a' + i % 23);
    *ret_size = bed.body_size;
    return body;
}

static void begin(uint32_t client_ms)
{
    bed = (struct bed){.body_size = 100};
    snprintf(bed.path, sizeof bed.path, "%s/m", scratch_folder);
    descriptors_init(&bed.descriptors);
    memory_init(&bed.memory, UINT64_MAX);
    assert_int_equal(uv_loop_init(&bed.loop), 0);
    const struct metrics_options options = {.path = bed.path,
                                            .descriptors = &bed.descriptors,
                                            .memory = &bed.memory,
                                            .text = make_body,
                                            .client_ms = client_ms};
    assert_int_equal(metrics_open(&bed.metrics, &bed.loop, &options, NULL), BVHD_OK);
}

static int end(void **state)
{
    (void)state;
    metrics_close(&bed.metrics);
    metrics_close(&bed.metrics);
    uv_run(&bed.loop, UV_RUN_DEFAULT);
    assert_int_equal(uv_loop_close(&bed.loop), 0);
    assert_int_equal(atomic_load(&bed.memory.live), 0);
    assert_int_equal(access(bed.path, F_OK), -1);
    return 0;
}

static int join(void)
{
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    snprintf(address.sun_path, sizeof address.sun_path, "%s", bed.path);
    int socket_ = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
    assert_int_equal(connect(socket_, (struct sockaddr *)&address, sizeof address), 0);
    return socket_;
}

static void say(int client, const char *text)
{
    assert_int_equal(send(client, text, strlen(text), MSG_NOSIGNAL), strlen(text));
}

/* Runs the loop, and reads what the client gets until its connection ends. The next call reuses the text. */
static const char *answer(int client)
{
    static char text[ROOM];
    size_t size = 0;
    for (;;) {
        uv_run(&bed.loop, UV_RUN_NOWAIT);
        ssize_t got = recv(client, text + size, sizeof text - 1 - size, MSG_DONTWAIT);
        if (got == 0 || (got < 0 && errno == ECONNRESET))
            break;
        if (got > 0)
            size += (size_t)got;
        else
            usleep(100);
    }
    text[size] = 0;
    close(client);
    return text;
}

static const char *ask(const char *request)
{
    int client = join();
    say(client, request);
    return answer(client);
}

static void starts(const char *text, const char *start)
{
    if (strncmp(text, start, strlen(start)) != 0)
        fail_msg("'%.200s' does not start with '%s'", text, start);
}

static void check_body(const char *text, uint64_t size)
{
    char length[64];
    snprintf(length, sizeof length, "Content-Length: %llu\r\n", (unsigned long long)size);
    starts(text, "HTTP/1.0 200 OK\r\nContent-Type: text/plain; version=0.0.4; charset=utf-8\r\n");
    assert_non_null(strstr(text, length));
    const char *body = strstr(text, "\r\n\r\n");
    assert_non_null(body);
    assert_int_equal(strlen(body + 4), size);
    for (uint64_t i = 0; i < size; i++)
        assert_int_equal(body[4 + i], 'a' + i % 23);
}

static void requests_are_answered(void **state)
{
    (void)state;
    struct stat status;
    begin(LONG_MS);
    assert_int_equal(stat(bed.path, &status), 0);
    assert_int_equal(status.st_mode & 0777, 0600);
    check_body(ask("GET /metrics HTTP/1.1\r\nHost: x\r\nAccept: */*\r\n\r\n"), 100);
    check_body(ask("GET /metrics HTTP/1.0\n\n"), 100);
    check_body(ask("GET /metrics?name=x HTTP/1.1\r\n\r\n"), 100);
    starts(ask("GET / HTTP/1.1\r\n\r\n"), "HTTP/1.0 404 ");
    starts(ask("GET /metrics2 HTTP/1.1\r\n\r\n"), "HTTP/1.0 404 ");
    starts(ask("GET  /metrics HTTP/1.1\r\n\r\n"), "HTTP/1.0 404 ");
    starts(ask("POST /metrics HTTP/1.1\r\n\r\n"), "HTTP/1.0 405 ");
    starts(ask("\r\n\r\n"), "HTTP/1.0 405 ");
    starts(ask("\n\n"), "HTTP/1.0 405 ");
    starts(ask("GET \n\n"), "HTTP/1.0 404 ");
    bed.body_size = 0;
    starts(ask("GET /metrics HTTP/1.1\r\n\r\n"), "HTTP/1.0 503 ");
}

static void requests_may_come_in_pieces(void **state)
{
    (void)state;
    static const char request[] = "GET /metrics HTTP/1.1\r\nHost: x\r\n\r\n";
    begin(LONG_MS);
    int client = join();
    for (size_t i = 0; i + 1 < sizeof request; i++) {
        assert_int_equal(send(client, request + i, 1, MSG_NOSIGNAL), 1);
        uv_run(&bed.loop, UV_RUN_NOWAIT);
    }
    check_body(answer(client), 100);
    client = join();
    say(client, request);
    shutdown(client, SHUT_WR);
    check_body(answer(client), 100);
}

static void large_answers_wait_for_their_reader(void **state)
{
    (void)state;
    begin(LONG_MS);
    bed.body_size = LARGE;
    int slow = join();
    say(slow, "GET /metrics HTTP/1.1\r\n\r\n");
    for (int i = 0; i < 10; i++)
        uv_run(&bed.loop, UV_RUN_NOWAIT);
    bed.body_size = 10;
    check_body(ask("GET /metrics HTTP/1.1\r\n\r\n"), 10);
    check_body(answer(slow), LARGE);
}

static void wrong_requests_end(void **state)
{
    (void)state;
    static char flood[2 * METRICS_REQUEST];
    begin(LONG_MS);
    memset(flood, 'x', sizeof flood - 1);
    starts(ask(flood), "HTTP/1.0 431 ");
    int client = join();
    assert_int_equal(send(client, "GET /metrics\0\r\n\r\n", 17, MSG_NOSIGNAL), 17);
    starts(answer(client), "HTTP/1.0 404 ");
    client = join();
    shutdown(client, SHUT_WR);
    assert_string_equal(answer(client), "");
    client = join();
    say(client, "GET /met");
    assert_int_equal(send(client, "r", 1, MSG_OOB | MSG_NOSIGNAL), 1);
    say(client, "ics HTTP/1.1\r\n\r\n");
    check_body(answer(client), 100);
    client = join();
    say(client, "GET /metrics HTTP/1.1\r\n\r\n");
    close(client); /* before the answer */
    for (int i = 0; i < 10; i++)
        uv_run(&bed.loop, UV_RUN_NOWAIT);
    assert_int_equal(bed.metrics.count, 0);
    check_body(ask("GET /metrics HTTP/1.1\r\n\r\n"), 100);
}

static void silent_clients_are_dropped(void **state)
{
    (void)state;
    begin(SHORT_MS);
    int silent = join(), unfinished = join(), unread = join();
    bed.body_size = LARGE;
    say(unfinished, "GET /metrics HTTP");
    say(unread, "GET /metrics HTTP/1.1\r\n\r\n");
    while (bed.metrics.count < 3)
        uv_run(&bed.loop, UV_RUN_NOWAIT);
    while (bed.metrics.count > 0)
        uv_run(&bed.loop, UV_RUN_ONCE);
    assert_string_equal(answer(silent), "");
    assert_string_equal(answer(unfinished), "");
    assert_true(strlen(answer(unread)) < LARGE);
}

static void only_some_are_served_at_once(void **state)
{
    (void)state;
    begin(LONG_MS);
    int clients[METRICS_CLIENTS];
    for (int i = 0; i < METRICS_CLIENTS; i++)
        clients[i] = join();
    while (bed.metrics.count < METRICS_CLIENTS)
        uv_run(&bed.loop, UV_RUN_NOWAIT);
    assert_string_equal(answer(join()), "");
    close(clients[0]);
    while (bed.metrics.count == METRICS_CLIENTS)
        uv_run(&bed.loop, UV_RUN_NOWAIT);
    check_body(ask("GET /metrics HTTP/1.1\r\n\r\n"), 100);
    for (int i = 1; i < METRICS_CLIENTS; i++) {
        say(clients[i], "GET /metrics HTTP/1.1\r\n\r\n");
        check_body(answer(clients[i]), 100);
    }
}

static void a_place_that_cannot_be_bound_is_an_error(void **state)
{
    (void)state;
    begin(LONG_MS);
    struct metrics second;
    struct bvhd_error error;
    assert_int_equal(metrics_open(&second, &bed.loop, &bed.metrics.options, &error), BVHD_BUSY);
    metrics_close(&second);
}

#define TEST(name) cmocka_unit_test_teardown(name, end)

int main(void)
{
    const struct CMUnitTest tests[] = {
        TEST(requests_are_answered),
        TEST(requests_may_come_in_pieces),
        TEST(large_answers_wait_for_their_reader),
        TEST(wrong_requests_end),
        TEST(silent_clients_are_dropped),
        TEST(only_some_are_served_at_once),
        TEST(a_place_that_cannot_be_bound_is_an_error),
    };
    return cmocka_run_group_tests(tests, scratch_make, scratch_remove);
}
