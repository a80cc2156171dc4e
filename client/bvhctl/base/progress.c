/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/base/progress.h"

#include <pthread.h>
#include <stdio.h>
#include <string.h>
#include <sys/ioctl.h>
#include <time.h>
#include <unistd.h>

#include "client/bvhctl/base/report.h"
#include "proto/base/clock.h"

enum { BAR_WIDTH = 20, DRAW_MS = 100, LINE_MS = 5000, COLUMNS = 80, LINE_SIZE = 256 };

/* The thread that draws, and what it shares with the others. */
static struct {
    pthread_mutex_t lock;
    pthread_cond_t ends;
    pthread_t thread;
    struct progress *current; /* NULL: the thread has to end */
    bool is_terminal;
    bool is_drawn; /* the line is on the terminal */
} drawing = {.lock = PTHREAD_MUTEX_INITIALIZER, .ends = PTHREAD_COND_INITIALIZER};

static void put(const char *text, size_t size)
{
    if (write(STDERR_FILENO, text, size) < 0)
        return; /* the terminal is gone, which is no reason to stop */
}

/* The lock is held. */
static void erase(void)
{
    if (drawing.is_drawn)
        put("\r\033[K", 4);
    drawing.is_drawn = false;
}

void progress_make_room(void)
{
    pthread_mutex_lock(&drawing.lock);
    erase();
    pthread_mutex_unlock(&drawing.lock);
}

/* Returns 0 .. 1, or a negative number where nobody knows. */
static double fraction_of(const struct progress *progress)
{
    uint64_t total = atomic_load(&progress->total), done = atomic_load(&progress->done);
    return total == 0 ? -1 : done < total ? (double)done / (double)total : 1;
}

static int columns(void)
{
    struct winsize size;
    return ioctl(STDERR_FILENO, TIOCGWINSZ, &size) == 0 && size.ws_col > 0 ? size.ws_col : COLUMNS;
}

/* Draws a line that is shorter than the terminal is wide, because one that wraps cannot be erased. */
static void draw(const struct progress *progress)
{
    char tail[64], line[LINE_SIZE];
    double fraction = fraction_of(progress), seconds = (clock_ms() - progress->start) / 1000;
    int used = 0;
    if (fraction >= 0) {
        char bar[BAR_WIDTH + 1] = "";
        for (int i = 0; i < BAR_WIDTH; i++)
            bar[i] = i < (int)(fraction * BAR_WIDTH) ? '#' : '.';
        used = snprintf(tail, sizeof tail, "  %s %3d %%", bar, (int)(fraction * 100));
    }
    used += snprintf(tail + used, sizeof tail - (size_t)used, "  %.0f s", seconds);
    int room = columns() - 1 - used;
    room = room < 0 ? 0 : room > 128 ? 128 : room;
    int size = snprintf(line, sizeof line, "\r%.*s%s\033[K", room, progress->label, tail);
    put(line, (size_t)size);
    drawing.is_drawn = true;
}

/* Prints the sparse line for those who read a file and not a terminal. */
static void print(const struct progress *progress)
{
    char line[LINE_SIZE];
    double fraction = fraction_of(progress), seconds = (clock_ms() - progress->start) / 1000;
    int size = fraction < 0 ? snprintf(line, sizeof line, "bvhctl: %s: %.1f s\n", progress->label, seconds)
                            : snprintf(line, sizeof line, "bvhctl: %s: %d %%, %.1f s\n", progress->label,
                                       (int)(fraction * 100), seconds);
    put(line, (size_t)size);
}

static struct timespec after(double ms)
{
    struct timespec time;
    clock_gettime(CLOCK_REALTIME, &time);
    uint64_t ns = (uint64_t)time.tv_nsec + (uint64_t)(ms * 1e6);
    return (struct timespec){time.tv_sec + (time_t)(ns / 1000000000), (long)(ns % 1000000000)};
}

static void *run(void *unused)
{
    (void)unused;
    pthread_mutex_lock(&drawing.lock);
    while (drawing.current) {
        struct timespec next = after(drawing.is_terminal ? DRAW_MS : LINE_MS);
        int ended = pthread_cond_timedwait(&drawing.ends, &drawing.lock, &next);
        if (!drawing.current || ended == 0)
            continue;
        if (drawing.is_terminal)
            draw(drawing.current);
        else
            print(drawing.current);
    }
    erase();
    pthread_mutex_unlock(&drawing.lock);
    return NULL;
}

/* Names may hold anything; control characters would break the line. */
static void clean(char *text)
{
    for (; *text; text++)
        if ((unsigned char)*text < 0x20 || *text == 0x7f)
            *text = '?';
}

void progress_begin(struct progress *progress, const char *verb, const char *name)
{
    enum report_volume volume = report_volume();
    drawing.is_terminal = isatty(STDERR_FILENO);
    progress->start = clock_ms();
    atomic_store(&progress->done, 0);
    atomic_store(&progress->total, 0);
    snprintf(progress->label, sizeof progress->label, "%s %s", verb, name);
    clean(progress->label);
    drawing.current = progress;
    progress->shown = volume != REPORT_ERRORS && (drawing.is_terminal || volume == REPORT_ALL) &&
                      pthread_create(&drawing.thread, NULL, run, NULL) == 0;
}

void progress_update(void *context, uint64_t done, uint64_t total)
{
    struct progress *progress = context;
    /* Several threads report at once: the largest figure is kept. */
    if (atomic_exchange(&progress->total, total) != total || done > atomic_load(&progress->done))
        atomic_store(&progress->done, done);
}

void progress_end(struct progress *progress)
{
    if (!progress->shown)
        return;
    progress->shown = false;
    pthread_mutex_lock(&drawing.lock);
    drawing.current = NULL;
    pthread_cond_signal(&drawing.ends);
    pthread_mutex_unlock(&drawing.lock);
    pthread_join(drawing.thread, NULL);
    if (!drawing.is_terminal)
        print(progress);
}
