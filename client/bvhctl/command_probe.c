/* SPDX-License-Identifier: Apache-2.0 */
#include <stdio.h>

#include "client/bvhctl/commands.h"
#include "client/bvhctl/base/files.h"
#include "client/bvhctl/gpu/gpu.h"

/* The state of `bvhctl probe`. */
struct probe_command {
    const struct options *options;
    struct memory memory;
    struct gpu *gpu;
    void *probe;
    uint64_t size;
    const char *target; /* the name of the target that the device loads; NULL: none that is known */
    struct bvhd_error why_not;
};

/* It is not an error if no target is known: the probe is written anyway, because a newer version may know one. */
static enum bvhd_status match(struct probe_command *call, struct bvhd_error *error)
{
    struct bvhd_format format = {.struct_size = sizeof format};
    enum bvhd_status status = bvhd_format_from_probe(call->probe, call->size, &format, &call->why_not);
    if (status == BVHD_OK)
        call->target = bvhd_target_name(format.target);
    if (status != BVHD_OK && status != BVHD_UNSUPPORTED)
        *error = call->why_not;
    return status == BVHD_UNSUPPORTED ? BVHD_OK : status;
}

static enum bvhd_status run(struct probe_command *call, struct bvhd_error *error)
{
    const struct options *options = call->options;
    enum bvhd_status status = gpu_open(options->device ? options->device : "auto", &call->memory, &call->gpu, error);
    if (status == BVHD_OK)
        status = bvhd_vulkan_probe(call->gpu->library, &call->gpu->queue, &call->probe, &call->size, error);
    if (status == BVHD_OK)
        status = match(call, error);
    if (status == BVHD_OK)
        status = files_write(options->output, (struct bytes){call->probe, call->size}, &call->memory, NULL, error);
    return status;
}

static bool print_json(struct probe_command *call)
{
    struct json json;
    json_init(&json, &call->memory, false);
    json_object(&json, NULL);
    json_integer(&json, "schema", 1);
    json_text(&json, "device", call->gpu->properties.name);
    json_text(&json, "driver", call->gpu->properties.driver);
    json_text(&json, "file", call->options->output);
    json_integer(&json, "bytes", call->size);
    if (call->target)
        json_text(&json, "target", call->target);
    else
        json_null(&json, "target");
    if (call->target)
        json_null(&json, "not_native");
    else
        json_text(&json, "not_native", call->why_not.text);
    json_object_end(&json);
    bool ok = report_print(&json);
    json_finish(&json);
    return ok;
}

static bool print_text(const struct probe_command *call)
{
    if (report_volume() == REPORT_ERRORS)
        return true;
    printf("%s: %s, %s\n", call->options->output, call->gpu->properties.name, call->gpu->properties.driver);
    if (call->target)
        printf("it loads %s structures: bvhctl build --probe %s\n", call->target, call->options->output);
    else
        printf("it loads only portable structures (%s)\n", call->why_not.text);
    return report_flush();
}

enum exit_code command_probe(const struct options *options)
{
    struct probe_command call = {.options = options};
    struct bvhd_error error;
    memory_init(&call.memory, UINT64_MAX);
    enum exit_code code;
    if (run(&call, &error) != BVHD_OK) {
        report_failure(options->json, "probe", &error);
        /* EXIT_NO_DAEMON would be wrong: it is a device that is missing. */
        code = !call.gpu && error.status == BVHD_NOT_FOUND ? EXIT_USAGE : EXIT_FAILED;
    } else {
        code = (options->json ? print_json(&call) : print_text(&call)) ? EXIT_DONE : EXIT_FAILED;
    }
    bvhd_vulkan_free(call.probe);
    gpu_close(call.gpu);
    return code;
}
