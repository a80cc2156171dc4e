/* SPDX-License-Identifier: Apache-2.0 */
/*
 * fault_calls.c - lets each system call and each allocation fail that a daemon makes during requests, one after the
 * other. The daemon goes on, answers what it was asked, and holds nothing afterwards.
 *
 *     fault_calls BVHD SHIM [--cycles STRIDE] [--seed N] [TEST...]
 *
 * With a stride, a random one of every STRIDE calls fails; 1: each one.
 *
 *     requests   each call while requests are built, kept on disk, and answered from there
 *     storm      some calls of a few random kinds, 10 times; 1,000 times if each call fails
 *     start      each call while the daemon starts: it starts all the same, or says why not
 */
#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include "tests/support/daemon/fault_bed.h"

enum { ANSWER_MS = 20000, KEPT_MS = 150, MOST_CALLS = 4000, START_MS = 10000 };

static struct fault_bed bed;
static uint32_t stride;

/* How the requests ended that a failing call concerned. */
static uint32_t answers[FAULT_WRONG + 1];

static const char *const call_names[] = {
#define FAULT_CALL(name, number) #name,
    FAULT_CALLS(FAULT_CALL)
#undef FAULT_CALL
};

#if defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer)
#define HAS_SANITIZER 1
#endif
#endif
#ifndef HAS_SANITIZER
#define HAS_SANITIZER 0
#endif

/* A shortage is reported as one: never as a defect, and never as a mistake of the client. */
static bool is_shortage(enum bvhd_status status)
{
    return status == BVHD_BUSY || status == BVHD_NO_MEMORY || status == BVHD_IO || status == BVHD_UNAVAILABLE;
}

static void judge(const struct fault_reply *reply, const char *when)
{
    answers[reply->answer]++;
    hostile_expect(reply->answer != FAULT_LOST, "%s: no answer", when);
    hostile_expect(reply->answer != FAULT_WRONG, "%s: other bytes", when);
    hostile_expect(reply->answer != FAULT_REFUSED || is_shortage(reply->error.status), "%s: %s: %s", when,
                   bvhd_status_name(reply->error.status), reply->error.text);
}

/* Entries that were not used lately get a new time when they are read. */
static void make_old(struct fault_bed *the_bed, const char *path)
{
    const struct timespec old = {.tv_sec = 1000000000};
    (void)the_bed;
    utimensat(AT_FDCWD, path, (const struct timespec[2]){old, old}, 0);
}

/* Builds a mesh, and asks for it again when it is on disk. */
static struct key ask_twice(enum fault_size size, const char *when)
{
    struct fault_reply reply = fault_ask(&bed, size, 0);
    judge(&reply, when);
    if (reply.answer == FAULT_RIGHT)
        fault_is_kept(&bed, &reply.key, KEPT_MS);
    fault_each_entry(&bed, make_old);
    reply = fault_ask(&bed, size, 0);
    judge(&reply, when);
    return reply.key;
}

static void pack(struct raw_client *client, enum frame_type type, const struct key *key, struct bytes *ret_control)
{
    const struct control_get get = {1, (struct key *)(uintptr_t)key};
    const struct control_cache show = {.action = CACHE_SHOW};
    *ret_control = (struct bytes){NULL, 0};
    if (type == FRAME_GET)
        control_pack_get(&get, &client->memory, ret_control, NULL);
    else if (type == FRAME_CACHE)
        control_pack_cache(&show, &client->memory, ret_control, NULL);
}

/* Sends a frame of another type than BUILD. Expects an answer, or the end of the connection. */
static void ask_for_other(enum frame_type type, const struct key *key, const char *when)
{
    struct raw_client client;
    struct raw_frame question = {.header = {.type = (uint16_t)type, .request = 1}};
    struct frame answer;
    bool closed = false;
    if (!fault_connect(&bed, &client)) {
        answers[FAULT_NOT_WELCOME]++;
        return;
    }
    pack(&client, type, key, &question.control);
    bool answered = raw_send_frame(&client, &question) && raw_receive(&client, ANSWER_MS, &answer, &closed);
    hostile_expect(answered || closed, "%s: a frame of type %d is not answered", when, (int)type);
    answers[answered ? FAULT_RIGHT : FAULT_CLOSED]++;
    if (answered && answer.header.descriptors > 0)
        close(answer.descriptors[0]);
    memory_free(&client.memory, (void *)(uintptr_t)question.control.data);
    raw_close(&client);
}

