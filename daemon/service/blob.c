/* SPDX-License-Identifier: Apache-2.0 */
#include "daemon/service/blob.h"

#include <assert.h>
#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <string.h>
#include <unistd.h>

#include "daemon/system/release.h"
#include "proto/base/container_of.h"
#include "proto/base/seal.h"

enum { SEALS = F_SEAL_SHRINK | F_SEAL_GROW | F_SEAL_WRITE | F_SEAL_SEAL };

void blob_account_init(struct blob_account *account, struct memory *memory, struct descriptors *descriptors)
{
    account->memory = memory;
    account->descriptors = descriptors;
    atomic_init(&account->live_bytes, 0);
    atomic_init(&account->live_blobs, 0);
}

/* From now on bytes are written to the mapped pages. */
static void use_mapped(struct blob_writer *writer, const struct memfd *memfd)
{
    writer->descriptor = memfd->descriptor;
    writer->bytes = memfd->bytes;
    writer->mapped = memfd->size;
}

/* The threads that write do most of the work, which is to clear the pages. */
static enum bvhd_status map_file(struct blob_writer *writer, struct bvhd_error *error)
{
    struct memfd memfd;
    enum bvhd_status status = memfd_make(&writer->descriptor, error);
    if (status == BVHD_OK)
        status = memfd_reserve(writer->descriptor, 0, writer->size, error);
    if (status == BVHD_OK)
        status = memfd_map(writer->descriptor, writer->size, &memfd, error);
    if (status == BVHD_OK)
        use_mapped(writer, &memfd);
    return status;
}

static enum bvhd_status allocate_memory(struct blob_writer *writer, struct bvhd_error *error)
{
    writer->bytes = memory_alloc(writer->account->memory, writer->size);
    return writer->bytes ? BVHD_OK
                         : bvhd_error_no_memory(error, "blob", "no memory for %" PRIu64 " bytes", writer->size);
}

static bool needs_descriptor(uint64_t size)
{
    return size > BLOB_INLINE_MAX;
}

/* Counts the bytes and the descriptor of a blob of that size in the account. */
static enum bvhd_status take(struct blob_writer *writer, uint64_t size, struct bvhd_error *error)
{
    if (size > INT64_MAX)
        return bvhd_error_no_memory(error, "blob", "no memory for %" PRIu64 " bytes", size);
    if (needs_descriptor(size) && !descriptors_take(writer->account->descriptors, 1, DESCRIPTORS_RESERVE))
        return bvhd_error_set(error, BVHD_BUSY, "blob", "too many open descriptors");
    atomic_fetch_add_explicit(&writer->account->live_bytes, size, memory_order_relaxed);
    writer->size = size;
    return BVHD_OK;
}

static void give(struct blob_account *account, uint64_t size)
{
    if (needs_descriptor(size))
        descriptors_give(account->descriptors, 1);
    uint64_t before = atomic_fetch_sub_explicit(&account->live_bytes, size, memory_order_relaxed);
    assert(before >= size);
    (void)before;
}

static struct blob_writer *writer_of(struct build_output *output)
{
    return container_of(output, struct blob_writer, output);
}

static unsigned char *allocate(struct build_output *output, uint64_t size)
{
    struct blob_writer *writer = writer_of(output);
    assert(writer->size == 0);
    enum bvhd_status status = take(writer, size, &writer->error);
    if (status == BVHD_OK)
        status = size >= BLOB_MAPPED_MIN ? map_file(writer, &writer->error) : allocate_memory(writer, &writer->error);
    if (status != BVHD_OK)
        blob_writer_discard(writer);
    return writer->bytes;
}

static void release_bytes(struct blob_writer *writer)
{
    if (writer->mapped > 0)
        memfd_unmap(&(struct memfd){writer->descriptor, writer->bytes, writer->mapped});
    else
        memory_free(writer->account->memory, writer->bytes);
    writer->bytes = NULL;
    writer->mapped = 0;
}

void blob_writer_discard(struct blob_writer *writer)
{
    if (writer->size == 0)
        return;
    release_bytes(writer);
    if (writer->descriptor >= 0)
        close(writer->descriptor);
    give(writer->account, writer->size);
    writer->descriptor = -1;
    writer->size = writer->filled = 0;
}

static void discard(struct build_output *output, unsigned char *bytes)
{
    assert(bytes && bytes == writer_of(output)->bytes);
    (void)bytes;
    blob_writer_discard(writer_of(output));
}

void blob_writer_init(struct blob_writer *writer, struct blob_account *account)
{
    *writer = (struct blob_writer){
        .output = {.allocate = allocate, .discard = discard}, .account = account, .descriptor = -1};
}

static enum bvhd_status write_file(struct blob_writer *writer, const unsigned char *bytes, uint64_t size,
                                   struct bvhd_error *error)
{
    for (uint64_t written = 0; written < size;) {
        ssize_t count = write(writer->descriptor, bytes + written, size - written);
        if (count > 0)
            written += (uint64_t)count;
        else if (count == 0 || errno != EINTR)
            return memfd_refused(error, "write");
    }
    return BVHD_OK;
}

