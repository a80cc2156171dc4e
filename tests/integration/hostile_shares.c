/* SPDX-License-Identifier: Apache-2.0 */
/*
 * hostile_shares.c - tests that clients which demand much, or leave things unread, do not take the share of others, and
 * that memory stays within bounds.
 *
 *     hostile_shares BVHD [CASE...]
 */
#include <fcntl.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "tests/support/daemon/hostile.h"

/*
 * ThreadSanitizer makes a thread that others wake all the time about twenty times as slow, and AddressSanitizer one
 * that parses frames about five times.
 */
#if defined(__has_feature)
#if __has_feature(thread_sanitizer)
enum { SLOWNESS = 20 };
#elif __has_feature(address_sanitizer)
enum { SLOWNESS = 5 };
#else
enum { SLOWNESS = 1 };
#endif
#elif defined(__SANITIZE_THREAD__)
enum { SLOWNESS = 20 };
#elif defined(__SANITIZE_ADDRESS__)
enum { SLOWNESS = 5 };
#else
enum { SLOWNESS = 1 };
#endif

enum {
    MIB = 1 << 20,
    MEMORY = 256,
    UNREAD_MEMORY = 64, /* MiB: three eighths of the budget of 128 for the user, plus what was in flight */
    SOON_MS = 1000,
    UNFINISHED = 300,
    SLOW_READERS = 4,
    REQUESTS = 56,
    CROWD = 17
};
enum { FLOODS = 64, ROWS = 1000000, PING_MEAN_MS = 30 * SLOWNESS, PING_WORST_MS = 1000 * SLOWNESS, FREE_MS = 250 };

static struct hostile hostile;

static void sleep_ms(long ms)
{
    struct timespec wait = {ms / 1000, ms % 1000 * 1000000};
    nanosleep(&wait, NULL);
}

static void connect_well(struct raw_client *client)
{
    hostile_connect_as(&hostile, client, geteuid());
}

static double counter_mib(const char *name)
{
    return (double)hostile_counter(&hostile, name) / MIB;
}

/* Requests `count` boxes with a payload of 120 bytes, `times` times in one request. */
static void ask_for_boxes(struct raw_client *client, uint32_t count, uint32_t seed, uint32_t times)
{
    unsigned char payload[RAW_BOXES_PAYLOAD];
    raw_boxes_write(count, seed, payload);
    static struct control_item items[CONTROL_MAX_ITEMS];
    for (uint32_t i = 0; i < times; i++)
        items[i] = raw_item(0, sizeof payload, SOURCE_INLINE);
    raw_build(client, items, times, (struct bytes){payload, sizeof payload}, NULL, NULL, 0);
}

/* Waits until the counter is at least `least`. Returns false after 20 s. */
static bool wait_for(const char *counter, uint64_t least)
{
    double begin = hostile_now();
    while (hostile_counter(&hostile, counter) < least)
        if (hostile_now() - begin > 20000)
            return false;
    return true;
}

static enum bvhd_status status_of(struct raw_client *client, int timeout_ms)
{
    struct frame frame;
    struct control_result *result =
        raw_await(client, FRAME_RESULT, timeout_ms, &frame) ? raw_result(client, &frame) : NULL;
    enum bvhd_status status = result ? result->error.status : BVHD_UNAVAILABLE;
    for (int i = 0; result && i < frame.header.descriptors; i++)
        close(frame.descriptors[i]);
    memory_free(&client->memory, result);
    return status;
}

/*
 * A request of 120 bytes needs nearly all memory, so it has to wait for a slow build to end. No other client has to
 * wait.
 */
static void case_giants(void)
{
    struct raw_client builder, giant;
    connect_well(&builder);
    connect_well(&giant);
    ask_for_boxes(&builder, 700000, 1, 1);
    hostile_expect(wait_for("builds_running", 1), "no build runs");
    ask_for_boxes(&giant, 3500000, 1, 1);
    hostile_expect(wait_for("prepares_waiting", 1) || hostile_counter(&hostile, "builds_running") == 0,
                   "the giant does not wait");
    double longest = 0;
    uint32_t beside = 0;
    while (hostile_counter(&hostile, "prepares_waiting") > 0) {
        double ms = hostile_serves(&hostile, "a giant waits", SOON_MS);
        longest = ms > longest ? ms : longest;
        beside++;
    }
    hostile_expect(beside > 1, "nobody was served while the giant waited");
    hostile_expect(status_of(&builder, 60000) == BVHD_OK, "what the giant waited for has failed");
    printf("%u others were served while a giant waited, each within %.0f ms\n", beside, longest);
    raw_close(&builder);
    raw_close(&giant);
}

