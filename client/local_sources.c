/* SPDX-License-Identifier: Apache-2.0 */
#include "client/local_sources.h"

#include <pthread.h>

#include "client/library.h"
#include "client/result_blob.h"
#include "proto/base/container_of.h"
#include "proto/base/list.h"

struct local_source {
    struct list_link link; /* in its bucket */
    struct key key;
    struct bvhd_blob *blob; /* which it belongs to; no reference */
    struct bytes record; /* from library_memory */
};

/* Keys are cryptographic hashes, so any byte of them is a good hash. */
enum { BUCKETS = 256 };

static struct list buckets[BUCKETS];
static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;

static struct list *bucket_of(const struct key *key)
{
    return &buckets[key->bytes[0]];
}

static bool copy(struct bytes record, struct bytes *ret_copy)
{
    void *bytes = record.size > 0 ? memory_alloc(&library_memory, record.size) : NULL;
    if (bytes)
        memcpy(bytes, record.data, record.size);
    *ret_copy = (struct bytes){bytes, record.size};
    return bytes || record.size == 0;
}

enum bvhd_status local_source_create(struct bvhd_blob *blob, const struct key *key, struct bytes record,
                                     struct local_source **ret_source, struct bvhd_error *error)
{
    struct local_source *source = memory_alloc(&library_memory, sizeof *source);
    struct bytes own;
    if (!source || !copy(record, &own)) {
        memory_free(&library_memory, source);
        return bvhd_error_no_memory(error, "result", "no memory for it");
    }
    *source = (struct local_source){.key = *key, .blob = blob, .record = own};
    pthread_mutex_lock(&lock);
    list_append(bucket_of(key), &source->link);
    pthread_mutex_unlock(&lock);
    *ret_source = source;
    return BVHD_OK;
}

void local_source_destroy(struct local_source *source)
{
    if (!source)
        return;
    pthread_mutex_lock(&lock);
    list_remove(bucket_of(&source->key), &source->link);
    pthread_mutex_unlock(&lock);
    memory_free(&library_memory, (void *)(uintptr_t)source->record.data);
    memory_free(&library_memory, source);
}

struct bytes local_source_record(const struct local_source *source)
{
    return source->record;
}

struct bvhd_blob *local_sources_find(const struct key *key)
{
    struct bvhd_blob *found = NULL;
    pthread_mutex_lock(&lock);
    for (struct list_link *link = bucket_of(key)->first; link && !found; link = link->next) {
        const struct local_source *source = container_of(link, struct local_source, link);
        if (key_equal(&source->key, key) && result_blob_try_ref(source->blob))
            found = source->blob;
    }
    pthread_mutex_unlock(&lock);
    return found;
}
