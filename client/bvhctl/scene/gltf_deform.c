/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/scene/gltf_deform.h"

#include <math.h>
#include <string.h>

#include "client/bvhctl/scene/gltf_accessor.h"
#include "client/bvhctl/scene/gltf_skin.h"

/* What deforms the primitives of one form of a mesh. */
struct deformer {
    struct gltf_file *file;
    const double *weights; /* of morph targets; NULL: those that were read, or none */
    double *read_weights;
    uint32_t weight_count;
    struct gltf_value weights_place;
    const struct gltf_skin *skin; /* NULL: there is none */
};

enum bvhd_status gltf_deform_targets(const struct gltf_file *file, const struct gltf_value *node, uint32_t *ret_count)
{
    uint32_t index = 0;
    bool found = false;
    *ret_count = 0;
    enum bvhd_status status = gltf_reference(file, node, "mesh", GLTF_MESHES, &index, &found);
    if (status || !found)
        return status;
    struct gltf_value mesh = gltf_item(file, GLTF_MESHES, index), primitives, targets;
    status = gltf_array(file, &mesh, "primitives", &primitives);
    if (status || !primitives.json || !primitives.json->child)
        return status;
    struct gltf_value primitive = gltf_element(&primitives, primitives.json->child, 0);
    status = gltf_array(file, &primitive, "targets", &targets);
    *ret_count = status ? 0 : (uint32_t)cJSON_GetArraySize(targets.json);
    return status;
}

/* ---- morph targets ---- */

static enum bvhd_status read_weights(struct deformer *deformer, const struct gltf_value *list)
{
    struct gltf_file *file = deformer->file;
    uint64_t count = (uint64_t)cJSON_GetArraySize(list->json);
    deformer->read_weights = memory_array(file->memory, count + 1, sizeof *deformer->read_weights);
    if (!deformer->read_weights)
        return gltf_no_memory(file);
    for (const cJSON *item = list->json->child; item; item = item->next) {
        struct gltf_value place = gltf_element(list, item, deformer->weight_count);
        if (!cJSON_IsNumber(item) || !isfinite(item->valuedouble))
            return gltf_refuse(file, BVHD_INVALID, &place, "not a finite number");
        deformer->read_weights[deformer->weight_count++] = item->valuedouble;
    }
    deformer->weights = deformer->read_weights;
    return BVHD_OK;
}

/* Finds the weights of a form: those of the animation, else those of its node, else those of its mesh. */
static enum bvhd_status find_weights(struct deformer *deformer, const struct gltf_posed_node *posed,
                                     const struct gltf_value *node, const struct gltf_value *mesh)
{
    deformer->weights_place = gltf_member(node, "weights");
    if (posed && posed->weights) {
        deformer->weights = posed->weights;
        deformer->weight_count = posed->weight_count;
        return BVHD_OK;
    }
    if (!deformer->weights_place.json)
        deformer->weights_place = gltf_member(mesh, "weights");
    if (!deformer->weights_place.json)
        return BVHD_OK;
    if (!cJSON_IsArray(deformer->weights_place.json))
        return gltf_refuse(deformer->file, BVHD_INVALID, &deformer->weights_place, "no array");
    return read_weights(deformer, &deformer->weights_place);
}

/* Adds the weighted displacements of one morph target. */
static enum bvhd_status add_target(const struct deformer *deformer, const struct gltf_value *target, double weight,
                                   uint32_t vertex_count, double *positions)
{
    struct gltf_file *file = deformer->file;
    struct gltf_value place = gltf_member(target, "POSITION");
    struct gltf_accessor accessor;
    uint32_t index = 0;
    bool found = false;
    enum bvhd_status status = gltf_reference(file, target, "POSITION", GLTF_ACCESSORS, &index, &found);
    if (!status && found)
        status = gltf_accessor_open(file, index, &accessor);
    if (status || !found)
        return status;
    if (accessor.components != 3 || accessor.component == GLTF_UINT32 || accessor.elements.count != vertex_count)
        return gltf_refuse(file, BVHD_INVALID, &place,
                           "accessors[%u] is no VEC3 of floats, or of 8 or 16 bit integers, for each of %u vertices",
                           index, vertex_count);
    float *moves = memory_array(file->memory, (uint64_t)vertex_count + 1, 3 * sizeof *moves);
    if (!moves)
        return gltf_no_memory(file);
    status = gltf_accessor_floats(file, &accessor, moves);
    for (size_t i = 0; i < 3 * (size_t)vertex_count && !status; i++) {
        positions[i] += weight * (double)moves[i];
        if (!isfinite(moves[i]))
            status = gltf_refuse(file, BVHD_INVALID, &place, "the displacement of vertex %zu is not finite", i / 3);
    }
    memory_free(file->memory, moves);
    return status;
}

