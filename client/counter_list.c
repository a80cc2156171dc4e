/* SPDX-License-Identifier: Apache-2.0 */
#include "client/counter_list.h"

#include "client/library.h"

struct bvhd_counters {
    struct control_counters *message;
};

struct bvhd_counters *counter_list_create(struct control_counters *message)
{
    struct bvhd_counters *counters = memory_alloc(&library_memory, sizeof *counters);
    if (counters)
        counters->message = message;
    else
        memory_free(&library_memory, message);
    return counters;
}

uint32_t bvhd_counters_count(const struct bvhd_counters *counters)
{
    return counters ? counters->message->count : 0;
}

const char *bvhd_counters_name(const struct bvhd_counters *counters, uint32_t index)
{
    return counters && index < counters->message->count ? counters->message->counters[index].name : NULL;
}

uint64_t bvhd_counters_value(const struct bvhd_counters *counters, uint32_t index)
{
    return counters && index < counters->message->count ? counters->message->counters[index].value : 0;
}

const char *bvhd_counters_version(const struct bvhd_counters *counters)
{
    return counters ? counters->message->version : "";
}

void bvhd_counters_destroy(struct bvhd_counters *counters)
{
    if (!counters)
        return;
    memory_free(&library_memory, counters->message);
    memory_free(&library_memory, counters);
}
