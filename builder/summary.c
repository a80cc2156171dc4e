/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/summary.h"

#include <assert.h>
#include <inttypes.h>
#include <stdio.h>

/* The values of summary.method, by their numbers in a summary, to which new ones are appended. */
static const char *const methods[] = {"none",       "ploc",          "binned",     "spatial",
                                      "embree-low", "embree-medium", "embree-high"};

enum { METHODS = sizeof methods / sizeof *methods };

static void set_method(struct summary *summary, const char *method)
{
    snprintf(summary->method, sizeof summary->method, "%s", method);
}

struct summary summary_of(const struct build_stats *stats, enum target target)
{
    struct summary summary = {
        .primitives = stats->primitives,
        .triangles = stats->triangles,
        .instances = stats->instances,
        .inactive = stats->inactive,
        .degenerate = stats->degenerate,
        .skipped = stats->skipped,
        .refs = stats->refs,
        .depth = stats->depth,
        .target = target,
        .quality = stats->quality,
        .sah = stats->sah,
        .bounds = stats->bounds,
        .slabs = stats->slabs,
    };
    set_method(&summary, stats->method);
    return summary;
}

static uint32_t method_number(const char *method)
{
    uint32_t number = 0;
    while (strcmp(methods[number], method) != 0) {
        number++;
        assert(number < METHODS);
    }
    return number;
}

/* The place of the next field. A pass over the fields either writes them all or reads them all. */
struct cursor {
    unsigned char *to; /* NULL: reads */
    const unsigned char *from;
};

static void pass(struct cursor *cursor, void *field, uint64_t size)
{
    if (cursor->to) {
        memcpy(cursor->to, field, size);
        cursor->to += size;
    } else {
        memcpy(field, cursor->from, size);
        cursor->from += size;
    }
}

/* The numbers of the three fields that may have few values. */
struct named {
    uint32_t target, quality, method;
};

/* All fields in their order. */
static void pass_fields(struct cursor *cursor, struct summary *summary, struct named *named)
{
    uint64_t *const counts[] = {&summary->primitives, &summary->triangles, &summary->instances, &summary->inactive,
                                &summary->degenerate, &summary->skipped,   &summary->refs,      &summary->peak_bytes};
    for (size_t i = 0; i < sizeof counts / sizeof *counts; i++)
        pass(cursor, counts[i], sizeof *counts[i]);
    pass(cursor, &summary->sah, sizeof summary->sah);
    pass(cursor, &summary->build_ms, sizeof summary->build_ms);
    pass(cursor, &summary->bounds, sizeof summary->bounds);
    pass(cursor, &summary->slabs, sizeof summary->slabs);
    pass(cursor, &summary->depth, sizeof summary->depth);
    pass(cursor, &named->target, sizeof named->target);
    pass(cursor, &named->quality, sizeof named->quality);
    pass(cursor, &named->method, sizeof named->method);
}

void summary_write(const struct summary *summary, unsigned char ret_bytes[SUMMARY_SIZE])
{
    struct summary copy = *summary;
    struct named named = {summary->target, summary->quality, method_number(summary->method)};
    struct cursor cursor = {.to = ret_bytes};
    assert(summary->refits == 0);
    pass_fields(&cursor, &copy, &named);
    assert(cursor.to == ret_bytes + SUMMARY_SIZE);
}

static enum bvhd_status check(const struct named *named, struct bvhd_error *error)
{
    if (!layout_find((enum target)named->target))
        return bvhd_error_set(error, BVHD_CORRUPT, "summary.target", "%" PRIu32 " is no target", named->target);
    if (named->quality < QUALITY_FAST || named->quality > QUALITY_HIGH)
        return bvhd_error_set(error, BVHD_CORRUPT, "summary.quality", "%" PRIu32 " is no quality", named->quality);
    if (named->method >= METHODS)
        return bvhd_error_set(error, BVHD_CORRUPT, "summary.method", "%" PRIu32 " is no method", named->method);
    return BVHD_OK;
}

enum bvhd_status summary_read(struct bytes bytes, struct summary *ret_summary, struct bvhd_error *error)
{
    struct summary summary = {0};
    struct named named;
    struct cursor cursor = {.from = bytes.data};
    if (bytes.size != SUMMARY_SIZE)
        return bvhd_error_set(error, BVHD_CORRUPT, "summary", "%" PRIu64 " bytes instead of %d", bytes.size,
                              SUMMARY_SIZE);
    pass_fields(&cursor, &summary, &named);
    if (check(&named, error) != BVHD_OK)
        return error->status;
    summary.target = named.target;
    summary.quality = named.quality;
    set_method(&summary, methods[named.method]);
    *ret_summary = summary;
    return BVHD_OK;
}
