/* SPDX-License-Identifier: Apache-2.0 */
#include "release.h"

#include <assert.h>
#include <pthread.h>
#include <stdbool.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <unistd.h>

#include "descriptors.h"
#include "detached.h"

/* Either a mapping or a descriptor. */
struct release {
    struct release *next;
    void *address; /* NULL for a descriptor */
    uint64_t size;
    int descriptor;
};

/* Of the process: pages and descriptors are the process's too, and the thread outlives whoever used it. */
static struct {
    pthread_mutex_t mutex;
    pthread_cond_t filled;
    struct release *first, *last;
    bool served; /* by a thread */
} queue = {.mutex = PTHREAD_MUTEX_INITIALIZER, .filled = PTHREAD_COND_INITIALIZER};

static void carry_out(const struct release *release)
{
    if (release->address) {
        int result = munmap(release->address, release->size);
        assert(result == 0);
        (void)result;
    } else {
        close(release->descriptor);
    }
}

static struct release *take_first(void)
{
    pthread_mutex_lock(&queue.mutex);
    while (!queue.first)
        pthread_cond_wait(&queue.filled, &queue.mutex);
    struct release *release = queue.first;
    queue.first = release->next;
    pthread_mutex_unlock(&queue.mutex);
    return release;
}

static void *serve(void *context)
{
    (void)context;
    for (;;) {
        struct release *release = take_first();
        carry_out(release);
        if (!release->address)
            descriptors_lingered();
        free(release);
    }
    return NULL;
}

static void append(struct release *release)
{
    if (queue.first)
        queue.last->next = release;
    else
        queue.first = release;
    queue.last = release;
}

/* False without memory or thread. */
static bool hand_over(const struct release *release)
{
    struct release *queued = malloc(sizeof *queued);
    if (!queued)
        return false;
    *queued = *release;
    pthread_mutex_lock(&queue.mutex);
    if (!queue.served)
        queue.served = detached_start(serve, NULL);
    bool served = queue.served;
    if (served) {
        append(queued);
        pthread_cond_signal(&queue.filled);
    }
    pthread_mutex_unlock(&queue.mutex);
    if (!served)
        free(queued);
    return served;
}

void release_mapping(void *address, uint64_t size)
{
    struct release release = {.address = address, .size = size};
    if (size < RELEASE_LATER_MIN || !hand_over(&release))
        carry_out(&release);
}

void release_memfd(int descriptor, uint64_t size)
{
    struct release release = {.size = size, .descriptor = descriptor};
    if (size < RELEASE_LATER_MIN) {
        carry_out(&release);
        return;
    }
    descriptors_linger();
    if (!hand_over(&release)) {
        carry_out(&release);
        descriptors_lingered();
    }
}
