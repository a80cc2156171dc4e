/* SPDX-License-Identifier: Apache-2.0 */
#include "daemon/service/attachment.h"

#include <pthread.h>
#include <stdio.h>

#include "daemon/system/release.h"

struct attachment {
    atomic_uint refs;
    pthread_mutex_t mutex; /* held while it is opened */
    struct payload_file file; /* the descriptor is -1 once it was opened, or could not be */
    char where[BVHD_WHERE_SIZE];
    struct payload *payload;
    struct bvhd_error error;
};

struct attachment *attachment_create(const struct payload_file *file)
{
    struct attachment *attachment = memory_alloc(file->memory, sizeof *attachment);
    if (!attachment) {
        release_descriptor(file->share, file->descriptor);
        return NULL;
    }
    *attachment = (struct attachment){.file = *file};
    atomic_init(&attachment->refs, 1);
    pthread_mutex_init(&attachment->mutex, NULL);
    snprintf(attachment->where, sizeof attachment->where, "%s", file->where);
    attachment->file.where = attachment->where;
    return attachment;
}

struct attachment *attachment_ref(struct attachment *attachment)
{
    atomic_fetch_add_explicit(&attachment->refs, 1, memory_order_relaxed);
    return attachment;
}

void attachment_unref(struct attachment *attachment)
{
    if (!attachment || atomic_fetch_sub_explicit(&attachment->refs, 1, memory_order_acq_rel) != 1)
        return;
    if (attachment->file.descriptor >= 0)
        release_descriptor(attachment->file.share, attachment->file.descriptor);
    payload_unref(attachment->payload);
    pthread_mutex_destroy(&attachment->mutex);
    memory_free(attachment->file.memory, attachment);
}

static void open_once(struct attachment *attachment)
{
    if (attachment->file.descriptor < 0)
        return;
    payload_open_memfd(&attachment->file, &attachment->payload, &attachment->error);
    attachment->file.descriptor = -1;
}

enum bvhd_status attachment_open(struct attachment *attachment, struct payload **ret_payload, struct bvhd_error *error)
{
    pthread_mutex_lock(&attachment->mutex);
    open_once(attachment);
    pthread_mutex_unlock(&attachment->mutex);
    if (!attachment->payload) {
        *error = attachment->error;
        return error->status;
    }
    *ret_payload = attachment->payload;
    return BVHD_OK;
}
