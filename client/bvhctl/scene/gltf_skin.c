/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/scene/gltf_skin.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "client/bvhctl/scene/gltf_accessor.h"

enum { SET = 4 }; /* joints of a vertex in one attribute */

/* ---- the joints ---- */

static bool take_columns(const float floats[16], struct gltf_matrix *ret_matrix)
{
    double columns[16];
    for (int i = 0; i < 16; i++)
        columns[i] = floats[i];
    return gltf_matrix_from_columns(columns, ret_matrix);
}

/* Reads a list of columns of four numbers, as in the file. They are affine up to rounding. */
static enum bvhd_status read_inverse_binds(struct gltf_file *file, uint32_t index, struct gltf_skin *skin)
{
    struct gltf_value place = gltf_item(file, GLTF_ACCESSORS, index);
    struct gltf_accessor accessor;
    enum bvhd_status status = gltf_accessor_open_matrices(file, index, &accessor);
    if (status)
        return status;
    if (accessor.elements.count < skin->count)
        return gltf_refuse(file, BVHD_INVALID, &place, "%u inverse bind matrices for the %u joints of skins[%u]",
                           accessor.elements.count, skin->count, skin->index);
    float *columns = memory_array(file->memory, (uint64_t)accessor.elements.count + 1, 16 * sizeof *columns);
    if (!columns)
        return gltf_no_memory(file);
    status = gltf_accessor_floats(file, &accessor, columns);
    for (uint32_t i = 0; i < skin->count && !status; i++)
        if (!take_columns(columns + 16 * (size_t)i, &skin->matrices[i]))
            status = gltf_refuse(file, BVHD_INVALID, &place,
                                 "matrix %u is not finite, or its last row is not 0, 0, 0, 1", i);
    memory_free(file->memory, columns);
    return status;
}

/* Multiplies the matrix of a joint by where its node is. */
static enum bvhd_status place_joint(const struct gltf_file *file, const struct gltf_pose *pose,
                                    const struct gltf_value *joint, struct gltf_matrix *matrix)
{
    uint32_t node = 0;
    enum bvhd_status status = gltf_index(file, joint, GLTF_NODES, &node);
    if (status)
        return status;
    if (!pose->nodes[node].is_placed)
        return gltf_refuse(file, BVHD_INVALID, joint, "nodes[%u] is in no scene that is read", node);
    *matrix = gltf_matrix_product(&pose->nodes[node].world, matrix);
    return BVHD_OK;
}

static enum bvhd_status read_skin(struct gltf_file *file, const struct gltf_pose *pose, uint32_t index,
                                  struct gltf_skin *ret_skin)
{
    struct gltf_value value = gltf_item(file, GLTF_SKINS, index), joints;
    uint32_t binds = 0;
    bool has_binds = false;
    *ret_skin = (struct gltf_skin){.index = index};
    enum bvhd_status status = gltf_array(file, &value, "joints", &joints);
    if (!status && (!joints.json || !joints.json->child))
        status = gltf_refuse(file, BVHD_INVALID, &joints, "a skin has at least one joint");
    if (!status)
        status = gltf_reference(file, &value, "inverseBindMatrices", GLTF_ACCESSORS, &binds, &has_binds);
    if (status)
        return status;
    ret_skin->count = (uint32_t)cJSON_GetArraySize(joints.json);
    ret_skin->matrices = memory_array(file->memory, ret_skin->count, sizeof *ret_skin->matrices);
    if (!ret_skin->matrices)
        return gltf_no_memory(file);
    for (uint32_t i = 0; i < ret_skin->count; i++)
        ret_skin->matrices[i] = gltf_matrix_identity;
    if (has_binds)
        status = read_inverse_binds(file, binds, ret_skin);
    uint32_t number = 0;
    for (const cJSON *item = joints.json->child; item && !status; item = item->next, number++) {
        struct gltf_value joint = gltf_element(&joints, item, number);
        status = place_joint(file, pose, &joint, &ret_skin->matrices[number]);
    }
    return status;
}

enum bvhd_status gltf_skin_get(struct gltf_file *file, const struct gltf_pose *pose, uint32_t index,
                               const struct gltf_skin **ret_skin)
{
    *ret_skin = &pose->skins[index];
    return pose->skins[index].matrices ? BVHD_OK : read_skin(file, pose, index, &pose->skins[index]);
}

void gltf_skin_finish(const struct gltf_file *file, struct gltf_skin *skin)
{
    memory_free(file->memory, skin->matrices);
    *skin = (struct gltf_skin){0};
}

/* ---- the vertices ---- */

/* What is needed to move the vertices of a primitive. */
struct skinning {
    struct gltf_file *file;
    const struct gltf_skin *skin;
    const struct gltf_value *attributes;
    uint32_t vertex_count;
    float *joints, *weights; /* of one set: four for each vertex */
    double *moved; /* xyz of each vertex, summed up over the sets */
    double *sums; /* of the weights of each vertex */
};

