/* SPDX-License-Identifier: Apache-2.0 */
#include "daemon/server.h"

#include <assert.h>
#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <uv.h>

#include "daemon/reload.h"
#include "daemon/socket/accept.h"
#include "daemon/service/metrics_text.h"
#include "daemon/socket/listen.h"
#include "daemon/socket/metrics.h"
#include "daemon/system/heap.h"
#include "daemon/system/notify.h"
#include "daemon/system/wakeup.h"
#include "daemon/pool/turns.h"
#include "daemon/pool/watchdog.h"

/* Between two trims of the heaps while there are requests; the threads that have heaps beside the workers. */
enum { TRIM_MS = 2000, OTHER_THREADS = 4 };

struct server {
    struct config *config;
    uv_loop_t loop;
    struct wakeup collect;
    uv_signal_t terminate, interrupt, hang_up;
    uv_timer_t alive, idle, drain, trim;
    struct listener listener;
    struct service *service;
    struct conn_group group;
    struct acceptor acceptor;
    struct metrics metrics;
    struct watchdog watchdog;
    struct reload reload;
    bool draining;
};

/* Called on any thread. */
static void wake_loop(void *context)
{
    struct server *server = context;
    wakeup_send(&server->collect);
}

static void on_collect(void *context)
{
    struct server *server = context;
    if (server->service)
        service_collect(server->service);
}

static void on_drain_timeout(uv_timer_t *timer)
{
    struct server *server = timer->data;
    log_event(LOG_WARNING, "drain_timeout", "pending=%u connections=%u", service_pending(server->service),
              server->group.count);
    uv_stop(&server->loop);
}

static void start_drain(struct server *server)
{
    server->draining = true;
    uv_timer_stop(&server->idle); /* it would accept from the socket, which is closed by then */
    log_event(LOG_INFO, "draining", "pending=%u connections=%u", service_pending(server->service), server->group.count);
    notify_stopping("finishing what is under way");
    accept_close(&server->acceptor);
    listen_close(&server->listener);
    service_drain(server->service);
    conn_group_goodbye(&server->group);
    uv_timer_start(&server->drain, on_drain_timeout, server->config->drain_ms, 0);
}

static void on_signal(uv_signal_t *handle, int number)
{
    struct server *server = handle->data;
    log_event(LOG_INFO, "signal", "name=%s", number == SIGTERM ? "SIGTERM" : "SIGINT");
    if (server->draining)
        uv_stop(&server->loop);
    else
        start_drain(server);
}

/* Takes over the options that can change while the daemon runs. If any is wrong, nothing changes. */
static void on_reloaded(void *context, enum bvhd_status status, const struct config *fresh,
                        const struct bvhd_error *error)
{
    struct server *server = context;
    if (server->draining)
        return;
    if (status != BVHD_OK) {
        log_event(LOG_ERROR, "reload_failed", "where=%s why=%s", log_quote(error->where).text,
                  log_quote(error->text).text);
        return;
    }
    const char *fixed = config_fixed_difference(server->config, fresh);
    if (fixed)
        log_event(LOG_WARNING, "reload_incomplete", "option=%s why=%s", fixed,
                  log_quote("this option has its effect at the next start").text);
    server->config->log_level = fresh->log_level;
    server->config->idle_exit_ms = fresh->idle_exit_ms;
    server->config->drain_ms = fresh->drain_ms;
    log_set_level(fresh->log_level);
    uv_timer_stop(&server->idle); /* it starts again with the new time */
    server->acceptor.max_connections = fresh->max_connections;
    service_reconfigure(server->service, &fresh->service);
    log_event(LOG_INFO, "reloaded", "file=%s", log_quote(*fresh->file ? fresh->file : "(none)").text);
}

static void on_hang_up(uv_signal_t *handle, int number)
{
    struct server *server = handle->data;
    struct bvhd_error error;
    (void)number;
    if (!server->draining && reload_begin(&server->reload, &error) != BVHD_OK)
        on_reloaded(server, error.status, NULL, &error);
}

