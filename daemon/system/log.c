/* SPDX-License-Identifier: Apache-2.0 */
#include "daemon/system/log.h"

#include <pthread.h>
#include <stdarg.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#include "proto/base/clock.h"

enum { LINE_SIZE = 1000 };

static const char *const level_names[] = {"error", "warning", "info", "debug"};
static const char journal_priorities[] = {'3', '4', '6', '7'};

static atomic_int highest_level = LOG_INFO;
static pthread_once_t journal_once = PTHREAD_ONCE_INIT;
static bool journal;

/*
 * $JOURNAL_STREAM names the device and inode that the service manager connected to stderr. They are compared, because
 * stderr may have been redirected since.
 */
static void find_journal(void)
{
    const char *stream = getenv("JOURNAL_STREAM");
    unsigned long long device, inode;
    struct stat status;
    journal = stream && sscanf(stream, "%llu:%llu", &device, &inode) == 2 && fstat(STDERR_FILENO, &status) == 0 &&
              status.st_dev == device && status.st_ino == inode;
}

void log_set_level(enum log_level level)
{
    atomic_store_explicit(&highest_level, (int)level, memory_order_relaxed);
}

bool log_writes(enum log_level level)
{
    return (int)level <= atomic_load_explicit(&highest_level, memory_order_relaxed);
}

static size_t write_prefix(enum log_level level, const char *event, char *line)
{
    if (journal)
        return (size_t)snprintf(line, LINE_SIZE, "<%c>level=%s event=%s", journal_priorities[level], level_names[level],
                                event);
    struct timespec now;
    struct tm utc;
    char text[32];
    clock_gettime(CLOCK_REALTIME, &now);
    gmtime_r(&now.tv_sec, &utc);
    strftime(text, sizeof text, "%Y-%m-%dT%H:%M:%S", &utc);
    return (size_t)snprintf(line, LINE_SIZE, "%s.%03ldZ level=%s event=%s", text, now.tv_nsec / 1000000,
                            level_names[level], event);
}

static size_t shorter(size_t a, size_t b)
{
    return a < b ? a : b;
}

void log_event(enum log_level level, const char *event, const char *pairs, ...)
{
    if (!log_writes(level))
        return;
    pthread_once(&journal_once, find_journal);
    char line[LINE_SIZE + 1];
    size_t length = shorter(write_prefix(level, event, line), LINE_SIZE - 1);
    if (pairs) {
        va_list arguments;
        line[length++] = ' ';
        va_start(arguments, pairs);
        int more = vsnprintf(line + length, LINE_SIZE - length, pairs, arguments);
        va_end(arguments);
        length = shorter(length + (more > 0 ? (size_t)more : 0), LINE_SIZE - 1);
    }
    for (size_t i = 0; i < length; i++)
        if ((unsigned char)line[i] < 0x20 || line[i] == 0x7f)
            line[i] = '?';
    line[length++] = '\n';
    if (write(STDERR_FILENO, line, length) < 0)
        return; /* stderr is the only place where an error could be reported */
}

struct log_quoted log_quote(const char *text)
{
    struct log_quoted quoted;
    size_t length = 0;
    quoted.text[length++] = '"';
    for (; *text && length < sizeof quoted.text - 2; text++)
        quoted.text[length++] = *text == '"' || *text == '\\'                  ? '\''
                                : (unsigned char)*text < 0x20 || *text == 0x7f ? '?'
                                                                               : *text;
    quoted.text[length++] = '"';
    quoted.text[length] = 0;
    return quoted;
}

bool log_limit_pass(struct log_limit *limit, uint32_t *ret_suppressed)
{
    uint64_t ms = clock_ns() / 1000000;
    if (ms < limit->next_ms) {
        limit->suppressed++;
        return false;
    }
    *ret_suppressed = limit->suppressed;
    *limit = (struct log_limit){.next_ms = ms + 1000};
    return true;
}
