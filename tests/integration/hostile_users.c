/* SPDX-License-Identifier: Apache-2.0 */
/*
 * hostile_users.c - tests that a user with many connections, or one that reads nothing, takes no more than one user's
 * share: of memory for frames, payloads and results, of pools, of the daemon's own memory, of threads.
 *
 *     hostile_users BVHD [CASE...]
 *     hostile_users BVHD figure       100 stalled clients, 2,000 idle connections, 500 busy ones of one user: how long
 *                                     another user's small builds take, beside how long they take on a quiet daemon
 *
 * As root it connects as several users. Otherwise all connections are of one user, and the cases that need more are
 * left out, with a message.
 */
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "tests/support/daemon/hostile.h"

enum { MIB = 1 << 20, GREEDY = 1001, MODEST = 1002, PATIENCE_MS = 60000, SOON_MS = 5000, MOST_CONNECTIONS = 3000 };

static struct hostile hostile;

static void sleep_ms(long ms)
{
    nanosleep(&(struct timespec){ms / 1000, ms % 1000 * 1000000}, NULL);
}

static void connect_as(struct raw_client *client, unsigned uid)
{
    hostile_connect_as(&hostile, client, uid);
}

/* Receives the next RESULT or BUSY. Returns the status, BVHD_BUSY for BUSY, BVHD_UNAVAILABLE for nothing. */
static enum bvhd_status answer(struct raw_client *client, int timeout_ms)
{
    struct frame frame;
    for (;;) {
        if (!raw_receive(client, timeout_ms, &frame, NULL))
            return BVHD_UNAVAILABLE;
        for (int i = 0; i < frame.header.descriptors; i++)
            close(frame.descriptors[i]);
        if (frame.header.type == FRAME_BUSY)
            return BVHD_BUSY;
        if (frame.header.type != FRAME_RESULT)
            continue;
        struct control_result *result = raw_result(client, &frame);
        enum bvhd_status status = result ? result->error.status : BVHD_CORRUPT;
        memory_free(&client->memory, result);
        return status;
    }
}

/* A small build of another user is answered soon. */
static void serves_the_modest(const char *when, uint32_t seed)
{
    struct raw_client client;
    connect_as(&client, MODEST);
    double begin = hostile_now();
    raw_build_boxes(&client, 100, seed, RAW_BOXES_PAYLOAD);
    enum bvhd_status status = answer(&client, PATIENCE_MS);
    double took = hostile_now() - begin;
    hostile_expect(status == BVHD_OK, "%s: another user gets %s", when, bvhd_status_name(status));
    hostile_expect(took < SOON_MS, "%s: another user waits %.0f ms", when, took);
    printf("%s: another user is served in %.1f ms\n", when, took);
    raw_close(&client);
}

/* Builds that fit into the budget one by one fit together, too: each ends, in the worst case one after the other. */
static void case_giants(void)
{
    enum { CLIENTS = 4, EACH = 3, BOXES = 300000 };
    struct raw_client clients[CLIENTS];
    for (uint32_t i = 0; i < CLIENTS; i++)
        connect_as(&clients[i], GREEDY + i);
    for (uint32_t k = 0; k < CLIENTS * EACH; k++)
        raw_build_boxes(&clients[k % CLIENTS], BOXES, k, RAW_BOXES_PAYLOAD);
    for (uint32_t k = 0; k < CLIENTS * EACH; k++) {
        enum bvhd_status status = answer(&clients[k % CLIENTS], PATIENCE_MS);
        hostile_expect(status == BVHD_OK, "build %u: %s", k, bvhd_status_name(status));
    }
    for (int i = 0; i < CLIENTS; i++)
        raw_close(&clients[i]);
}

/* One user fills its share of payloads inside frames, with items that have to wait for memory. */
static void case_inline(void)
{
    enum { CLIENTS = 16, EACH = 40 };
    static struct raw_client clients[CLIENTS];
    for (int i = 0; i < CLIENTS; i++)
        connect_as(&clients[i], GREEDY);
    uint32_t seed = 0;
    for (uint64_t size = FRAME_MAX_INLINE; size >= RAW_BOXES_PAYLOAD; size /= 4) /* smaller ones fill the gaps */
        for (uint32_t k = 0; k < CLIENTS * EACH; k++)
            raw_build_boxes(&clients[k % CLIENTS], 250000, ++seed, size);
    for (uint32_t k = 0; k < 5; k++)
        serves_the_modest("payloads fill frames", k);
    for (int i = 0; i < CLIENTS; i++)
        raw_close(&clients[i]);
}

