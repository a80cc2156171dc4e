/* SPDX-License-Identifier: Apache-2.0 */
/*
 * hostile_descriptors.c - tests that a daemon with few descriptors continues to serve others while clients use up what
 * they can of them: with messages of more than there is room for, descriptors that close slowly, and unfinished frames.
 *
 *     hostile_descriptors BVHD
 *
 * The case of two users needs root, who can act as another one, and is left out for others.
 */
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include "tests/support/daemon/hostile.h"
#include "tests/support/daemon/test_lingering.h"

enum {
    FEW_DESCRIPTORS = 512,
    CROWD = 420, /* connections */
    SLOW = 70, /* descriptors that close slowly: more than the daemon has threads for */
    COMERS = 600, /* clients that come and go: more than the daemon has descriptors */
    TRICKLING = 120, /* connections */
    OTHER_USER = 64321,
};

static struct hostile hostile;

static bool answers(struct raw_client *client)
{
    struct frame frame;
    struct raw_frame ping = {.header = {.type = FRAME_PING, .request = ++client->last_request}};
    return raw_send_frame(client, &ping) && raw_await(client, FRAME_PONG, 2000, &frame);
}

static void connect_to(struct raw_client *client)
{
    if (!raw_connect(client, hostile.service.socket))
        exit(1);
}

/*
 * Stops the daemon, so that it closes nothing before the clients have closed their own descriptors. A signal also ends
 * the wait of a thread that closes slowly.
 */
static void stop_daemon(void)
{
    int status;
    kill(hostile.service.pid, SIGSTOP);
    if (waitpid(hostile.service.pid, &status, WUNTRACED) < 0 || !WIFSTOPPED(status))
        exit(1);
}

static void go_on(void)
{
    kill(hostile.service.pid, SIGCONT);
}

/* The last one of the descriptors is closed by the daemon alone, and slowly. To be called while the daemon stands. */
static struct test_lingering send_many(struct raw_client *client, uint32_t count)
{
    struct test_lingering pair;
    int descriptors[RAW_MAX_DESCRIPTORS];
    if (!test_lingering_make(&pair))
        exit(1);
    for (uint32_t i = 0; i < count; i++)
        descriptors[i] = i + 1 < count ? STDIN_FILENO : pair.sender;
    raw_send(client, "B", 1, descriptors, count);
    close(pair.sender);
    return pair;
}

/* A message brings more descriptors than the daemon has left. The kernel may not close the rest of them on the loop. */
static void more_than_there_is_room_for(void)
{
    static struct raw_client crowd[CROWD];
    struct raw_client old, sender;
    int open = 0;
    connect_to(&old);
    raw_hello(&old);
    connect_to(&sender);
    raw_hello(&sender);
    while (open < CROWD && raw_connect(&crowd[open], hostile.service.socket))
        raw_try_hello(&crowd[open++]);
    hostile_expect(answers(&old), "a crowd: a connection from before is not answered");
    stop_daemon();
    struct test_lingering pair = send_many(&sender, RAW_MAX_DESCRIPTORS);
    go_on();
    hostile_expect(answers(&old), "too many descriptors: another connection is not answered");
    for (int i = 0; i < open; i++)
        raw_close(&crowd[i]);
    raw_close(&sender);
    raw_close(&old);
    test_lingering_end(&pair);
}

/* Clients' sockets do not wait to be closed behind what closes slowly. */
static void slow_ones_in_front(void)
{
    static struct test_lingering pairs[SLOW];
    static struct raw_client clients[SLOW];
    struct raw_client client;
    for (int i = 0; i < SLOW; i++)
        connect_to(&clients[i]);
    stop_daemon();
    for (int i = 0; i < SLOW; i++)
        pairs[i] = send_many(&clients[i], 1);
    for (int i = 0; i < SLOW; i++)
        raw_close(&clients[i]);
    go_on();
    for (int i = 0; i < COMERS; i++) {
        connect_to(&client);
        raw_close(&client);
    }
    hostile_serves(&hostile, "many descriptors close slowly", 5000);
    for (int i = 0; i < SLOW; i++)
        test_lingering_end(&pairs[i]);
}

/* Another user's connections begin frames with descriptors, and do not finish them. Does not return. */
static void trickle(int told)
{
    static struct raw_client clients[TRICKLING];
    int descriptors[16] = {0};
    if (setresuid(OTHER_USER, OTHER_USER, OTHER_USER) != 0)
        _exit(2);
    for (int i = 0; i < TRICKLING && raw_connect(&clients[i], hostile.service.socket); i++)
        raw_send(&clients[i], "B", 1, descriptors, 4);
    for (int i = 0; i < TRICKLING && clients[i].socket > 0; i++)
        if (raw_send(&clients[i], "V", 1, descriptors, i % 2 ? 12 : 0))
            raw_send(&clients[i], "H", 1, descriptors, i % 2 ? 16 : 0);
    if (write(told, "", 1) == 1)
        for (;;)
            pause();
    _exit(0);
}

static void unfinished_frames(void)
{
    int ends[2];
    char byte;
    if (geteuid() != 0) {
        printf("unfinished frames of another user were not tried: this needs root\n");
        return;
    }
    if (chmod(hostile.service.directory, 0755) || chmod(hostile.service.socket, 0666) || pipe(ends))
        exit(1);
    fflush(stdout);
    pid_t child = fork();
    if (child == 0)
        trickle(ends[1]);
    close(ends[1]);
    hostile_expect(read(ends[0], &byte, 1) == 1, "the other user's process has failed");
    for (int i = 0; i < 3; i++)
        hostile_serves(&hostile, "another user's unfinished frames", 5000);
    kill(child, SIGKILL);
    waitpid(child, NULL, 0);
    close(ends[0]);
}

static const struct {
    const char *name;
    void (*run)(void);
} cases[] = {
    {"more than there is room for", more_than_there_is_room_for},
    {"slow ones in front", slow_ones_in_front},
    {"unfinished frames", unfinished_frames},
};

int main(int argc, char **argv)
{
    static const char *const options[] = {"--workers", "2", NULL};
    struct rlimit limit = {FEW_DESCRIPTORS, FEW_DESCRIPTORS};
    if (argc != 2)
        return 2;
    if (!test_lingering_is_possible() || setrlimit(RLIMIT_NOFILE, &limit))
        return 77;
    hostile_begin(&hostile, argv[1], options);
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        double begin = hostile_now();
        cases[i].run();
        hostile_serves(&hostile, cases[i].name, 5000);
        hostile_expect_clean(&hostile, cases[i].name, 10000);
        printf("%-28s %.0f ms\n", cases[i].name, hostile_now() - begin);
        fflush(stdout);
    }
    return hostile_end(&hostile) ? 1 : 0;
}
