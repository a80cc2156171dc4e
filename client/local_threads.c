/* SPDX-License-Identifier: Apache-2.0 */
#include "client/local_threads.h"

#include <errno.h>
#include <signal.h>
#include <string.h>

#include "client/client_wait.h"
#include "client/local_library.h"
#include "proto/base/processor.h"

void local_threads_init(struct local_threads *threads, unsigned allowed)
{
    unsigned most = processor_count();
    *threads = (struct local_threads){.allowed = allowed < most ? allowed : most};
    pthread_cond_init(&threads->work, NULL);
}

/* The state that the threads of one round share. */
struct round {
    struct bvhd_client *client;
    const struct parallel *parallel;
};

static void take_items(void *context, size_t index)
{
    const struct round *round = context;
    struct bvhd_client *client = round->client;
    (void)index;
    client_lock(client);
    while (!client->local.threads.stop && local_builds_run(client, round->parallel, NULL))
        ;
    client_unlock(client);
}

/* Fewer threads build the same bytes, so a pool that cannot be started is none that fails a build. */
static struct workers *start_workers(const struct build_library *library, unsigned count)
{
    struct workers *workers = NULL;
    return library->workers_create(count, &workers, NULL) == BVHD_OK ? workers : NULL;
}

/* Builds until there is nothing to build. Without the library, each item fails with the reason when it is run. */
static void run_round(struct bvhd_client *client, const struct build_library **library, struct workers **workers)
{
    unsigned count = client->local.threads.allowed;
    if (!*library && local_library_load(library, NULL) == BVHD_OK && count > 1)
        *workers = start_workers(*library, count);
    struct round round = {client, *workers ? (*library)->workers_parallel(*workers) : &parallel_serial};
    parallel_for(round.parallel, round.parallel->threads, take_items, &round);
}

static void *drive(void *argument)
{
    struct bvhd_client *client = argument;
    const struct build_library *library = NULL;
    struct workers *workers = NULL;
    client_lock(client);
    while (!client->local.threads.stop) {
        if (!local_builds_has_work(client)) {
            pthread_cond_wait(&client->local.threads.work, &client->lock);
            continue;
        }
        client_unlock(client);
        run_round(client, &library, &workers);
        client_lock(client);
    }
    client_unlock(client);
    if (workers)
        library->workers_destroy(workers);
    return NULL;
}

/* Signals are blocked while the thread starts, so that the program's own threads receive them. */
static int start_driver(struct bvhd_client *client)
{
    sigset_t all, before;
    sigfillset(&all);
    pthread_sigmask(SIG_SETMASK, &all, &before);
    int failure = pthread_create(&client->local.threads.driver, NULL, drive, client);
    pthread_sigmask(SIG_SETMASK, &before, NULL);
    return failure;
}

enum bvhd_status local_threads_wake(struct bvhd_client *client, struct bvhd_error *error)
{
    struct local_threads *threads = &client->local.threads;
    int failure = threads->is_started ? 0 : start_driver(client);
    if (failure)
        return bvhd_error_set(error, failure == ENOMEM ? BVHD_NO_MEMORY : BVHD_IO, "options.local_threads",
                              "cannot start a thread: %s", strerror(failure));
    threads->is_started = true;
    pthread_cond_signal(&threads->work);
    return BVHD_OK;
}

void local_threads_finish(struct bvhd_client *client)
{
    struct local_threads *threads = &client->local.threads;
    client_lock(client);
    threads->stop = true;
    pthread_cond_signal(&threads->work);
    client_unlock(client);
    if (threads->is_started)
        pthread_join(threads->driver, NULL);
    pthread_cond_destroy(&threads->work);
}
