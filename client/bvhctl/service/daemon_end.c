/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/service/daemon_end.h"

#include <errno.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <sys/pidfd.h>
#include <sys/socket.h>
#include <unistd.h>

#include "client/bvhctl/service/connect.h"
#include "proto/base/clock.h"

/* Who listens on a socket. */
struct listener {
    struct ucred peer;
    int process; /* a descriptor of the process */
    char name[32];
};

static enum bvhd_status refuse(const char *socket, const char *text, struct bvhd_error *error)
{
    return bvhd_error_set(error, BVHD_UNSUPPORTED, socket, "%s", text);
}

/* Reads a process's name, which is that of its program. */
static void read_name(pid_t process, char *ret_name, size_t size)
{
    char path[64];
    snprintf(path, sizeof path, "/proc/%d/comm", (int)process);
    *ret_name = '\0';
    FILE *file = fopen(path, "re");
    if (!file)
        return;
    if (fgets(ret_name, (int)size, file))
        ret_name[strcspn(ret_name, "\n")] = '\0';
    fclose(file);
}

/* End with a close of ret_listener->process. */
static enum bvhd_status find_listener(const char *socket, struct listener *ret_listener, struct bvhd_error *error)
{
    int connection = connect_raw(socket);
    if (connection < 0)
        return bvhd_error_set(error, errno == EACCES ? BVHD_UNSUPPORTED : BVHD_UNAVAILABLE, socket,
                              "no daemon to stop: %s", strerror(errno));
    struct listener listener = {.process = -1};
    socklen_t size = sizeof listener.peer;
    int failed = getsockopt(connection, SOL_SOCKET, SO_PEERCRED, &listener.peer, &size);
    if (!failed && listener.peer.pid > 0)
        listener.process = pidfd_open(listener.peer.pid, 0);
    close(connection);
    if (listener.process < 0)
        return refuse(socket, "the process that listens there cannot be seen from here", error);
    read_name(listener.peer.pid, listener.name, sizeof listener.name);
    *ret_listener = listener;
    return BVHD_OK;
}

static enum bvhd_status check_listener(const char *socket, const struct listener *listener, struct bvhd_error *error)
{
    if (!strcmp(listener->name, "bvhd"))
        return BVHD_OK;
    return bvhd_error_set(error, BVHD_UNSUPPORTED, socket,
                          "process %d (%s) listens there, which is no bvhd; for a service: systemctl %sstop "
                          "bvhd.socket bvhd.service",
                          (int)listener->peer.pid, listener->name, listener->peer.uid ? "--user " : "");
}

static enum bvhd_status end(const char *socket, const struct listener *listener, struct bvhd_error *error)
{
    if (pidfd_send_signal(listener->process, SIGTERM, NULL, 0) == 0 || errno == ESRCH)
        return BVHD_OK;
    if (errno == EPERM)
        return bvhd_error_set(error, BVHD_UNSUPPORTED, socket,
                              "it belongs to user %u and not to you; the system's service ends by: sudo systemctl stop "
                              "bvhd.socket bvhd.service",
                              (unsigned)listener->peer.uid);
    return bvhd_error_set(error, BVHD_IO, socket, "process %d: %s", (int)listener->peer.pid, strerror(errno));
}

/* Waits until the process has ended, which makes its descriptor readable. */
static enum bvhd_status wait_for(const char *socket, const struct listener *listener, int timeout_ms,
                                 struct bvhd_error *error)
{
    double deadline = clock_ms() + timeout_ms;
    struct pollfd poller = {listener->process, POLLIN, 0};
    for (;;) {
        double left = deadline - clock_ms();
        int ready = poll(&poller, 1, left > 0 ? (int)left + 1 : 0);
        if (ready > 0)
            return BVHD_OK;
        if (ready == 0 && left <= 0)
            return bvhd_error_set(error, BVHD_BUSY, socket, "process %d was asked to end, but has work to finish still",
                                  (int)listener->peer.pid);
        if (ready < 0 && errno != EINTR)
            return bvhd_error_set(error, BVHD_IO, socket, "poll: %s", strerror(errno));
    }
}

enum bvhd_status daemon_end(const char *socket, int timeout_ms, pid_t *ret_process, struct bvhd_error *error)
{
    struct listener listener;
    enum bvhd_status status = find_listener(socket, &listener, error);
    if (status != BVHD_OK)
        return status;
    status = check_listener(socket, &listener, error);
    if (status == BVHD_OK)
        status = end(socket, &listener, error);
    if (status == BVHD_OK)
        status = wait_for(socket, &listener, timeout_ms, error);
    close(listener.process);
    if (status == BVHD_OK)
        *ret_process = listener.peer.pid;
    return status;
}
