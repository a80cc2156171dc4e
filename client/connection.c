/* SPDX-License-Identifier: Apache-2.0 */
#include "client/connection.h"

#include <errno.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include "client/library.h"

enum {
    /* in one connection_receive, so that a daemon that never stops sending does not hold a thread for ever */
    READS_AT_ONCE = 64,
    READ_AHEAD = 256 * 1024, /* some results that come inside frames */
    DEFAULT_CREDITS = 256, /* for a daemon that does not announce its credits */
};

static void append(struct exchange_list *list, struct exchange *exchange)
{
    exchange->next = NULL;
    if (list->tail)
        list->tail->next = exchange;
    else
        list->head = exchange;
    list->tail = exchange;
}

static struct exchange *pop(struct exchange_list *list)
{
    struct exchange *exchange = list->head;
    list->head = exchange->next;
    if (!list->head)
        list->tail = NULL;
    exchange->next = NULL;
    return exchange;
}

static enum bvhd_status open_socket(const char *path, int *ret_socket, struct bvhd_error *error)
{
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    if (strlen(path) >= sizeof address.sun_path)
        return bvhd_error_set(error, BVHD_INVALID, path, "a socket's path has at most %zu bytes",
                              sizeof address.sun_path - 1);
    memcpy(address.sun_path, path, strlen(path) + 1);
    int descriptor = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
    if (descriptor < 0)
        return bvhd_error_set(error, errno == ENOMEM || errno == ENOBUFS ? BVHD_NO_MEMORY : BVHD_IO, "socket", "%s",
                              strerror(errno));
    int result;
    do
        result = connect(descriptor, (const struct sockaddr *)&address, sizeof address);
    while (result != 0 && errno == EINTR);
    if (result != 0) {
        enum bvhd_status status = errno == EAGAIN ? BVHD_BUSY : BVHD_UNAVAILABLE;
        bvhd_error_set(error, status, path, "%s", strerror(errno));
        close(descriptor);
        return status;
    }
    *ret_socket = descriptor;
    return BVHD_OK;
}

/* How often the daemon tells how far builds are, at most. */
enum { PROGRESS_MS = 200 };

static enum bvhd_status say_hello(struct connection *connection, struct bvhd_error *error)
{
    struct control_hello hello = {
        .version_min = CONTROL_VERSION,
        .version_max = CONTROL_VERSION,
        .software = "libbvhd " BVHD_VERSION_STRING,
        .progress_ms = PROGRESS_MS,
        .releases = true,
    };
    struct exchange *exchange = exchange_create(FRAME_HELLO, 0);
    if (!exchange)
        return bvhd_error_no_memory(error, "connection", "no memory for it");
    exchange->expects = false; /* WELCOME answers the connection, not this exchange */
    enum bvhd_status status = control_pack_hello(&hello, &library_memory, &exchange->control, error);
    if (status != BVHD_OK) {
        exchange_destroy(exchange);
        return status;
    }
    exchange_seal(exchange, 0);
    append(&connection->outgoing, exchange);
    return BVHD_OK;
}

enum bvhd_status connection_create(const char *path, uint64_t now, struct connection **ret_connection,
                                   struct bvhd_error *error)
{
    struct connection *connection = memory_alloc(&library_memory, sizeof *connection);
    if (!connection)
        return bvhd_error_no_memory(error, "connection", "no memory for it");
    *connection = (struct connection){.socket = -1, .opened_at = now, .heard_at = now};
    frame_parser_init(&connection->parser, &library_memory, FRAME_MAX_CONTROL, FRAME_MAX_INLINE);
    frame_parser_read_ahead(&connection->parser, READ_AHEAD);
    exchange_table_init(&connection->table);
    enum bvhd_status status = open_socket(path, &connection->socket, error);
    if (status == BVHD_OK)
        status = say_hello(connection, error);
    if (status == BVHD_OK) {
        status = connection_flush(connection, error);
        if (status == BVHD_UNAVAILABLE) /* it has listened, and may be about to end */
            error->status = status = BVHD_BUSY;
    }
    if (status == BVHD_OK)
        *ret_connection = connection;
    else
        connection_destroy(connection);
    return status;
}

