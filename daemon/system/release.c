/* SPDX-License-Identifier: Apache-2.0 */
#include "daemon/system/release.h"

#include <assert.h>
#include <fcntl.h>
#include <pthread.h>
#include <stdbool.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include "daemon/system/descriptors.h"
#include "daemon/system/detached.h"

/* Either a mapping or a descriptor. */
struct release {
    struct release *next;
    void *address; /* NULL for a descriptor */
    uint64_t size;
    int descriptor;
};

/* What waits, and the threads that work on it; they end when nothing does. */
struct crew {
    pthread_mutex_t mutex;
    struct release *first, *last;
    unsigned threads, most_threads;
};

/*
 * Of the process, as pages and descriptors are. What is ours takes its time but ends; what is a stranger's may not, and
 * would hold that up.
 */
static struct crew ours = {.mutex = PTHREAD_MUTEX_INITIALIZER, .most_threads = 1};
static struct crew strangers = {.mutex = PTHREAD_MUTEX_INITIALIZER, .most_threads = RELEASE_STRANGERS};

static void carry_out(const struct release *release)
{
    if (release->address) {
        int result = munmap(release->address, release->size);
        assert(result == 0);
        (void)result;
    } else {
        close(release->descriptor);
        descriptors_lingered();
    }
}

/* NULL ends the thread that asks. */
static struct release *take_first(struct crew *crew)
{
    pthread_mutex_lock(&crew->mutex);
    struct release *release = crew->first;
    if (release)
        crew->first = release->next;
    else
        crew->threads--;
    pthread_mutex_unlock(&crew->mutex);
    return release;
}

static void *work(void *context)
{
    struct crew *crew = context;
    for (struct release *release; (release = take_first(crew));) {
        carry_out(release);
        free(release);
    }
    return NULL;
}

/* True when there should be one more thread, which is counted. */
static bool append(struct crew *crew, struct release *release)
{
    pthread_mutex_lock(&crew->mutex);
    if (crew->first)
        crew->last->next = release;
    else
        crew->first = release;
    crew->last = release;
    bool more = crew->threads < crew->most_threads;
    crew->threads += more;
    pthread_mutex_unlock(&crew->mutex);
    return more;
}

/* False without memory. Without a thread it waits for the next one that can be had. */
static bool hand_over(struct crew *crew, const struct release *release)
{
    struct release *queued = malloc(sizeof *queued);
    if (!queued)
        return false;
    *queued = *release;
    if (append(crew, queued) && !detached_start(work, crew)) {
        pthread_mutex_lock(&crew->mutex);
        crew->threads--;
        pthread_mutex_unlock(&crew->mutex);
    }
    return true;
}

static void release_ours(const struct release *release)
{
    if (release->size < RELEASE_LATER_MIN || !hand_over(&ours, release))
        carry_out(release);
}

void release_mapping(void *address, uint64_t size)
{
    release_ours(&(struct release){.address = address, .size = size});
}

void release_memfd(int descriptor, uint64_t size)
{
    descriptors_linger();
    release_ours(&(struct release){.descriptor = descriptor, .size = size});
}

/*
 * Asking for seals is answered by the kernel alone, whoever the file belongs to; so is everything about what has them.
 */
static bool is_memfd(int descriptor, uint64_t *ret_size)
{
    struct stat file;
    if (fcntl(descriptor, F_GET_SEALS) < 0 || fstat(descriptor, &file) != 0)
        return false;
    *ret_size = (uint64_t)file.st_blocks * 512; /* may be more or less than what it says to hold */
    return true;
}

void release_descriptor(int descriptor)
{
    uint64_t size;
    if (is_memfd(descriptor, &size)) {
        release_memfd(descriptor, size);
    } else if (fcntl(descriptor, F_GETFD) >= 0) {
        descriptors_linger();
        hand_over(&strangers,
                  &(struct release){.descriptor = descriptor}); /* without memory it stays open, and counted */
    }
}