static void on_alive(uv_timer_t *timer)
{
    struct server *server = timer->data;
    if (watchdog_is_alive(&server->watchdog, uv_now(&server->loop)))
        notify_alive();
    else
        log_event(LOG_ERROR, "workers_stuck", "pending=%u", service_pending(server->service));
}

/* A client that connected in the last moment is accepted. */
static void on_idle(uv_timer_t *timer)
{
    struct server *server = timer->data;
    if (accept_waiting(&server->acceptor))
        return;
    log_event(LOG_INFO, "idle", NULL);
    uv_stop(&server->loop);
}

static void watch_idleness(struct server *server)
{
    bool idle = server->group.count == 0 && service_pending(server->service) == 0;
    if (!idle)
        uv_timer_stop(&server->idle);
    else if (!uv_is_active((uv_handle_t *)&server->idle))
        uv_timer_start(&server->idle, on_idle, server->config->idle_exit_ms, 0);
}

/* The timer stops with the last request, so that an idle daemon sleeps. */
static void on_trim(uv_timer_t *timer)
{
    struct server *server = timer->data;
    heap_trim();
    if (service_pending(server->service) == 0)
        uv_timer_stop(timer);
}

static void watch_heap(struct server *server)
{
    if (service_pending(server->service) > 0 && !uv_is_active((uv_handle_t *)&server->trim))
        uv_timer_start(&server->trim, on_trim, TRIM_MS, TRIM_MS);
}

static void on_group_changed(void *context)
{
    struct server *server = context;
    watch_heap(server);
    service_rest(server->service);
    if (server->draining && service_pending(server->service) == 0 && conn_group_is_flushed(&server->group))
        uv_stop(&server->loop);
    if (!server->draining && server->config->idle_exit_ms)
        watch_idleness(server);
}

static enum bvhd_status bind_socket(struct server *server, struct bvhd_error *error)
{
    const struct config *config = server->config;
    enum bvhd_status status = listen_bind(config->socket, &server->listener, error);
    if (status != BVHD_OK && !config->socket_given)
        bvhd_error_set(error, status, error->where, "%s (--socket PATH names another place)", error->text);
    return status;
}

static enum bvhd_status open_socket(struct server *server, struct bvhd_error *error)
{
    int count = notify_sockets();
    if (count < 0)
        return bvhd_error_set(error, BVHD_INVALID, "socket activation", "%s", strerror(-count));
    if (count > 1)
        return bvhd_error_set(error, BVHD_INVALID, "socket activation", "%d sockets were handed over instead of one",
                              count);
    return count ? listen_adopt(NOTIFY_FIRST_SOCKET, &server->listener, error) : bind_socket(server, error);
}

static void init_handles(struct server *server)
{
    uv_loop_t *loop = &server->loop;
    uv_signal_init(loop, &server->terminate);
    uv_signal_init(loop, &server->interrupt);
    uv_signal_init(loop, &server->hang_up);
    uv_timer_init(loop, &server->alive);
    uv_timer_init(loop, &server->idle);
    uv_timer_init(loop, &server->drain);
    uv_timer_init(loop, &server->trim);
    server->terminate.data = server->interrupt.data = server->hang_up.data = server;
    server->alive.data = server->idle.data = server->drain.data = server->trim.data = server;
}

/* Opens the descriptors of the loop and the socket first, because the service counts those that are open. */
static enum bvhd_status open_service(struct server *server, struct bvhd_error *error)
{
    if (!wakeup_init(&server->collect, &server->loop, on_collect, server) ||
        !reload_init(&server->reload, &server->loop))
        return bvhd_error_set(error, BVHD_IO, "start", "the event loop cannot be woken");
    init_handles(server);
    uv_signal_start(&server->terminate, on_signal, SIGTERM);
    uv_signal_start(&server->interrupt, on_signal, SIGINT);
    struct service_options options = server->config->service;
    options.disk_directory = *server->config->cache ? server->config->cache : NULL;
    uv_signal_start(&server->hang_up, on_hang_up, SIGHUP);
    enum bvhd_status status = open_socket(server, error);
    if (status == BVHD_OK)
        status = service_create(&options, wake_loop, server, &server->service, error);
    if (status == BVHD_OK)
        heap_limit(service_memory_limit(server->service), pool_threads(service_pool(server->service)) + OTHER_THREADS);
    return status;
}