void connection_silence(struct connection *connection)
{
    while (connection->outgoing.head) {
        struct exchange *exchange = pop(&connection->outgoing);
        if (!exchange->expects)
            exchange_destroy(exchange);
    }
    connection_unpark(connection);
}

void connection_destroy(struct connection *connection)
{
    if (!connection)
        return;
    connection_silence(connection);
    exchange_table_finish(&connection->table);
    frame_parser_finish(&connection->parser);
    holdings_unref(connection->holdings);
    if (connection->socket >= 0) {
        shutdown(connection->socket, SHUT_RDWR); /* a child process may hold the socket, too */
        close(connection->socket);
    }
    memory_free(&library_memory, connection);
}

bool connection_send(struct connection *connection, struct exchange *exchange, uint64_t now)
{
    if (exchange->expects) {
        if (connection->table.count == 0) {
            connection->heard_at = now; /* nothing was owed until now, so silence counts from now */
            connection->pinged_at = 0;
        }
        if (!exchange_table_add(&connection->table, exchange))
            return false;
        exchange_seal(exchange, exchange->number);
    }
    append(&connection->outgoing, exchange);
    connection_flush(connection, NULL);
    return true;
}

bool connection_ask(struct connection *connection, enum frame_type type, struct bytes control,
                    struct exchange_waiter *waiter, uint64_t now)
{
    struct exchange *exchange = exchange_create(type, 0);
    if (!exchange) {
        memory_free(&library_memory, (void *)(uintptr_t)control.data);
        return false;
    }
    exchange->waiter = waiter;
    exchange->control = control;
    bool sent = connection_send(connection, exchange, now);
    if (!sent)
        exchange_destroy(exchange);
    return sent;
}

void connection_cancel(struct connection *connection, uint64_t request, const uint32_t *entries, uint32_t count,
                       uint64_t now)
{
    struct control_items items = {.count = count, .items = (uint32_t *)(uintptr_t)entries};
    struct exchange *exchange = exchange_create(FRAME_CANCEL, 0);
    if (!exchange)
        return;
    exchange->expects = false;
    if (control_pack_items(&items, &library_memory, &exchange->control, NULL) != BVHD_OK) {
        exchange_destroy(exchange);
        return;
    }
    exchange_seal(exchange, request);
    connection_send(connection, exchange, now);
}

void connection_decline(struct connection *connection, uint64_t size)
{
    if (!connection->holdings || size == 0)
        return;
    holdings_add(connection->holdings, size);
    holdings_release(connection->holdings, size);
}

/* Without memory the daemon is told later. */
void connection_release(struct connection *connection, uint64_t now)
{
    struct control_released released = {connection->holdings ? holdings_collect(connection->holdings) : 0};
    if (released.bytes == 0)
        return;
    struct exchange *exchange = exchange_create(FRAME_RELEASED, 0);
    if (exchange && control_pack_released(&released, &library_memory, &exchange->control, NULL) == BVHD_OK) {
        exchange->expects = false;
        exchange_seal(exchange, 0);
        connection_send(connection, exchange, now);
        return;
    }
    exchange_destroy(exchange);
    holdings_add(connection->holdings, released.bytes);
    holdings_release(connection->holdings, released.bytes);
}

/* Space for the descriptors that go with a frame. */
union ancillary {
    char bytes[CMSG_SPACE(sizeof(int) * FRAME_QUEUE)];
    struct cmsghdr aligned;
};

static void attach(struct msghdr *message, union ancillary *ancillary, const int *descriptors, uint32_t count)
{
    memset(ancillary, 0, sizeof *ancillary);
    message->msg_control = ancillary->bytes;
    message->msg_controllen = CMSG_SPACE(sizeof(int) * count);
    struct cmsghdr *header = CMSG_FIRSTHDR(message);
    header->cmsg_level = SOL_SOCKET;
    header->cmsg_type = SCM_RIGHTS;
    header->cmsg_len = CMSG_LEN(sizeof(int) * count);
    memcpy(CMSG_DATA(header), descriptors, sizeof(int) * count);
}

