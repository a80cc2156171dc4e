/* SPDX-License-Identifier: Apache-2.0 */
/*
 * hostile_limits.c - tests a daemon at its limits: without free descriptors, with too many connections, with other
 * versions of the protocol, and with frames of future versions.
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

int main(int argc, char **argv)
{
    if (argc < 2)
        return 2;
    int failures = run_short_of_descriptors(argv[1]);
    hostile_begin(&hostile, argv[1], NULL);
    check_versions();
    check_future();
    return hostile_end(&hostile) + failures ? 1 : 0;
}
