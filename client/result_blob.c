/* SPDX-License-Identifier: Apache-2.0 */
#include "client/result_blob.h"

#include <errno.h>
#include <fcntl.h>
#include <stdatomic.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include "client/library.h"
#include "client/local_sources.h"

struct bvhd_blob {
    atomic_uint refs;
    bool mapped; /* `data` is a mapping */
    struct result_block *block; /* `data` is in it; NULL, and not mapped: `data` comes from library_memory */
    void *data;
    uint64_t size;
    struct local_source *source; /* of a blob that was built here; NULL: it cannot be updated here */
    struct holdings *holdings; /* where it counts; NULL: nowhere */
};

/* Copies the fields that say where the bytes are. It takes nothing over if it fails. */
static enum bvhd_status create(const struct bvhd_blob *place, struct bvhd_blob **ret_blob, struct bvhd_error *error)
{
    struct bvhd_blob *blob = memory_alloc(&library_memory, sizeof *blob);
    if (!blob)
        return bvhd_error_no_memory(error, "result", "no memory for it");
    *blob =
        (struct bvhd_blob){.mapped = place->mapped, .block = place->block, .data = place->data, .size = place->size};
    atomic_init(&blob->refs, 1);
    *ret_blob = blob;
    return BVHD_OK;
}

enum bvhd_status result_blob_take(void *data, uint64_t size, struct bvhd_blob **ret_blob, struct bvhd_error *error)
{
    enum bvhd_status status = create(&(struct bvhd_blob){.data = data, .size = size}, ret_blob, error);
    if (status != BVHD_OK)
        memory_free(&library_memory, data);
    return status;
}

enum bvhd_status result_blob_copy(struct bytes bytes, struct bvhd_blob **ret_blob, struct bvhd_error *error)
{
    void *data = memory_alloc(&library_memory, bytes.size);
    if (!data)
        return bvhd_error_no_memory(error, "result", "no memory for %llu bytes", (unsigned long long)bytes.size);
    memcpy(data, bytes.data, bytes.size);
    return result_blob_take(data, bytes.size, ret_blob, error);
}

enum bvhd_status result_blob_copy_into(struct bytes bytes, struct result_blocks *blocks, struct bvhd_blob **ret_blob,
                                       struct bvhd_error *error)
{
    struct result_block *block = NULL;
    void *data = result_blocks_take(blocks, bytes.size, &block);
    if (!data)
        return result_blob_copy(bytes, ret_blob, error);
    memcpy(data, bytes.data, bytes.size);
    const struct bvhd_blob place = {.block = block, .data = data, .size = bytes.size};
    enum bvhd_status status = create(&place, ret_blob, error);
    if (status != BVHD_OK)
        result_block_unref(block);
    return status;
}

enum bvhd_status result_blob_set_source(struct bvhd_blob *blob, const struct key *key, struct bytes record,
                                        struct bvhd_error *error)
{
    return local_source_create(blob, key, record, &blob->source, error);
}

struct bytes result_blob_record(const struct bvhd_blob *blob)
{
    return blob->source ? local_source_record(blob->source) : (struct bytes){NULL, 0};
}

bool result_blob_try_ref(struct bvhd_blob *blob)
{
    unsigned refs = atomic_load_explicit(&blob->refs, memory_order_relaxed);
    while (refs > 0 && !atomic_compare_exchange_weak_explicit(&blob->refs, &refs, refs + 1, memory_order_relaxed,
                                                              memory_order_relaxed)) {
    }
    return refs > 0;
}

/* The seals guarantee that the bytes never change, and that reading them never runs beyond the end of the file. */
static enum bvhd_status check(int descriptor, uint64_t size, struct bvhd_error *error)
{
    int seals = fcntl(descriptor, F_GET_SEALS), wanted = F_SEAL_SHRINK | F_SEAL_GROW | F_SEAL_WRITE;
    struct stat file;
    if (seals < 0 || (seals & wanted) != wanted)
        return bvhd_error_set(error, BVHD_CORRUPT, "result.descriptor", "not a sealed memfd");
    if (fstat(descriptor, &file) != 0 || file.st_size < 0 || (uint64_t)file.st_size < size)
        return bvhd_error_set(error, BVHD_CORRUPT, "result.descriptor", "less than %llu bytes",
                              (unsigned long long)size);
    return BVHD_OK;
}

static enum bvhd_status map(int descriptor, uint64_t size, struct bvhd_blob **ret_blob, struct bvhd_error *error)
{
    enum bvhd_status status = check(descriptor, size, error);
    if (status != BVHD_OK)
        return status;
    /* A fault maps 64 KiB at a time, so all pages are mapped in less time than MAP_POPULATE takes, if they are read. */
    void *data = mmap(NULL, size, PROT_READ, MAP_PRIVATE, descriptor, 0);
    if (data == MAP_FAILED)
        return bvhd_error_set(error, errno == ENOMEM ? BVHD_NO_MEMORY : BVHD_IO, "result", "mmap: %s", strerror(errno));
    /* Without this advice, munmap marks each page as used, which takes longer than all the rest that it does. */
    madvise(data, size, MADV_SEQUENTIAL);
    status = create(&(struct bvhd_blob){.mapped = true, .data = data, .size = size}, ret_blob, error);
    if (status != BVHD_OK)
        munmap(data, size);
    return status;
}

/* Puts a copy in the place of a blob that maps what may not be held. */
static enum bvhd_status copy_mapped(struct bvhd_blob **blob, struct bvhd_error *error)
{
    struct bvhd_blob *mapped = *blob;
    enum bvhd_status status = result_blob_copy((struct bytes){mapped->data, mapped->size}, blob, error);
    bvhd_blob_unref(mapped);
    return status;
}

enum bvhd_status result_blob_map(int descriptor, uint64_t size, struct holdings *holdings, struct bvhd_blob **ret_blob,
                                 struct bvhd_error *error)
{
    struct bvhd_blob *blob = NULL;
    enum bvhd_status status = map(descriptor, size, &blob, error);
    bool may_be_held = !holdings || holdings_add(holdings, size);
    close(descriptor);
    if (status == BVHD_OK && may_be_held)
        blob->holdings = holdings_ref(holdings);
    else if (status == BVHD_OK)
        status = copy_mapped(&blob, error);
    if (holdings && (status != BVHD_OK || !may_be_held))
        holdings_release(holdings, size);
    if (status == BVHD_OK)
        *ret_blob = blob;
    return status;
}

struct bvhd_blob *bvhd_blob_ref(struct bvhd_blob *blob)
{
    if (blob)
        atomic_fetch_add_explicit(&blob->refs, 1, memory_order_relaxed);
    return blob;
}

void bvhd_blob_unref(struct bvhd_blob *blob)
{
    if (!blob || atomic_fetch_sub_explicit(&blob->refs, 1, memory_order_acq_rel) != 1)
        return;
    local_source_destroy(blob->source);
    if (blob->mapped)
        munmap(blob->data, blob->size);
    else if (blob->block)
        result_block_unref(blob->block);
    else
        memory_free(&library_memory, blob->data);
    if (blob->holdings)
        holdings_release(blob->holdings, blob->size);
    holdings_unref(blob->holdings);
    memory_free(&library_memory, blob);
}

const void *bvhd_blob_data(const struct bvhd_blob *blob)
{
    return blob ? blob->data : NULL;
}

uint64_t bvhd_blob_size(const struct bvhd_blob *blob)
{
    return blob ? blob->size : 0;
}
