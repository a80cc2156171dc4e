/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/gpu/inspect_probe.h"

#include <stdio.h>

#include "client/bvhctl/base/files.h"

enum { LARGEST_FILE = 16 << 20 };

static enum bvhd_status read(struct inspect_probe *probe, struct bvhd_error *error)
{
    struct bytes data = {probe->data, probe->size};
    if (!probe_is(data))
        return bvhd_error_set(error, BVHD_NOT_FOUND, "probe", "this is no probe");
    enum bvhd_status status = probe_unpack(data, &probe->probe, error);
    if (status != BVHD_OK)
        return status;
    probe->format.struct_size = sizeof probe->format;
    status = bvhd_format_from_probe(probe->data, probe->size, &probe->format, &probe->why_not);
    if (status == BVHD_OK)
        probe->target = bvhd_target_name(probe->format.target);
    if (status == BVHD_OK || status == BVHD_UNSUPPORTED)
        return BVHD_OK;
    *error = probe->why_not;
    return status;
}

enum bvhd_status inspect_probe_open(const char *path, struct memory *memory, struct inspect_probe *ret_probe,
                                    struct bvhd_error *error)
{
    struct inspect_probe probe = {.data = NULL};
    struct bvhd_error inner = {0};
    enum bvhd_status status = files_read(path, LARGEST_FILE, memory, &probe.data, &probe.size, error);
    if (status != BVHD_OK)
        return status;
    status = read(&probe, &inner);
    if (status != BVHD_OK) {
        inspect_probe_close(&probe, memory);
        return bvhd_error_set(error, status, path, "%s: %s", inner.where, inner.text);
    }
    *ret_probe = probe;
    return BVHD_OK;
}

void inspect_probe_close(struct inspect_probe *probe, struct memory *memory)
{
    memory_free(memory, probe->data);
    *probe = (struct inspect_probe){.data = NULL};
}

void inspect_probe_print(const char *path, const struct inspect_probe *probe)
{
    const struct bytes *structures = probe->probe.structures;
    printf("%s: probe of %s, %s, %llu bytes\n", path, probe->probe.device, probe->probe.driver,
           (unsigned long long)probe->size);
    if (probe->target)
        printf("  loads portable, %s (variant %u)\n", probe->target, probe->format.variant);
    else
        printf("  loads portable (nothing natively: %s)\n", probe->why_not.text);
    printf("  serialized: triangles %llu, AABBs %llu, instances %llu bytes\n",
           (unsigned long long)structures[PROBE_TRIANGLES].size, (unsigned long long)structures[PROBE_AABBS].size,
           (unsigned long long)structures[PROBE_INSTANCES].size);
}

void inspect_uuid(const uint8_t uuid[16], char ret_text[INSPECT_UUID])
{
    char *out = ret_text;
    for (int i = 0; i < 16; i++)
        out += sprintf(out, "%s%02x", i == 4 || i == 6 || i == 8 || i == 10 ? "-" : "", uuid[i]);
}

static void write_uuid(struct json *json, const char *key, const uint8_t uuid[16])
{
    char text[INSPECT_UUID];
    inspect_uuid(uuid, text);
    json_text(json, key, text);
}

static void write_native(struct json *json, const struct inspect_probe *probe)
{
    if (!probe->target) {
        json_null(json, "target");
        json_text(json, "not_native", probe->why_not.text);
        return;
    }
    json_text(json, "target", probe->target);
    json_null(json, "not_native");
    json_integer(json, "variant", probe->format.variant);
    write_uuid(json, "driver_uuid", probe->format.driver_uuid);
    write_uuid(json, "compatibility_uuid", probe->format.compatibility_uuid);
}

void inspect_probe_write(const char *path, const struct inspect_probe *probe, struct json *json)
{
    const char *slash = strrchr(path, '/');
    json_object(json, NULL);
    json_text(json, "file", slash ? slash + 1 : path);
    json_text(json, "path", path);
    json_text(json, "content", "probe");
    json_text(json, "device", probe->probe.device);
    json_text(json, "driver", probe->probe.driver);
    write_native(json, probe);
    json_array(json, "structure_bytes");
    for (int i = 0; i < PROBE_COUNT; i++)
        json_integer(json, NULL, probe->probe.structures[i].size);
    json_array_end(json);
    json_object_end(json);
}