/* Targets whose weight is 0 are not read: files have many of them, of which few are on at a time. */
static enum bvhd_status add_targets(const struct deformer *deformer, const struct gltf_value *primitive,
                                    uint32_t vertex_count, double *positions)
{
    struct gltf_value targets = gltf_member(primitive, "targets");
    enum bvhd_status status = BVHD_OK;
    uint32_t count = (uint32_t)cJSON_GetArraySize(targets.json), number = 0;
    if (!deformer->weights)
        return BVHD_OK;
    if (count != deformer->weight_count) {
        struct gltf_value place = deformer->weights_place.json ? deformer->weights_place : targets;
        return gltf_refuse(deformer->file, BVHD_INVALID, &place, "%u weights for %u morph targets",
                           deformer->weight_count, count);
    }
    for (const cJSON *item = count ? targets.json->child : NULL; item && !status; item = item->next, number++) {
        struct gltf_value target = gltf_element(&targets, item, number);
        if (!cJSON_IsObject(item))
            status = gltf_refuse(deformer->file, BVHD_INVALID, &target, "not an object");
        else if (deformer->weights[number] < 0 || deformer->weights[number] > 0)
            status = add_target(deformer, &target, deformer->weights[number], vertex_count, positions);
    }
    return status;
}

/* ---- a primitive, and all of a form ---- */

static void drop_normals(struct gltf_file *file, struct import_mesh *mesh)
{
    memory_free(file->memory, mesh->look.normals);
    mesh->look.normals = NULL;
}

static enum bvhd_status deform_primitive(const struct deformer *deformer, const struct gltf_value *primitive,
                                         struct import_mesh *mesh)
{
    struct gltf_file *file = deformer->file;
    size_t count = 3 * (size_t)mesh->vertex_count;
    double *positions = memory_array(file->memory, (uint64_t)mesh->vertex_count + 1, 3 * sizeof *positions);
    if (!positions)
        return gltf_no_memory(file);
    for (size_t i = 0; i < count; i++)
        positions[i] = mesh->positions[i];
    enum bvhd_status status = add_targets(deformer, primitive, mesh->vertex_count, positions);
    if (!status && deformer->skin)
        status = gltf_skin_apply(file, deformer->skin, primitive, mesh->vertex_count, positions);
    for (size_t i = 0; i < count && !status; i++)
        mesh->positions[i] = (float)positions[i];
    drop_normals(file, mesh);
    memory_free(file->memory, positions);
    return status;
}

static enum bvhd_status deform_primitives(const struct deformer *deformer, const struct gltf_value *mesh,
                                          struct import_mesh *meshes)
{
    struct gltf_value primitives = gltf_member(mesh, "primitives");
    enum bvhd_status status = BVHD_OK;
    uint32_t number = 0;
    for (const cJSON *item = primitives.json ? primitives.json->child : NULL; item && !status; item = item->next) {
        struct gltf_value primitive = gltf_element(&primitives, item, number);
        if (meshes[number].primitive_count)
            status = deform_primitive(deformer, &primitive, &meshes[number]);
        number++;
    }
    return status;
}

enum bvhd_status gltf_deform(struct gltf_file *file, const struct gltf_pose *pose, const struct gltf_form *form,
                             struct import_mesh *meshes)
{
    struct deformer deformer = {.file = file};
    struct gltf_value mesh = gltf_item(file, GLTF_MESHES, form->mesh), node = {0};
    const struct gltf_posed_node *posed = form->is_own ? &pose->nodes[form->first_node] : NULL;
    uint32_t skin = 0;
    bool has_skin = false;
    if (form->is_own)
        node = gltf_item(file, GLTF_NODES, form->first_node);
    enum bvhd_status status = find_weights(&deformer, posed, &node, &mesh);
    if (!status && form->is_own)
        status = gltf_reference(file, &node, "skin", GLTF_SKINS, &skin, &has_skin);
    if (!status && has_skin)
        status = gltf_skin_get(file, pose, skin, &deformer.skin);
    if (!status && (deformer.weights || deformer.skin))
        status = deform_primitives(&deformer, &mesh, meshes);
    memory_free(file->memory, deformer.read_weights);
    return status;
}
