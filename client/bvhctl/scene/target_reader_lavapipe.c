/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/scene/target_reader.h"

#include <inttypes.h>
#include <string.h>

#include "client/bvhctl/scene/boxes.h"
#include "client/bvhctl/scene/survey.h"
#include "proto/base/place.h"

static const char *const content_names[] = {
    [CONTENT_UNKNOWN] = "nothing",
    [CONTENT_TRIANGLES] = "triangles",
    [CONTENT_AABBS] = "AABBs",
    [CONTENT_INSTANCES] = "instances",
};

static enum bvhd_status no_memory(struct bvhd_error *error)
{
    return bvhd_error_no_memory(error, "leaves", "no memory to count them");
}

/* The primitive that a leaf holds. */
struct identity {
    uint32_t geometry, primitive, flags;
};

static struct identity identity_of(const struct lavapipe_view *view, uint32_t leaf)
{
    uint32_t primitive, geometry_and_flags;
    if (view->kind == LAVAPIPE_TRIANGLE) {
        struct lavapipe_triangle triangle = lavapipe_triangle_at(view, leaf);
        primitive = triangle.primitive;
        geometry_and_flags = triangle.geometry_and_flags;
    } else {
        struct lavapipe_aabb aabb = lavapipe_aabb_at(view, leaf);
        primitive = aabb.primitive;
        geometry_and_flags = aabb.geometry_and_flags;
    }
    uint32_t flags = geometry_and_flags & LAVAPIPE_GEOMETRY_OPAQUE ? GEOMETRY_OPAQUE : 0;
    return (struct identity){geometry_and_flags & 0xffffff, primitive, flags};
}

/* The reader of the layout may take the padding behind the last leaf for a leaf: one whose fields are all zero. */
static bool is_padding(const struct lavapipe_view *view, uint32_t leaf, const struct identity *identity)
{
    return leaf > 0 && leaf + 1 == view->leaf_count && identity->geometry == 0 && identity->primitive == 0 &&
           identity->flags == 0;
}

/*
 * Counts the geometries and, unless `rows` is NULL, lists them there. BVHD_CORRUPT when the leaves are not in the order
 * of the primitives.
 */
static enum bvhd_status list_geometries(struct structure *structure, struct structure_geometry *rows,
                                        struct bvhd_error *error)
{
    const struct lavapipe_view *view = &structure->view.lavapipe;
    struct structure_geometry last = {0};
    uint32_t count = 0, leaf;
    for (leaf = 0; leaf < view->leaf_count; leaf++) {
        struct identity identity = identity_of(view, leaf);
        bool begins = count == 0 || identity.geometry != last.geometry;
        if (is_padding(view, leaf, &identity))
            break;
        if (begins ? identity.primitive != 0 || (count > 0 && identity.geometry < last.geometry)
                   : identity.primitive != last.primitive_count || identity.flags != last.flags)
            return bvhd_error_set(error, BVHD_CORRUPT, place("leaf[%" PRIu32 "]", leaf).text,
                                  "not in the order of the primitives");
        count += begins;
        if (begins)
            last = (struct structure_geometry){identity.geometry, identity.flags, leaf, 0};
        last.primitive_count++;
        if (rows)
            rows[count - 1] = last;
    }
    structure->record_count = structure->primitive_count = leaf;
    structure->geometry_count = count;
    return BVHD_OK;
}

static enum bvhd_status open_bottom(struct structure *structure, struct bvhd_error *error)
{
    structure->content = structure->view.lavapipe.kind == LAVAPIPE_AABB ? CONTENT_AABBS : CONTENT_TRIANGLES;
    enum bvhd_status status = list_geometries(structure, NULL, error);
    if (status != BVHD_OK)
        return status;
    structure->geometries =
        memory_array(structure->memory, (uint64_t)structure->geometry_count + 1, sizeof *structure->geometries);
    return structure->geometries ? list_geometries(structure, structure->geometries, error) : no_memory(error);
}