/* Reads JOINTS_n or WEIGHTS_n. */
static enum bvhd_status read_set(const struct skinning *skinning, const char *name, bool are_joints, float *ret_floats,
                                 bool *ret_found)
{
    struct gltf_file *file = skinning->file;
    struct gltf_value place = gltf_member(skinning->attributes, name);
    struct gltf_accessor accessor;
    uint32_t index = 0;
    enum bvhd_status status = gltf_reference(file, skinning->attributes, name, GLTF_ACCESSORS, &index, ret_found);
    if (!status && *ret_found)
        status = gltf_accessor_open(file, index, &accessor);
    if (status || !*ret_found)
        return status;
    bool is_small = accessor.component == GLTF_UINT8 || accessor.component == GLTF_UINT16;
    bool fits = are_joints ? is_small && !accessor.is_normalized
                           : accessor.component == GLTF_FLOAT || (is_small && accessor.is_normalized);
    if (accessor.components != SET || !fits)
        return gltf_refuse(file, BVHD_INVALID, &place, "accessors[%u] is no VEC4 of %s", index,
                           are_joints ? "unsigned integers of 8 or 16 bits"
                                      : "floats, or of normalized integers of 8 or 16 bits");
    if (accessor.elements.count != skinning->vertex_count)
        return gltf_refuse(file, BVHD_INVALID, &place, "accessors[%u] has %u elements for %u vertices", index,
                           accessor.elements.count, skinning->vertex_count);
    return gltf_accessor_floats(file, &accessor, ret_floats);
}

/* Adds to a vertex what one joint does with it. */
static void add_joint(const struct gltf_matrix *matrix, double weight, const double *position, double *moved)
{
    for (int row = 0; row < 3; row++) {
        const double *at = matrix->at + 4 * row;
        moved[row] += weight * (at[0] * position[0] + at[1] * position[1] + at[2] * position[2] + at[3]);
    }
}

/* Adds a set of joints and weights, after they were read. */
static enum bvhd_status add_set(const struct skinning *skinning, const struct gltf_value *joints,
                                const struct gltf_value *weights, const double *positions)
{
    for (size_t i = 0; i < skinning->vertex_count; i++)
        for (size_t k = SET * i; k < SET * (i + 1); k++) {
            double weight = skinning->weights[k];
            if (!(skinning->joints[k] < (float)skinning->skin->count))
                return gltf_refuse(skinning->file, BVHD_INVALID, joints,
                                   "vertex %zu names joint %g, but skins[%u] has %u", i, (double)skinning->joints[k],
                                   skinning->skin->index, skinning->skin->count);
            if (!(weight >= 0 && isfinite(weight)))
                return gltf_refuse(skinning->file, BVHD_INVALID, weights, "vertex %zu has the weight %g", i, weight);
            skinning->sums[i] += weight;
            if (weight > 0)
                add_joint(&skinning->skin->matrices[(uint32_t)skinning->joints[k]], weight, positions + 3 * i,
                          skinning->moved + 3 * i);
        }
    return BVHD_OK;
}

static enum bvhd_status add_sets(const struct skinning *skinning, const double *positions)
{
    bool found = true;
    for (int set = 0; found; set++) {
        char joints_name[32], weights_name[32];
        bool has_weights = false;
        snprintf(joints_name, sizeof joints_name, "JOINTS_%d", set);
        snprintf(weights_name, sizeof weights_name, "WEIGHTS_%d", set);
        struct gltf_value joints = gltf_member(skinning->attributes, joints_name);
        struct gltf_value weights = gltf_member(skinning->attributes, weights_name);
        enum bvhd_status status = read_set(skinning, joints_name, true, skinning->joints, &found);
        if (!status)
            status = read_set(skinning, weights_name, false, skinning->weights, &has_weights);
        if (!status && (found != has_weights || (set == 0 && !found)))
            status = gltf_refuse(skinning->file, BVHD_INVALID, found ? &weights : &joints, "missing");
        if (!status && found)
            status = add_set(skinning, &joints, &weights, positions);
        if (status)
            return status;
    }
    return BVHD_OK;
}

static enum bvhd_status take_moved(const struct skinning *skinning, double *positions)
{
    struct gltf_value weights = gltf_member(skinning->attributes, "WEIGHTS_0");
    for (size_t i = 0; i < skinning->vertex_count; i++) {
        if (!(skinning->sums[i] > 0))
            return gltf_refuse(skinning->file, BVHD_INVALID, &weights, "all weights of vertex %zu are 0", i);
        for (size_t k = 0; k < 3; k++)
            positions[3 * i + k] = skinning->moved[3 * i + k] / skinning->sums[i];
    }
    return BVHD_OK;
}

enum bvhd_status gltf_skin_apply(struct gltf_file *file, const struct gltf_skin *skin,
                                 const struct gltf_value *primitive, uint32_t vertex_count, double *positions)
{
    struct gltf_value attributes = gltf_member(primitive, "attributes");
    uint64_t room = (uint64_t)vertex_count + 1;
    struct skinning skinning = {.file = file,
                                .skin = skin,
                                .attributes = &attributes,
                                .vertex_count = vertex_count,
                                .joints = memory_array(file->memory, room, SET * sizeof(float)),
                                .weights = memory_array(file->memory, room, SET * sizeof(float)),
                                .moved = memory_array(file->memory, room, 3 * sizeof(double)),
                                .sums = memory_array(file->memory, room, sizeof(double))};
    enum bvhd_status status = BVHD_OK;
    if (!skinning.joints || !skinning.weights || !skinning.moved || !skinning.sums) {
        status = gltf_no_memory(file);
    } else {
        memset(skinning.moved, 0, room * 3 * sizeof(double));
        memset(skinning.sums, 0, room * sizeof(double));
        status = add_sets(&skinning, positions);
        if (!status)
            status = take_moved(&skinning, positions);
    }
    memory_free(file->memory, skinning.joints);
    memory_free(file->memory, skinning.weights);
    memory_free(file->memory, skinning.moved);
    memory_free(file->memory, skinning.sums);
    return status;
}
