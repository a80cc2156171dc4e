/* SPDX-License-Identifier: Apache-2.0 */
#include <stdio.h>

#include "client/bvhctl/commands.h"
#include "client/bvhctl/gpu/gpu.h"
#include "client/bvhctl/gpu/probe_source.h"

/* A device, and the target that it loads natively, according to a probe. */
struct found {
    struct gpu_properties properties;
    const char *native; /* the target's name; NULL: none */
    struct bvhd_error why_not; /* without a target: the reason */
};

struct device_list {
    struct memory memory;
    struct found *devices;
    uint32_t count;
    struct bvhd_error missing; /* the reason if the list is empty */
};

static const char *kind_of(VkPhysicalDeviceType type)
{
    switch (type) {
    case VK_PHYSICAL_DEVICE_TYPE_DISCRETE_GPU:
        return "discrete";
    case VK_PHYSICAL_DEVICE_TYPE_INTEGRATED_GPU:
        return "integrated";
    case VK_PHYSICAL_DEVICE_TYPE_VIRTUAL_GPU:
        return "virtual";
    case VK_PHYSICAL_DEVICE_TYPE_CPU:
        return "cpu";
    default:
        return "other";
    }
}

static void probe(struct found *found, struct memory *memory)
{
    struct gpu *gpu;
    struct bvhd_format format;
    if (gpu_open(found->properties.number, memory, &gpu, &found->why_not) != BVHD_OK)
        return;
    if (probe_source_ask(gpu, &format, &found->why_not) == BVHD_OK)
        found->native = bvhd_target_name(format.target);
    gpu_close(gpu);
}

/* An empty list is not an error. */
static enum bvhd_status find(struct device_list *list, struct bvhd_error *error)
{
    struct gpu_properties *properties = NULL;
    uint32_t count = 0;
    enum bvhd_status status = gpu_list(&list->memory, &properties, &count, &list->missing);
    if (status != BVHD_OK) {
        *error = list->missing;
        return status == BVHD_UNAVAILABLE ? BVHD_OK : status;
    }
    list->devices = memory_array(&list->memory, count, sizeof *list->devices);
    if (!list->devices)
        status = bvhd_error_no_memory(error, "devices", "no memory for the list of devices");
    for (uint32_t i = 0; i < count && status == BVHD_OK; i++) {
        list->devices[i] = (struct found){.properties = properties[i]};
        probe(&list->devices[i], &list->memory);
    }
    list->count = status != BVHD_OK ? 0 : count;
    memory_free(&list->memory, properties);
    return status;
}

static void write_device(const struct found *found, struct json *json)
{
    const struct gpu_properties *properties = &found->properties;
    char version[32];
    snprintf(version, sizeof version, "%u.%u", VK_API_VERSION_MAJOR(properties->api_version),
             VK_API_VERSION_MINOR(properties->api_version));
    json_object(json, NULL);
    json_text(json, "name", properties->name);
    json_text(json, "number", properties->number);
    json_text(json, "kind", kind_of(properties->type));
    json_text(json, "driver", properties->driver);
    json_text(json, "vulkan", version);
    json_integer(json, "memory", properties->memory);
    json_array(json, "targets");
    json_text(json, NULL, "portable");
    if (found->native)
        json_text(json, NULL, found->native);
    json_array_end(json);
    if (found->native)
        json_null(json, "not_native");
    else
        json_text(json, "not_native", found->why_not.text);
    json_bool(json, "acceleration_structures", properties->has_acceleration_structure);
    json_bool(json, "ray_queries", properties->has_ray_query);
    json_bool(json, "ray_pipelines", properties->has_ray_pipeline);
    json_bool(json, "buffer_addresses", properties->has_buffer_address);
    json_integer(json, "subgroup_size", properties->subgroup_size);
    json_object_end(json);
}

static bool print_json(struct device_list *list)
{
    struct json json;
    json_init(&json, &list->memory, false);
    json_object(&json, NULL);
    json_integer(&json, "schema", 1);
    json_array(&json, "devices");
    for (uint32_t i = 0; i < list->count; i++)
        write_device(&list->devices[i], &json);
    json_array_end(&json);
    if (list->count)
        json_null(&json, "missing");
    else
        json_text(&json, "missing", list->missing.text);
    json_object_end(&json);
    bool ok = report_print(&json);
    json_finish(&json);
    return ok;
}

static void print_device(const struct found *found)
{
    const struct gpu_properties *properties = &found->properties;
    printf("%s\n", properties->name);
    printf("  number    %s\n", properties->number);
    printf("  kind      %s, %.1f GB, Vulkan %u.%u\n", kind_of(properties->type), (double)properties->memory / 1e9,
           VK_API_VERSION_MAJOR(properties->api_version), VK_API_VERSION_MINOR(properties->api_version));
    printf("  driver    %s\n", properties->driver);
    if (found->native)
        printf("  loads     portable, %s\n", found->native);
    else
        printf("  loads     portable (nothing natively: %s)\n", found->why_not.text);
    printf("  rays      queries: %s; ray-tracing pipelines: %s\n", properties->has_ray_query ? "yes" : "no",
           properties->has_ray_pipeline ? "yes" : "no");
}

static bool print_text(const struct device_list *list)
{
    if (!list->count)
        printf("no Vulkan device: %s\n", list->missing.text);
    for (uint32_t i = 0; i < list->count; i++)
        print_device(&list->devices[i]);
    return report_flush();
}

enum exit_code command_devices(const struct options *options)
{
    struct device_list list = {.count = 0};
    struct bvhd_error error;
    memory_init(&list.memory, UINT64_MAX);
    enum exit_code code;
    if (find(&list, &error) != BVHD_OK)
        code = report_failure(options->json, "devices", &error);
    else
        code = (options->json ? print_json(&list) : print_text(&list)) ? EXIT_DONE : EXIT_FAILED;
    memory_free(&list.memory, list.devices);
    return code;
}
