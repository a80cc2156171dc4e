/* SPDX-License-Identifier: Apache-2.0 */
/*
 * hostile_limits.c - tests a daemon at its limits: without free descriptors, with too many connections, with other
 * versions of the protocol, with frames of future versions, and with events that would fill its log.
 *
 *     hostile_limits BVHD
 */
#include <stdio.h>
#include <stdlib.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "tests/support/daemon/hostile.h"

enum { FEW_DESCRIPTORS = 512 };

static struct hostile hostile;

static void sleep_ms(long ms)
{
    struct timespec wait = {ms / 1000, ms % 1000 * 1000000};
    nanosleep(&wait, NULL);
}

/* The processor time that a process has used so far, from /proc, in seconds. */
static double cpu_seconds(pid_t pid)
{
    char path[64];
    unsigned long user = 0, system = 0;
    snprintf(path, sizeof path, "/proc/%d/stat", (int)pid);
    FILE *file = fopen(path, "r");
    if (file && fscanf(file, "%*d (%*[^)]) %*c %*d %*d %*d %*d %*d %*u %*u %*u %*u %*u %lu %lu", &user, &system) != 2)
        user = system = 0;
    if (file)
        fclose(file);
    return (double)(user + system) / (double)sysconf(_SC_CLK_TCK);
}

/* Whether the daemon answers one PING on an existing connection. */
static bool still_answers(struct raw_client *client)
{
    struct frame frame;
    struct raw_frame ping = {.header = {.type = FRAME_PING, .request = ++client->last_request}};
    return raw_send_frame(client, &ping) && raw_await(client, FRAME_PONG, 2000, &frame);
}

/*
 * Runs in a separate process, whose limit the daemon inherits. The daemon keeps some descriptors in reserve, so that it
 * serves connected clients while others wait to be accepted.
 */
static int crowd_out(const char *program)
{
    static struct raw_client crowd[FEW_DESCRIPTORS];
    struct raw_client old;
    int open = 0;
    hostile_begin(&hostile, program, NULL);
    if (!raw_connect(&old, hostile.service.socket))
        return 1;
    raw_hello(&old);
    while (open < FEW_DESCRIPTORS - 12 && raw_connect(&crowd[open], hostile.service.socket))
        open++;
    uint32_t used = service_process_descriptors(&hostile.service);
    double busy = cpu_seconds(hostile.service.pid);
    sleep_ms(500);
    busy = cpu_seconds(hostile.service.pid) - busy;
    hostile_expect(still_answers(&old), "short of descriptors: a connection from before is not answered");
    hostile_expect(busy < 0.25, "short of descriptors: the daemon burns %.2f s in half a second", busy);
    for (int i = 0; i < open; i++)
        raw_close(&crowd[i]);
    raw_close(&old);
    hostile_serves(&hostile, "descriptors are back", 5000);
    hostile_expect_clean(&hostile, "descriptors are back", 5000);
    printf("short of descriptors: %d connections were tried, the daemon had %u of %d open\n", open, used,
           FEW_DESCRIPTORS);
    return hostile_end(&hostile);
}

static int run_short_of_descriptors(const char *program)
{
    int status;
    fflush(stdout);
    pid_t pid = fork();
    if (pid == 0) {
        struct rlimit limit = {FEW_DESCRIPTORS, FEW_DESCRIPTORS};
        int failures = setrlimit(RLIMIT_NOFILE, &limit) ? 1 : crowd_out(program);
        fflush(stdout);
        _exit(failures ? 1 : 0);
    }
    return waitpid(pid, &status, 0) == pid && WIFEXITED(status) ? WEXITSTATUS(status) : 1;
}

/* Sends HELLO with these versions. Returns the frame type of the answer, or 0 when there is none. */
static int say_hello(uint32_t least, uint32_t most, struct bvhd_error *ret_error, uint32_t *ret_version)
{
    struct raw_client client;
    struct frame frame;
    struct control_hello hello = {.version_min = least, .version_max = most, .software = "other version"};
    struct raw_frame request = {.header = {.type = FRAME_HELLO}};
    int type = 0;
    if (!raw_connect(&client, hostile.service.socket))
        return 0;
    control_pack_hello(&hello, &client.memory, &request.control, NULL);
    raw_send_frame(&client, &request);
    if (raw_receive(&client, 5000, &frame, NULL)) {
        struct control_welcome *welcome;
        struct bvhd_error *error;
        type = frame.header.type;
        if (type == FRAME_WELCOME && control_unpack_welcome(frame.control, &client.memory, &welcome, NULL) == BVHD_OK) {
            *ret_version = welcome->version;
            memory_free(&client.memory, welcome);
        }
        if (type == FRAME_ERROR && control_unpack_error(frame.control, &client.memory, &error, NULL) == BVHD_OK) {
            *ret_error = *error;
            memory_free(&client.memory, error);
        }
    }
    memory_free(&client.memory, (void *)(uintptr_t)request.control.data);
    raw_close(&client);
    return type;
}

