/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/format/probe.h"

#include <inttypes.h>

#include "proto/base/place.h"

static const char magic[8] = "bvhdprob";

enum {
    VERSION = 1,
    NAMES = 24,
    HANDLES = NAMES + 2 * PROBE_NAME_SIZE,
    SIZES = HANDLES + 8 * PROBE_COUNT,
    HEADER = SIZES + 8 * PROBE_COUNT
};

/* Returns how much space a structure takes in the block, where each begins at a multiple of 8. */
static uint64_t room(uint64_t size)
{
    return bytes_align(size, 8);
}

static enum bvhd_status check_size(uint64_t size, int index, enum bvhd_status status, struct bvhd_error *error)
{
    if (size > 0 && size <= PROBE_MAX_STRUCTURE)
        return BVHD_OK;
    return bvhd_error_set(error, status, place("probe.structures[%d]", index).text, "%" PRIu64 " bytes, not 1 to %d",
                          size, (int)PROBE_MAX_STRUCTURE);
}

enum bvhd_status probe_pack(const struct probe *probe, struct memory *memory, unsigned char **ret_data,
                            uint64_t *ret_size, struct bvhd_error *error)
{
    uint64_t size = HEADER;
    for (int i = 0; i < PROBE_COUNT; i++) {
        enum bvhd_status status = check_size(probe->structures[i].size, i, BVHD_TOO_LARGE, error);
        if (status != BVHD_OK)
            return status;
        size += room(probe->structures[i].size);
    }
    unsigned char *data = memory_alloc(memory, size);
    if (!data)
        return bvhd_error_no_memory(error, "probe", "no memory for %" PRIu64 " bytes", size);
    memset(data, 0, size);
    memcpy(data, magic, sizeof magic);
    bytes_put32(data + 8, VERSION);
    bytes_put32(data + 12, PROBE_COUNT);
    bytes_put64(data + 16, size);
    /* The last byte of a name stays 0. */
    memcpy(data + NAMES, probe->device, strnlen(probe->device, PROBE_NAME_SIZE - 1));
    memcpy(data + NAMES + PROBE_NAME_SIZE, probe->driver, strnlen(probe->driver, PROBE_NAME_SIZE - 1));
    unsigned char *at = data + HEADER;
    for (int i = 0; i < PROBE_COUNT; i++) {
        const struct bytes *structure = &probe->structures[i];
        bytes_put64(data + HANDLES + 8 * i, probe->handles[i]);
        bytes_put64(data + SIZES + 8 * i, structure->size);
        memcpy(at, structure->data, structure->size);
        at += room(structure->size);
    }
    *ret_data = data;
    *ret_size = size;
    return BVHD_OK;
}

static bool all_zero(const unsigned char *bytes, uint64_t count)
{
    for (uint64_t i = 0; i < count; i++)
        if (bytes[i])
            return false;
    return true;
}

static enum bvhd_status read_name(const unsigned char *at, const char *where, char *ret_name, struct bvhd_error *error)
{
    size_t length = strnlen((const char *)at, PROBE_NAME_SIZE);
    if (!all_zero(at + length, PROBE_NAME_SIZE - length) || length == PROBE_NAME_SIZE)
        return bvhd_error_set(error, BVHD_CORRUPT, where, "a name does not end, or something stands behind its end");
    memcpy(ret_name, at, PROBE_NAME_SIZE);
    return BVHD_OK;
}

bool probe_is(struct bytes data)
{
    return data.size >= sizeof magic && memcmp(data.data, magic, sizeof magic) == 0;
}

static enum bvhd_status read_header(struct bytes data, struct probe *probe, struct bvhd_error *error)
{
    if (!probe_is(data))
        return bvhd_error_set(error, BVHD_CORRUPT, "probe", "this is no probe");
    if (data.size < HEADER)
        return bvhd_error_set(error, BVHD_CORRUPT, "probe", "%" PRIu64 " bytes are too few", data.size);
    uint32_t version = bytes_get32(data.data + 8), count = bytes_get32(data.data + 12);
    if (version != VERSION)
        return bvhd_error_set(error, BVHD_INCOMPATIBLE, "probe.version", "%" PRIu32 ", but this is version %d", version,
                              VERSION);
    if (count != PROBE_COUNT)
        return bvhd_error_set(error, BVHD_CORRUPT, "probe.structures", "%" PRIu32 " structures, not %d", count,
                              PROBE_COUNT);
    if (bytes_get64(data.data + 16) != data.size)
        return bvhd_error_set(error, BVHD_CORRUPT, "probe.size", "says %" PRIu64 " bytes, but there are %" PRIu64,
                              bytes_get64(data.data + 16), data.size);
    enum bvhd_status status = read_name(data.data + NAMES, "probe.device", probe->device, error);
    return status == BVHD_OK ? read_name(data.data + NAMES + PROBE_NAME_SIZE, "probe.driver", probe->driver, error)
                             : status;
}

enum bvhd_status probe_unpack(struct bytes data, struct probe *ret_probe, struct bvhd_error *error)
{
    struct probe probe;
    enum bvhd_status status = read_header(data, &probe, error);
    uint64_t at = HEADER;
    for (int i = 0; status == BVHD_OK && i < PROBE_COUNT; i++) {
        uint64_t size = bytes_get64(data.data + SIZES + 8 * i);
        probe.handles[i] = bytes_get64(data.data + HANDLES + 8 * i);
        status = check_size(size, i, BVHD_CORRUPT, error);
        if (status != BVHD_OK)
            break;
        if (room(size) > data.size - at || !all_zero(data.data + at + size, room(size) - size))
            return bvhd_error_set(error, BVHD_CORRUPT, place("probe.structures[%d]", i).text, "does not fit");
        probe.structures[i] = (struct bytes){data.data + at, size};
        at += room(size);
    }
    if (status != BVHD_OK)
        return status;
    if (at != data.size)
        return bvhd_error_set(error, BVHD_CORRUPT, "probe", "%" PRIu64 " bytes are left over", data.size - at);
    *ret_probe = probe;
    return BVHD_OK;
}