/* Each client sends the header of a frame, and a few bytes more. */
static void case_unfinished(void)
{
    static struct raw_client clients[UNFINISHED];
    unsigned char bytes[FRAME_HEADER_SIZE];
    struct frame_header header = {
        .type = FRAME_GET, .control_size = FRAME_MAX_CONTROL, .inline_size = FRAME_MAX_INLINE, .request = 1};
    frame_header_write(&header, bytes);
    for (int i = 0; i < UNFINISHED; i++) {
        connect_well(&clients[i]);
        raw_send(&clients[i], bytes, sizeof bytes, NULL, 0);
    }
    sleep_ms(100);
    for (int i = 0; i < UNFINISHED; i++)
        raw_send(&clients[i], "more", 4, NULL, 0);
    sleep_ms(100);
    hostile_expect(counter_mib("memory_live") < 16, "%d unfinished frames hold %.0f MiB of %d", UNFINISHED,
                   counter_mib("memory_live"), MEMORY);
    struct raw_client client;
    connect_well(&client);
    ask_for_boxes(&client, 200000, 2, 1);
    hostile_expect(status_of(&client, 20000) == BVHD_OK, "a build fails beside unfinished frames");
    raw_close(&client);
    for (int i = 0; i < UNFINISHED; i++)
        raw_close(&clients[i]);
}

/* The queue is filled with as many items as it takes of one user, none of which is done soon. */
static void case_crowd(void)
{
    static struct raw_client clients[CROWD];
    for (uint32_t i = 0; i < CROWD; i++) {
        connect_well(&clients[i]);
        ask_for_boxes(&clients[i], 300000, 1000 + i, 1024);
    }
    hostile_expect(wait_for("queue_depth", 11000), "the queue is not full");
    for (int i = 0; i < 10; i++)
        hostile_serves(&hostile, "the queue is full", SOON_MS);
    printf("%llu items are under way\n", (unsigned long long)hostile_counter(&hostile, "queue_depth"));
    for (int i = 0; i < CROWD; i++)
        raw_close(&clients[i]);
}

/* Returns how many jobs the workers have, and how many builds will become some. */
static uint64_t jobs_left(void)
{
    return hostile_counter(&hostile, "jobs_running") + hostile_counter(&hostile, "jobs_queued") +
           hostile_counter(&hostile, "builds_waiting");
}

/* Clients do not read their results of 2.6 MiB each. */
static void case_unread(void)
{
    struct raw_client clients[SLOW_READERS];
    uint32_t asked = 0;
    for (int i = 0; i < SLOW_READERS; i++)
        connect_well(&clients[i]);
    for (int k = 0; k < REQUESTS; k++)
        ask_for_boxes(&clients[k % SLOW_READERS], 100000, 10 + ++asked, 1);
    wait_for("prepares_waiting", 1);
    for (double begin = hostile_now(); jobs_left() > 0 && hostile_now() - begin < 60000;)
        sleep_ms(200);
    double unread = counter_mib("results_held_bytes");
    hostile_expect(unread > 0 && unread < UNREAD_MEMORY, "%.0f MiB of results lie unread", unread);
    hostile_expect(hostile_counter(&hostile, "prepares_waiting") > 0, "everything was built: nothing is shown");
    hostile_serves(&hostile, "results lie unread", SOON_MS);
    printf("%.0f MiB of results lie unread, %llu wait for their clients to read\n", unread,
           (unsigned long long)hostile_counter(&hostile, "prepares_waiting"));
    for (uint32_t i = 0; i < asked; i++) {
        enum bvhd_status status = status_of(&clients[i % SLOW_READERS], 20000);
        hostile_expect(status == BVHD_OK, "who reads again gets for request %u: %s", i, bvhd_status_name(status));
    }
    for (int i = 0; i < SLOW_READERS; i++)
        raw_close(&clients[i]);
}

/* Measures for `ms` milliseconds how long the daemon's event loop takes to answer a PING. */
static void ping_for(double ms, const char *when)
{
    struct raw_client client;
    connect_well(&client);
    double begin = hostile_now(), sum = 0, worst = 0;
    int count = 0;
    for (bool answered = true; answered && hostile_now() - begin < ms; count++) {
        struct raw_frame ping = {.header = {.type = FRAME_PING, .request = ++client.last_request}};
        struct frame pong;
        double sent = hostile_now();
        answered = raw_send_frame(&client, &ping) && raw_await(&client, FRAME_PONG, 20000, &pong);
        double took = hostile_now() - sent;
        hostile_expect(answered, "%s: no PONG", when);
        sum += took;
        worst = took > worst ? took : worst;
        sleep_ms(2);
    }
    hostile_expect(sum <= PING_MEAN_MS * count && worst <= PING_WORST_MS, "%s: PONG after %.1f ms, worst %.0f ms", when,
                   sum / count, worst);
    printf("%s: PONG after %.1f ms, worst %.1f ms\n", when, sum / count, worst);
    raw_close(&client);
}

static void cancel(struct raw_client *client)
{
    struct raw_frame frame = {.header = {.type = FRAME_CANCEL, .request = client->last_request}};
    raw_send_frame(client, &frame);
}

static void connect_impatiently(struct raw_client *client)
{
    static const struct timeval patience = {.tv_usec = 20000};
    connect_well(client);
    setsockopt(client->socket, SOL_SOCKET, SO_SNDTIMEO, &patience, sizeof patience);
}

