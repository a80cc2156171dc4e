/* SPDX-License-Identifier: Apache-2.0 */
#include <stdio.h>

#include "client/bvhctl/base/files.h"
#include "client/bvhctl/commands.h"
#include "client/bvhctl/scene/held.h"

static bool print_result(const struct options *options, const struct held *source, const struct held *copy,
                         bool is_changed, struct memory *memory)
{
    struct json json;
    if (!options->json && report_volume() == REPORT_ERRORS)
        return true;
    if (!options->json) {
        printf("%s  %.2f MB%s\n", options->operands[1], (double)copy->state.data_size / 1e6,
               is_changed ? "" : ", unchanged");
        return report_flush();
    }
    json_init(&json, memory, false);
    json_object(&json, NULL);
    json_integer(&json, "schema", 1);
    json_text(&json, "source", options->operands[0]);
    json_text(&json, "file", options->operands[1]);
    json_text(&json, "mode", options->compact ? "compact" : "clone");
    json_integer(&json, "source_bytes", source->state.data_size);
    json_integer(&json, "bytes", copy->state.data_size);
    json_bool(&json, "changed", is_changed);
    json_object_end(&json);
    bool ok = report_print(&json);
    json_finish(&json);
    return ok;
}

static enum bvhd_status copy_file(const struct options *options, struct memory *memory, struct held *source,
                                  struct held *copy, bool *ret_changed, struct bvhd_error *error)
{
    const VkCopyAccelerationStructureModeKHR mode = options->compact ? VK_COPY_ACCELERATION_STRUCTURE_MODE_COMPACT_KHR
                                                                     : VK_COPY_ACCELERATION_STRUCTURE_MODE_CLONE_KHR;
    enum bvhd_status status = held_open(options->operands[0], memory, source, error);
    if (status != BVHD_OK)
        return status;
    status = held_copy(source, mode, copy, error);
    if (status != BVHD_OK) {
        snprintf(error->where, sizeof error->where, "%s", options->operands[0]);
        return status;
    }
    return files_write(options->operands[1], (struct bytes){copy->state.data, copy->state.data_size}, memory,
                       ret_changed, error);
}

enum exit_code command_copy(const struct options *options)
{
    struct memory memory;
    struct held source = {0}, copy = {0};
    struct bvhd_error error = {0};
    bool is_changed = false;
    enum exit_code code;
    memory_init(&memory, options->memory);
    if (copy_file(options, &memory, &source, &copy, &is_changed, &error) != BVHD_OK) {
        memory_explain(&memory, &error);
        code = report_failure(options->json, "copy", &error);
    } else {
        code = print_result(options, &source, &copy, is_changed, &memory) ? EXIT_DONE : EXIT_FAILED;
    }
    bvhd_structure_destroy(copy.structure);
    bvhd_structure_destroy(source.structure);
    return code;
}
