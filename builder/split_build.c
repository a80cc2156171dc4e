/* SPDX-License-Identifier: Apache-2.0 */
#include "split.h"

enum bvhd_status split_build(const struct split_request *request, struct memory *memory, const struct parallel *parallel,
                             struct ir *ret_ir, struct bvhd_error *error)
{
    struct split_tree tree;
    enum bvhd_status status = split_refs(request, memory, parallel, &tree, error);
    if (status != BVHD_OK)
        return status;
    struct ir ir;
    status = ir_init(&ir, memory, tree.node_count, request->count, error);
    if (status == BVHD_OK) {
        for (uint32_t i = 0; i < tree.node_count; i++) {
            const struct split_node *node = &tree.nodes[i];
            ir.nodes[i] = node->child ? (struct ir_node){.first = node->child} : (struct ir_node){node->first, node->count};
            ir.boxes[0][i] = node->bounds;
        }
        for (uint32_t i = 0; i < request->count; i++)
            ir.refs[i] = request->refs[i].id;
        ir.node_count = tree.node_count;
        ir.ref_count = request->count;
        *ret_ir = ir;
    }
    memory_free(memory, tree.nodes);
    return status;
}