/* Results that are built into mappings take longer than all others together, so they are a case of their own. */
static void ask(bool large, const char *when)
{
    static const enum frame_type others[] = {FRAME_GET, FRAME_STATS, FRAME_PING, FRAME_CACHE, FRAME_CLIENTS};
    if (large) {
        struct fault_reply reply = fault_ask(&bed, FAULT_LARGE, 0);
        judge(&reply, when);
    } else {
        ask_twice(FAULT_SMALL, when);
        struct key key = ask_twice(FAULT_MIDDLE, when);
        for (size_t i = 0; i < sizeof others / sizeof *others; i++)
            ask_for_other(others[i], &key, when);
    }
}

/* Lets one call fail during requests. Returns whether there are as many calls. */
static bool try_call(enum fault_call call, int64_t after, bool large)
{
    char when[64];
    snprintf(when, sizeof when, "%s, call %lld", call_names[call], (long long)after);
    fault_clear_cache(&bed);
    fault_bed_arm(&bed, UINT64_C(1) << call, after, 1);
    ask(large, when);
    bool came = bed.plan->failed > 0;
    fault_bed_disarm(&bed);
    hostile_expect(service_process_runs(&bed.hostile.service), "%s: the daemon is gone", when);
    fault_expect_right(&bed, FAULT_SMALL, 0, when);
    return came;
}

static uint64_t step(void)
{
    return stride == 1 ? 1 : 1 + random_next(&bed.random) % (2 * (uint64_t)stride - 1);
}

static uint32_t try_all(enum fault_call call, bool large)
{
    uint32_t tried = 0;
    int64_t after = (int64_t)(stride == 1 ? 0 : random_next(&bed.random) % stride);
    while (after < MOST_CALLS && service_process_runs(&bed.hostile.service) && try_call(call, after, large)) {
        after += (int64_t)step();
        tried++;
    }
    return tried;
}

/*
 * Sanitizers replace allocations, and their functions for these calls seem to be the program's when the event loop's
 * library calls them, which ends the process when it cannot wake or close.
 */
static bool is_replaced(enum fault_call call)
{
    return HAS_SANITIZER && (call == FAULT_allocation || call == FAULT_close || call == FAULT_fcntl64 ||
                             call == FAULT_ioctl || call == FAULT_write);
}

/* The calls that no request makes, or only on machines of another kind. */
static bool is_rare(enum fault_call call)
{
    return call == FAULT_mkdir || call == FAULT_mremap || call == FAULT_madvise || call == FAULT_opendir ||
           call == FAULT_socket || call == FAULT_fdopendir || call == FAULT_fstatat64 || call == FAULT_lseek64 ||
           call == FAULT_send || call == FAULT_setsockopt || call == FAULT_unlinkat;
}

static int test_requests(const struct fault_options *options)
{
    static const char *const more[] = {"--disk-cache-size", "64M", "--log-level", "error", NULL};
    fault_bed_init(&bed, options, "0", more);
    fault_bed_start(&bed);
    for (int call = 0; call < FAULT_CALL_COUNT && service_process_runs(&bed.hostile.service); call++) {
        if (is_replaced((enum fault_call)call))
            continue;
        memset(answers, 0, sizeof answers);
        uint32_t tried = try_all((enum fault_call)call, false);
        if (call != FAULT_allocation)
            tried += try_all((enum fault_call)call, true);
        printf("%-14s %4u failed: %4u right answers, %3u errors, %3u refused and %3u closed connections\n",
               call_names[call], tried, answers[FAULT_RIGHT], answers[FAULT_REFUSED], answers[FAULT_NOT_WELCOME],
               answers[FAULT_CLOSED]);
        hostile_expect_clean(&bed.hostile, call_names[call], 10000);
        hostile_expect(tried > 0 || stride > 1 || is_rare((enum fault_call)call), "%s never failed", call_names[call]);
    }
    int failures = fault_bed_end(&bed);
    fault_bed_remove(&bed);
    return failures;
}

/* ---- several calls ---- */

/* Lets some calls of a few kinds fail during requests. */
static void try_several(uint32_t round)
{
    char when[64];
    uint64_t calls = 0;
    for (uint64_t kinds = 1 + random_next(&bed.random) % 4; kinds > 0; kinds--)
        calls |= UINT64_C(1) << random_next(&bed.random) % FAULT_CALL_COUNT;
    for (int call = 0; call < FAULT_CALL_COUNT; call++)
        if (is_replaced((enum fault_call)call))
            calls &= ~(UINT64_C(1) << call);
    snprintf(when, sizeof when, "round %u, calls %llx", round, (unsigned long long)calls);
    if (round % 4 == 0)
        fault_clear_cache(&bed);
    fault_bed_arm(&bed, calls, (int64_t)(random_next(&bed.random) % 20), 1 + (int64_t)(random_next(&bed.random) % 8));
    ask(false, when);
    fault_bed_disarm(&bed);
    fault_expect_right(&bed, FAULT_SMALL, 0, when);
}

