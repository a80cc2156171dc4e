/* SPDX-License-Identifier: Apache-2.0 */
#include <stdio.h>

#include "client/bvhctl/commands.h"
#include "client/bvhctl/service/connect.h"
#include "client/bvhctl/base/files.h"

static const char *origin_name(enum bvhd_origin origin)
{
    switch (origin) {
    case BVHD_ORIGIN_BUILT:
    case BVHD_ORIGIN_COALESCED:
        return "built";
    case BVHD_ORIGIN_MEMORY:
        return "memory";
    case BVHD_ORIGIN_DISK:
        return "disk";
    default:
        return "";
    }
}

static bool print_result(const struct options *options, const struct bvhd_result *result, struct memory *memory)
{
    struct json json;
    char key[BVHD_KEY_TEXT_SIZE];
    if (!options->json && report_volume() == REPORT_ERRORS)
        return true;
    if (!options->json) {
        printf("%s  %.2f MB\n", options->output, (double)result->size / 1e6);
        return report_flush();
    }
    json_init(&json, memory, false);
    json_object(&json, NULL);
    json_integer(&json, "schema", 1);
    bvhd_key_to_text(&result->key, key);
    json_text(&json, "key", key);
    json_text(&json, "file", options->output);
    json_integer(&json, "bytes", result->size);
    json_text(&json, "origin", origin_name(result->origin));
    json_object_end(&json);
    bool ok = report_print(&json);
    json_finish(&json);
    return ok;
}

/* Waits for the structure and writes it to the file. */
static enum bvhd_status fetch(const struct options *options, struct bvhd_batch *batch, struct memory *memory,
                              struct bvhd_error *error)
{
    bvhd_batch_wait(batch, -1);
    const struct bvhd_result *result = bvhd_batch_result(batch, 0);
    if (result->error.status != BVHD_OK) {
        *error = result->error;
        return bvhd_error_set(error, error->status, options->operands[0], "%s", error->text);
    }
    return files_write(options->output, (struct bytes){result->data, result->size}, memory, NULL, error);
}

enum exit_code command_get(const struct options *options)
{
    struct memory memory;
    struct connect connect = {0};
    struct bvhd_batch *batch = NULL;
    struct bvhd_key key;
    struct bvhd_error error;
    memory_init(&memory, UINT64_MAX);
    if (bvhd_key_from_text(options->operands[0], &key) != BVHD_OK) {
        bvhd_error_set(&error, BVHD_INVALID, options->operands[0], "not a key: 64 hexadecimal digits");
        report_failure(options->json, "get", &error);
        return EXIT_USAGE;
    }
    enum bvhd_status status = connect_find(options, &memory, &connect, &error);
    if (status == BVHD_OK)
        status = bvhd_batch_fetch(connect.client, 1, &key, &batch, &error);
    if (status == BVHD_OK)
        status = fetch(options, batch, &memory, &error);
    enum exit_code code;
    if (status != BVHD_OK)
        code = report_failure(options->json, "get", &error);
    else
        code = print_result(options, bvhd_batch_result(batch, 0), &memory) ? EXIT_DONE : EXIT_FAILED;
    bvhd_batch_destroy(batch);
    connect_close(&connect);
    return code;
}
