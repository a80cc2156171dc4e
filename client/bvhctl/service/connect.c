/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/service/connect.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include "client/address.h"
#include "proto/base/clock.h"
#include "client/bvhctl/base/files.h"
#include "client/bvhctl/service/cache_place.h"
#include "client/bvhctl/service/private_daemon.h"
#include "client/bvhctl/base/report.h"

const char connect_system_socket[] = ADDRESS_SYSTEM_SOCKET;

/*
 * Limits for one attempt to connect. They are short, because the daemon may exit after it was found; then bvhctl
 * searches again.
 */
enum { SHORTEST_CALL_MS = 250, LONGEST_CALL_MS = 1000 };

int connect_raw(const char *path)
{
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    if (strlen(path) >= sizeof address.sun_path) {
        errno = ENAMETOOLONG;
        return -1;
    }
    memcpy(address.sun_path, path, strlen(path) + 1);
    int descriptor = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
    if (descriptor < 0 || connect(descriptor, (struct sockaddr *)&address, sizeof address) == 0)
        return descriptor;
    int number = errno;
    close(descriptor);
    errno = number;
    return -1;
}

/* Returns 0 if a daemon listens there, or the number of the error. */
static int ask(const char *path)
{
    int descriptor = connect_raw(path), number = errno;
    if (descriptor < 0)
        return number == EAGAIN ? 0 : number; /* EAGAIN: its queue of connections is full, so there is a daemon */
    close(descriptor);
    return 0;
}

bool connect_answers(const char *path)
{
    return ask(path) == 0;
}

const char *connect_named_socket(const struct options *options)
{
    const char *named = getenv("BVHD_SOCKET");
    if (options->socket)
        return options->socket;
    return named && *named ? named : NULL;
}

static enum bvhd_status no_memory(const char *path, struct bvhd_error *error)
{
    return bvhd_error_no_memory(error, path, "no memory for its name");
}

/* Creates a client on the socket of `connect`. Takes ownership of `connect`, even after a failure. */
static enum bvhd_status attach(struct connect connect, uint32_t timeout_ms, struct connect *ret_connect,
                               struct bvhd_error *error)
{
    struct bvhd_client_options options = {.struct_size = sizeof options,
                                          .socket_path = connect.path,
                                          .connect_timeout_ms = timeout_ms,
                                          .local = BVHD_LOCAL_NEVER};
    enum bvhd_status status = bvhd_client_create(&options, &connect.client, error);
    if (status == BVHD_OK)
        status = bvhd_client_connect(connect.client, error);
    if (status == BVHD_UNAVAILABLE)
        bvhd_error_set(error, status, connect.path, "no daemon answers: %s", error->text);
    if (status != BVHD_OK)
        connect_close(&connect);
    else
        *ret_connect = connect;
    return status;
}

static enum bvhd_status open_explicit(const char *socket, uint32_t timeout_ms, struct memory *memory,
                                      struct connect *ret_connect, struct bvhd_error *error)
{
    char *path = files_copy_text(memory, socket);
    return path ? attach((struct connect){.path = path, .memory = memory}, timeout_ms, ret_connect, error)
                : no_memory(socket, error);
}

/* The state of the search for a daemon, which may take several attempts. */
struct search {
    const struct options *options;
    double deadline;
    bool is_started; /* this process has started a daemon */
    bool is_refused; /* the daemon of the machine has refused this user, and a remark has said so */
};

static enum bvhd_status start_private(const struct search *search, struct private_place *place, struct memory *memory,
                                      bool *ret_is_new, struct bvhd_error *error)
{
    char *directory;
    enum bvhd_status status = cache_place_find(search->options, memory, &directory, error);
    if (status != BVHD_OK)
        return status;
    const struct private_cache cache = {directory, search->options->disk_cache_size};
    status = private_daemon_start(place, &cache, search->deadline, memory, ret_is_new, error);
    memory_free(memory, directory);
    return status;
}