static bool gets_pool(struct raw_client *client, uint64_t size)
{
    struct control_pool message = {size};
    struct frame frame;
    int descriptor = memfd_create("pool", MFD_CLOEXEC | MFD_ALLOW_SEALING);
    if (descriptor < 0 || ftruncate(descriptor, (off_t)size) ||
        fcntl(descriptor, F_ADD_SEALS, F_SEAL_SHRINK | F_SEAL_GROW))
        exit(1);
    struct raw_frame request = {.header = {.type = FRAME_POOL, .request = ++client->last_request, .descriptors = 1},
                                .descriptors = &descriptor,
                                .descriptor_count = 1};
    control_pack_pool(&message, &client->memory, &request.control, NULL);
    bool answered = raw_send_frame(client, &request) && raw_receive(client, PATIENCE_MS, &frame, NULL);
    memory_free(&client->memory, (void *)(uintptr_t)request.control.data);
    close(descriptor);
    return answered && frame.header.type == FRAME_DONE;
}

/* Idle connections of one user hold pools; another user gets one, too. */
static void case_pools(void)
{
    enum { CLIENTS = 32 };
    static struct raw_client clients[CLIENTS];
    struct raw_client other;
    int count = 0;
    for (int i = 0; i < CLIENTS; i++) {
        connect_as(&clients[i], GREEDY);
        for (uint64_t size = 16 * MIB; size >= MIB; size /= 2)
            if (gets_pool(&clients[i], size)) {
                count++;
                break;
            }
    }
    connect_as(&other, MODEST);
    hostile_expect(gets_pool(&other, 4 * MIB), "another user gets no pool");
    printf("%d connections of one user have a pool\n", count);
    raw_close(&other);
    for (int i = 0; i < CLIENTS; i++)
        raw_close(&clients[i]);
}

/* Sixteen connections of one user ask for large results and read none; a user that reads gets all of its own. */
static void case_unread(void)
{
    enum { CLIENTS = 16, EACH = 8, BOXES = 60000, MEMORY = 128, OWN = 6 };
    struct raw_client clients[CLIENTS], reader;
    for (int i = 0; i < CLIENTS; i++)
        connect_as(&clients[i], GREEDY);
    connect_as(&reader, MODEST);
    for (uint32_t k = 0; k < CLIENTS * EACH; k++)
        raw_build_boxes(&clients[k % CLIENTS], BOXES, k, RAW_BOXES_PAYLOAD);
    for (uint32_t k = 0; k < OWN; k++) {
        raw_build_boxes(&reader, BOXES, 1000 + k, RAW_BOXES_PAYLOAD);
        enum bvhd_status status = answer(&reader, PATIENCE_MS);
        hostile_expect(status == BVHD_OK, "who reads at once gets %s", bvhd_status_name(status));
    }
    double held = (double)hostile_counter(&hostile, "results_held_bytes") / MIB;
    hostile_expect(held < MEMORY / 2, "%.0f MiB of results lie unread", held);
    printf("%.0f MiB of results lie unread\n", held);
    for (int i = 0; i < CLIENTS; i++)
        raw_close(&clients[i]);
    raw_close(&reader);
}

/* Connections ask for counters as fast as the daemon takes the frames, and read none of the answers. */
static void case_answers(void)
{
    enum { CLIENTS = 64, QUESTIONS = 4000, MOST_MIB = 48 };
    static struct raw_client clients[CLIENTS];
    unsigned char bytes[FRAME_HEADER_SIZE];
    struct frame_header header = {.type = FRAME_STATS, .request = 7};
    frame_header_write(&header, bytes);
    uint64_t before = service_process_resident(&hostile.service);
    for (int i = 0; i < CLIENTS; i++)
        connect_as(&clients[i], GREEDY);
    for (int k = 0; k < QUESTIONS; k++)
        for (int i = 0; i < CLIENTS; i++)
            send(clients[i].socket, bytes, sizeof bytes, MSG_DONTWAIT | MSG_NOSIGNAL);
    sleep_ms(200);
    serves_the_modest("answers lie unread", 1);
    uint64_t after = service_process_resident(&hostile.service);
    double grown = after > before ? (double)(after - before) / MIB : 0;
    hostile_expect(grown < MOST_MIB, "unread answers hold %.0f MiB", grown);
    printf("%d connections that read no answers hold %.0f MiB\n", CLIENTS, grown);
    for (int i = 0; i < CLIENTS; i++)
        raw_close(&clients[i]);
}

