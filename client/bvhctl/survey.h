/* SPDX-License-Identifier: Apache-2.0 */
/* survey.h - figures about an opened structure: where its bytes go, how full its nodes are, what a ray costs. */
#ifndef BVHCTL_SURVEY_H
#define BVHCTL_SURVEY_H

#include "portable.h"

struct survey {
    uint64_t header_bytes; /* serialized header, handles, body header, with the padding after them */
    uint64_t node_bytes, record_bytes, vertex_bytes, geometry_bytes;
    uint64_t other_bytes; /* padding between sections */
    uint64_t node_children[9]; /* nodes that have that many children */
    uint64_t leaf_records[PORTABLE_LEAF_MAX + 1]; /* leaf children that have that many records */
    uint64_t inner_children, leaf_children;
    uint64_t level_nodes[PORTABLE_MAX_DEPTH]; /* nodes on each level, the root's first */
    double sah; /* of the 8-wide tree: nodes and records count 1, by area of the quantised boxes; 0 when empty */
};

/* `blob_size`: bytes of the file. The view is one that portable_open has accepted. `memory`: for the levels, freed before return. */
enum bvhd_status survey_take(const struct portable_view *view, uint64_t blob_size, struct memory *memory, struct survey *ret_survey,
                             struct bvhd_error *error);

/* "triangles", "indexed triangles", "AABBs", "instances". */
const char *survey_content_name(uint32_t content);

#endif