static void check_versions(void)
{
    struct bvhd_error error = {0};
    uint32_t version = 0;
    hostile_expect(say_hello(CONTROL_VERSION, CONTROL_VERSION + 1, &error, &version) == FRAME_WELCOME &&
                       version == CONTROL_VERSION,
                   "a newer client that speaks this version, too, is not welcome");
    hostile_expect(say_hello(CONTROL_VERSION - 1, CONTROL_VERSION, &error, &version) == FRAME_WELCOME &&
                       version == CONTROL_VERSION,
                   "an older client that speaks this version, too, is not welcome");
    hostile_expect(say_hello(CONTROL_VERSION + 1, CONTROL_VERSION + 1, &error, &version) == FRAME_ERROR &&
                       error.status == BVHD_INCOMPATIBLE,
                   "a newer client gets no INCOMPATIBLE but %s", bvhd_status_name(error.status));
    printf("a newer client is told: %s: %s: %s\n", bvhd_status_name(error.status), error.where, error.text);
    hostile_expect(say_hello(CONTROL_VERSION - 1, CONTROL_VERSION - 1, &error, &version) == FRAME_ERROR,
                   "an older client gets no error");
    hostile_expect(say_hello(CONTROL_VERSION + 1, CONTROL_VERSION - 1, &error, &version) == FRAME_ERROR,
                   "a range upside down is welcome");
}

/* Sends a frame of an unknown type, and a message with an unknown field. */
static void check_future(void)
{
    struct raw_client client;
    struct frame frame;
    unsigned char control[256];
    if (!raw_connect(&client, hostile.service.socket))
        exit(1);
    raw_hello(&client);
    struct raw_frame unknown = {.header = {.type = 40, .request = ++client.last_request},
                                .control = {(const unsigned char *)"\x08\x01", 2}};
    raw_send_frame(&client, &unknown);
    struct bvhd_error *error = NULL;
    bool answered = raw_await(&client, FRAME_ERROR, 2000, &frame) && frame.header.request == client.last_request &&
                    control_unpack_error(frame.control, &client.memory, &error, NULL) == BVHD_OK;
    hostile_expect(answered && error->status == BVHD_UNSUPPORTED,
                   "an unknown frame type is not answered with UNSUPPORTED");
    memory_free(&client.memory, error);
    hostile_expect(still_answers(&client), "an unknown frame type ends the connection");

    struct key key = {{9}};
    struct control_get get = {1, &key};
    struct bytes packed;
    if (control_pack_get(&get, &client.memory, &packed, NULL) != BVHD_OK || packed.size + 5 > sizeof control)
        return;
    memcpy(control, packed.data, packed.size);
    memcpy(control + packed.size, "\xfa\x3e\x02hi", 5); /* field 1007, two bytes */
    struct raw_frame longer = {.header = {.type = FRAME_GET, .request = ++client.last_request},
                               .control = {control, packed.size + 5}};
    raw_send_frame(&client, &longer);
    struct control_result *result = raw_await(&client, FRAME_RESULT, 2000, &frame) ? raw_result(&client, &frame) : NULL;
    hostile_expect(result && result->error.status == BVHD_NOT_FOUND,
                   "a message with a field of the future is not understood");
    memory_free(&client.memory, result);
    memory_free(&client.memory, (void *)(uintptr_t)packed.data);
    raw_close(&client);
}

/* ---- the log ---- */

enum { CONNECTIONS = 64, FLOOD = 200, LOG_REST_MS = 1100 /* after which an event is logged again */ };

/* An event that clients can cause at will, and how often these have caused it. */
struct flood {
    const char *event;
    uint32_t caused;
};

/* Returns how many lines the log has for the event, or in all for NULL. *ret_events is how many events they tell of. */
static uint32_t lines_in_log(const char *event, uint32_t *ret_events)
{
    char line[4096], name[64];
    uint32_t lines = 0;
    FILE *file = fopen(hostile.service.log, "r");
    snprintf(name, sizeof name, " event=%s ", event ? event : "");
    while (file && fgets(line, sizeof line, file)) {
        const char *suppressed = strstr(line, " suppressed=");
        if (event && !strstr(line, name))
            continue;
        lines++;
        *ret_events += 1 + (suppressed ? (uint32_t)atoi(suppressed + strlen(" suppressed=")) : 0);
    }
    if (file)
        fclose(file);
    return lines;
}

