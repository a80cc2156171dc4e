/* SPDX-License-Identifier: Apache-2.0 */
#include "client/client_wait.h"

#include <errno.h>
#include <poll.h>
#include <sys/epoll.h>
#include <sys/eventfd.h>
#include <sys/timerfd.h>
#include <time.h>
#include <unistd.h>

#include "client/client_link.h"

static bool control_loop(int epoll, int descriptor, int operation, uint32_t events)
{
    struct epoll_event event = {.events = events};
    return epoll_ctl(epoll, operation, descriptor, &event) == 0;
}

static bool open_descriptors(struct client_wakeups *wakeups)
{
    wakeups->epoll = epoll_create1(EPOLL_CLOEXEC);
    wakeups->timer = timerfd_create(CLOCK_MONOTONIC, TFD_CLOEXEC | TFD_NONBLOCK);
    wakeups->notice = eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK);
    wakeups->wake = eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK);
    return wakeups->epoll >= 0 && wakeups->timer >= 0 && wakeups->notice >= 0 && wakeups->wake >= 0 &&
           control_loop(wakeups->epoll, wakeups->timer, EPOLL_CTL_ADD, EPOLLIN) &&
           control_loop(wakeups->epoll, wakeups->notice, EPOLL_CTL_ADD, EPOLLIN);
}

static void close_descriptors(struct client_wakeups *wakeups)
{
    const int all[] = {wakeups->epoll, wakeups->timer, wakeups->notice, wakeups->wake};
    for (size_t i = 0; i < sizeof all / sizeof all[0]; i++)
        if (all[i] >= 0)
            close(all[i]);
}

enum bvhd_status client_wait_init(struct bvhd_client *client, struct bvhd_error *error)
{
    client->wakeups =
        (struct client_wakeups){.epoll = -1, .timer = -1, .notice = -1, .wake = -1, .timer_at = LIBRARY_NEVER};
    if (!open_descriptors(&client->wakeups)) {
        enum bvhd_status status =
            bvhd_error_set(error, errno == ENOMEM ? BVHD_NO_MEMORY : BVHD_IO, "client", "%s", strerror(errno));
        close_descriptors(&client->wakeups);
        return status;
    }
    pthread_condattr_t attributes;
    pthread_condattr_init(&attributes);
    pthread_condattr_setclock(&attributes, CLOCK_MONOTONIC);
    pthread_cond_init(&client->changed, &attributes);
    pthread_condattr_destroy(&attributes);
    pthread_mutex_init(&client->lock, NULL);
    callback_init(&client->callbacks);
    return BVHD_OK;
}

void client_wait_finish(struct bvhd_client *client)
{
    callback_finish(&client->callbacks);
    close_descriptors(&client->wakeups);
    pthread_cond_destroy(&client->changed);
    pthread_mutex_destroy(&client->lock);
}

void client_lock(struct bvhd_client *client)
{
    pthread_mutex_lock(&client->lock);
}

static void signal_descriptor(int descriptor)
{
    uint64_t one = 1;
    ssize_t written = write(descriptor, &one, sizeof one);
    (void)written; /* fails only if the counter is full, and then the descriptor is signalled already */
}

static void drain(int descriptor)
{
    uint64_t count;
    ssize_t got = read(descriptor, &count, sizeof count);
    (void)got; /* it does not matter if there was nothing to read */
}

static void set_timer(struct client_wakeups *wakeups, uint64_t moment)
{
    struct itimerspec spec = {{0, 0}, {0, 0}};
    if (moment != LIBRARY_NEVER) {
        uint64_t at = moment > 0 ? moment : 1; /* 0 turns it off */
        spec.it_value = (struct timespec){(time_t)(at / (1000 * LIBRARY_MS)), (long)(at % (1000 * LIBRARY_MS))};
    }
    timerfd_settime(wakeups->timer, TFD_TIMER_ABSTIME, &spec, NULL);
    wakeups->timer_at = moment;
}

/*
 * A timer that fires too early costs less than setting it for each request. Therefore it is set again only if it would
 * fire too late, or has fired.
 */
static void update_timer(struct client_wakeups *wakeups, uint64_t deadline)
{
    if (deadline < wakeups->timer_at || (wakeups->timer_at != LIBRARY_NEVER && wakeups->timer_at <= clock_ns()))
        set_timer(wakeups, deadline);
}

/*
 * Updates the events for which a connection is watched. Returns true if the polling thread must poll for other events.
 */
