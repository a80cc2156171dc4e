/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/scene/import_nodes.h"

#include <math.h>
#include <string.h>

#include "client/bvhctl/base/files.h"
#include "builder/input/validate.h"

/* A node that has to be visited, with the matrix of its parent, from object to world. */
struct visit {
    const struct aiNode *node;
    double parent[12];
};

struct node_walk {
    const struct import_meshes_of *meshes_of; /* of each mesh of the scene */
    uint32_t scene_mesh_count;
    bool *is_reached; /* for each mesh of the scene: a node has it */
    uint32_t *list; /* the meshes of a node that are of one shape */
    uint64_t list_capacity;
    bool is_broken; /* a node has a mesh that is not there, which assimp never returns if it is right */
    struct visit *stack;
    uint64_t depth, capacity;
    uint32_t *slots; /* hash table of bottom levels by their list of meshes: index + 1, 0 for empty; power of two */
    uint64_t slot_count;
    uint64_t bottom_capacity, instance_capacity;
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

static bool push(struct node_walk *walk, struct memory *memory, const struct aiNode *node, const double parent[12])
{
    void *stack = walk->stack;
    if (!grow(memory, &stack, walk->depth, &walk->capacity, sizeof *walk->stack))
        return false;
    walk->stack = stack;
    struct visit *visit = &walk->stack[walk->depth++];
    visit->node = node;
    memcpy(visit->parent, parent, sizeof visit->parent);
    return true;
}

static void multiply(const double a[12], const struct aiMatrix4x4 *b, double ret_product[12])
{
    const double rows[4][4] = {
        {b->a1, b->a2, b->a3, b->a4}, {b->b1, b->b2, b->b3, b->b4}, {b->c1, b->c2, b->c3, b->c4}, {0, 0, 0, 1}};
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 4; j++) {
            double sum = 0;
            for (int k = 0; k < 4; k++)
                sum += a[4 * i + k] * rows[k][j];
            ret_product[4 * i + j] = sum;
        }
}

static uint64_t hash_list(const uint32_t *list, uint32_t count)
{
    uint64_t hash = 0xcbf29ce484222325u + count;
    for (uint32_t i = 0; i < count; i++)
        hash = (hash ^ list[i]) * 0x100000001b3u;
    return hash ^ hash >> 29;
}

static bool same_list(const struct import_bottom *bottom, const uint32_t *list, uint32_t count)
{
    return bottom->mesh_count == count && !memcmp(bottom->meshes, list, count * sizeof *list);
}

/* Returns the slot that has this list of meshes, or the empty slot for it. */
static uint32_t *find_slot(const struct node_walk *walk, const struct import *import, const uint32_t *list,
                           uint32_t count)
{
    for (uint64_t at = hash_list(list, count);; at++) {
        uint32_t *slot = &walk->slots[at & (walk->slot_count - 1)];
        if (*slot == 0 || same_list(&import->bottoms[*slot - 1], list, count))
            return slot;
    }
}

/* Grows the table so that it is at most half full. Returns false when there is no memory. */
static bool grow_slots(struct node_walk *walk, const struct import *import)
{
    if (walk->slots && import->bottom_count * UINT64_C(2) < walk->slot_count)
        return true;
    uint64_t slot_count = walk->slot_count ? walk->slot_count * 2 : 64;
    uint32_t *slots = memory_array(import->memory, slot_count, sizeof *slots);
    if (!slots)
        return false;
    memset(slots, 0, slot_count * sizeof *slots);
    memory_free(import->memory, walk->slots);
    walk->slots = slots;
    walk->slot_count = slot_count;
    for (uint32_t i = 0; i < import->bottom_count; i++)
        *find_slot(walk, import, import->bottoms[i].meshes, import->bottoms[i].mesh_count) = i + 1;
    return true;
}

static const char *name_of(const struct aiNode *node)
{
    return node->mName.length < sizeof node->mName.data ? node->mName.data : "";
}

static bool add_bottom(struct node_walk *walk, struct import *import, const struct aiNode *node, uint32_t count)
{
    void *bottoms = import->bottoms;
    if (!grow(import->memory, &bottoms, import->bottom_count, &walk->bottom_capacity, sizeof *import->bottoms))
        return false;
    import->bottoms = bottoms;
    struct import_bottom *bottom = &import->bottoms[import->bottom_count++];
    *bottom = (struct import_bottom){.mesh_count = count};
    const char *mesh_name = import->meshes[walk->list[0]].name;
    bottom->name = files_copy_text(import->memory, bottom->mesh_count == 1 && *mesh_name ? mesh_name : name_of(node));
    bottom->meshes = memory_array(import->memory, bottom->mesh_count, sizeof *bottom->meshes);
    if (!bottom->name || !bottom->meshes)
        return false;
    memcpy(bottom->meshes, walk->list, bottom->mesh_count * sizeof *bottom->meshes);
    return true;
}

