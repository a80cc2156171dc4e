/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/scene/gltf_pose.h"

#include <string.h>

#include "client/bvhctl/scene/gltf_named.h"
#include "client/bvhctl/scene/gltf_skin.h"

/* ---- what the animation says ---- */

/* Evaluates a channel. The weights of a node have their room. */
static void evaluate(const struct gltf_channel *channel, double time, struct gltf_posed_node *node)
{
    double *const values[GLTF_PATHS] = {node->animated.trs.translation, node->animated.trs.rotation,
                                        node->animated.trs.scale, node->weights};
    gltf_sampler_at(&channel->sampler, time, values[channel->path]);
}

/* Marks what a channel sets, and makes room for weights. */
static enum bvhd_status mark(const struct gltf_file *file, const struct gltf_channel *channel,
                             struct gltf_posed_node *node)
{
    node->animated.has_translation |= channel->path == GLTF_TRANSLATION;
    node->animated.has_rotation |= channel->path == GLTF_ROTATION;
    node->animated.has_scale |= channel->path == GLTF_SCALE;
    node->moves |= channel->path != GLTF_WEIGHTS;
    if (channel->path != GLTF_WEIGHTS)
        return BVHD_OK;
    node->weight_count = channel->sampler.width;
    node->weights = memory_array(file->memory, (uint64_t)node->weight_count + 1, sizeof *node->weights);
    return node->weights ? BVHD_OK : gltf_no_memory(file);
}

static enum bvhd_status read_animation(struct gltf_file *file, double time, struct gltf_pose *pose)
{
    enum bvhd_status status = gltf_animation_read(file, pose->index, &pose->animation);
    for (uint32_t i = 0; i < pose->animation.count && !status; i++) {
        const struct gltf_channel *channel = &pose->animation.channels[i];
        struct gltf_posed_node *node = &pose->nodes[channel->node];
        status = mark(file, channel, node);
        if (!status)
            evaluate(channel, time, node);
    }
    return status;
}

/* Finds the animation that is meant: that of the moment, else the first one, if the file has any. */
static enum bvhd_status choose(const struct gltf_file *file, const struct import_moment *moment, struct gltf_pose *pose)
{
    pose->has_animation = moment->animation || file->lists[GLTF_ANIMATIONS].count > 0;
    return moment->animation ? gltf_named_find(file, GLTF_ANIMATIONS, moment->animation, &pose->index) : BVHD_OK;
}

enum bvhd_status gltf_pose_read(struct gltf_file *file, const struct import_moment *moment, struct gltf_pose *ret_pose)
{
    uint64_t nodes = (uint64_t)file->lists[GLTF_NODES].count + 1;
    uint64_t skins = (uint64_t)file->lists[GLTF_SKINS].count + 1;
    *ret_pose = (struct gltf_pose){.nodes = memory_array(file->memory, nodes, sizeof *ret_pose->nodes),
                                   .placed = memory_array(file->memory, nodes, sizeof *ret_pose->placed),
                                   .skins = memory_array(file->memory, skins, sizeof *ret_pose->skins)};
    enum bvhd_status status = ret_pose->nodes && ret_pose->placed && ret_pose->skins ? BVHD_OK : gltf_no_memory(file);
    if (ret_pose->nodes)
        memset(ret_pose->nodes, 0, nodes * sizeof *ret_pose->nodes);
    if (ret_pose->skins)
        memset(ret_pose->skins, 0, skins * sizeof *ret_pose->skins);
    if (!status)
        status = choose(file, moment, ret_pose);
    if (!status && ret_pose->has_animation)
        status = read_animation(file, moment->time, ret_pose);
    return status;
}

/* ---- where the nodes are ---- */

static void find_world(struct gltf_pose *pose, struct gltf_posed_node *node)
{
    struct gltf_matrix matrix = gltf_transform_matrix(&node->local, &node->animated);
    const struct gltf_matrix *parent =
        node->parent == GLTF_NO_NODE ? &gltf_matrix_identity : &pose->nodes[node->parent].world;
    node->world = gltf_matrix_product(parent, &matrix);
}

const struct gltf_matrix *gltf_pose_place(struct gltf_pose *pose, uint32_t node, uint32_t parent,
                                          const struct gltf_local *local)
{
    struct gltf_posed_node *posed = &pose->nodes[node];
    pose->placed[pose->placed_count++] = node;
    posed->is_placed = true;
    posed->moves |= parent != GLTF_NO_NODE && pose->nodes[parent].moves;
    posed->parent = parent;
    posed->local = *local;
    find_world(pose, posed);
    return &posed->world;
}

static void finish_skins(const struct gltf_file *file, struct gltf_pose *pose)
{
    for (uint32_t i = 0; pose->skins && i < file->lists[GLTF_SKINS].count; i++)
        gltf_skin_finish(file, &pose->skins[i]);
}

void gltf_pose_move(const struct gltf_file *file, struct gltf_pose *pose, double time)
{
    for (uint32_t i = 0; i < pose->animation.count; i++)
        evaluate(&pose->animation.channels[i], time, &pose->nodes[pose->animation.channels[i].node]);
    for (uint32_t i = 0; i < pose->placed_count; i++)
        if (pose->nodes[pose->placed[i]].moves)
            find_world(pose, &pose->nodes[pose->placed[i]]);
    finish_skins(file, pose);
}

void gltf_pose_finish(const struct gltf_file *file, struct gltf_pose *pose)
{
    for (uint32_t i = 0; pose->nodes && i < file->lists[GLTF_NODES].count; i++)
        memory_free(file->memory, pose->nodes[i].weights);
    finish_skins(file, pose);
    gltf_animation_finish(file, &pose->animation);
    memory_free(file->memory, pose->nodes);
    memory_free(file->memory, pose->placed);
    memory_free(file->memory, pose->skins);
    *pose = (struct gltf_pose){0};
}
