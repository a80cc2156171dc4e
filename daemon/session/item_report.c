/* SPDX-License-Identifier: Apache-2.0 */
/* item_report.c - what the daemon says of an item that has its result: its latencies, and why it was slow. */
#include "daemon/session/item_internal.h"

#include "builder/build.h"
#include "daemon/system/log.h"
#include "proto/base/clock.h"

/* Counts the stages that the item has passed through. */
static void count(struct service *service, const struct item *item, const struct control_result *result)
{
    const struct item_times *times = &item->times;
    const double total = result->queued_ms + result->prepare_ms + result->build_ms;
    const struct {
        enum latency_stage stage;
        bool passed;
        double ms;
    } stages[] = {
        {LATENCY_waiting, true, result->queued_ms > times->disk_ms ? result->queued_ms - times->disk_ms : 0},
        {LATENCY_disk, times->disk_ms > 0, times->disk_ms},
        {LATENCY_prepare, times->prepare_ms > 0, times->prepare_ms},
        {LATENCY_build, result->origin == ORIGIN_BUILT, times->build_ms},
        {LATENCY_total, true, total},
    };
    uint64_t now = clock_ns();
    for (size_t i = 0; i < sizeof stages / sizeof *stages; i++)
        if (stages[i].passed)
            latency_add(&service->latencies[stages[i].stage], now, (uint64_t)(stages[i].ms * 1e6));
}

static const char *origin_name(const struct control_result *result)
{
    static const char *const names[] = {
        [ORIGIN_NONE] = "none",     [ORIGIN_BUILT] = "built", [ORIGIN_COALESCED] = "coalesced",
        [ORIGIN_MEMORY] = "memory", [ORIGIN_DISK] = "disk",
    };
    return result->origin <= ORIGIN_DISK ? names[result->origin] : "unknown";
}

/* Milliseconds that no stage of the item accounts for: it waited for another item's build, or for the loop. */
static double other_ms(const struct item_times *times, const struct control_result *result)
{
    double other = result->queued_ms - times->memory_ms - times->threads_ms - times->disk_ms - times->repeated_ms;
    return other > 0 ? other : 0;
}

/* Names what took most of the time. */
static const char *reason(const struct item_times *times, const struct control_result *result)
{
    const bool joined = result->origin == ORIGIN_COALESCED;
    const struct {
        double ms;
        const char *text;
    } shares[] = {
        {times->memory_ms, "it waited for memory, or for its client to read earlier results"},
        {times->threads_ms, "it waited for threads"},
        {times->prepare_ms, "its geometry took long to prepare"},
        {times->disk_ms, "its result was long looked for on disk"},
        {times->build_ms, "its build took long"},
        {times->repeated_ms, "its build ran short of memory and was repeated alone"},
        {other_ms(times, result),
         joined ? "it waited for a build that another request had started" : "the daemon was busy with other clients"},
    };
    size_t most = 0;
    for (size_t i = 1; i < sizeof shares / sizeof *shares; i++)
        if (shares[i].ms > shares[most].ms)
            most = i;
    return shares[most].text;
}

static void log_slow(const struct item *item, const struct control_result *result, uint32_t suppressed)
{
    const struct request *request = item->request;
    const struct item_times *times = &item->times;
    const struct summary *built = &result->summary;
    char key[KEY_TEXT_SIZE];
    key_to_text(&item->key, key);
    log_event(LOG_INFO, "slow_build",
              PEER_FORMAT
              " request=%llu item=%u key=%.8s ms=%.1f memory_ms=%.1f threads_ms=%.1f prepare_ms=%.1f disk_ms=%.1f "
              "build_ms=%.1f repeated_ms=%.1f other_ms=%.1f status=%s origin=%s primitives=%llu "
              "quality=%s method=%s waiters=%u why=%s suppressed=%u",
              PEER_VALUES(&request->client->peer), (unsigned long long)request->number, item->index, key,
              result->queued_ms + result->prepare_ms + result->build_ms, times->memory_ms, times->threads_ms,
              times->prepare_ms, times->disk_ms, times->build_ms, times->repeated_ms, other_ms(times, result),
              bvhd_status_name(result->error.status), origin_name(result), (unsigned long long)built->primitives,
              build_quality_name((enum build_quality)built->quality), *built->method ? built->method : "none",
              times->waiters, log_quote(reason(times, result)).text, suppressed);
}

static void log_done(const struct item *item, const struct control_result *result)
{
    const struct request *request = item->request;
    char key[KEY_TEXT_SIZE];
    key_to_text(&item->key, key);
    log_event(LOG_DEBUG, "item_done", PEER_FORMAT " request=%llu item=%u key=%.8s status=%s origin=%s ms=%.3f",
              PEER_VALUES(&request->client->peer), (unsigned long long)request->number, item->index, key,
              bvhd_status_name(result->error.status), origin_name(result),
              result->queued_ms + result->prepare_ms + result->build_ms);
}

void item_report(const struct item *item, const struct control_result *result)
{
    struct service *service = item_service(item);
    const double slow = (double)service->options.slow_ms;
    uint32_t suppressed;
    if (log_writes(LOG_DEBUG))
        log_done(item, result);
    if (result->error.status == BVHD_OK)
        count(service, item, result);
    if (slow > 0 && result->queued_ms + result->prepare_ms + result->build_ms >= slow &&
        result->error.status != BVHD_CANCELLED && log_limit_pass(&service->slow_log, &suppressed))
        log_slow(item, result, suppressed);
}
