/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/support/daemon/fault_bed.h"

#include <fcntl.h>
#include <getopt.h>
#include <glob.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "proto/base/key.h"

enum { SEALS = F_SEAL_SHRINK | F_SEAL_GROW | F_SEAL_WRITE | F_SEAL_SEAL, ANSWER_MS = 30000 };

static const uint32_t triangles[FAULT_SIZE_COUNT] = {100, 3000, 87000};

/* The right bytes of meshes, and the daemon that has built them. */
static struct service_process reference;
static unsigned char *right[FAULT_SIZE_COUNT][FAULT_MESHES];
static uint64_t right_size[FAULT_SIZE_COUNT][FAULT_MESHES];

static void fail(const char *what)
{
    perror(what);
    exit(1);
}

void fault_pause(long ms)
{
    nanosleep(&(struct timespec){ms / 1000, ms % 1000 * 1000000}, NULL);
}

/* ---- options ---- */

struct fault_options fault_options_parse(int argc, char **argv, uint32_t cycles)
{
    static const struct option known[] = {
        {"cycles", required_argument, NULL, 'c'}, {"seed", required_argument, NULL, 's'}, {0}};
    struct fault_options options = {.cycles = cycles, .seed = 1};
    for (int option; (option = getopt_long(argc, argv, "", known, NULL)) != -1;) {
        if (option == 'c')
            options.cycles = (uint32_t)strtoul(optarg, NULL, 10);
        else if (option == 's')
            options.seed = strtoull(optarg, NULL, 10);
        else
            exit(2);
    }
    if (argc - optind < 2) {
        fprintf(stderr, "usage: %s BVHD SHIM [--cycles N] [--seed N] [TEST...]\n", argv[0]);
        exit(2);
    }
    options.program = argv[optind];
    options.shim = argv[optind + 1];
    options.tests = argv + optind + 2;
    return options;
}

bool fault_options_have(const struct fault_options *options, const char *test)
{
    for (char **chosen = options->tests; *chosen; chosen++)
        if (strcmp(*chosen, test) == 0)
            return true;
    return !*options->tests;
}

/* ---- the daemon ---- */

