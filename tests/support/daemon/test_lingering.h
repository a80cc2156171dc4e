/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_lingering.h - sockets that take a minute to close: TCP connections with SO_LINGER and more bytes to send than
 * their peer reads. For test programs only.
 */
#ifndef BVHD_TEST_LINGERING_H
#define BVHD_TEST_LINGERING_H

#include <netinet/in.h>
#include <stdbool.h>
#include <stdio.h>
#include <sys/socket.h>
#include <unistd.h>

struct test_lingering {
    int sender; /* closing its last descriptor takes a minute */
    int peer; /* the other end */
};

static inline void test_lingering_set(int socket, int seconds)
{
    struct linger linger = {.l_onoff = 1, .l_linger = seconds};
    setsockopt(socket, SOL_SOCKET, SO_LINGER, &linger, sizeof linger);
}

static inline bool test_lingering_connect(int listener, int sender, int *ret_peer)
{
    struct sockaddr_in address = {.sin_family = AF_INET, .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
    socklen_t length = sizeof address;
    int size = 4096;
    setsockopt(listener, SOL_SOCKET, SO_RCVBUF, &size, sizeof size);
    setsockopt(sender, SOL_SOCKET, SO_SNDBUF, &size, sizeof size);
    if (bind(listener, (struct sockaddr *)&address, length) != 0 || listen(listener, 1) != 0 ||
        getsockname(listener, (struct sockaddr *)&address, &length) != 0 ||
        connect(sender, (struct sockaddr *)&address, length) != 0)
        return false;
    *ret_peer = accept4(listener, NULL, NULL, SOCK_CLOEXEC);
    return *ret_peer >= 0;
}

/* Makes a connection. Returns false where there is no loopback interface. */
static inline bool test_lingering_make(struct test_lingering *ret_pair)
{
    int listener = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0),
        sender = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0), peer;
    bool connected = test_lingering_connect(listener, sender, &peer);
    close(listener);
    if (!connected) {
        close(sender);
        return false;
    }
    static char block[1 << 16];
    while (send(sender, block, sizeof block, MSG_DONTWAIT) > 0)
        ;
    test_lingering_set(sender, 60);
    *ret_pair = (struct test_lingering){sender, peer};
    return true;
}

/* Resets the connection, so that closing the sender takes no time. Does not close the sender. */
static inline void test_lingering_end(const struct test_lingering *pair)
{
    test_lingering_set(pair->peer, 0);
    close(pair->peer);
}

/* Whether such sockets can be made here; prints a message if not. */
static inline bool test_lingering_is_possible(void)
{
    struct test_lingering pair;
    if (!test_lingering_make(&pair)) {
        printf("no loopback interface here\n");
        return false;
    }
    test_lingering_end(&pair);
    close(pair.sender);
    return true;
}

#endif
