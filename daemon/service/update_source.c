/* SPDX-License-Identifier: Apache-2.0 */
#include "daemon/service/update_source.h"

#include <sys/mman.h>

#include "builder/format/portable.h"
#include "builder/format/serialized.h"

static bool is_shortage_or_cancelled(enum bvhd_status status)
{
    return status == BVHD_NO_MEMORY || status == BVHD_BUSY || status == BVHD_CANCELLED;
}

struct bytes update_source_record(const struct update_source *source)
{
    return source->blob->record.size > 0 ? source->blob->record : source->record.bytes;
}

enum bvhd_status update_source_open(const struct update_source *source, struct build_entry_source *ret_opened,
                                    struct bvhd_error *error)
{
    const struct blob *blob = source->blob;
    if (!blob) {
        *ret_opened = (struct build_entry_source){.blob = {NULL, 0}};
        return BVHD_OK;
    }
    const void *bytes = blob->bytes;
    if (blob->descriptor >= 0)
        bytes = mmap(NULL, blob->size, PROT_READ, MAP_PRIVATE, blob->descriptor, 0);
    if (bytes == MAP_FAILED)
        return bvhd_error_no_memory(error, "source", "no address space for the source of an update");
    *ret_opened = (struct build_entry_source){{bytes, blob->size}, update_source_record(source)};
    return BVHD_OK;
}

void update_source_close(const struct update_source *source, const struct build_entry_source *opened)
{
    if (source->blob && source->blob->descriptor >= 0)
        munmap((void *)(uintptr_t)opened->blob.data, opened->blob.size);
}

/* Returns whether the bytes say that the structure was built without ALLOW_UPDATE; those of native layouts do not. */
static bool says_not_updatable(struct bytes bytes)
{
    struct serialized_header header;
    if (serialized_read(bytes, &header, NULL) != BVHD_OK)
        return false;
    uint64_t body = portable_body_of(&header);
    return memcmp(header.driver_uuid, portable_driver_uuid, sizeof header.driver_uuid) == 0 &&
           bytes_reach(bytes.size, body, 0, 0, sizeof(struct portable_header)) &&
           !(bytes_get32(bytes.data + body + offsetof(struct portable_header, build_flags)) & BUILD_ALLOW_UPDATE);
}

/* A blob that was built in this process has no record because it was built without the flag. */
static enum bvhd_status judge_recordless(const struct update_source *source, const struct key *key, uint32_t index,
                                         struct bvhd_error *error)
{
    struct build_entry_source opened = {0};
    if (!source->blob->is_from_disk)
        return BVHD_OK;
    enum bvhd_status status = update_source_open(source, &opened, error);
    if (status != BVHD_OK)
        return status;
    bool not_updatable = says_not_updatable(opened.blob);
    update_source_close(source, &opened);
    return not_updatable
               ? BVHD_OK
               : build_entry_source_lost(key, index, "what updates of the structure need is not there", error);
}

static bool is_record(struct bytes bytes)
{
    struct record record;
    return record_open(bytes, &record, NULL) == BVHD_OK;
}

/* Forgets a damaged record, so that it is not taken for the source's own. */
static void drop_record(struct update_source *source)
{
    memory_free(source->record.memory, (void *)(uintptr_t)source->record.bytes.data);
    source->record.bytes = (struct bytes){NULL, 0};
}

enum bvhd_status update_source_find_record(struct update_source *source, const struct key *key, uint32_t index,
                                           const atomic_bool *cancel, struct bvhd_error *error)
{
    if (update_source_record(source).size > 0)
        return BVHD_OK;
    if (source->disk && source->blob->is_from_disk) {
        enum bvhd_status status = disk_read_record(source->disk, key, cancel, &source->record, error);
        if (status == BVHD_OK && is_record(source->record.bytes))
            return BVHD_OK;
        if (status == BVHD_TOO_LARGE || is_shortage_or_cancelled(status))
            return status;
        drop_record(source);
    }
    return judge_recordless(source, key, index, error);
}

/* A disk that fails loses what is there. */
enum bvhd_status update_source_find(struct update_source *source, const struct key *key, uint32_t index,
                                    const atomic_bool *cancel, struct bvhd_error *error)
{
    if (!source->blob && source->disk) {
        enum bvhd_status status = disk_read(source->disk, key, &parallel_serial, cancel, &source->blob, error);
        if (is_shortage_or_cancelled(status))
            return status;
        source->is_read = status == BVHD_OK;
    }
    return source->blob ? BVHD_OK : build_entry_source_lost(key, index, "the structure is not there", error);
}

void update_source_finish(struct update_source *source)
{
    blob_unref(source->blob);
    drop_record(source);
    *source = (struct update_source){.blob = NULL};
}