/* The leaves that the boxes of a top level refer to. */
struct referred {
    const struct lavapipe_view *view;
    unsigned char *is_referred; /* by leaf */
};

static void mark_leaves(void *context, const struct lavapipe_box *box, uint32_t level)
{
    const struct referred *referred = context;
    (void)level;
    for (int child = 0; child < 2; child++)
        if (boxes_child_kind(box, child) == LAVAPIPE_INSTANCE)
            referred->is_referred[lavapipe_leaf_index(referred->view, box->children[child])] = 1;
}

static uint64_t handle_of(const struct lavapipe_view *view, uint32_t leaf)
{
    return bytes_get64(view->handles + UINT64_C(8) * leaf);
}

/* Limits the rows and the instances that leaves name, because callers allocate tables of that size. */
static enum bvhd_status check_instances(const struct lavapipe_view *view, struct bvhd_error *error)
{
    for (uint32_t leaf = 0; leaf < view->leaf_count; leaf++) {
        if (handle_of(view, leaf) - 1 >= UINT32_MAX)
            return bvhd_error_set(error, BVHD_CORRUPT, place("handles[%" PRIu32 "]", leaf).text,
                                  "not the row of a reference");
        if (lavapipe_instance_at(view, leaf).instance >= LAVAPIPE_MAX_PRIMITIVES)
            return bvhd_error_set(error, BVHD_CORRUPT, place("leaf[%" PRIu32 "]", leaf).text,
                                  "not the instance of a request");
    }
    return BVHD_OK;
}

static enum bvhd_status open_top(struct structure *structure, struct bvhd_error *error)
{
    const struct lavapipe_view *view = &structure->view.lavapipe;
    uint32_t leaf_count = view->leaf_count;
    enum bvhd_status status = check_instances(view, error);
    if (status != BVHD_OK)
        return status;
    struct referred referred = {view, memory_alloc(structure->memory, leaf_count)};
    structure->instance_rows = memory_array(structure->memory, leaf_count, sizeof *structure->instance_rows);
    if (!referred.is_referred || !structure->instance_rows) {
        memory_free(structure->memory, referred.is_referred);
        return no_memory(error);
    }
    memset(referred.is_referred, 0, leaf_count);
    boxes_visit(view, mark_leaves, &referred);
    for (uint32_t leaf = 0; leaf < leaf_count; leaf++)
        if (referred.is_referred[leaf])
            structure->instance_rows[structure->record_count++] = leaf;
    memory_free(structure->memory, referred.is_referred);
    structure->content = CONTENT_INSTANCES;
    structure->primitive_count = leaf_count;
    return BVHD_OK;
}

static enum bvhd_status open_structure(struct structure *structure, struct bvhd_error *error)
{
    struct lavapipe_view *view = &structure->view.lavapipe;
    enum bvhd_status status = lavapipe_open_any(structure->blob, structure->memory, view, error);
    if (status != BVHD_OK || view->leaf_count == 0)
        return status;
    return view->kind == LAVAPIPE_INSTANCE ? open_top(structure, error) : open_bottom(structure, error);
}

static void get_bounds(const struct structure *structure, float ret_bounds[6])
{
    memcpy(ret_bounds, structure->view.lavapipe.bounds, sizeof structure->view.lavapipe.bounds);
}

static void get_triangle(const struct structure *structure, uint32_t row, float time, float ret_corners[3][3],
                         uint32_t *ret_primitive)
{
    (void)time;
    const struct lavapipe_triangle leaf = lavapipe_triangle_at(&structure->view.lavapipe, row);
    memcpy(ret_corners, leaf.corners, sizeof leaf.corners);
    *ret_primitive = row;
}

