/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/base/progress.h"

#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "proto/base/clock.h"

enum { BAR_WIDTH = 30, DRAW_INTERVAL = 100 };

static void put(const char *text, size_t size)
{
    if (write(STDERR_FILENO, text, size) < 0)
        return; /* the terminal is gone, which is no reason to stop */
}

void progress_begin(struct progress *progress, const char *verb, const char *name)
{
    progress->shown = isatty(STDERR_FILENO);
    snprintf(progress->label, sizeof progress->label, "%s %s", verb, name);
    atomic_store(&progress->next, (int64_t)clock_ms() + DRAW_INTERVAL);
}

static void draw(const struct progress *progress, double fraction)
{
    char bar[BAR_WIDTH + 1] = "";
    for (int i = 0; i < BAR_WIDTH; i++)
        bar[i] = i < (int)(fraction * BAR_WIDTH) ? '#' : '.';
    char line[160];
    int size = snprintf(line, sizeof line, "\r%s  %s %3d %%\033[K", progress->label, bar, (int)(fraction * 100));
    put(line, (size_t)size);
}

void progress_update(void *context, uint64_t done, uint64_t total)
{
    struct progress *progress = context;
    if (!progress->shown || total == 0)
        return;
    int64_t now = (int64_t)clock_ms(), next = atomic_load(&progress->next);
    if (now >= next && atomic_compare_exchange_strong(&progress->next, &next, now + DRAW_INTERVAL))
        draw(progress, done < total ? (double)done / (double)total : 1);
}

void progress_end(struct progress *progress)
{
    if (progress->shown)
        put("\r\033[K", 4);
    progress->shown = false;
}
