/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/scene/boxes.h"

enum { KIND_MASK = 3 };

int boxes_child_kind(const struct lavapipe_box *box, int child)
{
    return box->children[child] == LAVAPIPE_NONE ? -1 : (int)(box->children[child] & KIND_MASK);
}

void boxes_visit(const struct lavapipe_view *view, boxes_visitor visit, void *context)
{
    struct {
        uint32_t offset, level;
    } waiting[LAVAPIPE_MAX_LEVELS + 1] = {{LAVAPIPE_HEADER, 0}}; /* one of each level, and two of the lowest */
    for (unsigned count = 1; count > 0;) {
        uint32_t level = waiting[--count].level;
        struct lavapipe_box box = lavapipe_box_at(view, waiting[count].offset);
        visit(context, &box, level);
        for (int child = 1; child >= 0; child--) {
            if (boxes_child_kind(&box, child) != LAVAPIPE_BOX)
                continue;
            waiting[count].offset = box.children[child] & ~(uint32_t)KIND_MASK;
            waiting[count++].level = level + 1;
        }
    }
}