static struct structure_instance get_instance(const struct structure *structure, uint32_t row)
{
    const struct lavapipe_view *view = &structure->view.lavapipe;
    uint32_t leaf = structure->instance_rows[row];
    const struct lavapipe_instance record = lavapipe_instance_at(view, leaf);
    struct structure_instance instance = {.instance = record.instance, .bottom = (uint32_t)(handle_of(view, leaf) - 1)};
    memcpy(instance.start, record.object_to_world, sizeof record.object_to_world);
    memcpy(instance.end, record.object_to_world, sizeof record.object_to_world);
    return instance;
}

static const char *content_name(const struct structure *structure)
{
    return content_names[structure->content];
}

/* ---- the survey ---- */

/* The state of a walk over the box nodes. */
struct census {
    const struct lavapipe_view *view;
    struct survey *survey;
    unsigned char *is_referred; /* by leaf: some box refers to it */
    struct box root;
};

static void count_box(void *context, const struct lavapipe_box *box, uint32_t level)
{
    struct census *census = context;
    struct survey *survey = census->survey;
    unsigned children = 0;
    for (int child = 0; child < 2; child++) {
        int kind = boxes_child_kind(box, child);
        struct box bounds;
        if (kind < 0)
            continue;
        memcpy(bounds.min, box->bounds[child].min, sizeof bounds.min);
        memcpy(bounds.max, box->bounds[child].max, sizeof bounds.max);
        if (level == 0)
            box_grow(&census->root, &bounds);
        survey->sah += box_half_area(&bounds);
        children++;
        if (kind == LAVAPIPE_BOX) {
            survey->inner_children++;
            continue;
        }
        survey->leaf_children++;
        survey->leaf_records[1]++;
        census->is_referred[lavapipe_leaf_index(census->view, box->children[child])] = 1;
    }
    survey->nodes++;
    survey->node_children[children]++;
    survey->level_nodes[level]++;
}

static void count_bytes(const struct structure *structure, struct survey *survey)
{
    const struct lavapipe_view *view = &structure->view.lavapipe;
    survey->header_bytes = structure->blob.size - view->body_size + LAVAPIPE_HEADER;
    survey->node_bytes = view->leaf_offset - LAVAPIPE_HEADER;
    survey->record_bytes = survey->records * lavapipe_leaf_size(view->kind);
    survey->other_bytes = structure->blob.size - survey->header_bytes - survey->node_bytes - survey->record_bytes;
    survey->unused_nodes = survey->node_bytes / sizeof(struct lavapipe_box) - survey->nodes;
}

static enum bvhd_status take_survey(const struct structure *structure, struct memory *memory, struct survey *survey)
{
    const struct lavapipe_view *view = &structure->view.lavapipe;
    struct census census = {view, survey, memory_alloc(memory, (uint64_t)view->leaf_count + 1), box_empty()};
    if (!census.is_referred)
        return BVHD_NO_MEMORY;
    memset(census.is_referred, 0, (size_t)view->leaf_count + 1);
    survey->arity = 2;
    survey->leaf_max = 1;
    survey->records = structure->primitive_count;
    survey_add_figure(survey, "variant", view->device.variant);
    survey_add_figure(survey, "leaf_offset", view->leaf_offset);
    boxes_visit(view, count_box, &census);
    count_bytes(structure, survey);
    survey->unreferred_records = survey->records;
    for (uint32_t leaf = 0; leaf < view->leaf_count; leaf++)
        survey->unreferred_records -= census.is_referred[leaf];
    memory_free(memory, census.is_referred);
    bool is_empty = survey->inner_children + survey->leaf_children == 0;
    survey->depth = is_empty ? 0 : view->levels;
    survey->sah = is_empty ? 0 : survey->sah / box_half_area(&census.root) + 1;
    return BVHD_OK;
}

const struct target_reader target_reader_lavapipe = {
    .target = TARGET_LAVAPIPE,
    .is_native = true,
    .open = open_structure,
    .bounds = get_bounds,
    .triangle = get_triangle,
    .instance = get_instance,
    .content_name = content_name,
    .survey = take_survey,
    .invert = lavapipe_invert,
};
