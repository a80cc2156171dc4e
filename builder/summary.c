/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/summary.h"

#include <assert.h>
#include <inttypes.h>

/* The values of build_stats.method, by their numbers in a summary, to which new ones are appended. */
static const char *const methods[] = {"none",       "ploc",          "binned",     "spatial",
                                      "embree-low", "embree-medium", "embree-high"};

enum { METHODS = sizeof methods / sizeof *methods };

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

/* The numbers of the three fields that are not numbers in struct summary. */
struct named {
    uint32_t target, quality, method;
};

/* All fields in their order. */
static void pass_fields(struct cursor *cursor, struct summary *summary, struct named *named)
{
    struct build_stats *stats = &summary->stats;
    uint64_t *const counts[] = {&stats->primitives, &stats->triangles, &stats->instances, &stats->inactive,
                                &stats->degenerate, &stats->skipped,   &stats->refs,      &summary->peak_bytes};
    for (size_t i = 0; i < sizeof counts / sizeof *counts; i++)
        pass(cursor, counts[i], sizeof *counts[i]);
    pass(cursor, &stats->sah, sizeof stats->sah);
    pass(cursor, &summary->build_ms, sizeof summary->build_ms);
    pass(cursor, &stats->bounds, sizeof stats->bounds);
    pass(cursor, &stats->slabs, sizeof stats->slabs);
    pass(cursor, &stats->depth, sizeof stats->depth);
    pass(cursor, &named->target, sizeof named->target);
    pass(cursor, &named->quality, sizeof named->quality);
    pass(cursor, &named->method, sizeof named->method);
}

void summary_write(const struct summary *summary, unsigned char ret_bytes[SUMMARY_SIZE])
{
    struct summary copy = *summary;
    struct named named = {summary->target, summary->stats.quality, method_number(summary->stats.method)};
    struct cursor cursor = {.to = ret_bytes};
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

enum bvhd_status summary_read(struct bytes bytes, uint64_t size, struct summary *ret_summary, struct bvhd_error *error)
{
    struct summary summary = {.stats.sizes.total = size};
    struct named named;
    struct cursor cursor = {.from = bytes.data};
    if (bytes.size != SUMMARY_SIZE)
        return bvhd_error_set(error, BVHD_CORRUPT, "summary", "%" PRIu64 " bytes instead of %d", bytes.size,
                              SUMMARY_SIZE);
    pass_fields(&cursor, &summary, &named);
    if (check(&named, error) != BVHD_OK)
        return error->status;
    summary.target = (enum target)named.target;
    summary.stats.quality = (enum build_quality)named.quality;
    summary.stats.method = methods[named.method];
    *ret_summary = summary;
    return BVHD_OK;
}
