/* SPDX-License-Identifier: Apache-2.0 */
#include "survey.h"

#include <math.h>

static const struct {
    const char *name;
    uint32_t record_size;
} contents[] = {
    [PORTABLE_INDEXED_TRIANGLES] = {"indexed triangles", sizeof(struct portable_indexed_triangle)},
    [PORTABLE_TRIANGLES] = {"triangles", sizeof(struct portable_triangle)},
    [PORTABLE_AABBS] = {"AABBs", sizeof(struct portable_aabb)},
    [PORTABLE_INSTANCES] = {"instances", sizeof(struct portable_instance)},
};

const char *survey_content_name(uint32_t content)
{
    return content < sizeof contents / sizeof *contents ? contents[content].name : "unknown";
}

static void count_bytes(const struct portable_view *view, uint64_t blob_size, struct survey *survey)
{
    const struct portable_header *header = view->header;
    survey->node_bytes = header->node_count * (uint64_t)sizeof(struct portable_node);
    survey->record_bytes = header->record_count * (uint64_t)contents[header->content].record_size;
    survey->vertex_bytes = header->vertex_count * UINT64_C(12);
    survey->geometry_bytes = header->geometry_count * (uint64_t)sizeof(struct portable_geometry);
    survey->header_bytes = blob_size - header->body_size + sizeof *header;
    survey->other_bytes =
        blob_size - survey->header_bytes - survey->node_bytes - survey->record_bytes - survey->vertex_bytes - survey->geometry_bytes;
}

static double slot_half_area(const struct portable_node *node, unsigned slot)
{
    double side[3];
    for (int axis = 0; axis < 3; axis++) {
        double scale = node->exponent[axis] ? ldexp(1, node->exponent[axis] - 127) : 0;
        side[axis] = (node->hi[axis][slot] - node->lo[axis][slot]) * scale;
    }
    return side[0] * side[1] + side[1] * side[2] + side[2] * side[0];
}

/* Records of a leaf slot: its count is written in unary. */
static unsigned leaf_count(uint8_t meta)
{
    return (unsigned)__builtin_popcount(meta >> 5);
}

/* Children follow their parents, so levels are known when a node is reached. */
static void count_node(const struct portable_view *view, uint32_t index, uint8_t *levels, struct survey *survey)
{
    const struct portable_node *node = &view->nodes[index];
    unsigned children = 0, inner = 0;
    survey->level_nodes[levels[index]]++;
    for (unsigned slot = 0; slot < 8; slot++) {
        if (node->meta[slot] == 0)
            continue;
        bool is_inner = node->inner_mask >> slot & 1;
        children++;
        survey->sah += slot_half_area(node, slot) * (is_inner ? 1 : leaf_count(node->meta[slot]));
        if (is_inner)
            levels[node->first_child + inner++] = levels[index] + 1;
        else
            survey->leaf_records[leaf_count(node->meta[slot])]++;
    }
    survey->inner_children += inner;
    survey->leaf_children += children - inner;
    survey->node_children[children]++;
}

enum bvhd_status survey_take(const struct portable_view *view, uint64_t blob_size, struct memory *memory, struct survey *ret_survey,
                             struct bvhd_error *error)
{
    struct survey survey = {0};
    const struct portable_header *header = view->header;
    count_bytes(view, blob_size, &survey);
    if (header->node_count) {
        uint8_t *levels = memory_alloc(memory, header->node_count);
        if (!levels)
            return bvhd_error_set(error, BVHD_NO_MEMORY, "nodes", "no memory to walk them");
        levels[0] = 0;
        for (uint32_t i = 0; i < header->node_count; i++)
            count_node(view, i, levels, &survey);
        memory_free(memory, levels);
        struct box bounds;
        memcpy(&bounds, header->bounds, sizeof bounds);
        survey.sah = survey.sah / box_half_area(&bounds) + 1;
    }
    *ret_survey = survey;
    return BVHD_OK;
}
