/* SPDX-License-Identifier: Apache-2.0 */
#include "daemon/service/blob_make.h"

static enum bvhd_status run(struct preparation *preparation, const struct build_context *context,
                            struct build_made *ret_made, struct bvhd_error *error)
{
    struct build_entry_source source;
    enum bvhd_status status = update_source_open(&preparation->updated, &source, error);
    if (status != BVHD_OK)
        return status;
    status = build_entry_make(&preparation->entry, &source, context, ret_made, error);
    update_source_close(&preparation->updated, &source);
    return status;
}

/* A build that gets no bytes for its blob knows only that there was no memory; the writer knows why. */
static enum bvhd_status fail(const struct blob_writer *writer, const struct build_context *context,
                             enum bvhd_status status, struct bvhd_error *error)
{
    if (status == BVHD_NO_MEMORY && writer->error.status != BVHD_OK)
        *error = writer->error;
    memory_explain(context->memory, error);
    return error->status;
}

/* Completes a blob that is not shared yet. */
static enum bvhd_status describe(const struct build_entry *entry, const struct build_made *made, struct blob *blob,
                                 struct bvhd_error *error)
{
    blob->key = entry->key;
    blob->summary = made->summary;
    return entry->record.header ? blob_set_record(blob, entry->record.bytes, error) : BVHD_OK;
}

enum bvhd_status blob_make(struct preparation *preparation, struct blob_account *account,
                           const struct build_context *context, struct blob **ret_blob, struct bvhd_error *error)
{
    struct blob_writer writer;
    struct build_context writing = *context;
    struct build_made made;
    struct blob *blob;
    blob_writer_init(&writer, account);
    writing.output = &writer.output;
    enum bvhd_status status = run(preparation, &writing, &made, error);
    if (status != BVHD_OK) {
        blob_writer_discard(&writer);
        return fail(&writer, context, status, error);
    }
    status = blob_writer_finish(&writer, &blob, error);
    if (status != BVHD_OK)
        return status;
    status = describe(&preparation->entry, &made, blob, error);
    if (status == BVHD_OK)
        *ret_blob = blob;
    else
        blob_unref(blob);
    return status;
}