/* A client that sends no frames is turned away: the daemon has no room for it, or says that it breaks the protocol. */
static enum bvhd_status be_turned_away(struct flood *refused, struct flood *failed)
{
    struct raw_client client;
    struct bvhd_error error = {0};
    if (!raw_connect(&client, hostile.service.socket))
        exit(1);
    raw_send(&client, "this is no frame", 16, NULL, 0);
    hostile_expect(raw_await_close(&client, 5000, &error), "a client that sends no frames is not turned away");
    raw_close(&client);
    refused->caused += error.status == BVHD_BUSY;
    failed->caused += error.status == BVHD_CORRUPT;
    return error.status;
}

/* Opens connections until there is no room. Each has begun a frame, so that none has to make room for others. */
static int fill_connections(struct raw_client clients[CONNECTIONS], struct flood *refused)
{
    int count = 0;
    while (count < CONNECTIONS && raw_connect(&clients[count], hostile.service.socket)) {
        if (!raw_try_hello(&clients[count])) {
            raw_close(&clients[count]);
            refused->caused++;
            break;
        }
        raw_send(&clients[count++], "BVHD", 4, NULL, 0);
    }
    return count;
}

static void ask_for_the_unknown(struct raw_client *client, struct flood *unknown)
{
    struct frame frame;
    struct raw_frame request = {.header = {.type = 40, .request = ++client->last_request}};
    raw_send_frame(client, &request);
    unknown->caused += raw_await(client, FRAME_ERROR, 5000, &frame);
}

/* The floods began at the time `begin`, when the log had `before` lines. */
static void expect_few_lines(const struct flood *floods, uint32_t count, uint32_t before, double begin)
{
    uint32_t most = 2 + (uint32_t)((hostile_now() - begin) / 1000), events = 0;
    uint32_t all = lines_in_log(NULL, &events) - before;
    for (uint32_t i = 0; i < count; i++) {
        events = 0;
        uint32_t lines = lines_in_log(floods[i].event, &events), caused = floods[i].caused;
        printf("%s: %u events, %u lines\n", floods[i].event, caused, lines);
        hostile_expect(caused >= FLOOD / 2, "%s was caused only %u times", floods[i].event, caused);
        hostile_expect(lines >= 2 && lines <= most, "%s has %u lines, at most %u", floods[i].event, lines, most);
        hostile_expect(events == caused, "the lines of %s tell of %u events of %u", floods[i].event, events, caused);
    }
    hostile_expect(all <= count * most, "the log has %u more lines, at most %u", all, count * most);
}

/* However many clients break the protocol or are refused, there is a line a second, and none is left uncounted. */
static void check_log(const char *program)
{
    static const char *const options[] = {"--max-connections", "64", NULL};
    static struct raw_client clients[CONNECTIONS];
    struct flood floods[] = {{"connection_refused", 0}, {"connection_failed", 0}, {"request_refused", 0}};
    struct flood later = {NULL, 0}; /* refusals after the line that counts those before it */
    struct raw_client old;
    hostile_begin(&hostile, program, options);
    uint32_t events = 0, before = lines_in_log(NULL, &events);
    double begin = hostile_now();
    if (!raw_connect(&old, hostile.service.socket))
        exit(1);
    raw_hello(&old);
    for (int i = 0; i < FLOOD; i++) {
        be_turned_away(&floods[0], &floods[1]);
        ask_for_the_unknown(&old, &floods[2]);
    }
    int count = fill_connections(clients, &floods[0]);
    for (int i = 0; i < FLOOD; i++)
        be_turned_away(&floods[0], &floods[1]);
    sleep_ms(LOG_REST_MS);
    be_turned_away(&floods[0], &floods[1]);
    for (int i = 0; i < count; i++)
        raw_close(&clients[i]);
    while (be_turned_away(&later, &floods[1]) == BVHD_BUSY)
        ;
    ask_for_the_unknown(&old, &floods[2]);
    raw_close(&old);
    expect_few_lines(floods, sizeof floods / sizeof *floods, before, begin);
    hostile_end(&hostile);
}

int main(int argc, char **argv)
{
    if (argc < 2)
        return 2;
    int failures = run_short_of_descriptors(argv[1]);
    check_log(argv[1]);
    hostile_begin(&hostile, argv[1], NULL);
    check_versions();
    check_future();
    return hostile_end(&hostile) + failures ? 1 : 0;
}
