/* SPDX-License-Identifier: Apache-2.0 */
/* micromap_read.c - says what is in a micromap. */
#include <bvhd/bvhd_micromap.h>

#include "builder/format/portable_micromap.h"
#include "client/argument.h"

enum { LEVELS = MICRO_LEVEL_MAX + 1, FORMATS = 2, DATA_ALIGNMENT = 16 };

_Static_assert(BVHD_MICROMAP_MAX_USAGES == LEVELS * FORMATS && (int)BVHD_MICROMAP_STATES == (int)MICRO_STATES,
               "one usage count for each level and format");

/* How many triangles have each level and format. */
struct histogram {
    uint32_t counts[FORMATS][LEVELS];
};

static void count_triangle(const struct micromap_triangle *triangle, struct histogram *histogram)
{
    histogram->counts[triangle->format - 1][triangle->level]++;
}

/* Lists those that there are; returns their number. */
static uint32_t list_usages(const struct histogram *histogram, VkMicromapUsageEXT ret_usages[BVHD_MICROMAP_MAX_USAGES])
{
    uint32_t number = 0;
    for (uint32_t format = 0; format < FORMATS; format++)
        for (uint32_t level = 0; level < LEVELS; level++)
            if (histogram->counts[format][level] > 0)
                ret_usages[number++] = (VkMicromapUsageEXT){histogram->counts[format][level], level, format + 1};
    return number;
}

static struct histogram count_all(const struct portable_micromap_view *view)
{
    struct histogram histogram = {0};
    for (uint32_t i = 0; i < view->header->triangle_count; i++)
        count_triangle(&view->triangles[i], &histogram);
    return histogram;
}

/* Special indices name no triangle. */
static struct histogram count_named(const struct portable_micromap_view *view)
{
    struct histogram histogram = {0};
    for (uint32_t i = 0; i < view->header->index_count; i++)
        if (view->indices[i] < view->header->triangle_count)
            count_triangle(&view->triangles[view->indices[i]], &histogram);
    return histogram;
}

static enum bvhd_status check_arguments(const void *data, const struct bvhd_micromap *micromap,
                                        struct bvhd_error *error)
{
    enum bvhd_status status = ARGUMENTS_CHECK(error, {data, "data"}, {micromap, "ret_micromap"});
    if (status == BVHD_OK)
        status =
            argument_check_size(micromap, sizeof *micromap, sizeof *micromap, "ret_micromap", "bvhd_micromap", error);
    if (status == BVHD_OK && (uintptr_t)data % DATA_ALIGNMENT != 0)
        status = bvhd_error_set(error, BVHD_INVALID, "data", "it is not aligned to %d bytes", DATA_ALIGNMENT);
    return status;
}

enum bvhd_status bvhd_micromap_read(const void *data, uint64_t size, struct bvhd_micromap *ret_micromap,
                                    struct bvhd_error *ret_error)
{
    struct portable_micromap_view view;
    enum bvhd_status status = check_arguments(data, ret_micromap, ret_error);
    if (status == BVHD_OK)
        status = portable_micromap_open((struct bytes){data, size}, &view, ret_error);
    if (status != BVHD_OK)
        return status;
    const struct histogram all = count_all(&view), named = count_named(&view);
    ret_micromap->triangle_count = view.header->triangle_count;
    ret_micromap->index_count = view.header->index_count;
    ret_micromap->indices = view.header->index_count > 0 ? view.indices : NULL;
    ret_micromap->states_size = view.header->states_size;
    memcpy(ret_micromap->baked, view.header->baked, sizeof ret_micromap->baked);
    ret_micromap->usage_count = list_usages(&all, ret_micromap->usages);
    ret_micromap->named_usage_count = list_usages(&named, ret_micromap->named_usages);
    return BVHD_OK;
}
