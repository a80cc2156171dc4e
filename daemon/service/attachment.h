/* SPDX-License-Identifier: Apache-2.0 */
/*
 * attachment.h - a memfd that came with a request, from its arrival to its last reader. It is opened by the first
 * worker that wants to read it: looking at all of its pages takes longer than the loop may stop for.
 */
#ifndef BVHD_ATTACHMENT_H
#define BVHD_ATTACHMENT_H

#include "daemon/system/descriptors.h"
#include "daemon/service/payload.h"

struct attachment;

/*
 * Takes file->descriptor, also when it fails (NULL: no memory); its count goes back to `descriptors` when it is closed.
 * file->where is copied, file->memory and `descriptors` must outlive it. One ref.
 */
struct attachment *attachment_create(const struct payload_file *file, struct descriptors *descriptors);

struct attachment *attachment_ref(struct attachment *attachment);
/* From any thread; the last one unmaps and closes. NULL-safe. */
void attachment_unref(struct attachment *attachment);

/*
 * As payload_open_memfd; the payload lives as long as the attachment. Every caller gets the same answer. From any
 * thread.
 */
enum bvhd_status attachment_open(struct attachment *attachment, struct payload **ret_payload, struct bvhd_error *error);

#endif
