/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/scene/gltf_nodes.h"

#include <string.h>

#include "client/bvhctl/scene/gltf_accessor.h"
#include "client/bvhctl/scene/gltf_transform.h"

/* A node that has to be visited, with its parent and the matrix of it, from object to world. */
struct node_visit {
    uint32_t node, parent; /* GLTF_NO_NODE: none */
    struct gltf_matrix parent_world;
};

struct walk {
    struct gltf_file *file;
    struct import *import;
    struct gltf_pose *pose; /* NULL: at rest */
    struct gltf_forms *forms;
    struct gltf_spot **spots; /* NULL: not wanted */
    bool *is_reached; /* for each node */
    struct node_visit *stack;
    uint64_t depth, stack_capacity, instance_capacity, spot_capacity;
};

static bool grow(struct memory *memory, void **array, uint64_t used, uint64_t *capacity, size_t size)
{
    if (used < *capacity)
        return true;
    uint64_t wanted = *capacity * 2 + 64;
    void *grown = memory_resize(memory, *array, wanted * size);
    if (!grown)
        return false;
    *array = grown;
    *capacity = wanted;
    return true;
}

static enum bvhd_status push(struct walk *walk, const struct gltf_value *place, uint32_t node, uint32_t parent,
                             const struct gltf_matrix *parent_world)
{
    if (walk->is_reached[node])
        return gltf_refuse(walk->file, BVHD_INVALID, place, "nodes[%u] is reached twice: nodes must be trees", node);
    void *stack = walk->stack;
    if (!grow(walk->file->memory, &stack, walk->depth, &walk->stack_capacity, sizeof *walk->stack))
        return gltf_no_memory(walk->file);
    walk->is_reached[node] = true;
    walk->stack = stack;
    walk->stack[walk->depth++] = (struct node_visit){node, parent, *parent_world};
    return BVHD_OK;
}

/* The values that all instances at one node share. */
struct node_use {
    uint32_t form, name, node;
    bool is_still;
};

/* Records where an instance is. `local` is NULL if that is its node. */
static bool add_spot(struct walk *walk, const struct node_use *use, const struct gltf_matrix *local)
{
    void *spots = walk->spots ? *walk->spots : NULL;
    if (!walk->spots)
        return true;
    if (!grow(walk->file->memory, &spots, walk->import->instance_count, &walk->spot_capacity, sizeof **walk->spots))
        return false;
    *walk->spots = spots;
    (*walk->spots)[walk->import->instance_count] =
        (struct gltf_spot){.node = use->node, .is_still = use->is_still, .has_local = local != NULL};
    if (local)
        (*walk->spots)[walk->import->instance_count].local = *local;
    return true;
}

static enum bvhd_status add_instance(struct walk *walk, const struct node_use *use, const struct gltf_matrix *world,
                                     const struct gltf_matrix *local)
{
    struct import *import = walk->import;
    void *instances = import->instances;
    if (import->instance_count == UINT32_MAX || !add_spot(walk, use, local) ||
        !grow(import->memory, &instances, import->instance_count, &walk->instance_capacity, sizeof *import->instances))
        return gltf_no_memory(walk->file);
    import->instances = instances;
    struct import_instance *instance = &import->instances[import->instance_count++];
    *instance = (struct import_instance){.bottom = use->form, .name = use->name};
    instance->skipped = !gltf_matrix_round(world, instance->transform);
    import->skipped_instances += instance->skipped;
    return BVHD_OK;
}

/* The three attributes of EXT_mesh_gpu_instancing. */
enum { TRANSLATION, ROTATION, SCALE, ATTRIBUTES };

struct instancing {
    struct gltf_accessor accessors[ATTRIBUTES];
    float *values[ATTRIBUTES]; /* NULL: the file does not have this one */
    uint32_t count;
};

