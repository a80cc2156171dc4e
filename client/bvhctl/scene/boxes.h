/* SPDX-License-Identifier: Apache-2.0 */
/* boxes.h - visits the box nodes of a structure of the lavapipe layout, each once, parents before their children. */
#ifndef BVHCTL_BOXES_H
#define BVHCTL_BOXES_H

#include "builder/format/lavapipe.h"

/* `level` is 0 for the root. */
typedef void (*boxes_visitor)(void *context, const struct lavapipe_box *box, uint32_t level);

/* Calls `visit` for all box nodes. The view must have been opened by lavapipe_open or lavapipe_open_any. */
void boxes_visit(const struct lavapipe_view *view, boxes_visitor visit, void *context);

/* Returns the kind of child 0 or 1 (enum lavapipe_kind): LAVAPIPE_BOX or a kind of leaf; -1 if it is absent. */
int boxes_child_kind(const struct lavapipe_box *box, int child);

#endif