/*
 * Sends 1,024 items at a time over many connections, cancels half of them at once, and replaces some connections. Never
 * returns.
 */
static void flood(void)
{
    static struct raw_client clients[FLOODS];
    static char scrap[65536];
    prctl(PR_SET_PDEATHSIG, SIGKILL);
    signal(SIGPIPE, SIG_IGN);
    for (int i = 0; i < FLOODS; i++)
        connect_impatiently(&clients[i]);
    for (uint32_t seed = 1;; seed++) {
        struct raw_client *client = &clients[seed % FLOODS];
        ask_for_boxes(client, 1, seed, 1024);
        if (seed % 2)
            cancel(client);
        while (recv(client->socket, scrap, sizeof scrap, MSG_DONTWAIT) > 0)
            ;
        if (seed % 15 == 0) {
            raw_close(client);
            connect_impatiently(client);
        }
    }
}

static void case_floods(void)
{
    ping_for(500, "nobody else");
    fflush(stdout);
    pid_t pid = fork();
    if (pid == 0)
        flood();
    hostile_expect(pid > 0, "no second process");
    sleep_ms(500);
    ping_for(4000, "floods");
    if (pid > 0) {
        kill(pid, SIGKILL);
        waitpid(pid, NULL, 0);
    }
}

static int make_rows(uint64_t *ret_size)
{
    uint64_t box = (uint64_t)ROWS * ROWS_GEOMETRY_LEAST, box_size = 6 * sizeof(float), size = box + box_size;
    int descriptor = memfd_create("rows", MFD_ALLOW_SEALING);
    if (ftruncate(descriptor, (off_t)size) != 0)
        return -1;
    const struct geometry_row row = {.type = GEOMETRY_AABBS, .primitive_count = 1, .data = {box, box_size}};
    unsigned char *rows = mmap(NULL, size, PROT_READ | PROT_WRITE, MAP_SHARED, descriptor, 0);
    for (uint32_t i = 0; i < ROWS; i++)
        memcpy(rows + (uint64_t)i * ROWS_GEOMETRY_LEAST, &row, ROWS_GEOMETRY_LEAST);
    memset(rows + box, 0, box_size); /* a point, which is a valid box */
    munmap(rows, size);
    fcntl(descriptor, F_ADD_SEALS, F_SEAL_SHRINK | F_SEAL_GROW | F_SEAL_WRITE | F_SEAL_SEAL);
    *ret_size = size;
    return descriptor;
}

/* One item has a million geometries. When it is cancelled at any moment, its thread is soon free. */
static void case_rows(void)
{
    struct raw_client client;
    uint64_t size;
    int descriptor = make_rows(&size);
    double sum = 0, worst = 0;
    enum { TIMES = 10 };
    connect_well(&client);
    for (int i = 0; i < TIMES; i++) {
        struct control_item item = raw_item(0, size, SOURCE_MEMFD);
        item.geometry_count = ROWS;
        raw_build(&client, &item, 1, (struct bytes){NULL, 0}, &descriptor, &size, 1);
        sleep_ms(5 + 25 * i);
        cancel(&client);
        double begin = hostile_now();
        enum bvhd_status status = status_of(&client, 20000);
        hostile_expect(status == BVHD_CANCELLED || status == BVHD_OK, "rows: %s", bvhd_status_name(status));
        while (hostile_counter(&hostile, "jobs_running") > 0 && hostile_now() - begin < 20000)
            ;
        double took = hostile_now() - begin;
        sum += took;
        worst = took > worst ? took : worst;
    }
    hostile_expect(sum <= TIMES * FREE_MS, "the thread is free %.0f ms after cancelling rows", sum / TIMES);
    printf("the thread is free %.1f ms after cancelling rows, worst %.1f ms\n", sum / TIMES, worst);
    close(descriptor);
    raw_close(&client);
}

static const struct {
    const char *name;
    void (*run)(void);
    const char *memory;
} cases[] = {{"giants", case_giants, "256M"}, {"unfinished", case_unfinished, "256M"}, {"crowd", case_crowd, "256M"},
             {"unread", case_unread, "128M"}, {"floods", case_floods, "1G"},           {"rows", case_rows, "3G"}};

int main(int argc, char **argv)
{
    int failures = 0;
    if (argc < 2)
        return 2;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        bool chosen = argc == 2;
        for (int k = 2; k < argc; k++)
            chosen |= !strcmp(argv[k], cases[i].name);
        if (!chosen)
            continue;
        const char *const options[] = {"--workers", "2", "--memory", cases[i].memory, "--cache-size", "16M", NULL};
        hostile_begin(&hostile, argv[1], options);
        double begin = hostile_now();
        cases[i].run();
        hostile.descriptors_base += hostile_counter(&hostile, "cache_entries"); /* each entry may hold a descriptor */
        hostile_expect_clean(&hostile, cases[i].name, 5000);
        printf("%-12s %.0f ms\n", cases[i].name, hostile_now() - begin);
        fflush(stdout);
        failures = hostile_end(&hostile);
    }
    return failures ? 1 : 0;
}