static int test_storm(const struct fault_options *options)
{
    static const char *const more[] = {"--disk-cache-size", "2M", "--log-level", "error", NULL};
    const uint32_t rounds = stride == 1 ? 1000 : 10;
    fault_bed_init(&bed, options, "0", more);
    fault_bed_start(&bed);
    memset(answers, 0, sizeof answers);
    for (uint32_t round = 0; round < rounds && service_process_runs(&bed.hostile.service); round++)
        try_several(round);
    printf("%u storms: %u right answers, %u errors, %u refused and %u closed connections\n", rounds,
           answers[FAULT_RIGHT], answers[FAULT_REFUSED], answers[FAULT_NOT_WELCOME], answers[FAULT_CLOSED]);
    int failures = fault_bed_end(&bed);
    fault_bed_remove(&bed);
    return failures;
}

/* ---- starting ---- */

static bool log_names_a_reason(void)
{
    char line[1024], last[1024] = "";
    FILE *file = fopen(bed.hostile.service.log, "r");
    while (file && fgets(line, sizeof line, file))
        strcpy(last, line);
    if (file)
        fclose(file);
    return strncmp(last, "bvhd: ", 6) == 0 && strlen(last) > 12;
}

/* Clients can connect before the daemon is ready, so a daemon that ends then has seemed to answer. */
static bool says_hello(void)
{
    struct raw_client client;
    double end = hostile_now() + START_MS;
    while (hostile_now() < end && service_process_runs(&bed.hostile.service)) {
        if (fault_connect(&bed, &client)) {
            raw_close(&client);
            return true;
        }
        fault_pause(1);
    }
    return false;
}

/* Lets one call of a start fail. Returns whether there are as many calls. */
static bool try_start(enum fault_call call, int64_t after, uint32_t *started)
{
    char when[64];
    snprintf(when, sizeof when, "start: %s, call %lld", call_names[call], (long long)after);
    fault_bed_arm(&bed, UINT64_C(1) << call, after, 1);
    bool starts = fault_bed_try_start(&bed) && says_hello(), came = bed.plan->failed > 0;
    fault_bed_disarm(&bed);
    *started += starts;
    if (starts) {
        fault_expect_right(&bed, FAULT_SMALL, 0, when);
        hostile_expect(service_process_end(&bed.hostile.service), "%s: the daemon does not exit cleanly", when);
    } else {
        int status = bed.hostile.service.status;
        hostile_expect(WIFEXITED(status) && WEXITSTATUS(status) == 1, "%s: status %#x", when, (unsigned)status);
        hostile_expect(log_names_a_reason(), "%s: the daemon does not say why it does not start", when);
    }
    return came;
}

static int test_start(const struct fault_options *options)
{
    static const char *const more[] = {"--log-level", "error", NULL};
    fault_bed_init(&bed, options, "1M", more);
    for (int call = 0; call < FAULT_CALL_COUNT; call++) {
        uint32_t tried = 0, started = 0;
        if (is_replaced((enum fault_call)call))
            continue;
        for (int64_t after = (int64_t)(stride == 1 ? 0 : random_next(&bed.random) % stride);
             after < MOST_CALLS && try_start((enum fault_call)call, after, &started); after += (int64_t)step())
            tried++;
        if (tried > 0)
            printf("start: %-14s %4u failed: %4u started\n", call_names[call], tried, started);
    }
    fault_bed_start(&bed);
    int failures = fault_bed_end(&bed);
    fault_bed_remove(&bed);
    return failures;
}

int main(int argc, char **argv)
{
    static const uint32_t meshes[FAULT_SIZE_COUNT] = {1, 1, 1};
    struct fault_options options = fault_options_parse(argc, argv, 1);
    int failures = 0;
    stride = options.cycles ? options.cycles : 1;
    setvbuf(stdout, NULL, _IOLBF, 0);
    fault_learn(&options, meshes);
    if (fault_options_have(&options, "requests"))
        failures = test_requests(&options);
    if (fault_options_have(&options, "storm"))
        failures = test_storm(&options);
    if (fault_options_have(&options, "start"))
        failures = test_start(&options);
    return failures != 0;
}