static enum bvhd_status read_attribute(struct walk *walk, const struct gltf_value *attributes, int attribute,
                                       struct instancing *instancing, bool *ret_found)
{
    static const char *const names[ATTRIBUTES] = {"TRANSLATION", "ROTATION", "SCALE"};
    struct gltf_file *file = walk->file;
    struct gltf_accessor *accessor = &instancing->accessors[attribute];
    struct gltf_value place = gltf_member(attributes, names[attribute]);
    uint32_t index = 0;
    enum bvhd_status status = gltf_reference(file, attributes, names[attribute], GLTF_ACCESSORS, &index, ret_found);
    if (!status && *ret_found)
        status = gltf_accessor_open(file, index, accessor);
    if (status || !*ret_found)
        return status;
    if (accessor->components != (attribute == ROTATION ? 4 : 3))
        return gltf_refuse(file, BVHD_INVALID, &place, "accessors[%u] has the wrong type", index);
    uint64_t floats = (uint64_t)accessor->elements.count * accessor->components;
    instancing->values[attribute] = memory_array(file->memory, floats + 1, sizeof(float));
    return instancing->values[attribute] ? gltf_accessor_floats(file, accessor, instancing->values[attribute])
                                         : gltf_no_memory(file);
}

static enum bvhd_status read_instancing(struct walk *walk, const struct gltf_value *attributes,
                                        struct instancing *instancing)
{
    bool any = false, found = false;
    for (int i = 0; i < ATTRIBUTES; i++) {
        enum bvhd_status status = read_attribute(walk, attributes, i, instancing, &found);
        if (status)
            return status;
        if (found && any && instancing->accessors[i].elements.count != instancing->count)
            return gltf_refuse(walk->file, BVHD_INVALID, attributes, "the attributes have different counts");
        instancing->count = found ? instancing->accessors[i].elements.count : instancing->count;
        any |= found;
    }
    return any ? BVHD_OK
               : gltf_refuse(walk->file, BVHD_INVALID, attributes, "neither TRANSLATION nor ROTATION nor SCALE");
}

static struct gltf_trs instance_trs(const struct instancing *instancing, uint32_t i)
{
    struct gltf_trs trs = gltf_trs_identity;
    for (size_t k = 0; k < 3; k++) {
        if (instancing->values[TRANSLATION])
            trs.translation[k] = instancing->values[TRANSLATION][3 * (size_t)i + k];
        if (instancing->values[SCALE])
            trs.scale[k] = instancing->values[SCALE][3 * (size_t)i + k];
    }
    for (size_t k = 0; k < 4 && instancing->values[ROTATION]; k++)
        trs.rotation[k] = instancing->values[ROTATION][4 * (size_t)i + k];
    if (instancing->accessors[ROTATION].is_normalized) /* rounded to integers, it is no unit quaternion any more */
        gltf_trs_normalize(&trs);
    return trs;
}

static enum bvhd_status add_instanced(struct walk *walk, const struct gltf_value *extension, const struct node_use *use,
                                      const struct gltf_matrix *world)
{
    struct instancing instancing = {0};
    struct gltf_value attributes = gltf_member(extension, "attributes");
    enum bvhd_status status = read_instancing(walk, &attributes, &instancing);
    for (uint32_t i = 0; i < instancing.count && !status; i++) {
        struct gltf_trs trs = instance_trs(&instancing, i);
        struct gltf_matrix local = gltf_trs_matrix(&trs), product = gltf_matrix_product(world, &local);
        status = add_instance(walk, use, &product, &local);
    }
    for (int i = 0; i < ATTRIBUTES; i++)
        memory_free(walk->file->memory, instancing.values[i]);
    return status;
}

/* Adds a form of a mesh. Returns false if there is no memory. */
static bool add_form(struct walk *walk, const struct gltf_form *form, uint32_t *ret_form)
{
    struct gltf_forms *forms = walk->forms;
    struct gltf_form_list *list = &forms->lists[form->mesh];
    void *items = forms->items;
    if (forms->count == UINT32_MAX - 1 ||
        !grow(walk->file->memory, &items, forms->count, &forms->capacity, sizeof *forms->items))
        return false;
    forms->items = items;
    *ret_form = forms->count++;
    forms->items[*ret_form] = *form;
    if (list->last)
        forms->items[list->last - 1].next = forms->count;
    list->first = list->first ? list->first : forms->count;
    list->last = forms->count;
    return true;
}

