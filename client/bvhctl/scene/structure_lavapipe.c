/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/scene/structure_lavapipe.h"

#include <inttypes.h>
#include <string.h>

#include "client/bvhctl/scene/boxes.h"
#include "proto/base/place.h"

static enum bvhd_status no_memory(struct bvhd_error *error)
{
    return bvhd_error_set(error, BVHD_NO_MEMORY, "leaves", "no memory to count them");
}

/* What a leaf says of the primitive that it is. */
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

/* The padding behind the last leaf can look like another one. */
static bool is_padding(const struct lavapipe_view *view, uint32_t leaf, const struct identity *identity)
{
    return leaf > 0 && leaf + 1 == view->leaf_count && identity->geometry == 0 && identity->primitive == 0 &&
           identity->flags == 0;
}

/* Counts geometries and, when there is room for them, lists them. Leaves are in the order of primitives. */
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
    if (status)
        return status;
    structure->geometries =
        memory_array(structure->memory, (uint64_t)structure->geometry_count + 1, sizeof *structure->geometries);
    return structure->geometries ? list_geometries(structure, structure->geometries, error) : no_memory(error);
}

/* The leaves of a top level that some box refers to. */
struct referred {
    const struct lavapipe_view *view;
    unsigned char *is_referred;
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

/* Tables are made for as many references and instances as leaves name. */
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
    if (status)
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

enum bvhd_status structure_lavapipe_open(struct structure *structure, struct bvhd_error *error)
{
    struct lavapipe_view *view = &structure->view.lavapipe;
    enum bvhd_status status = lavapipe_open_any(structure->blob, structure->memory, view, error);
    if (status)
        return status;
    structure->target = TARGET_LAVAPIPE;
    if (view->leaf_count == 0)
        return BVHD_OK;
    return view->kind == LAVAPIPE_INSTANCE ? open_top(structure, error) : open_bottom(structure, error);
}

struct structure_instance structure_lavapipe_instance(const struct structure *structure, uint32_t row)
{
    const struct lavapipe_view *view = &structure->view.lavapipe;
    uint32_t leaf = structure->instance_rows[row];
    const struct lavapipe_instance record = lavapipe_instance_at(view, leaf);
    struct structure_instance instance = {.instance = record.instance, .bottom = (uint32_t)(handle_of(view, leaf) - 1)};
    memcpy(instance.object_to_world, record.object_to_world, sizeof instance.object_to_world);
    return instance;
}
