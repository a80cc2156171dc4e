/* SPDX-License-Identifier: Apache-2.0 */
/* boxes.h - a walk over the box nodes of a structure of the lavapipe layout: each once, parents first. */
#ifndef BVHCTL_BOXES_H
#define BVHCTL_BOXES_H

#include "builder/format/lavapipe.h"

/* `level` is 0 for the root. */
typedef void (*boxes_visitor)(void *context, const struct lavapipe_box *box, uint32_t level);

/* The view is one that lavapipe_open has accepted. */
void boxes_visit(const struct lavapipe_view *view, boxes_visitor visit, void *context);

/* What child `child` is: LAVAPIPE_BOX or a kind of leaf; -1 for none. */
int boxes_child_kind(const struct lavapipe_box *box, int child);

#endif
