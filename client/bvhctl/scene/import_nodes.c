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
    bool *is_reached; /* for each mesh: a node has it */
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

static uint64_t hash_list(const unsigned *list, uint32_t count)
{
    uint64_t hash = 0xcbf29ce484222325u + count;
    for (uint32_t i = 0; i < count; i++)
        hash = (hash ^ list[i]) * 0x100000001b3u;
    return hash ^ hash >> 29;
}

static bool same_list(const struct import_bottom *bottom, const unsigned *list, uint32_t count)
{
    return bottom->mesh_count == count && !memcmp(bottom->meshes, list, count * sizeof *list);
}

/* Returns the slot that has this list of meshes, or the empty slot for it. */
static uint32_t *find_slot(const struct node_walk *walk, const struct import *import, const unsigned *list,
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

static bool add_bottom(struct node_walk *walk, struct import *import, const struct aiNode *node)
{
    void *bottoms = import->bottoms;
    if (!grow(import->memory, &bottoms, import->bottom_count, &walk->bottom_capacity, sizeof *import->bottoms))
        return false;
    import->bottoms = bottoms;
    struct import_bottom *bottom = &import->bottoms[import->bottom_count++];
    *bottom = (struct import_bottom){.mesh_count = node->mNumMeshes};
    const char *mesh_name = import->meshes[node->mMeshes[0]].name;
    bottom->name = files_copy_text(import->memory, bottom->mesh_count == 1 && *mesh_name ? mesh_name : name_of(node));
    bottom->meshes = memory_array(import->memory, bottom->mesh_count, sizeof *bottom->meshes);
    if (!bottom->name || !bottom->meshes)
        return false;
    memcpy(bottom->meshes, node->mMeshes, bottom->mesh_count * sizeof *bottom->meshes);
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

static bool add_instance(struct node_walk *walk, struct import *import, const struct aiNode *node,
                         const double world[12])
{
    void *instances = import->instances;
    if (!grow(import->memory, &instances, import->instance_count, &walk->instance_capacity, sizeof *import->instances))
        return false;
    import->instances = instances;
    uint32_t *slot = find_slot(walk, import, node->mMeshes, node->mNumMeshes);
    uint32_t bottom = *slot ? *slot - 1 : import->bottom_count;
    if (*slot == 0) {
        *slot = bottom + 1;
        if (!add_bottom(walk, import, node) || !grow_slots(walk, import))
            return false;
    }
    struct import_instance *instance = &import->instances[import->instance_count];
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

/* Nodes with only points and lines are left out, because they would become a bottom level without a triangle. */
static bool has_triangles(struct node_walk *walk, const struct import *import, const struct aiNode *node)
{
    uint64_t triangles = 0;
    for (unsigned i = 0; i < node->mNumMeshes; i++) {
        walk->is_broken |= node->mMeshes[i] >= import->mesh_count;
        if (walk->is_broken)
            return false;
        walk->is_reached[node->mMeshes[i]] = true;
        triangles += import->meshes[node->mMeshes[i]].triangle_count;
    }
    return triangles > 0;
}

static bool visit_next(struct node_walk *walk, struct import *import)
{
    struct visit visit = walk->stack[--walk->depth];
    double world[12];
    multiply(visit.parent, &visit.node->mTransformation, world);
    if (has_triangles(walk, import, visit.node) && !add_instance(walk, import, visit.node, world))
        return false;
    for (unsigned i = visit.node->mNumChildren; i-- > 0;) /* the first child is on top */
        if (!push(walk, import->memory, visit.node->mChildren[i], world))
            return false;
    return true;
}

enum bvhd_status import_nodes(const struct aiScene *scene, struct import *import)
{
    static const double identity[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
    struct node_walk walk = {.is_reached = memory_array(import->memory, import->mesh_count, sizeof *walk.is_reached)};
    if (walk.is_reached)
        memset(walk.is_reached, 0, import->mesh_count * sizeof *walk.is_reached);
    bool ok = walk.is_reached && grow_slots(&walk, import) && push(&walk, import->memory, scene->mRootNode, identity);
    while (ok && walk.depth && !walk.is_broken)
        ok = visit_next(&walk, import);
    for (uint32_t i = 0; ok && i < import->mesh_count; i++)
        import->counts.meshes += !walk.is_reached[i];
    memory_free(import->memory, walk.stack);
    memory_free(import->memory, walk.slots);
    memory_free(import->memory, walk.is_reached);
    return !ok ? BVHD_NO_MEMORY : walk.is_broken ? BVHD_UNSUPPORTED : BVHD_OK;
}
