/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/piece/binned.h"

#include "builder/kernel/bins.h"
#include "builder/piece/full_sweep.h"
#include "proto/base/parallel.h"

/* A set of nodes that is still to be divided, as refs whose ids are the nodes' numbers. */
struct node_set {
    struct vec4_box centroids;
    struct primitive_ref *refs, *other; /* where the refs lie, and where they may be moved */
    uint32_t count;
    uint32_t *ret_node; /* receives the number of the set's root */
};

/* A node above the sets, before it has a number. */
struct unnumbered_node {
    uint32_t children[2];
    uint32_t *ret_node;
};

static void divide(const struct node_set *set, struct unnumbered_node *division, struct node_set ret_children[2])
{
    struct bins_mapping mapping;
    struct bins_plane plane;
    struct vec4_box centroids[2];
    /* Sets are divided as spatial.c divides refs, without cuts. */
    bool halved = !bins_find(set->refs, set->count, &set->centroids, &mapping, &plane);
    if (halved)
        bins_halve(set->refs, set->count, &plane, centroids);
    else
        bins_partition(&mapping, &plane, set->refs, set->count, set->other, set->other + plane.left_count, centroids);
    uint32_t left = plane.left_count;
    struct primitive_ref *refs = halved ? set->refs : set->other, *other = halved ? set->other : set->refs;
    division->ret_node = set->ret_node;
    ret_children[0] = (struct node_set){centroids[0], refs, other, left, &division->children[0]};
    ret_children[1] =
        (struct node_set){centroids[1], refs + left, other + left, set->count - left, &division->children[1]};
}

static inline float cost_of_two(const struct cluster_tree *tree, uint32_t left, uint32_t right)
{
    return vec4_box_half_area(cluster_box_of_two(tree, left, right)) + tree->facts[left].cost + tree->facts[right].cost;
}

/*
 * Tree rotation (Kensler 2008): exchanges a child of `node` with a child of its other child, if that makes the other
 * child cheaper.
 */
static void rotate(struct cluster_tree *tree, uint32_t node)
{
    const struct primitive_ref *own = cluster_tree_node(tree, node);
    uint32_t children[2] = {own->link & ~CLUSTER_BECOMES_LEAF, own->id & ~CLUSTER_BECOMES_LEAF};
    float best = tree->facts[children[0]].cost + tree->facts[children[1]].cost;
    uint32_t low = 0, up = 0, stays = 0, side = 2;
    for (uint32_t i = 0; i < 2; i++) {
        uint32_t inner = children[i], other = children[1 - i];
        if (inner < tree->leaf_count)
            continue;
        const struct primitive_ref *ref = cluster_tree_node(tree, inner);
        uint32_t left = ref->link & ~CLUSTER_BECOMES_LEAF, right = ref->id & ~CLUSTER_BECOMES_LEAF;
        float right_stays = cost_of_two(tree, other, right) + tree->facts[left].cost;
        float left_stays = cost_of_two(tree, other, left) + tree->facts[right].cost;
        if (right_stays < best) {
            best = right_stays;
            side = i, low = other, up = left, stays = right;
        }
        if (left_stays < best) {
            best = left_stays;
            side = i, low = other, up = right, stays = left;
        }
    }
    if (side != 2) {
        cluster_tree_set(tree, children[side], stays, low);
        children[1 - side] = up;
    }
    cluster_tree_set(tree, node, children[0], children[1]);
}

/*
 * Improves the nodes above the swept sets: they are few, most rays pass them, and bins considered only a few planes for
 * them. Further passes find nothing more.
 */
static void rotate_above(struct cluster_tree *tree, uint32_t first)
{
    enum { PASSES = 3 };
    for (int pass = 0; pass < PASSES; pass++)
        for (uint32_t node = first; node < tree->node_count; node++)
            rotate(tree, node);
}

static uint32_t sweep_set(struct cluster_tree *tree, const struct node_set *set)
{
    struct full_sweep_pair pairs[FULL_SWEEP_MOST];
    uint32_t nodes[2 * FULL_SWEEP_MOST], count = set->count;
    full_sweep(set->refs, count, pairs);
    for (uint32_t i = 0; i < count; i++)
        nodes[i] = set->refs[i].id;
    for (uint32_t i = 0; i + 1 < count; i++)
        nodes[count + i] = cluster_tree_join(tree, nodes[pairs[i].left], nodes[pairs[i].right]);
    return nodes[2 * count - 2];
}

/*
 * Divides a set down to sets that can be swept. The larger child waits while the smaller one is divided, so at most 32
 * wait. Returns false when cancelled.
 */
static bool divide_set(struct cluster_tree *tree, struct node_set set, struct unnumbered_node *divisions)
{
    struct node_set waiting[33], children[2];
    uint32_t waiting_count = 0, division_count = 0;
    for (;;) {
        if (set.count > FULL_SWEEP_MOST) {
            if (parallel_cancelled(tree->request->cancel))
                return false;
            divide(&set, &divisions[division_count++], children);
            bool right_first = children[1].count < children[0].count;
            waiting[waiting_count++] = children[!right_first];
            set = children[right_first];
            continue;
        }
        *set.ret_node = sweep_set(tree, &set);
        if (waiting_count == 0)
            break;
        set = waiting[--waiting_count];
    }
    /* Divisions are listed parents first, so going backwards finds the children joined. */
    const uint32_t first = tree->node_count;
    while (division_count-- > 0) {
        const struct unnumbered_node *division = &divisions[division_count];
        *division->ret_node = cluster_tree_join(tree, division->children[0], division->children[1]);
    }
    if (!tree->request->fills_leaves)
        rotate_above(tree, first);
    return true;
}

enum bvhd_status binned_join_nodes(struct cluster_tree *tree, const uint32_t *nodes, uint32_t count,
                                   struct memory *memory, uint32_t *ret_root)
{
    struct unnumbered_node *divisions = memory_array(memory, count, sizeof *divisions);
    struct primitive_ref *refs = memory_array(memory, 2 * (uint64_t)count, sizeof *refs);
    enum bvhd_status status = BVHD_NO_MEMORY;
    if (divisions && refs) {
        struct node_set set = {.refs = refs, .other = refs + count, .count = count, .ret_node = ret_root};
        for (uint32_t i = 0; i < count; i++) {
            uint32_t node = nodes ? nodes[i] : i;
            vec4_box_store(&refs[i], vec4_box_load(cluster_tree_node(tree, node)));
            refs[i].id = node;
        }
        set.centroids = bins_centroids(refs, count);
        status = divide_set(tree, set, divisions) ? BVHD_OK : BVHD_CANCELLED;
    }
    memory_free(memory, divisions);
    memory_free(memory, refs);
    return status;
}

enum bvhd_status binned_join(struct cluster_tree *tree, struct memory *memory, uint32_t *ret_root)
{
    return binned_join_nodes(tree, NULL, tree->leaf_count, memory, ret_root);
}