/* Finds the form in which a node shows its mesh, or adds it. Returns false if there is no memory. */
static bool find_form(struct walk *walk, const struct gltf_value *node, uint32_t index, uint32_t mesh,
                      uint32_t *ret_form)
{
    struct gltf_form form = {.mesh = mesh, .first_node = index, .is_skinned = gltf_member(node, "skin").json != NULL};
    uint32_t *common = &walk->forms->lists[mesh].common;
    form.is_own = walk->pose &&
                  (form.is_skinned || walk->pose->nodes[index].weights || gltf_member(node, "weights").json != NULL);
    if (form.is_own)
        return add_form(walk, &form, ret_form);
    if (!*common && add_form(walk, &form, ret_form))
        *common = *ret_form + 1;
    if (!*common)
        return false;
    *ret_form = *common - 1;
    walk->forms->items[*ret_form].is_skinned |= form.is_skinned;
    return true;
}

static enum bvhd_status add_mesh(struct walk *walk, const struct gltf_value *node, uint32_t index,
                                 const struct gltf_matrix *world)
{
    struct node_use at_node = {.node = index};
    bool found;
    uint32_t mesh;
    struct gltf_value extensions, extension = gltf_extension(node, "EXT_mesh_gpu_instancing", &extensions);
    enum bvhd_status status = gltf_reference(walk->file, node, "mesh", GLTF_MESHES, &mesh, &found);
    if (status || !found)
        return status;
    if (!import_names_add(&walk->import->node_names, gltf_text(node, "name"), walk->file->memory, &at_node.name) ||
        !find_form(walk, node, index, mesh, &at_node.form))
        return gltf_no_memory(walk->file);
    bool is_skinned = walk->pose && walk->forms->items[at_node.form].is_skinned;
    if (is_skinned && extension.json)
        return gltf_refuse(walk->file, BVHD_UNSUPPORTED, &extension, "a skinned mesh is not instanced");
    if (extension.json)
        return add_instanced(walk, &extension, &at_node, world);
    at_node.is_still = is_skinned;
    return add_instance(walk, &at_node, is_skinned ? &gltf_matrix_identity : world, NULL);
}

static enum bvhd_status place_node(struct walk *walk, const struct gltf_value *node, const struct node_visit *visit,
                                   struct gltf_matrix *ret_world)
{
    struct gltf_local local;
    enum bvhd_status status = gltf_transform_read(walk->file, node, &local);
    if (status)
        return status;
    struct gltf_matrix matrix = gltf_transform_matrix(&local, NULL);
    *ret_world = walk->pose ? *gltf_pose_place(walk->pose, visit->node, visit->parent, &local)
                            : gltf_matrix_product(&visit->parent_world, &matrix);
    return BVHD_OK;
}

/* Pushes nodes so that the first one is on top of the stack. */
static enum bvhd_status push_nodes(struct walk *walk, const struct gltf_value *list, uint32_t parent,
                                   const struct gltf_matrix *parent_world, bool may_be_reached)
{
    uint64_t first = walk->depth;
    int64_t number = 0;
    for (const cJSON *item = list->json ? list->json->child : NULL; item; item = item->next, number++) {
        struct gltf_value place = gltf_element(list, item, number);
        uint32_t node = 0;
        enum bvhd_status status = gltf_index(walk->file, &place, GLTF_NODES, &node);
        if (!status && may_be_reached && walk->is_reached[node])
            continue;
        if (!status)
            status = push(walk, &place, node, parent, parent_world);
        if (status)
            return status;
    }
    for (uint64_t low = first, high = walk->depth; low + 1 < high; low++, high--) {
        struct node_visit swapped = walk->stack[low];
        walk->stack[low] = walk->stack[high - 1];
        walk->stack[high - 1] = swapped;
    }
    return BVHD_OK;
}