/* Sends parts of the frame while the daemon reads. Returns whether it has read all of them. */
static bool send_frames(struct raw_client *clients, uint32_t count, const unsigned char *frame, size_t size)
{
    static size_t sent[MOST_CONNECTIONS];
    bool progress = true, complete = true;
    memset(sent, 0, sizeof sent);
    for (int rest = 0; rest < 100; rest = progress ? 0 : rest + 1) {
        progress = false;
        for (uint32_t i = 0; i < count; i++) {
            ssize_t part = send(clients[i].socket, frame + sent[i], size - sent[i], MSG_DONTWAIT | MSG_NOSIGNAL);
            sent[i] += part > 0 ? (size_t)part : 0;
            progress |= part > 0;
        }
        sleep_ms(2);
    }
    for (uint32_t i = 0; i < count; i++)
        complete &= sent[i] == size;
    return complete;
}

/* Many connections of one user each send a frame of the largest size, but for its last byte. */
static void case_frames(void)
{
    enum { CLIENTS = 96, MOST_MIB = 40 };
    static struct raw_client clients[CLIENTS];
    static unsigned char frame[FRAME_HEADER_SIZE + FRAME_MAX_CONTROL];
    struct raw_client same;
    frame_header_write(&(struct frame_header){.type = FRAME_BUILD, .request = 7, .control_size = FRAME_MAX_CONTROL},
                       frame);
    for (int i = 0; i < CLIENTS; i++)
        connect_as(&clients[i], GREEDY);
    connect_as(&same, GREEDY);
    uint64_t before = service_process_resident(&hostile.service);
    hostile_expect(!send_frames(clients, CLIENTS, frame, sizeof frame - 1), "the daemon has read all of the frames");
    serves_the_modest("frames are unfinished", 1);
    raw_build_boxes(&same, 100, 2, RAW_BOXES_PAYLOAD);
    hostile_expect(answer(&same, PATIENCE_MS) == BVHD_OK, "a small frame of the same user waits for large ones");
    uint64_t after = service_process_resident(&hostile.service);
    double grown = after > before ? (double)(after - before) / MIB : 0;
    hostile_expect(grown < MOST_MIB, "unfinished frames hold %.0f MiB", grown);
    printf("unfinished frames of %d connections hold %.0f MiB\n", CLIENTS, grown);
    for (int i = 0; i < CLIENTS; i++)
        raw_close(&clients[i]);
    raw_close(&same);
}

/* Receives frames until one of that type and request comes. Returns how many results of others came before it. */
static uint32_t results_before(struct raw_client *client, enum frame_type type, uint64_t request)
{
    struct frame frame;
    for (uint32_t count = 0;;) {
        bool came = raw_receive(client, PATIENCE_MS, &frame, NULL);
        hostile_expect(came, "no frame of type %d comes for request %d", (int)type, (int)request);
        for (int i = 0; came && i < frame.header.descriptors; i++)
            close(frame.descriptors[i]);
        if (!came || (frame.header.type == type && frame.header.request == request))
            return count;
        count += frame.header.type == FRAME_RESULT;
    }
}

/*
 * Structures are so large that they are built one by one. While the first is built, a user asks for one that has time,
 * and so does another user; then the first user asks for more that are urgent. The shared one is built in the turn of
 * the second user: not before its own turn, but long before all that the first user finds more important.
 */
static void case_shared(void)
{
    enum { BOXES = 120000, SHARED = 2, URGENT = 8 };
    struct raw_client first, second;
    connect_as(&first, GREEDY);
    connect_as(&second, MODEST);
    raw_build_boxes(&first, BOXES, 1, RAW_BOXES_PAYLOAD);
    results_before(&first, FRAME_PREPARED, 1);
    first.priority = PRIORITY_LOW;
    raw_build_boxes(&first, BOXES, SHARED, RAW_BOXES_PAYLOAD);
    first.priority = PRIORITY_NORMAL;
    results_before(&first, FRAME_PREPARED, SHARED);
    raw_build_boxes(&second, BOXES, SHARED, RAW_BOXES_PAYLOAD);
    results_before(&second, FRAME_PREPARED, 1);
    for (uint32_t k = 1; k <= URGENT; k++)
        raw_build_boxes(&first, BOXES, SHARED + k, RAW_BOXES_PAYLOAD);
    uint32_t before = results_before(&first, FRAME_RESULT, SHARED);
    hostile_expect(before <= 1 + URGENT / 2, "%u structures of one user were built before what two users ask for",
                   before);
    printf("%u of %d structures were built before the one that two users ask for\n", before, 1 + URGENT);
    raw_close(&first);
    raw_close(&second);
}

/* ---- the figure ---- */

