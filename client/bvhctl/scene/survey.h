/* SPDX-License-Identifier: Apache-2.0 */
/*
 * survey.h - figures about an opened structure, as `bvhctl inspect` prints them: how many bytes each section takes, how
 * full the nodes are, what a ray is expected to cost.
 */
#ifndef BVHCTL_SURVEY_H
#define BVHCTL_SURVEY_H

#include "client/bvhctl/scene/structure.h"

enum { SURVEY_FIGURES = 4 };

/* A figure that not every layout has. */
struct survey_figure {
    const char *name; /* a key of the JSON output */
    uint64_t value;
};

struct survey {
    uint64_t header_bytes; /* serialized header, handles, body header, with the padding after them */
    uint64_t node_bytes, record_bytes, vertex_bytes, geometry_bytes;
    /* padding between sections; in a native structure also leaves whose kind it does not say */
    uint64_t other_bytes;
    uint32_t arity; /* most children of a node: 8 or 2 */
    uint32_t leaf_max; /* most records of a leaf child */
    uint32_t depth; /* levels of nodes; 0 when empty */
    uint64_t nodes; /* of the tree */
    uint64_t records; /* in the file, those included that the tree does not reach */
    uint64_t unused_nodes; /* nodes for which a native structure has room beside those of the tree */
    uint64_t unreferred_records; /* records of a native structure that the tree does not reach */
    uint64_t node_children[9]; /* [n]: nodes that have n children */
    uint64_t leaf_records[PORTABLE_LEAF_MAX + 1]; /* [n]: leaf children that have n records */
    uint64_t inner_children, leaf_children;
    uint64_t level_nodes[PORTABLE_MAX_DEPTH]; /* nodes on each level, the root's first */
    /*
     * The cost by the surface area heuristic (SAH) of the tree as it is stored: each node and each record costs 1,
     * weighted by the area of its box over that of the root; 0 when empty. Where something moves, areas of boxes are
     * means over time, and that of the root is the area of its bounds over all time.
     */
    double sah;
    /* of the layout, in the order in which they are printed; the first is its version or variant */
    struct survey_figure figures[SURVEY_FIGURES];
    uint32_t figure_count;
};

/* `memory` is for the walk; all of it is freed before the return. BVHD_NO_MEMORY. */
enum bvhd_status survey_take(const struct structure *structure, struct memory *memory, struct survey *ret_survey,
                             struct bvhd_error *error);

/* For readers of targets: adds a figure, of which there are at most SURVEY_FIGURES. `name` is a literal. */
void survey_add_figure(struct survey *survey, const char *name, uint64_t value);

/* Returns the value of a figure; NULL when the layout does not have it. */
const uint64_t *survey_find_figure(const struct survey *survey, const char *name);

/* Returns a name such as "triangles", "indexed triangles", "motion instances" or "nothing". */
const char *survey_content_name(const struct structure *structure);

#endif
