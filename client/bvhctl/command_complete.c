/* SPDX-License-Identifier: Apache-2.0 */
#include <stdio.h>
#include <string.h>

#include "client/bvhctl/base/completion.h"
#include "client/bvhctl/commands.h"
#include "client/bvhctl/gpu/gpu.h"

/* Offers the first word of each device's name, or its number where several names begin with that word. */
static void offer_devices(int count, char *const *words)
{
    struct memory memory;
    struct gpu_properties *list;
    uint32_t devices;
    memory_init(&memory, UINT64_MAX);
    if (gpu_list(&memory, &list, &devices, NULL) != BVHD_OK)
        return;
    for (uint32_t i = 0; i < devices; i++) {
        char first[64];
        uint32_t alike = 0;
        snprintf(first, sizeof first, "%.*s", (int)strcspn(list[i].name, " "), list[i].name);
        for (uint32_t k = 0; k < devices; k++)
            alike += strstr(list[k].name, first) != NULL;
        completion_offer(count, words, alike == 1 ? first : list[i].number, list[i].name);
    }
    memory_free(&memory, list);
}

enum exit_code command_complete(int count, char *const *words)
{
    if (completion_print(count, words))
        offer_devices(count, words);
    return report_flush() ? EXIT_DONE : EXIT_FAILED;
}
