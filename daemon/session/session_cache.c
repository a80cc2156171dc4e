/* SPDX-License-Identifier: Apache-2.0 */
#include <stdio.h>

#include "daemon/session/management.h"
#include "daemon/session/session_internal.h"
#include "daemon/system/log.h"
#include "proto/base/container_of.h"

/* A trim or clear of the disk that a worker does. It may outlive its session. */
struct cache_task {
    struct pool_job job;
    struct service *service;
    struct session *session; /* NULL: it has been closed */
    uint64_t request;
    struct control_cache asked;
    enum bvhd_status status;
    struct bvhd_error error;
};

static void send_state(struct session *session, uint64_t request)
{
    const struct service *service = session->service;
    struct memory *memory = session_memory(session);
    struct cache_load load = cache_load(service->cache);
    struct control_cache_state state = {
        .memory_entries = load.entries, .memory_bytes = load.bytes, .memory_budget = load.budget};
    struct bytes control;
    if (service->disk) {
        struct store_state store = disk_state(service->disk).store;
        snprintf(state.directory, sizeof state.directory, "%s", disk_directory(service->disk));
        state.counted = store.counted;
        state.entries = store.entries;
        state.bytes = store.bytes;
        state.budget = store.budget;
    }
    if (control_pack_cache_state(&state, memory, &control, NULL) == BVHD_OK)
        session_send(session, reply_create(FRAME_CACHE_STATE, request, control, memory));
    else
        session_fail(session);
}

static void clear_memory(struct service *service)
{
    cache_clear(service->cache);
    service->wake(service->wake_context); /* the loop evicts a few at a time */
}

static struct cache_task *task_of_job(struct pool_job *job)
{
    return container_of(job, struct cache_task, job);
}

/* Runs on a worker. */
static void run_task(struct pool_job *job, const struct parallel *parallel)
{
    struct cache_task *task = task_of_job(job);
    struct disk *disk = task->service->disk;
    (void)parallel;
    task->status = task->asked.action == CACHE_CLEAR ? disk_clear(disk, &task->error)
                                                     : disk_trim(disk, task->asked.bytes, &task->error);
}

static void answer_task(const struct cache_task *task)
{
    struct session *session = task->session;
    session->cache_task = NULL;
    if (task->status == BVHD_OK)
        send_state(session, task->request);
    else
        session_send_error(session, task->request, &task->error);
}

static void task_done(struct pool_job *job)
{
    struct cache_task *task = task_of_job(job);
    struct service *service = task->service;
    if (task->asked.action == CACHE_CLEAR)
        clear_memory(service);
    if (task->session)
        answer_task(task);
    service->cache_tasks--;
    memory_free(&service->unlimited, task);
}

/* False without memory. */
static bool start_task(struct session *session, uint64_t request, const struct control_cache *asked)
{
    struct service *service = session->service;
    struct cache_task *task = memory_alloc(&service->unlimited, sizeof *task);
    if (!task)
        return false;
    *task = (struct cache_task){
        .job = {.run = run_task, .done = task_done, .flow = session->client.member.flow, .size = 1},
        .service = service,
        .session = session,
        .request = request,
        .asked = *asked,
    };
    session->cache_task = task;
    service->cache_tasks++;
    pool_submit(service->pool, &task->job);
    return true;
}

void session_cache_leave(struct session *session)
{
    if (session->cache_task)
        session->cache_task->session = NULL;
    session->cache_task = NULL;
}

/* Returns BVHD_OK if the session's client may ask for that now. */
static enum bvhd_status check(const struct session *session, const struct control_cache *asked,
                              struct bvhd_error *error)
{
    if (asked->action == CACHE_SHOW)
        return BVHD_OK;
    if (asked->action > CACHE_CLEAR)
        return bvhd_error_set(error, BVHD_UNSUPPORTED, "cache.action", "action %u is not known", asked->action);
    if (session_check_management(session, "cache.action", error) != BVHD_OK)
        return error->status;
    if (asked->action == CACHE_TRIM && !session->service->disk)
        return bvhd_error_set(error, BVHD_UNSUPPORTED, "cache.action", "this daemon keeps nothing on disk");
    return BVHD_OK;
}

static void act(struct session *session, uint64_t request, const struct control_cache *asked)
{
    struct service *service = session->service;
    struct bvhd_error error;
    if (check(session, asked, &error) != BVHD_OK) {
        session_send_error(session, request, &error);
    } else if (asked->action == CACHE_SHOW) {
        send_state(session, request);
    } else if (!service->disk) {
        clear_memory(service);
        send_state(session, request);
    } else if (session->cache_task) {
        session_send_busy(session, request, "another trim or clear of this connection is under way");
    } else if (!start_task(session, request, asked)) {
        session_send_busy(session, request, "no memory for a trim or clear");
    }
}

enum bvhd_status session_cache(struct session *session, const struct frame *frame, struct bvhd_error *error)
{
    struct memory *memory = session_memory(session);
    uint64_t request = frame->header.request;
    struct control_cache *asked;
    enum bvhd_status status = control_unpack_cache(frame->control, memory, &asked, error);
    if (status != BVHD_OK)
        return session_refuses(session, request, status, error) ? BVHD_OK : status;
    act(session, request, asked);
    memory_free(memory, asked);
    return BVHD_OK;
}
