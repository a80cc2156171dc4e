/* SPDX-License-Identifier: Apache-2.0 */
/*
 * hostile_fuzz.c - tests a daemon against processes that send requests with one thing wrong, and that are killed at any
 * moment.
 *
 *     hostile_fuzz BVHD [SECONDS [SEED]]
 *
 * Meanwhile an honest client builds the same meshes again and again. Each time it has to get the same bytes as the
 * first time, and soon. In the end the daemon must hold nothing of any client.
 */
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "tests/support/daemon/hostile.h"
#include "tests/support/daemon/wrong_frames.h"

enum { VANDALS = 5, LINES = 4, FRAMES = 400, MESHES = 4, TRIANGLES = 300, PATIENCE_MS = 20000 };

struct mesh {
    unsigned char *payload;
    uint64_t size;
    unsigned char *blob; /* the bytes of the first result */
    uint64_t blob_size;
};

static struct hostile hostile;
static struct mesh meshes[MESHES];

/* ---- clients that send wrong frames ---- */

static void send_a_while(struct wrong_frames *wrong, uint64_t frames)
{
    struct raw_client lines[LINES];
    bool open[LINES] = {false};
    for (uint64_t i = 0; i < frames; i++) {
        int line = (int)(wrong_below(wrong, LINES));
        if (!open[line])
            open[line] = wrong_connect(wrong, &lines[line], hostile.service.socket);
        if (open[line] && !wrong_send(wrong, &lines[line])) {
            raw_close(&lines[line]);
            open[line] = false;
        }
    }
    for (int i = 0; i < LINES; i++)
        if (open[i])
            raw_close(&lines[i]);
}

static pid_t start_vandal(uint64_t seed)
{
    fflush(stdout);
    pid_t pid = fork();
    if (pid != 0)
        return pid;
    struct wrong_frames wrong;
    prctl(PR_SET_PDEATHSIG, SIGKILL);
    signal(SIGPIPE, SIG_IGN);
    wrong_init(&wrong, seed);
    for (;;)
        send_a_while(&wrong, FRAMES);
}

/* ---- the honest client ---- */

static void keep_or_compare(struct mesh *mesh, const struct bytes *bytes)
{
    if (!mesh->blob) {
        mesh->blob_size = bytes->size;
        mesh->blob = malloc(bytes->size);
        memcpy(mesh->blob, bytes->data, bytes->size);
    } else {
        hostile_expect(bytes->size == mesh->blob_size && !memcmp(bytes->data, mesh->blob, bytes->size),
                       "an honest client got other bytes than before");
    }
}

/* Builds a mesh and checks its bytes. After BUSY it asks again. Returns how many milliseconds it took. */
static double build_honestly(struct mesh *mesh)
{
    struct raw_client client;
    struct frame frame;
    struct control_item item = raw_item(0, mesh->size, SOURCE_INLINE);
    double begin = hostile_now();
    if (!raw_connect(&client, hostile.service.socket)) {
        hostile_expect(false, "the daemon is gone");
        return 0;
    }
    raw_hello(&client);
    bool asks = true, done = false;
    while (!done && hostile_now() - begin < PATIENCE_MS) {
        if (asks)
            raw_build(&client, &item, 1, (struct bytes){mesh->payload, mesh->size}, NULL, NULL, 0);
        asks = false;
        if (!raw_receive(&client, 1000, &frame, NULL))
            continue;
        asks = frame.header.type == FRAME_BUSY;
        done = frame.header.type == FRAME_RESULT;
    }
    struct control_result *result = done ? raw_result(&client, &frame) : NULL;
    hostile_expect(result && result->error.status == BVHD_OK, "an honest build failed: %s",
                   result ? result->error.text : "no answer");
    if (result && result->error.status == BVHD_OK)
        keep_or_compare(mesh, &frame.inline_bytes);
    memory_free(&client.memory, result);
    raw_close(&client);
    return hostile_now() - begin;
}

static void sleep_ms(long ms)
{
    struct timespec wait = {ms / 1000, ms % 1000 * 1000000};
    nanosleep(&wait, NULL);
}

static void kill_vandal(pid_t pid)
{
    kill(pid, SIGKILL);
    waitpid(pid, NULL, 0);
}

int main(int argc, char **argv)
{
    /* The cache is so small that meshes are built again. */
    static const char *const options[] = {"--workers", "2", "--memory", "256M", "--cache-size", "64K", NULL};
    double seconds = argc > 2 ? atof(argv[2]) : 8;
    uint64_t seed = argc > 3 ? strtoull(argv[3], NULL, 10) : 1, killed = 0, builds = 0;
    pid_t vandals[VANDALS];
    if (argc < 2)
        return 2;
    hostile_begin(&hostile, argv[1], options);
    for (uint32_t i = 0; i < MESHES; i++) {
        meshes[i].payload = raw_payload(TRIANGLES, i + 1, &meshes[i].size);
        build_honestly(&meshes[i]);
    }
    for (int i = 0; i < VANDALS; i++)
        vandals[i] = start_vandal(seed++);
    double begin = hostile_now(), longest = 0;
    while (hostile_now() - begin < seconds * 1000 && service_process_runs(&hostile.service)) {
        sleep_ms(20);
        if (builds % 4 == 0) {
            pid_t *victim = &vandals[killed++ % VANDALS];
            kill_vandal(*victim);
            *victim = start_vandal(seed++);
        }
        double ms = build_honestly(&meshes[builds++ % MESHES]);
        longest = ms > longest ? ms : longest;
    }
    for (int i = 0; i < VANDALS; i++)
        kill_vandal(vandals[i]);
    hostile_expect_clean(&hostile, "wrong frames", 10000);
    printf("%llu honest builds, the slowest took %.0f ms; %llu clients killed; the daemon holds %.0f MiB, %llu "
           "protocol errors\n",
           (unsigned long long)builds, longest, (unsigned long long)killed,
           (double)service_process_resident(&hostile.service) / 1048576.0,
           (unsigned long long)hostile_counter(&hostile, "protocol_errors"));
    int failures = hostile_end(&hostile);
    for (uint32_t i = 0; i < MESHES; i++) {
        free(meshes[i].payload);
        free(meshes[i].blob);
    }
    return failures ? 1 : 0;
}