/*
 * Returns whether the matrix has an inverse, which Vulkan requires
 * (VUID-VkTransformMatrixKHR-matrix-03799), and is finite.
 */
static bool is_usable(const float matrix[12])
{
    for (int i = 0; i < 12; i++)
        if (!isfinite(matrix[i]))
            return false;
    return validate_invertible(matrix);
}

/* Adds an instance of the bottom level of the `count` meshes of walk->list. */
static bool add_instance(struct node_walk *walk, struct import *import, const struct aiNode *node, uint32_t count,
                         const double world[12])
{
    void *instances = import->instances;
    if (!grow(import->memory, &instances, import->instance_count, &walk->instance_capacity, sizeof *import->instances))
        return false;
    import->instances = instances;
    uint32_t *slot = find_slot(walk, import, walk->list, count);
    uint32_t bottom = *slot ? *slot - 1 : import->bottom_count;
    if (*slot == 0) {
        *slot = bottom + 1;
        if (!add_bottom(walk, import, node, count) || !grow_slots(walk, import))
            return false;
    }
    struct import_instance *instance = &import->instances[import->instance_count];
    *instance = (struct import_instance){0};
    if (!import_names_add(&import->node_names, name_of(node), import->memory, &instance->name))
        return false;
    import->instance_count++;
    instance->bottom = bottom;
    for (int i = 0; i < 12; i++)
        instance->transform[i] = (float)world[i];
    instance->skipped = !is_usable(instance->transform);
    import->skipped_instances += instance->skipped;
    return true;
}

/* Marks the meshes of a node. Returns false if one is not there. */
static bool reach_meshes(struct node_walk *walk, const struct aiNode *node)
{
    for (unsigned i = 0; i < node->mNumMeshes; i++) {
        walk->is_broken |= node->mMeshes[i] >= walk->scene_mesh_count;
        if (walk->is_broken)
            return false;
        walk->is_reached[node->mMeshes[i]] = true;
    }
    return true;
}

/*
 * Lists the meshes of a node that are of one shape. Returns their number, or 0 if they have no primitive: they would
 * become an empty bottom level.
 */
static uint32_t list_meshes(struct node_walk *walk, const struct import *import, const struct aiNode *node, int shape)
{
    uint64_t primitives = 0;
    uint32_t count = 0;
    for (unsigned i = 0; i < node->mNumMeshes; i++) {
        uint32_t mesh = walk->meshes_of[node->mMeshes[i]].shapes[shape];
        if (mesh == IMPORT_NO_MESH)
            continue;
        walk->list[count++] = mesh;
        primitives += import->meshes[mesh].primitive_count;
    }
    return primitives ? count : 0;
}

/* Adds an instance for each shape that the meshes of a node have. */
static bool add_node(struct node_walk *walk, struct import *import, const struct aiNode *node, const double world[12])
{
    void *list = walk->list;
    if (!reach_meshes(walk, node))
        return true;
    while (walk->list_capacity < node->mNumMeshes) {
        if (!grow(import->memory, &list, walk->list_capacity, &walk->list_capacity, sizeof *walk->list))
            return false;
        walk->list = list;
    }
    for (int shape = 0; shape < IMPORT_SHAPES; shape++) {
        uint32_t count = list_meshes(walk, import, node, shape);
        if (count && !add_instance(walk, import, node, count, world))
            return false;
    }
    return true;
}

static bool visit_next(struct node_walk *walk, struct import *import)
{
    struct visit visit = walk->stack[--walk->depth];
    double world[12];
    multiply(visit.parent, &visit.node->mTransformation, world);
    if (!add_node(walk, import, visit.node, world))
        return false;
    for (unsigned i = visit.node->mNumChildren; i-- > 0;) /* the first child is on top */
        if (!push(walk, import->memory, visit.node->mChildren[i], world))
            return false;
    return true;
}

enum bvhd_status import_nodes(const struct aiScene *scene, const struct import_meshes_of *meshes_of,
                              struct import *import)
{
    static const double identity[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
    uint32_t mesh_count = scene->mNumMeshes;
    struct node_walk walk = {.meshes_of = meshes_of,
                             .scene_mesh_count = mesh_count,
                             .is_reached = memory_array(import->memory, mesh_count, sizeof *walk.is_reached)};
    if (walk.is_reached)
        memset(walk.is_reached, 0, mesh_count * sizeof *walk.is_reached);
    bool ok = walk.is_reached && grow_slots(&walk, import) && push(&walk, import->memory, scene->mRootNode, identity);
    while (ok && walk.depth && !walk.is_broken)
        ok = visit_next(&walk, import);
    for (uint32_t i = 0; ok && i < mesh_count; i++)
        import->counts.meshes += !walk.is_reached[i];
    memory_free(import->memory, walk.stack);
    memory_free(import->memory, walk.slots);
    memory_free(import->memory, walk.list);
    memory_free(import->memory, walk.is_reached);
    return !ok ? BVHD_NO_MEMORY : walk.is_broken ? BVHD_UNSUPPORTED : BVHD_OK;
}
