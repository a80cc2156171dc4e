/* SPDX-License-Identifier: Apache-2.0 */
/*
 * attachment.h - a memfd that came with a request, from its arrival to its last reader.
 *
 * It is mapped and checked (payload_open_memfd) by the first worker that needs it and not by the loop, because checking
 * all its pages takes longer than the loop may stop for.
 */
#ifndef BVHD_ATTACHMENT_H
#define BVHD_ATTACHMENT_H

#include "daemon/service/payload.h"

struct attachment;

/*
 * Creates an attachment with one reference. It takes over file->descriptor and its count, also when it fails; returns
 * NULL without memory. file->where is copied; file->memory must outlive the attachment.
 */
struct attachment *attachment_create(const struct payload_file *file);

struct attachment *attachment_ref(struct attachment *attachment);
/* For any thread. The last reference unmaps and closes the memfd. `attachment` may be NULL. */
void attachment_unref(struct attachment *attachment);

/*
 * Opens the memfd as payload_open_memfd does, unless another caller has: all callers get the same answer. The payload
 * is borrowed, and lives as long as the attachment. For any thread.
 */
enum bvhd_status attachment_open(struct attachment *attachment, struct payload **ret_payload, struct bvhd_error *error);

#endif
