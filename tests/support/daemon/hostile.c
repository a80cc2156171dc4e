/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/support/daemon/hostile.h"

#include <stdio.h>
#include <stdlib.h>
#include <time.h>

static int failures;

double hostile_now(void)
{
    struct timespec time;
    clock_gettime(CLOCK_MONOTONIC, &time);
    return (double)time.tv_sec * 1e3 + (double)time.tv_nsec * 1e-6;
}

void hostile_expect(bool good, const char *format, ...)
{
    if (good)
        return;
    va_list arguments;
    va_start(arguments, format);
    fputs("failed: ", stdout);
    vprintf(format, arguments);
    putchar('\n');
    fflush(stdout);
    va_end(arguments);
    failures++;
}

/* Connects and says HELLO. A client that is refused tries again, as the protocol asks it to, for five seconds. */
static bool join(const struct hostile *hostile, struct raw_client *client)
{
    for (double begin = hostile_now(); hostile_now() - begin < 5000;) {
        if (!raw_connect(client, hostile->service.socket))
            return false;
        if (raw_try_hello(client))
            return true;
        raw_close(client);
        nanosleep(&(struct timespec){.tv_nsec = 5000000}, NULL);
    }
    return false;
}

uint64_t hostile_counter(struct hostile *hostile, const char *name)
{
    struct raw_client client;
    struct raw_frame question = {.header = {.type = FRAME_STATS, .request = 1}};
    struct frame answer;
    struct control_counters *counters;
    uint64_t value = UINT64_MAX;
    if (!join(hostile, &client))
        return value;
    if (raw_send_frame(&client, &question) && raw_await(&client, FRAME_COUNTERS, 5000, &answer) &&
        control_unpack_counters(answer.control, &client.memory, &counters, NULL) == BVHD_OK) {
        for (uint32_t i = 0; i < counters->count; i++)
            if (!strcmp(counters->counters[i].name, name))
                value = counters->counters[i].value;
        memory_free(&client.memory, counters);
    }
    raw_close(&client);
    return value;
}

/* A daemon under the address sanitizer keeps freed memory for a while, which these tests do not measure. */
static void keep_little_freed(void)
{
    const char *given = getenv("ASAN_OPTIONS");
    char options[512];
    snprintf(options, sizeof options, "%s%squarantine_size_mb=8", given ? given : "", given ? ":" : "");
    setenv("ASAN_OPTIONS", options, 1);
}

void hostile_begin(struct hostile *hostile, const char *program, const char *const *options)
{
    keep_little_freed();
    *hostile = (struct hostile){.program = program};
    service_process_start(&hostile->service, program, options);
    hostile->memory_base = hostile_counter(hostile, "memory_live");
    hostile->descriptors_base = hostile_counter(hostile, "descriptors_used");
}

int hostile_end(struct hostile *hostile)
{
    hostile_expect(service_process_runs(&hostile->service), "the daemon is gone");
    hostile_expect(service_process_stop(&hostile->service), "the daemon did not exit cleanly");
    return failures;
}

void hostile_connect_as(const struct hostile *hostile, struct raw_client *client, unsigned uid)
{
    const char *path = hostile->service.socket;
    if (!(raw_can_be_others() ? raw_connect_as(client, path, uid) : raw_connect(client, path))) {
        fputs("the daemon is gone\n", stderr);
        exit(1);
    }
    raw_hello(client);
}

double hostile_serves(struct hostile *hostile, const char *when, double limit_ms)
{
    static uint32_t seed = 1000000;
    struct raw_client client;
    struct frame frame;
    uint64_t size;
    unsigned char *payload = raw_payload(100, ++seed, &size);
    struct control_item item = raw_item(0, size, SOURCE_INLINE);
    double begin = hostile_now();
    bool connected = join(hostile, &client);
    hostile_expect(connected, "%s: nobody else can connect", when);
    if (connected) {
        raw_build(&client, &item, 1, (struct bytes){payload, size}, NULL, NULL, 0);
        bool came = raw_await(&client, FRAME_RESULT, 20000, &frame);
        hostile_expect(came, "%s: nobody else is served", when);
        struct control_result *result = came ? raw_result(&client, &frame) : NULL;
        hostile_expect(result && result->error.status == BVHD_OK, "%s: somebody else's build failed: %s", when,
                       result ? result->error.text : "no result");
        memory_free(&client.memory, result);
        raw_close(&client);
    }
    free(payload);
    double ms = hostile_now() - begin;
    hostile_expect(ms <= limit_ms, "%s: somebody else waited %.0f ms", when, ms);
    return ms;
}

void hostile_expect_clean(struct hostile *hostile, const char *when, double limit_ms)
{
    static const char *const names[] = {"connections", "jobs_running", "queue_depth",
                                        "pool_bytes",  "memory_live",  "descriptors_used"};
    uint64_t bases[] = {1, 0, 0, 0, hostile->memory_base, hostile->descriptors_base};
    double begin = hostile_now();
    for (size_t i = 0; i < sizeof names / sizeof *names; i++) {
        uint64_t value = hostile_counter(hostile, names[i]);
        while (value > bases[i] && hostile_now() - begin < limit_ms)
            value = hostile_counter(hostile, names[i]);
        hostile_expect(value <= bases[i], "%s: %s is %llu after %.0f ms, was %llu", when, names[i],
                       (unsigned long long)value, limit_ms, (unsigned long long)bases[i]);
    }
}