/* Finds the socket of a daemon that answers, and whether it is private. Starts a private daemon if none answers. */
static enum bvhd_status find_daemon(struct search *search, struct memory *memory, struct connect *ret_found,
                                    struct bvhd_error *error)
{
    struct connect found = {.memory = memory};
    struct private_place place;
    enum bvhd_status status = private_daemon_place(memory, &place, error);
    if (status != BVHD_OK)
        return status;
    found.is_private = place.is_safe && connect_answers(place.socket);
    int of_system = found.is_private ? ENOENT : ask(connect_system_socket);
    if (!found.is_private && of_system != 0) {
        bool is_new = false;
        status = start_private(search, &place, memory, &is_new, error);
        found.is_private = true;
        search->is_started = search->is_started || is_new;
    }
    found.is_started = found.is_private && search->is_started;
    if (status == BVHD_OK && of_system == EACCES && !search->is_refused) {
        report_note(connect_system_socket,
                    "only members of its group may use it, and you are not one; a private daemon was started on %s",
                    place.socket);
        search->is_refused = true;
    }
    if (status == BVHD_OK &&
        !(found.path = files_copy_text(memory, found.is_private ? place.socket : connect_system_socket)))
        status = no_memory(place.socket, error);
    private_place_finish(&place, memory);
    if (status == BVHD_OK)
        *ret_found = found;
    return status;
}

static uint32_t call_time(double deadline)
{
    double left = deadline - clock_ms();
    return left < SHORTEST_CALL_MS ? SHORTEST_CALL_MS : left > LONGEST_CALL_MS ? LONGEST_CALL_MS : (uint32_t)left;
}

enum bvhd_status connect_open(const struct options *options, struct memory *memory, struct connect *ret_connect,
                              struct bvhd_error *error)
{
    const char *socket = connect_named_socket(options);
    if (socket)
        return open_explicit(socket, options->connect_timeout_ms, memory, ret_connect, error);
    struct search search = {.options = options, .deadline = clock_ms() + options->connect_timeout_ms};
    for (;;) {
        struct connect found;
        enum bvhd_status status = find_daemon(&search, memory, &found, error);
        if (status != BVHD_OK)
            return status;
        status = attach(found, call_time(search.deadline), ret_connect, error);
        if (status != BVHD_UNAVAILABLE || clock_ms() >= search.deadline)
            return status;
    }
}

static const char *reason(int number)
{
    switch (number) {
    case ENOENT:
        return "there is none";
    case ECONNREFUSED:
        return "nobody listens";
    case EACCES:
        return "only members of its group may use it";
    case EPERM:
        return "its directory is not yours alone";
    default:
        return strerror(number);
    }
}

enum bvhd_status connect_find(const struct options *options, struct memory *memory, struct connect *ret_connect,
                              struct bvhd_error *error)
{
    if (connect_named_socket(options))
        return connect_open(options, memory, ret_connect, error);
    struct private_place place;
    enum bvhd_status status = private_daemon_place(memory, &place, error);
    if (status != BVHD_OK)
        return status;
    int of_user = place.is_safe || access(place.directory, F_OK) < 0 ? ask(place.socket) : EPERM;
    int of_system = of_user ? ask(connect_system_socket) : 0;
    struct connect found = {.memory = memory, .is_private = of_user == 0};
    if (of_user && of_system)
        status = bvhd_error_set(error, BVHD_UNAVAILABLE, place.socket,
                                "no daemon: %s; %s: %s; 'bvhctl build' starts a private one, 'systemctl start "
                                "bvhd.socket' the system's",
                                reason(of_user), connect_system_socket, reason(of_system));
    else if (!(found.path = files_copy_text(memory, of_user ? connect_system_socket : place.socket)))
        status = no_memory(place.socket, error);
    private_place_finish(&place, memory);
    return status == BVHD_OK ? attach(found, options->connect_timeout_ms, ret_connect, error) : status;
}

void connect_close(struct connect *connect)
{
    if (!connect || !connect->memory)
        return;
    bvhd_client_destroy(connect->client);
    memory_free(connect->memory, connect->path);
    *connect = (struct connect){0};
}
