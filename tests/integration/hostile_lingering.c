/* SPDX-License-Identifier: Apache-2.0 */
/*
 * hostile_lingering.c - tests that a daemon continues to serve others while clients send it sockets whose closing takes
 * a minute. The daemon closes them at every place where it closes descriptors, and is their only holder.
 *
 *     hostile_lingering BVHD
 */
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#include "tests/support/daemon/hostile.h"
#include "tests/support/daemon/test_lingering.h"

enum { MANY = 20 };

static struct hostile hostile;

/*
 * Stops the daemon, so that it closes nothing: the client closes its own descriptor first, so that the daemon's is the
 * last one.
 */
static void stop_daemon(void)
{
    int status;
    kill(hostile.service.pid, SIGSTOP);
    if (waitpid(hostile.service.pid, &status, WUNTRACED) < 0 || !WIFSTOPPED(status))
        exit(1);
}

/* Sends bytes with `count` descriptors. Afterwards only the daemon holds the last of them. */
static struct test_lingering send_lingering(struct raw_client *client, const void *bytes, size_t size, uint32_t count)
{
    struct test_lingering pair;
    int descriptors[MANY];
    if (!test_lingering_make(&pair))
        exit(1);
    for (uint32_t i = 0; i < count; i++)
        descriptors[i] = i + 1 < count ? STDIN_FILENO : pair.sender;
    stop_daemon();
    raw_send(client, bytes, size, descriptors, count);
    close(pair.sender);
    kill(hostile.service.pid, SIGCONT);
    return pair;
}

static void connect_to(struct raw_client *client)
{
    if (!raw_connect(client, hostile.service.socket))
        exit(1);
}

/* The descriptor comes with the first bytes, and its client is gone before, or just after, they are read. */
static struct test_lingering in_the_door(void)
{
    struct raw_client client;
    connect_to(&client);
    struct test_lingering pair = send_lingering(&client, "x", 1, 1);
    raw_close(&client);
    return pair;
}

/* The descriptor waits for a frame that never comes. */
static struct test_lingering without_a_frame(void)
{
    struct raw_client client;
    connect_to(&client);
    raw_hello(&client);
    struct test_lingering pair = send_lingering(&client, "", 1, 1);
    hostile_serves(&hostile, "a lingering socket waits for its frame", 2000);
    raw_close(&client);
    return pair;
}

/* The descriptor comes with a byte out of band, which a reader that does not ask for it skips. */
static struct test_lingering out_of_band(void)
{
    struct raw_client client;
    struct test_lingering pair;
    connect_to(&client);
    raw_hello(&client);
    if (!test_lingering_make(&pair))
        exit(1);
    stop_daemon();
    bool sent = raw_send_urgent(&client, 'x', &pair.sender, 1) && raw_send(&client, "y", 1, NULL, 0);
    close(pair.sender);
    kill(hostile.service.pid, SIGCONT);
    hostile_expect(raw_await_close(&client, 5000, NULL) || !sent, "bytes out of band: the connection stays");
    raw_close(&client);
    return pair;
}

/* There are more descriptors than one read accepts. */
static struct test_lingering beyond_the_most(void)
{
    struct raw_client client;
    connect_to(&client);
    raw_hello(&client);
    struct test_lingering pair = send_lingering(&client, "", 1, MANY);
    hostile_expect(raw_await_close(&client, 5000, NULL), "%d descriptors at once: the connection stays", MANY);
    raw_close(&client);
    return pair;
}

/* After a client has broken the protocol, the daemon discards what it sends. */
static struct test_lingering after_the_end(void)
{
    struct raw_client client;
    struct frame frame;
    connect_to(&client);
    raw_hello(&client);
    raw_send(&client, "this is no frame, however it is read", 36, NULL, 0);
    hostile_expect(raw_await(&client, FRAME_ERROR, 5000, &frame), "a broken frame: no error");
    struct test_lingering pair = send_lingering(&client, "x", 1, 1);
    hostile_serves(&hostile, "a lingering socket after the end", 2000);
    raw_close(&client);
    return pair;
}

/* The socket is in the place of a memfd. */
static struct test_lingering as_a_payload(void)
{
    struct raw_client client;
    struct control_item item = raw_item(0, 4096, SOURCE_MEMFD);
    struct control_build build = {.memfd_count = 1, .memfd_sizes = {4096}, .item_count = 1, .items = &item};
    struct raw_frame frame = {.header = {.type = FRAME_BUILD, .request = 1, .descriptors = 1}};
    size_t size;
    connect_to(&client);
    raw_hello(&client);
    control_pack_build(&build, &client.memory, &frame.control, NULL);
    unsigned char *bytes = raw_frame_bytes(&frame, &size);
    struct test_lingering pair = send_lingering(&client, bytes, size, 1);
    struct frame answer;
    hostile_expect(raw_await(&client, FRAME_RESULT, 5000, &answer), "a lingering socket as a payload: no result");
    free(bytes);
    memory_free(&client.memory, (void *)(uintptr_t)frame.control.data);
    raw_close(&client);
    return pair;
}

static const struct {
    const char *name;
    struct test_lingering (*run)(void);
} cases[] = {
    {"in the door", in_the_door},     {"without a frame", without_a_frame}, {"beyond the most", beyond_the_most},
    {"after the end", after_the_end}, {"as a payload", as_a_payload},       {"out of band", out_of_band},
};

int main(int argc, char **argv)
{
    static const char *const options[] = {"--workers", "2", NULL};
    if (argc != 2)
        return 2;
    if (!test_lingering_is_possible())
        return 77;
    hostile_begin(&hostile, argv[1], options);
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        double begin = hostile_now();
        struct test_lingering pair = cases[i].run();
        hostile_serves(&hostile, cases[i].name, 2000);
        test_lingering_end(&pair);
        hostile_expect_clean(&hostile, cases[i].name, 5000);
        printf("%-16s %.0f ms\n", cases[i].name, hostile_now() - begin);
        fflush(stdout);
    }
    return hostile_end(&hostile) ? 1 : 0;
}