static enum bvhd_status start_watchdog(struct server *server, struct bvhd_error *error)
{
    uint64_t interval = notify_interval_ms();
    if (!interval)
        return BVHD_OK;
    enum bvhd_status status =
        watchdog_init(&server->watchdog, service_pool(server->service), WATCHDOG_PATIENCE_MS, error);
    if (status == BVHD_OK)
        uv_timer_start(&server->alive, on_alive, interval, interval);
    return status;
}

static char *write_metrics(void *context, struct memory *memory, uint64_t *ret_size)
{
    const struct server *server = context;
    return metrics_text(server->service, memory, ret_size);
}

static enum bvhd_status open_metrics(struct server *server, struct bvhd_error *error)
{
    const struct metrics_options options = {
        .path = server->config->metrics,
        .descriptors = service_descriptors(server->service),
        .memory = service_frame_memory(server->service),
        .text = write_metrics,
        .context = server,
        .client_ms = METRICS_MS,
    };
    return *options.path ? metrics_open(&server->metrics, &server->loop, &options, error) : BVHD_OK;
}

static enum bvhd_status start(struct server *server, struct bvhd_error *error)
{
    enum bvhd_status status = open_service(server, error);
    if (status != BVHD_OK)
        return status;
    struct conn_limits limits = conn_limits_default();
    conn_group_init(&server->group, &server->loop, server->service, &limits);
    server->group.changed = on_group_changed;
    server->group.context = server;
    status =
        accept_open(&server->acceptor, &server->group, server->listener.socket, server->config->max_connections, error);
    if (status != BVHD_OK)
        return status;
    status = open_metrics(server, error);
    if (status != BVHD_OK)
        return status;
    return start_watchdog(server, error);
}

static void announce(const struct server *server)
{
    char status[LISTEN_PATH_SIZE + 32];
    const char *path = server->listener.path;
    snprintf(status, sizeof status, "listening on %s", *path ? path : "the socket handed over");
    log_event(LOG_INFO, "listening", "socket=%s version=%s", log_quote(*path ? path : "(handed over)").text,
              BVHD_DAEMON_VERSION);
    notify_ready(status);
}

static void close_handle(uv_handle_t *handle, void *context)
{
    (void)context;
    if (!uv_is_closing(handle))
        uv_close(handle, NULL);
}

/*
 * Ends everything that was started, also after a start that failed. Sessions end before the service, and the service
 * before the handle by which its threads wake the loop.
 */
static void finish(struct server *server)
{
    accept_close(&server->acceptor);
    listen_close(&server->listener);
    if (server->group.loop) {
        conn_group_close(&server->group);
        conn_group_finish(&server->group);
    }
    reload_finish(&server->reload);
    metrics_close(&server->metrics);
    watchdog_finish(&server->watchdog);
    service_destroy(server->service);
    server->service = NULL;
    uv_walk(&server->loop, close_handle, NULL);
    uv_run(&server->loop, UV_RUN_DEFAULT);
    wakeup_finish(&server->collect);
    wakeup_finish(&server->reload.ended);
    int left = uv_loop_close(&server->loop);
    assert(left == 0);
    (void)left;
}

enum bvhd_status server_run(struct config *config, struct bvhd_error *error)
{
    static struct server server; /* large */
    server = (struct server){
        .config = config,
        .listener.socket = -1,
        .reload = {.config = config, .done = on_reloaded, .context = &server},
    };
    int result = uv_loop_init(&server.loop);
    if (result)
        return bvhd_error_set(error, BVHD_IO, "start", "no event loop: %s", uv_strerror(result));
    signal(SIGPIPE, SIG_IGN);
    enum bvhd_status status = start(&server, error);
    if (status == BVHD_OK) {
        struct turns turns;
        turns_begin(&turns, TURNS_LOOP_NS, 0);
        announce(&server);
        uv_run(&server.loop, UV_RUN_DEFAULT);
        notify_stopping("leaving");
        log_event(LOG_INFO, "leaving", "connections=%u", server.group.count);
    }
    finish(&server);
    return status;
}
