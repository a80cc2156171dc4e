/* SPDX-License-Identifier: Apache-2.0 */
/* survey.h - figures about an opened structure: where its bytes go, how full its nodes are, what a ray costs. */
#ifndef BVHCTL_SURVEY_H
#define BVHCTL_SURVEY_H

#include "client/bvhctl/scene/structure.h"

struct survey {
    uint64_t header_bytes; /* serialized header, handles, body header, with the padding after them */
    uint64_t node_bytes, record_bytes, vertex_bytes, geometry_bytes;
    /* padding between sections; of a native structure also leaves that it does not say the kind of */
    uint64_t other_bytes;
    uint32_t arity; /* 8 or 2 */
    uint32_t depth; /* levels of nodes; 0 when empty */
    uint64_t nodes; /* of the tree */
    uint64_t unused_nodes,
        unreferred_records; /* of a native structure: what there is room for, and what the tree does not reach */
    uint64_t node_children[9]; /* nodes that have that many children */
    uint64_t leaf_records[PORTABLE_LEAF_MAX + 1]; /* leaf children that have that many records */
    uint64_t inner_children, leaf_children;
    uint64_t level_nodes[PORTABLE_MAX_DEPTH]; /* nodes on each level, the root's first */
    double sah; /* of the tree as it is stored: nodes and records count 1, by area of their boxes; 0 when empty */
};

/* `memory`: for the walk, freed before return. BVHD_NO_MEMORY. */
enum bvhd_status survey_take(const struct structure *structure, struct memory *memory, struct survey *ret_survey,
                             struct bvhd_error *error);

/* "triangles", "indexed triangles", "AABBs", "instances", "nothing". */
const char *survey_content_name(const struct structure *structure);

#endif