static enum bvhd_status visit_all(struct walk *walk)
{
    enum bvhd_status status = BVHD_OK;
    while (walk->depth && !status) {
        struct node_visit visit = walk->stack[--walk->depth];
        struct gltf_value node = gltf_item(walk->file, GLTF_NODES, visit.node), children;
        struct gltf_matrix world;
        status = place_node(walk, &node, &visit, &world);
        if (!status)
            status = add_mesh(walk, &node, visit.node, &world);
        if (!status)
            status = gltf_array(walk->file, &node, "children", &children);
        if (!status)
            status = push_nodes(walk, &children, visit.node, &world, false);
    }
    return status;
}

/* Scenes may share their roots, which become instances once. */
static enum bvhd_status walk_scene(struct walk *walk, uint32_t index)
{
    struct gltf_value scene = gltf_item(walk->file, GLTF_SCENES, index), nodes;
    enum bvhd_status status = gltf_array(walk->file, &scene, "nodes", &nodes);
    if (!status)
        status = push_nodes(walk, &nodes, GLTF_NO_NODE, &gltf_matrix_identity, true);
    return status ? status : visit_all(walk);
}

/* Walks from all nodes that are no children, of a file without scenes. */
static enum bvhd_status walk_roots(struct walk *walk, bool *is_child)
{
    struct gltf_file *file = walk->file;
    enum bvhd_status status = BVHD_OK;
    for (uint32_t i = 0; i < file->lists[GLTF_NODES].count && !status; i++) {
        struct gltf_value node = gltf_item(file, GLTF_NODES, i), children;
        status = gltf_array(file, &node, "children", &children);
        int64_t number = 0;
        for (const cJSON *item = children.json ? children.json->child : NULL; item && !status; item = item->next) {
            struct gltf_value place = gltf_element(&children, item, number++);
            uint32_t child = 0;
            status = gltf_index(file, &place, GLTF_NODES, &child);
            is_child[child] |= !status;
        }
    }
    for (uint32_t i = 0; i < file->lists[GLTF_NODES].count && !status; i++) {
        if (is_child[i])
            continue;
        struct gltf_value node = gltf_item(file, GLTF_NODES, i);
        status = push(walk, &node, i, GLTF_NO_NODE, &gltf_matrix_identity);
        if (!status)
            status = visit_all(walk);
    }
    return status;
}

static void count_unreached(struct walk *walk)
{
    for (uint32_t i = 0; i < walk->file->lists[GLTF_NODES].count; i++) {
        struct gltf_value node = gltf_item(walk->file, GLTF_NODES, i);
        walk->file->counts->nodes += !walk->is_reached[i] && gltf_member(&node, "mesh").json;
    }
}

static enum bvhd_status walk_scenes(struct walk *walk, uint32_t scene, bool *is_child)
{
    uint32_t count = walk->file->lists[GLTF_SCENES].count;
    if (scene != (uint32_t)GLTF_ALL_SCENES)
        return walk_scene(walk, scene);
    enum bvhd_status status = count ? BVHD_OK : walk_roots(walk, is_child);
    for (uint32_t i = 0; i < count && !status; i++)
        status = walk_scene(walk, i);
    count_unreached(walk);
    return status;
}

enum bvhd_status gltf_nodes_walk(struct gltf_file *file, uint32_t scene, struct gltf_pose *pose, struct import *import,
                                 struct gltf_forms *ret_forms, struct gltf_spot **ret_spots)
{
    uint64_t count = file->lists[GLTF_NODES].count;
    struct walk walk = {.file = file, .import = import, .pose = pose, .forms = ret_forms, .spots = ret_spots};
    walk.is_reached = memory_array(file->memory, count + 1, sizeof *walk.is_reached);
    bool *is_child = memory_array(file->memory, count + 1, sizeof *is_child);
    enum bvhd_status status = walk.is_reached && is_child ? BVHD_OK : gltf_no_memory(file);
    if (!status) {
        memset(walk.is_reached, 0, count * sizeof *walk.is_reached);
        memset(is_child, 0, count * sizeof *is_child);
        status = walk_scenes(&walk, scene, is_child);
    }
    memory_free(file->memory, is_child);
    memory_free(file->memory, walk.is_reached);
    memory_free(file->memory, walk.stack);
    return status;
}