/* The state of the load, in memory that both processes share. */
struct load {
    atomic_bool runs, pauses;
    atomic_uint under_way, done;
};

/* Keeps `count` connections of one user busy, one build each at a time, while it is not paused. Never returns. */
static void keep_busy(struct load *load, uint32_t count, uint32_t boxes)
{
    static struct raw_client clients[MOST_CONNECTIONS];
    static struct pollfd polled[MOST_CONNECTIONS];
    static bool is_asking[MOST_CONNECTIONS];
    uint32_t seed = 1;
    prctl(PR_SET_PDEATHSIG, SIGKILL);
    for (uint32_t i = 0; i < count; i++) {
        connect_as(&clients[i], GREEDY);
        polled[i] = (struct pollfd){clients[i].socket, POLLIN, 0};
    }
    atomic_store(&load->runs, true);
    for (;;) {
        for (uint32_t i = 0; i < count && !atomic_load(&load->pauses); i++)
            if (!is_asking[i]) {
                raw_build_boxes(&clients[i], boxes, ++seed % 4000000, RAW_BOXES_PAYLOAD);
                is_asking[i] = true;
                atomic_fetch_add(&load->under_way, 1);
            }
        poll(polled, count, 5);
        for (uint32_t i = 0; i < count; i++) {
            if (!(polled[i].revents & POLLIN))
                continue;
            struct frame frame;
            while (raw_receive(&clients[i], 0, &frame, NULL)) {
                for (int k = 0; k < frame.header.descriptors; k++)
                    close(frame.descriptors[k]);
                if (frame.header.type != FRAME_RESULT && frame.header.type != FRAME_BUSY)
                    continue;
                is_asking[i] = false;
                atomic_fetch_sub(&load->under_way, 1);
                atomic_fetch_add(&load->done, frame.header.type == FRAME_RESULT);
            }
        }
    }
}

static int compare(const void *a, const void *b)
{
    double left = *(const double *)a, right = *(const double *)b;
    return left < right ? -1 : left > right;
}

enum { SAMPLES = 200, MOST_BLOCKS = 7 };

/* Measures small builds of the other user. Returns the time that 99 of 100 do not exceed, in milliseconds. */
static double block_p99(struct raw_client *client, uint32_t samples)
{
    static uint32_t seed = 5000000;
    double times[SAMPLES];
    for (uint32_t i = 0; i < samples; i++) {
        double begin = hostile_now();
        raw_build_boxes(client, 1000, ++seed, RAW_BOXES_PAYLOAD);
        enum bvhd_status status = answer(client, PATIENCE_MS);
        times[i] = hostile_now() - begin;
        hostile_expect(status == BVHD_OK, "the other user gets %s", bvhd_status_name(status));
        sleep_ms(1);
    }
    qsort(times, samples, sizeof *times, compare);
    return times[(samples * 99 + 99) / 100 - 1];
}

/* Asks for large results and reads nothing from then on. */
static void stall(struct raw_client *client, uint32_t seed)
{
    connect_as(client, GREEDY + 2);
    for (uint32_t k = 0; k < 4; k++)
        raw_build_boxes(client, 5000, 9000000 + 4 * seed + k, RAW_BOXES_PAYLOAD);
}

struct scale {
    uint32_t stalled, idle, busy, samples, blocks; /* blocks: at most MOST_BLOCKS */
};

static void pause_load(struct load *load, bool pauses)
{
    atomic_store(&load->pauses, pauses);
    while (pauses && atomic_load(&load->under_way) > 0)
        sleep_ms(1);
    if (!pauses)
        sleep_ms(100);
}

/* Returns the memory of the daemon, and of results that clients have not read or hold, in MiB. */
static double memory_in_use(void)
{
    uint64_t held = hostile_counter(&hostile, "results_held_bytes");
    return (double)(service_process_resident(&hostile.service) + held) / MIB;
}

/*
 * Compares the other user's builds on the quiet daemon and beside the load, in turns. Returns both medians, and the
 * most memory that was in use in each half of the time.
 */