enum bvhd_status blob_writer_begin(struct blob_writer *writer, uint64_t size, struct ready_memfds *ready,
                                   struct bvhd_error *error)
{
    struct memfd memfd;
    assert(writer->size == 0);
    enum bvhd_status status = take(writer, size, error);
    if (status != BVHD_OK)
        return status;
    if (!needs_descriptor(size))
        return allocate_memory(writer, error);
    if (!ready || !ready_memfds_take(ready, size, &memfd))
        return memfd_make(&writer->descriptor, error);
    use_mapped(writer, &memfd);
    return BVHD_OK;
}

unsigned char *blob_writer_room(struct blob_writer *writer, uint64_t size)
{
    assert(size <= writer->size - writer->filled);
    (void)size;
    return writer->bytes ? writer->bytes + writer->filled : NULL;
}

enum bvhd_status blob_writer_append(struct blob_writer *writer, const void *bytes, uint64_t size,
                                    struct bvhd_error *error)
{
    assert(size <= writer->size - writer->filled);
    unsigned char *room = blob_writer_room(writer, size);
    if (!room && write_file(writer, bytes, size, error) != BVHD_OK)
        return error->status;
    if (room && room != bytes)
        memcpy(room, bytes, size);
    writer->filled += size;
    return BVHD_OK;
}

/*
 * Leaves a sealed descriptor and no bytes. The mapping goes first, since a memfd that is mapped for writing cannot be
 * sealed against it. A memfd that was ready may be longer than the blob.
 */
static enum bvhd_status seal(struct blob_writer *writer, struct bvhd_error *error)
{
    enum bvhd_status status = BVHD_OK;
    if (writer->descriptor < 0) {
        status = memfd_make(&writer->descriptor, error);
        if (status == BVHD_OK)
            status = write_file(writer, writer->bytes, writer->size, error);
    }
    if (status != BVHD_OK)
        return status;
    bool is_longer = writer->mapped > writer->size;
    release_bytes(writer);
    if (is_longer && ftruncate(writer->descriptor, (off_t)writer->size) != 0)
        return memfd_refused(error, "ftruncate");
    return seal_add(writer->descriptor, SEALS) == 0 ? BVHD_OK : memfd_refused(error, "sealing");
}

enum bvhd_status blob_writer_finish(struct blob_writer *writer, struct blob **ret_blob, struct bvhd_error *error)
{
    assert(writer->size > 0 && (writer->filled == 0 || writer->filled == writer->size));
    struct blob_account *account = writer->account;
    struct blob *blob = memory_alloc(account->memory, sizeof *blob);
    enum bvhd_status status = blob ? BVHD_OK : bvhd_error_no_memory(error, "blob", "no memory to keep it");
    if (status == BVHD_OK && needs_descriptor(writer->size))
        status = seal(writer, error);
    if (status != BVHD_OK) {
        memory_free(account->memory, blob);
        blob_writer_discard(writer);
        return status;
    }
    *blob = (struct blob){
        .account = account, .size = writer->size, .bytes = writer->bytes, .descriptor = writer->descriptor};
    atomic_init(&blob->refs, 1);
    atomic_fetch_add_explicit(&account->live_blobs, 1, memory_order_relaxed);
    blob_writer_init(writer, account);
    *ret_blob = blob;
    return BVHD_OK;
}

enum bvhd_status blob_set_record(struct blob *blob, struct bytes record, struct bvhd_error *error)
{
    assert(!blob->record.data);
    unsigned char *copy = memory_alloc(blob->account->memory, record.size);
    if (!copy)
        return bvhd_error_no_memory(error, "blob", "no memory for a record of %" PRIu64 " bytes", record.size);
    memcpy(copy, record.data, record.size);
    blob->record = (struct bytes){copy, record.size};
    atomic_fetch_add_explicit(&blob->account->live_bytes, record.size, memory_order_relaxed);
    return BVHD_OK;
}

struct blob *blob_ref(struct blob *blob)
{
    atomic_fetch_add_explicit(&blob->refs, 1, memory_order_relaxed);
    return blob;
}

void blob_unref(struct blob *blob)
{
    /* acq_rel orders the reads of all other holders before the end of the blob. */
    if (!blob || atomic_fetch_sub_explicit(&blob->refs, 1, memory_order_acq_rel) != 1)
        return;
    struct blob_account *account = blob->account;
    if (blob->descriptor >= 0)
        release_memfd(blob->descriptor, blob->size);
    memory_free(account->memory, (void *)(uintptr_t)blob->bytes);
    memory_free(account->memory, (void *)(uintptr_t)blob->record.data);
    atomic_fetch_sub_explicit(&account->live_bytes, blob->record.size, memory_order_relaxed);
    give(account, blob->size);
    atomic_fetch_sub_explicit(&account->live_blobs, 1, memory_order_relaxed);
    memory_free(account->memory, blob);
}
