/* SPDX-License-Identifier: Apache-2.0 */
/*
 * daemon_helper - what shell scripts need besides a daemon:
 *
 *   daemon_helper ping SOCKET              sends HELLO and PING; the exit status is 0 when both are answered
 *   daemon_helper hold SOCKET              sends HELLO, then prints one line for each frame, and "closed" at the end
 *   daemon_helper build SOCKET TRIANGLES   the same with one build; ends after its result
 *   daemon_helper builders SOCKET          prints WELCOME's builders, as bits, and the status of a build by Embree
 *   daemon_helper poke SOCKET              connects to a socket of any kind and sends a byte
 *   daemon_helper notify SOCKET SECONDS    receives a daemon's notifications and prints a line for each
 */
#include <fcntl.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <time.h>
#include <unistd.h>

#include "tests/support/daemon/raw_client.h"

enum { LONG_MS = 60000 };

static int usage(void)
{
    fprintf(stderr, "usage: daemon_helper ping SOCKET | hold SOCKET | build SOCKET TRIANGLES | builders SOCKET | "
                    "poke SOCKET | notify SOCKET SECONDS\n");
    return 2;
}

static const char *frame_name(unsigned type)
{
    switch (type) {
    case FRAME_ERROR:
        return "error";
    case FRAME_BUSY:
        return "busy";
    case FRAME_PREPARED:
        return "prepared";
    case FRAME_GOODBYE:
        return "goodbye";
    default:
        return "another";
    }
}

static bool say_hello(struct raw_client *client, const char *path)
{
    if (!raw_connect(client, path)) {
        puts("nobody");
        return false;
    }
    raw_hello(client);
    puts("welcome");
    return true;
}

static int ping(const char *path)
{
    struct raw_client client;
    struct frame frame;
    if (!say_hello(&client, path))
        return 1;
    bool answered = raw_send_frame(&client, &(struct raw_frame){.header = {.type = FRAME_PING, .request = 1}}) &&
                    raw_await(&client, FRAME_PONG, LONG_MS, &frame);
    raw_close(&client);
    return answered ? 0 : 1;
}

static bool send_build(struct raw_client *client, uint32_t triangles, enum build_builder builder)
{
    uint64_t size;
    unsigned char *payload = raw_payload(triangles, 1, &size);
    int memfd = raw_memfd(payload, size, F_SEAL_SHRINK | F_SEAL_GROW | F_SEAL_WRITE | F_SEAL_SEAL);
    struct control_item item = raw_item(0, size, SOURCE_MEMFD);
    item.builder = builder;
    bool sent = raw_build(client, &item, 1, (struct bytes){NULL, 0}, &memfd, &size, 1) != 0;
    close(memfd);
    free(payload);
    return sent;
}

/* Prints a line for the frame. Returns whether it was a RESULT. */
static bool tell_frame(struct raw_client *client, const struct frame *frame)
{
    bool is_result = frame->header.type == FRAME_RESULT;
    struct control_result *result = is_result ? raw_result(client, frame) : NULL;
    if (result)
        printf("result %s %llu\n", bvhd_status_name(result->error.status), (unsigned long long)result->size);
    else
        puts(frame_name(frame->header.type));
    for (int i = 0; i < frame->header.descriptors; i++)
        close(frame->descriptors[i]);
    memory_free(&client->memory, result);
    return is_result;
}

static int hold(const char *path, uint32_t triangles)
{
    struct raw_client client;
    struct frame frame;
    bool closed = false, answered = false;
    if (!say_hello(&client, path))
        return 1;
    if (triangles && !send_build(&client, triangles, BUILDER_OWN))
        return 1;
    if (triangles)
        puts("sent");
    while (!answered && raw_receive(&client, LONG_MS, &frame, &closed))
        answered = tell_frame(&client, &frame);
    if (closed)
        puts("closed");
    raw_close(&client);
    return answered || closed ? 0 : 1;
}

static int builders(const char *path)
{
    struct raw_client client;
    struct frame frame;
    if (!say_hello(&client, path))
        return 1;
    printf("builders %u\n", client.builders);
    if (!send_build(&client, 100, BUILDER_EMBREE) || !raw_await(&client, FRAME_RESULT, LONG_MS, &frame))
        return 1;
    struct control_result *result = raw_result(&client, &frame);
    printf("%s %s\n", bvhd_status_name(result->error.status), result->error.where);
    memory_free(&client.memory, result);
    raw_close(&client);
    return 0;
}

static int poke(const char *path)
{
    static const int kinds[] = {SOCK_STREAM, SOCK_DGRAM, SOCK_SEQPACKET};
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    snprintf(address.sun_path, sizeof address.sun_path, "%s", path);
    for (size_t i = 0; i < sizeof kinds / sizeof *kinds; i++) {
        int poker = socket(AF_UNIX, kinds[i] | SOCK_CLOEXEC, 0);
        bool reached = connect(poker, (struct sockaddr *)&address, sizeof address) == 0;
        /*
         * The connection alone wakes the other process, which may have exited before the send(). A datagram socket
         * wakes it only when something is sent.
         */
        bool sent = reached && send(poker, "", 1, MSG_NOSIGNAL) == 1;
        reached = kinds[i] == SOCK_DGRAM ? sent : reached;
        close(poker);
        if (reached)
            return 0;
    }
    return 1;
}

static double now(void)
{
    struct timespec time;
    clock_gettime(CLOCK_MONOTONIC, &time);
    return (double)time.tv_sec + (double)time.tv_nsec * 1e-9;
}

static int notify(const char *path, double seconds)
{
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    snprintf(address.sun_path, sizeof address.sun_path, "%s", path);
    int receiver = socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    if (receiver < 0 || bind(receiver, (struct sockaddr *)&address, sizeof address)) {
        perror(path);
        return 1;
    }
    for (double end = now() + seconds, left; (left = end - now()) > 0;) {
        char text[4096];
        struct pollfd ready = {.fd = receiver, .events = POLLIN};
        if (poll(&ready, 1, (int)(left * 1000) + 1) <= 0)
            continue;
        ssize_t size = recv(receiver, text, sizeof text - 1, 0);
        if (size < 0)
            break;
        text[size] = 0;
        for (char *at = text; *at; at++)
            *at = *at == '\n' ? ' ' : *at;
        puts(text);
    }
    close(receiver);
    return 0;
}

int main(int argc, char **argv)
{
    setvbuf(stdout, NULL, _IOLBF, 0);
    if (argc == 3 && !strcmp(argv[1], "ping"))
        return ping(argv[2]);
    if (argc == 3 && !strcmp(argv[1], "hold"))
        return hold(argv[2], 0);
    if (argc == 3 && !strcmp(argv[1], "builders"))
        return builders(argv[2]);
    if (argc == 3 && !strcmp(argv[1], "poke"))
        return poke(argv[2]);
    if (argc == 4 && !strcmp(argv[1], "build"))
        return hold(argv[2], (uint32_t)atoi(argv[3]));
    if (argc == 4 && !strcmp(argv[1], "notify"))
        return notify(argv[2], atof(argv[3]));
    return usage();
}