/* Lists the sections of a frame that are not sent yet. */
static int remaining_sections(const struct exchange *exchange, struct iovec sections[3])
{
    const struct bytes all[3] = {
        {exchange->header, sizeof exchange->header}, exchange->control, exchange->inline_bytes};
    uint64_t skip = exchange->sent;
    int count = 0;
    for (int i = 0; i < 3; i++) {
        if (skip >= all[i].size) {
            skip -= all[i].size;
            continue;
        }
        sections[count++] = (struct iovec){(void *)(uintptr_t)(all[i].data + skip), all[i].size - skip};
        skip = 0;
    }
    return count;
}

/* Returns the number of bytes sent, or -1 and errno. The descriptors go with the first byte. */
static ssize_t send_some(int socket, const struct exchange *exchange)
{
    struct iovec sections[3];
    union ancillary ancillary;
    struct msghdr message = {.msg_iov = sections, .msg_iovlen = (size_t)remaining_sections(exchange, sections)};
    if (exchange->sent == 0 && exchange->descriptor_count > 0)
        attach(&message, &ancillary, exchange->descriptors, exchange->descriptor_count);
    ssize_t result;
    do
        result = sendmsg(socket, &message, MSG_NOSIGNAL | MSG_DONTWAIT);
    while (result < 0 && errno == EINTR);
    return result;
}

enum bvhd_status connection_flush(struct connection *connection, struct bvhd_error *error)
{
    connection->is_blocked = connection->is_starved = false;
    while (connection->outgoing.head) {
        struct exchange *exchange = connection->outgoing.head;
        ssize_t sent = send_some(connection->socket, exchange);
        if (sent < 0) {
            connection->is_blocked = errno == EAGAIN;
            connection->is_starved = errno == ETOOMANYREFS || errno == ENOBUFS || errno == ENOMEM;
            if (connection->is_blocked || connection->is_starved)
                return BVHD_OK;
            return bvhd_error_set(error, BVHD_UNAVAILABLE, "connection", "the daemon has gone: %s", strerror(errno));
        }
        exchange->sent += (uint64_t)sent;
        if (exchange->sent < exchange_frame_size(exchange))
            continue;
        pop(&connection->outgoing);
        exchange->on_wire = true;
        if (!exchange->expects)
            exchange_destroy(exchange);
    }
    return BVHD_OK;
}

static uint32_t take_descriptors(struct msghdr *message, int ret_descriptors[FRAME_QUEUE])
{
    uint32_t count = 0;
    for (struct cmsghdr *header = CMSG_FIRSTHDR(message); header; header = CMSG_NXTHDR(message, header)) {
        if (header->cmsg_level != SOL_SOCKET || header->cmsg_type != SCM_RIGHTS)
            continue;
        uint32_t here = (uint32_t)((header->cmsg_len - CMSG_LEN(0)) / sizeof(int));
        /* `ancillary` has room for at most FRAME_QUEUE descriptors in all. */
        memcpy(ret_descriptors + count, CMSG_DATA(header), here * sizeof(int));
        count += here;
    }
    return count;
}

/* Reads once into the parser. *ret_more says whether there may be more to read. */
static enum bvhd_status read_some(struct connection *connection, uint64_t now, bool *ret_more, struct bvhd_error *error)
{
    unsigned char *at;
    uint64_t size;
    enum bvhd_status status = frame_parser_space(&connection->parser, &at, &size, error);
    if (status != BVHD_OK)
        return status;
    union ancillary ancillary;
    struct iovec room = {at, size};
    struct msghdr message = {
        .msg_iov = &room, .msg_iovlen = 1, .msg_control = ancillary.bytes, .msg_controllen = sizeof ancillary.bytes};
    ssize_t got;
    do
        got = recvmsg(connection->socket, &message, MSG_DONTWAIT | MSG_CMSG_CLOEXEC);
    while (got < 0 && errno == EINTR);
    *ret_more = false;
    if (got < 0 && errno == EAGAIN)
        return BVHD_OK;
    if (got <= 0)
        return bvhd_error_set(error, BVHD_UNAVAILABLE, "connection", "the daemon has gone%s%s", got < 0 ? ": " : "",
                              got < 0 ? strerror(errno) : "");
    int descriptors[FRAME_QUEUE];
    uint32_t count = take_descriptors(&message, descriptors);
    status = frame_parser_feed(&connection->parser, (uint64_t)got, descriptors, count, error);
    if (status == BVHD_OK && message.msg_flags & MSG_CTRUNC)
        status = bvhd_error_set(error, BVHD_IO, "connection", "descriptors were lost: too many files are open");
    connection->heard_at = now;
    connection->pinged_at = 0;
    /* A read ends after descriptors; otherwise it ends before the buffer is full only if there are no more data. */
    *ret_more = count > 0 || (uint64_t)got == size;
    return status;
}