static bool update_watch(struct client_wakeups *wakeups, struct connection *connection)
{
    if (!connection)
        return false;
    uint32_t events = POLLIN | (connection->is_blocked ? POLLOUT : 0);
    bool changed = events != connection->watched;
    if (wakeups->has_loop && (changed || !connection->in_loop)) {
        control_loop(wakeups->epoll, connection->socket, connection->in_loop ? EPOLL_CTL_MOD : EPOLL_CTL_ADD, events);
        connection->in_loop = true;
    }
    connection->watched = events;
    return changed;
}

static void announce(struct bvhd_client *client, bool from_loop)
{
    struct client_wakeups *wakeups = &client->wakeups;
    bool moved = update_watch(wakeups, client->current);
    moved = update_watch(wakeups, client->leaving) || moved;
    uint64_t deadline = wakeups->polling || wakeups->has_loop ? client_link_deadline(client) : LIBRARY_NEVER;
    if (wakeups->has_loop)
        update_timer(wakeups, deadline);
    if (wakeups->polling && (wakeups->stirred || moved || deadline < wakeups->polling_until))
        signal_descriptor(wakeups->wake);
    if (wakeups->stirred && wakeups->waiting > 0)
        pthread_cond_broadcast(&client->changed);
    if (wakeups->stirred && wakeups->has_loop && !from_loop)
        signal_descriptor(wakeups->notice);
    wakeups->stirred = false;
}

void client_unlock(struct bvhd_client *client)
{
    announce(client, false);
    pthread_mutex_unlock(&client->lock);
}

void client_unlock_dispatched(struct bvhd_client *client)
{
    announce(client, true);
    pthread_mutex_unlock(&client->lock);
}

/* Closing the socket is not enough: a child process may hold it, and epoll would still report its events. */
void client_wait_forget(struct bvhd_client *client, struct connection *connection)
{
    if (connection->in_loop)
        control_loop(client->wakeups.epoll, connection->socket, EPOLL_CTL_DEL, 0);
    connection->in_loop = false;
}

void client_wait_heard(struct bvhd_client *client)
{
    drain(client->wakeups.notice);
}

static void watch(struct pollfd *polls, nfds_t *count, const struct connection *connection)
{
    if (connection)
        polls[(*count)++] = (struct pollfd){.fd = connection->socket, .events = (short)connection->watched};
}

/* Polls the sockets with the lock dropped, and then does the work that is possible. */
static void poll_once(struct bvhd_client *client, uint64_t moment)
{
    struct client_wakeups *wakeups = &client->wakeups;
    announce(client, false);
    uint64_t deadline = client_link_deadline(client);
    wakeups->polling_until = moment < deadline ? moment : deadline;
    struct pollfd polls[3] = {{.fd = wakeups->wake, .events = POLLIN}};
    nfds_t count = 1;
    watch(polls, &count, client->current);
    watch(polls, &count, client->leaving);
    wakeups->polling = true;
    pthread_mutex_unlock(&client->lock);
    int timeout = library_poll_ms(clock_ns(), wakeups->polling_until);
    poll(polls, count, timeout);
    pthread_mutex_lock(&client->lock);
    wakeups->polling = false;
    if (polls[0].revents)
        drain(wakeups->wake);
    client_advance(client);
}

/*
 * Waits while another thread polls. The lock is dropped here too, so the polling thread has to learn what this thread
 * has done before, such as connecting.
 */
static void wait_for_others(struct bvhd_client *client, uint64_t moment)
{
    announce(client, false);
    client->wakeups.waiting++;
    if (moment == LIBRARY_NEVER) {
        pthread_cond_wait(&client->changed, &client->lock);
    } else {
        struct timespec until = {(time_t)(moment / (1000 * LIBRARY_MS)), (long)(moment % (1000 * LIBRARY_MS))};
        pthread_cond_timedwait(&client->changed, &client->lock, &until);
    }
    client->wakeups.waiting--;
}

bool client_wait_until(struct bvhd_client *client, uint64_t moment, const struct client_wait *wait)
{
    bool result, looked = false;
    while (!(result = wait->is_true(wait->context)) && (!looked || clock_ns() < moment)) {
        if (callback_run(client))
            continue;
        if (wait->work && wait->work(client, wait->context))
            client_advance(client);
        else if (client->wakeups.polling)
            wait_for_others(client, moment);
        else
            poll_once(client, moment);
        looked = true;
    }
    /*
     * Another thread has to poll after this one. A thread that wakes without need passes the signal on in the same way.
     */
    if (!client->wakeups.polling && client->wakeups.waiting > 0)
        pthread_cond_signal(&client->changed);
    callback_run(client);
    return result;
}