static void measure(const struct scale *scale, double ret_medians[2], double ret_memory[2])
{
    static struct raw_client others[MOST_CONNECTIONS];
    struct load *load = mmap(NULL, sizeof *load, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    struct raw_client client;
    double p99[2][MOST_BLOCKS];
    const int blocks = (int)scale->blocks;
    fflush(stdout);
    atomic_store(&load->pauses, true);
    pid_t pid = fork();
    if (pid == 0)
        keep_busy(load, scale->busy, 20000);
    while (!atomic_load(&load->runs))
        sleep_ms(10);
    for (uint32_t i = 0; i < scale->idle; i++)
        connect_as(&others[i], GREEDY + 1);
    for (uint32_t i = 0; i < scale->stalled; i++)
        stall(&others[scale->idle + i], i);
    connect_as(&client, MODEST);
    block_p99(&client, scale->samples / 4 + 1);
    for (int i = 0; i < 2 * blocks; i++) {
        pause_load(load, i % 2 == 0);
        p99[i % 2][i / 2] = block_p99(&client, scale->samples);
        double memory = memory_in_use(), *most = &ret_memory[i >= blocks];
        *most = memory > *most ? memory : *most;
    }
    printf("the load had %u builds done\n", atomic_load(&load->done));
    hostile_expect(atomic_load(&load->done) > 0, "the busy user was not served");
    for (int i = 0; i < 2; i++) {
        qsort(p99[i], scale->blocks, sizeof *p99[i], compare);
        ret_medians[i] = p99[i][blocks / 2];
    }
    kill(pid, SIGKILL);
    waitpid(pid, NULL, 0);
    raw_close(&client);
    for (uint32_t i = 0; i < scale->idle + scale->stalled; i++)
        raw_close(&others[i]);
    munmap(load, sizeof *load);
}

/* At a small scale, on a machine that may be busy, only that everybody is served is tested. */
static void case_crowd(void)
{
    static const struct scale scale = {8, 60, 40, 12, 3};
    double medians[2], memory[2] = {0};
    measure(&scale, medians, memory);
    printf("p99 of another user: quiet %.2f ms, beside a crowd %.2f ms\n", medians[0], medians[1]);
}

static void case_figure(void)
{
    static const struct scale scale = {100, 2000, 500, SAMPLES, MOST_BLOCKS};
    double medians[2], memory[2] = {0};
    measure(&scale, medians, memory);
    double limit = medians[0] * 1.5 > medians[0] + 5 ? medians[0] * 1.5 : medians[0] + 5;
    printf("p99 of another user, median of %u blocks: quiet %.2f ms, beside %u stalled clients, %u idle and %u busy "
           "connections %.2f ms; at most %.2f\n",
           scale.blocks, medians[0], scale.stalled, scale.idle, scale.busy, medians[1], limit);
    printf("memory in use: at most %.0f MiB in the first half, %.0f MiB in the second, of 1024\n", memory[0],
           memory[1]);
    hostile_expect(medians[1] <= limit, "the other user waits too long");
    hostile_expect(memory[0] < 1.05 * 1024 && memory[1] < 1.05 * 1024, "more memory is in use than the budget");
}

static const struct hostile_case {
    const char *name;
    void (*run)(void);
    const char *memory;
    bool needs_users, by_name;
} cases[] = {
    {"giants", case_giants, "128M", false, false},  {"inline", case_inline, "128M", true, false},
    {"pools", case_pools, "128M", true, false},     {"unread", case_unread, "128M", true, false},
    {"answers", case_answers, "64M", false, false}, {"frames", case_frames, "128M", false, false},
    {"shared", case_shared, "64M", true, false},    {"crowd", case_crowd, "256M", false, false},
    {"figure", case_figure, "1G", true, true},
};

static bool is_chosen(const struct hostile_case *one, int argc, char **argv)
{
    bool chosen = argc == 2 && !one->by_name;
    for (int k = 2; k < argc; k++)
        chosen |= !strcmp(argv[k], one->name);
    if (chosen && one->needs_users && !raw_can_be_others()) {
        printf("%s: left out, since only root can connect as several users\n", one->name);
        return false;
    }
    return chosen;
}

int main(int argc, char **argv)
{
    struct rlimit files;
    int failures = 0;
    if (argc < 2)
        return 2;
    signal(SIGPIPE, SIG_IGN);
    if (getrlimit(RLIMIT_NOFILE, &files) == 0) {
        files.rlim_cur = files.rlim_max;
        setrlimit(RLIMIT_NOFILE, &files);
    }
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        if (!is_chosen(&cases[i], argc, argv))
            continue;
        const char *const options[] = {"--workers",         "2",    "--memory", cases[i].memory, "--cache-size", "0",
                                       "--max-connections", "4000", NULL};
        hostile_begin(&hostile, argv[1], options);
        double begin = hostile_now();
        cases[i].run();
        hostile_expect_clean(&hostile, cases[i].name, 10000);
        printf("%-12s %.0f ms\n", cases[i].name, hostile_now() - begin);
        fflush(stdout);
        failures = hostile_end(&hostile);
    }
    return failures ? 1 : 0;
}
