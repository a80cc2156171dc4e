/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/scene/survey.h"

#include <math.h>
#include <string.h>

#include "client/bvhctl/scene/boxes.h"
#include "builder/format/portable_records.h"

static const char *const portable_contents[] = {
    [PORTABLE_INDEXED_TRIANGLES] = "indexed triangles",
    [PORTABLE_TRIANGLES] = "triangles",
    [PORTABLE_AABBS] = "AABBs",
    [PORTABLE_INSTANCES] = "instances",
};

static const char *const native_contents[] = {
    [CONTENT_UNKNOWN] = "nothing",
    [CONTENT_TRIANGLES] = "triangles",
    [CONTENT_AABBS] = "AABBs",
    [CONTENT_INSTANCES] = "instances",
};

const char *survey_content_name(const struct structure *structure)
{
    bool is_portable = structure->target == TARGET_PORTABLE;
    return is_portable ? portable_contents[structure->view.portable.header->content]
                       : native_contents[structure->content];
}

static void count_bytes(const struct portable_view *view, uint64_t blob_size, struct survey *survey)
{
    const struct portable_header *header = view->header;
    survey->node_bytes = header->node_count * (uint64_t)sizeof(struct portable_node);
    survey->record_bytes =
        header->record_count * (uint64_t)portable_record_size((enum portable_content)header->content);
    survey->vertex_bytes = header->vertex_count * UINT64_C(12);
    survey->geometry_bytes = header->geometry_count * (uint64_t)sizeof(struct portable_geometry);
    survey->header_bytes = blob_size - header->body_size + sizeof *header;
    survey->other_bytes = blob_size - survey->header_bytes - survey->node_bytes - survey->record_bytes -
                          survey->vertex_bytes - survey->geometry_bytes;
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

static enum bvhd_status take_portable(const struct portable_view *view, uint64_t blob_size, struct memory *memory,
                                      struct survey *survey)
{
    const struct portable_header *header = view->header;
    survey->arity = 8;
    survey->depth = header->depth;
    survey->nodes = header->node_count;
    count_bytes(view, blob_size, survey);
    if (header->node_count == 0)
        return BVHD_OK;
    uint8_t *levels = memory_alloc(memory, header->node_count);
    if (!levels)
        return BVHD_NO_MEMORY;
    levels[0] = 0;
    for (uint32_t i = 0; i < header->node_count; i++)
        count_node(view, i, levels, survey);
    memory_free(memory, levels);
    struct box bounds;
    memcpy(&bounds, header->bounds, sizeof bounds);
    survey->sah = survey->sah / box_half_area(&bounds) + 1;
    return BVHD_OK;
}

/* A walk over boxes. */
struct tour {
    const struct lavapipe_view *view;
    struct survey *survey;
    unsigned char *is_referred; /* by leaf */
    struct box root;
};

static void count_box(void *context, const struct lavapipe_box *box, uint32_t level)
{
    struct tour *tour = context;
    struct survey *survey = tour->survey;
    unsigned children = 0;
    for (int child = 0; child < 2; child++) {
        int kind = boxes_child_kind(box, child);
        struct box bounds;
        if (kind < 0)
            continue;
        memcpy(bounds.min, box->bounds[child].min, sizeof bounds.min);
        memcpy(bounds.max, box->bounds[child].max, sizeof bounds.max);
        if (level == 0)
            box_grow(&tour->root, &bounds);
        survey->sah += box_half_area(&bounds);
        children++;
        if (kind == LAVAPIPE_BOX) {
            survey->inner_children++;
            continue;
        }
        survey->leaf_children++;
        survey->leaf_records[1]++;
        tour->is_referred[lavapipe_leaf_index(tour->view, box->children[child])] = 1;
    }
    survey->nodes++;
    survey->node_children[children]++;
    survey->level_nodes[level]++;
}

static void count_native_bytes(const struct structure *structure, struct survey *survey)
{
    const struct lavapipe_view *view = &structure->view.lavapipe;
    uint64_t records = structure->content == CONTENT_INSTANCES ? view->leaf_count : structure->record_count;
    survey->header_bytes = structure->blob.size - view->body_size + LAVAPIPE_HEADER;
    survey->node_bytes = view->leaf_offset - LAVAPIPE_HEADER;
    survey->record_bytes = records * lavapipe_leaf_size(view->kind);
    survey->other_bytes = structure->blob.size - survey->header_bytes - survey->node_bytes - survey->record_bytes;
    survey->unused_nodes = survey->node_bytes / sizeof(struct lavapipe_box) - survey->nodes;
    survey->unreferred_records = records;
}

static enum bvhd_status take_lavapipe(const struct structure *structure, struct memory *memory, struct survey *survey)
{
    const struct lavapipe_view *view = &structure->view.lavapipe;
    struct tour tour = {view, survey, memory_alloc(memory, (uint64_t)view->leaf_count + 1), box_empty()};
    if (!tour.is_referred)
        return BVHD_NO_MEMORY;
    memset(tour.is_referred, 0, (size_t)view->leaf_count + 1);
    survey->arity = 2;
    boxes_visit(view, count_box, &tour);
    count_native_bytes(structure, survey);
    for (uint32_t leaf = 0; leaf < view->leaf_count; leaf++)
        survey->unreferred_records -= tour.is_referred[leaf];
    memory_free(memory, tour.is_referred);
    bool is_empty = survey->inner_children + survey->leaf_children == 0;
    survey->depth = is_empty ? 0 : view->levels;
    survey->sah = is_empty ? 0 : survey->sah / box_half_area(&tour.root) + 1;
    return BVHD_OK;
}

enum bvhd_status survey_take(const struct structure *structure, struct memory *memory, struct survey *ret_survey,
                             struct bvhd_error *error)
{
    struct survey survey = {0};
    enum bvhd_status status = structure->target == TARGET_PORTABLE
                                  ? take_portable(&structure->view.portable, structure->blob.size, memory, &survey)
                                  : take_lavapipe(structure, memory, &survey);
    if (status)
        return bvhd_error_set(error, status, "nodes", "no memory to walk them");
    *ret_survey = survey;
    return BVHD_OK;
}