static enum bvhd_status handle_frames(struct connection *connection, connection_handler handler, void *context,
                                      struct bvhd_error *error)
{
    for (;;) {
        struct frame frame;
        bool found;
        enum bvhd_status status = frame_parser_next(&connection->parser, &frame, &found, error);
        if (status != BVHD_OK || !found)
            return status;
        status = handler(context, connection, &frame, error);
        if (status != BVHD_OK)
            return status;
    }
}

enum bvhd_status connection_receive(struct connection *connection, connection_handler handler, void *context,
                                    uint64_t now, struct bvhd_error *error)
{
    bool more = true;
    for (int i = 0; more && i < READS_AT_ONCE; i++) {
        enum bvhd_status status = read_some(connection, now, &more, error);
        if (status == BVHD_OK)
            status = handle_frames(connection, handler, context, error);
        if (status != BVHD_OK)
            return status;
    }
    return BVHD_OK;
}

void connection_park(struct connection *connection, struct exchange *exchange, uint64_t until)
{
    exchange->sent = 0;
    exchange->on_wire = false;
    exchange->parked = true;
    append(&connection->parked, exchange);
    connection->busy_until = until;
}

struct exchange *connection_unpark(struct connection *connection)
{
    struct exchange *first = connection->parked.head;
    connection->parked = (struct exchange_list){NULL, NULL};
    connection->busy_until = 0;
    return first;
}

void connection_resend(struct connection *connection, struct exchange *exchange)
{
    exchange->parked = false;
    append(&connection->outgoing, exchange);
    connection_flush(connection, NULL);
}

static uint32_t sane(uint32_t said, uint32_t unsaid, uint32_t most)
{
    uint32_t value = said ? said : unsaid;
    return value < most ? value : most;
}

enum bvhd_status connection_welcome(struct connection *connection, const struct control_welcome *welcome,
                                    struct bvhd_error *error)
{
    if (welcome->version != CONTROL_VERSION)
        return bvhd_error_set(
            error, BVHD_INCOMPATIBLE, "connection", "%s speaks version %u of the protocol, this library version %u",
            welcome->software[0] ? welcome->software : "the daemon", welcome->version, (unsigned)CONTROL_VERSION);
    connection->limits = (struct connection_limits){
        .credits = sane(welcome->credits, DEFAULT_CREDITS, CONTROL_MAX_ITEMS),
        .max_items = sane(welcome->max_items, CONTROL_MAX_ITEMS, CONTROL_MAX_ITEMS),
        .max_control = sane(welcome->max_control, FRAME_MAX_CONTROL, FRAME_MAX_CONTROL),
        .max_inline = sane(welcome->max_inline, FRAME_MAX_INLINE, FRAME_MAX_INLINE),
        .max_pool = welcome->max_pool,
        .max_payload = welcome->max_payload ? welcome->max_payload : UINT64_MAX,
        .has_builders = welcome->builders != 0,
        .has_updates = welcome->updates,
    };
    connection->holdings = welcome->max_held > 0 ? holdings_create(welcome->max_held) : NULL;
    if (welcome->max_held > 0 && !connection->holdings)
        return bvhd_error_no_memory(error, "connection", "no memory for it");
    connection->credits = connection->limits.credits;
    connection->state = CONNECTION_OPEN;
    return BVHD_OK;
}
