/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/trace/tracer_choice.h"

#include <string.h>

#include "client/bvhctl/base/report.h"
#include "client/bvhctl/scene/target_reader.h"

static enum bvhd_status open_device(const char *name, const struct structures *structures, struct memory *memory,
                                    struct tracer_choice *ret_choice, struct bvhd_error *error)
{
    struct tracer_choice choice = {0};
    enum bvhd_status status = gpu_open(name, memory, &choice.gpu, error);
    if (status == BVHD_OK)
        status = target_reader_find(structures->target)->is_native
                     ? tracer_native_create(choice.gpu, structures, memory, &choice.tracer, error)
                     : tracer_portable_create(choice.gpu, structures, memory, &choice.tracer, error);
    if (status != BVHD_OK)
        tracer_choice_finish(&choice);
    else
        *ret_choice = choice;
    return status;
}

/* Whether it is only that the device is not one for these structures. */
static bool is_unfit(enum bvhd_status status)
{
    return status == BVHD_INCOMPATIBLE || status == BVHD_UNSUPPORTED;
}

/* true: one was found. */
static bool choose_device(const struct structures *structures, struct memory *memory, struct tracer_choice *ret_choice)
{
    struct gpu_properties *list;
    uint32_t count;
    if (gpu_list(memory, &list, &count, NULL) != BVHD_OK)
        return false;
    bool is_found = false;
    for (uint32_t i = 0; i < count && !is_found; i++) {
        struct bvhd_error error = {0};
        if (list[i].type == VK_PHYSICAL_DEVICE_TYPE_CPU)
            continue;
        enum bvhd_status status = open_device(list[i].number, structures, memory, ret_choice, &error);
        is_found = status == BVHD_OK;
        if (status != BVHD_OK && !is_unfit(status))
            report_note(list[i].name, "not used: %s: %s", error.where, error.text);
    }
    memory_free(memory, list);
    return is_found;
}

enum bvhd_status tracer_choose(const char *device, const struct structures *structures, const struct parallel *parallel,
                               struct memory *memory, struct tracer_choice *ret_choice, struct bvhd_error *error)
{
    bool is_auto = !strcmp(device, "auto");
    if (is_auto && choose_device(structures, memory, ret_choice))
        return BVHD_OK;
    if (!is_auto && strcmp(device, "cpu"))
        return open_device(device, structures, memory, ret_choice, error);
    struct tracer_choice choice = {.is_cpu = true};
    enum bvhd_status status = tracer_cpu_create(structures, parallel, memory, &choice.tracer, error);
    if (status == BVHD_OK)
        *ret_choice = choice;
    return status;
}

void tracer_choice_finish(struct tracer_choice *choice)
{
    if (!choice)
        return;
    tracer_destroy(choice->tracer);
    gpu_close(choice->gpu);
    *choice = (struct tracer_choice){0};
}