static void make_plan(struct fault_bed *bed)
{
    snprintf(bed->plan_path, sizeof bed->plan_path, "%s/plan", bed->hostile.service.directory);
    int file = open(bed->plan_path, O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC, 0600);
    if (file < 0 || ftruncate(file, sizeof *bed->plan) != 0)
        fail(bed->plan_path);
    bed->plan = mmap(NULL, sizeof *bed->plan, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
    close(file);
    if (bed->plan == MAP_FAILED)
        fail("mmap");
}

void fault_bed_init(struct fault_bed *bed, const struct fault_options *options, const char *memory_bytes,
                    const char *const *more)
{
    *bed = (struct fault_bed){.hostile.program = options->program, .shim = options->shim, .random = {options->seed}};
    service_process_init(&bed->hostile.service);
    snprintf(bed->cache, sizeof bed->cache, "%s/cache", bed->hostile.service.directory);
    snprintf(bed->memory_bytes, sizeof bed->memory_bytes, "%s", memory_bytes);
    make_plan(bed);
    const char *words[] = {"--cache", bed->cache, "--cache-size", bed->memory_bytes, "--workers", "2"};
    size_t count = sizeof words / sizeof *words;
    memcpy(bed->words, words, sizeof words);
    for (; more && *more && count < FAULT_WORDS - 1; more++)
        bed->words[count++] = *more;
}

bool fault_bed_try_start(struct fault_bed *bed)
{
    setenv("LD_PRELOAD", bed->shim, 1);
    setenv(FAULT_PLAN_VARIABLE, bed->plan_path, 1);
    bool started = service_process_try_restart(&bed->hostile.service, bed->hostile.program, bed->words);
    unsetenv("LD_PRELOAD");
    return started;
}

void fault_bed_start(struct fault_bed *bed)
{
    if (!fault_bed_try_start(bed)) {
        fprintf(stderr, "the daemon does not start: %s\n", bed->hostile.service.log);
        exit(1);
    }
    bed->hostile.memory_base = hostile_counter(&bed->hostile, "memory_live");
    bed->hostile.descriptors_base = hostile_counter(&bed->hostile, "descriptors_used");
}

int fault_bed_end(struct fault_bed *bed)
{
    hostile_expect_clean(&bed->hostile, "at the end", 10000);
    hostile_expect(service_process_runs(&bed->hostile.service), "the daemon is gone");
    return hostile_end(&bed->hostile);
}

void fault_bed_remove(struct fault_bed *bed)
{
    char command[160];
    service_process_kill(&bed->hostile.service);
    munmap(bed->plan, sizeof *bed->plan);
    snprintf(command, sizeof command, "rm -rf '%s'", bed->hostile.service.directory);
    if (system(command) != 0)
        fail(command);
}

void fault_bed_arm(struct fault_bed *bed, uint64_t calls, int64_t after, int64_t most)
{
    bed->plan->armed = 0;
    bed->plan->seen = bed->plan->failed = 0;
    bed->plan->left = after;
    bed->plan->most = most;
    bed->plan->armed = calls;
}

void fault_bed_disarm(struct fault_bed *bed)
{
    bed->plan->armed = 0;
}

/* ---- requests ---- */

/* Waits for WELCOME. */
static bool await_welcome(struct raw_client *client)
{
    struct frame answer;
    bool closed, came = raw_receive(client, ANSWER_MS, &answer, &closed);
    hostile_expect(came || closed, "HELLO is not answered");
    return came && answer.header.type == FRAME_WELCOME;
}

bool fault_say_hello(struct raw_client *client)
{
    struct control_hello hello = {
        .version_min = CONTROL_VERSION, .version_max = CONTROL_VERSION, .software = "test of faults"};
    struct raw_frame frame = {.header.type = FRAME_HELLO};
    if (control_pack_hello(&hello, &client->memory, &frame.control, NULL) != BVHD_OK)
        fail("hello");
    bool welcome = raw_send_frame(client, &frame) && await_welcome(client);
    memory_free(&client->memory, (void *)(uintptr_t)frame.control.data);
    return welcome;
}

static bool connect_to(const char *path, struct raw_client *client)
{
    if (!raw_connect(client, path))
        return false;
    if (fault_say_hello(client))
        return true;
    raw_close(client);
    return false;
}

bool fault_connect(struct fault_bed *bed, struct raw_client *client)
{
    return connect_to(bed->hostile.service.socket, client);
}

bool fault_send(struct raw_client *client, enum fault_size size, uint32_t seed)
{
    uint64_t bytes, sent;
    unsigned char *payload = raw_payload(triangles[size], seed + 1, &bytes);
    bool within = size == FAULT_SMALL;
    struct control_item item = raw_item(0, bytes, within ? SOURCE_INLINE : SOURCE_MEMFD);
    if (within) {
        sent = raw_build(client, &item, 1, (struct bytes){payload, bytes}, NULL, NULL, 0);
    } else {
        int file = raw_memfd(payload, bytes, SEALS);
        sent = raw_build(client, &item, 1, (struct bytes){NULL, 0}, &file, &bytes, 1);
        close(file);
    }
    free(payload);
    return sent != 0;
}

/* Copies the bytes of a result; malloc. NULL: they are not there. Closes the descriptor. */
static unsigned char *take_bytes(const struct frame *frame, uint64_t size)
{
    unsigned char *bytes = malloc(size ? size : 1);
    if (!bytes)
        fail("memory");
    bool there;
    if (frame->header.descriptors == 1) {
        there = pread(frame->descriptors[0], bytes, size, 0) == (ssize_t)size;
        close(frame->descriptors[0]);
    } else {
        there = frame->inline_bytes.size == size;
        if (there)
            memcpy(bytes, frame->inline_bytes.data, size);
    }
    if (there)
        return bytes;
    free(bytes);
    return NULL;
}

/* Waits for FRAME_RESULT, or for a frame that says that none will come. */
static bool await_answer(struct raw_client *client, int patience_ms, struct frame *ret_frame, bool *ret_closed)
{
    double end = hostile_now() + patience_ms;
    *ret_closed = false;
    for (double left; (left = end - hostile_now()) > 0;) {
        if (!raw_receive(client, (int)left + 1, ret_frame, ret_closed))
            return false;
        uint16_t type = ret_frame->header.type;
        if (type == FRAME_RESULT || type == FRAME_ERROR || type == FRAME_BUSY)
            return true;
    }
    return false;
}

static void read_refusal(struct raw_client *client, const struct frame *frame, struct bvhd_error *ret_error)
{
    struct bvhd_error *error;
    bvhd_error_set(ret_error, BVHD_BUSY, "", "busy");
    if (frame->header.type == FRAME_ERROR &&
        control_unpack_error(frame->control, &client->memory, &error, NULL) == BVHD_OK) {
        *ret_error = *error;
        memory_free(&client->memory, error);
    }
}

/* Receives an answer, and the bytes of a result, which are NULL if they are not there. */
static struct fault_reply receive(struct raw_client *client, int patience_ms, unsigned char **ret_bytes,
                                  uint64_t *ret_size)
{
    struct fault_reply reply = {.answer = FAULT_RIGHT};
    struct frame frame;
    bool closed;
    *ret_bytes = NULL;
    if (!await_answer(client, patience_ms, &frame, &closed))
        return (struct fault_reply){.answer = closed ? FAULT_CLOSED : FAULT_LOST};
    struct control_result *result = raw_result(client, &frame);
    if (!result) {
        reply.answer = FAULT_REFUSED;
        read_refusal(client, &frame, &reply.error);
        return reply;
    }
    reply.key = result->key;
    reply.origin = result->origin;
    reply.error = result->error;
    *ret_size = result->size;
    if (result->error.status == BVHD_OK)
        *ret_bytes = take_bytes(&frame, result->size);
    else
        reply.answer = FAULT_REFUSED;
    memory_free(&client->memory, result);
    return reply;
}

/* Asks the other daemon, once for each mesh. */
static void learn(enum fault_size size, uint32_t seed)
{
    struct raw_client client;
    if (right[size][seed])
        return;
    if (!connect_to(reference.socket, &client) || !fault_send(&client, size, seed))
        fail("the daemon without faults");
    receive(&client, ANSWER_MS, &right[size][seed], &right_size[size][seed]);
    raw_close(&client);
    if (!right[size][seed])
        fail("the daemon without faults");
}

void fault_learn(const struct fault_options *options, const uint32_t counts[FAULT_SIZE_COUNT])
{
    static const char *const words[] = {"--workers", "2", "--no-cache", "--cache-size", "0", NULL};
    service_process_start(&reference, options->program, words);
    for (int size = 0; size < FAULT_SIZE_COUNT; size++)
        for (uint32_t seed = 0; seed < counts[size]; seed++)
            learn((enum fault_size)size, seed);
    service_process_stop(&reference);
}

struct fault_reply fault_receive(struct raw_client *client, enum fault_size size, uint32_t seed, int patience_ms)
{
    unsigned char *bytes;
    uint64_t count = 0;
    struct fault_reply reply = receive(client, patience_ms, &bytes, &count);
    if (reply.answer == FAULT_RIGHT &&
        (!bytes || count != right_size[size][seed] || memcmp(bytes, right[size][seed], count) != 0))
        reply.answer = FAULT_WRONG;
    free(bytes);
    return reply;
}

struct fault_reply fault_ask(struct fault_bed *bed, enum fault_size size, uint32_t seed)
{
    struct raw_client client;
    struct fault_reply reply = {.answer = FAULT_NOT_WELCOME};
    if (!fault_connect(bed, &client))
        return reply;
    reply.answer = FAULT_CLOSED;
    if (fault_send(&client, size, seed))
        reply = fault_receive(&client, size, seed, ANSWER_MS);
    raw_close(&client);
    return reply;
}

uint32_t fault_expect_right(struct fault_bed *bed, enum fault_size size, uint32_t seed, const char *when)
{
    static const char *const names[] = {"right", "refused", "not welcome", "closed", "lost", "wrong"};
    struct fault_reply reply = fault_ask(bed, size, seed);
    hostile_expect(reply.answer == FAULT_RIGHT, "%s: mesh %u of size %d: %s %s", when, seed, (int)size,
                   names[reply.answer], reply.answer == FAULT_REFUSED ? reply.error.text : "");
    return reply.origin;
}

/* ---- the cache on disk ---- */

/* Matches DIRECTORY/GENERATION/SHARD/NAME. */
static void find_entries(struct fault_bed *bed, const char *name, glob_t *ret_found)
{
    char pattern[256];
    snprintf(pattern, sizeof pattern, "%s/*/[0-9a-f][0-9a-f]/%s", bed->cache, name);
    glob(pattern, GLOB_NOSORT, NULL, ret_found);
}

bool fault_is_kept(struct fault_bed *bed, const struct key *key, int patience_ms)
{
    char name[KEY_TEXT_SIZE];
    double end = hostile_now() + patience_ms;
    key_to_text(key, name);
    for (;;) {
        glob_t found;
        find_entries(bed, name, &found);
        bool kept = found.gl_pathc > 0;
        globfree(&found);
        if (kept || hostile_now() >= end)
            return kept;
        fault_pause(1);
    }
}

uint32_t fault_each_entry(struct fault_bed *bed, void (*visit)(struct fault_bed *bed, const char *path))
{
    glob_t found;
    uint32_t count = 0;
    find_entries(bed, "*", &found);
    for (size_t i = 0; i < found.gl_pathc; i++) {
        const char *name = strrchr(found.gl_pathv[i], '/') + 1;
        if (strlen(name) != KEY_TEXT_SIZE - 1)
            continue;
        count++;
        if (visit)
            visit(bed, found.gl_pathv[i]);
    }
    globfree(&found);
    return count;
}

const char *fault_generation(struct fault_bed *bed)
{
    char pattern[128];
    glob_t found;
    snprintf(pattern, sizeof pattern, "%s/*/[0-9a-f][0-9a-f]", bed->cache);
    if (glob(pattern, 0, NULL, &found) != 0)
        fail(pattern);
    snprintf(bed->generation, sizeof bed->generation, "%.*s", (int)strlen(found.gl_pathv[0]) - 3, found.gl_pathv[0]);
    globfree(&found);
    return bed->generation;
}

/* The daemon may be writing an entry at this moment, so that a folder is not empty. */
void fault_clear_cache(struct fault_bed *bed)
{
    char command[128];
    snprintf(command, sizeof command, "rm -rf '%s'/* 2>/dev/null", bed->cache);
    for (int tries = 0; system(command) != 0; tries++)
        if (tries == 100)
            fail(command);
}
