/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/scene/gltf_pose.h"

#include <math.h>
#include <string.h>

#include "client/bvhctl/scene/gltf_accessor.h"
#include "client/bvhctl/scene/gltf_deform.h"
#include "client/bvhctl/scene/gltf_named.h"
#include "client/bvhctl/scene/gltf_sampler.h"
#include "client/bvhctl/scene/gltf_skin.h"

/* The property of a node that a channel sets. */
enum path { TRANSLATION, ROTATION, SCALE, WEIGHTS, PATHS };

static const char *const path_names[PATHS] = {"translation", "rotation", "scale", "weights"};

/* An accessor that was decoded, which several samplers may share. */
struct decoded {
    struct gltf_accessor accessor;
    float *floats; /* NULL: it was not decoded yet */
    bool are_times; /* they are finite and ascend */
};

struct reader {
    struct gltf_file *file;
    struct gltf_pose *pose;
    double time;
    struct decoded *decoded; /* one for each accessor of the file */
    const cJSON **samplers; /* of the animation */
    uint32_t sampler_count;
};

static enum bvhd_status decode(struct reader *reader, const struct gltf_value *sampler, const char *member,
                               uint32_t *ret_index)
{
    struct gltf_value place = gltf_member(sampler, member);
    bool found;
    enum bvhd_status status = gltf_reference(reader->file, sampler, member, GLTF_ACCESSORS, ret_index, &found);
    if (status || !found)
        return status ? status : gltf_refuse(reader->file, BVHD_INVALID, &place, "missing");
    struct decoded *decoded = &reader->decoded[*ret_index];
    if (decoded->floats)
        return BVHD_OK;
    status = gltf_accessor_open(reader->file, *ret_index, &decoded->accessor);
    if (status)
        return status;
    uint64_t count = (uint64_t)decoded->accessor.elements.count * decoded->accessor.components;
    decoded->floats = memory_array(reader->file->memory, count + 1, sizeof *decoded->floats);
    if (!decoded->floats)
        return gltf_no_memory(reader->file);
    status = gltf_accessor_floats(reader->file, &decoded->accessor, decoded->floats);
    for (uint64_t i = 0; i < count && !status; i++)
        if (!isfinite(decoded->floats[i])) {
            place = gltf_item(reader->file, GLTF_ACCESSORS, *ret_index);
            status = gltf_refuse(reader->file, BVHD_INVALID, &place, "element %llu is not finite",
                                 (unsigned long long)(i / decoded->accessor.components));
        }
    return status;
}

static enum bvhd_status check_times(const struct reader *reader, uint32_t index)
{
    struct decoded *decoded = &reader->decoded[index];
    struct gltf_value place = gltf_item(reader->file, GLTF_ACCESSORS, index);
    uint32_t count = decoded->accessor.elements.count;
    if (decoded->are_times)
        return BVHD_OK;
    if (decoded->accessor.component != GLTF_FLOAT || decoded->accessor.components != 1 || count == 0)
        return gltf_refuse(reader->file, BVHD_INVALID, &place, "times of keys are SCALARs of floats, at least one");
    if (decoded->floats[0] < 0)
        return gltf_refuse(reader->file, BVHD_INVALID, &place, "the first time of a key is negative");
    for (uint32_t i = 1; i < count; i++)
        if (!(decoded->floats[i] > decoded->floats[i - 1]))
            return gltf_refuse(reader->file, BVHD_INVALID, &place, "time %g at %u is not after the one before it",
                               (double)decoded->floats[i], i);
    decoded->are_times = true;
    return BVHD_OK;
}

static enum bvhd_status read_interpolation(const struct reader *reader, const struct gltf_value *value,
                                           enum gltf_interpolation *ret_interpolation)
{
    static const char *const names[] = {
        [GLTF_LINEAR] = "LINEAR", [GLTF_STEP] = "STEP", [GLTF_CUBICSPLINE] = "CUBICSPLINE"};
    struct gltf_value place = gltf_member(value, "interpolation");
    const char *text = gltf_text(value, "interpolation");
    *ret_interpolation = GLTF_LINEAR;
    if (!place.json)
        return BVHD_OK;
    for (int i = GLTF_LINEAR; text && i <= GLTF_CUBICSPLINE; i++)
        if (!strcmp(text, names[i])) {
            *ret_interpolation = (enum gltf_interpolation)i;
            return BVHD_OK;
        }
    return gltf_refuse(reader->file, BVHD_INVALID, &place, "none of LINEAR, STEP, CUBICSPLINE");
}

/* Checks the values of a sampler against what the property needs. `width` is the count of weights, or 3 or 4. */
static enum bvhd_status check_values(const struct reader *reader, const struct gltf_value *value, enum path path,
                                     const struct decoded *values, const struct gltf_sampler *sampler)
{
    struct gltf_value place = gltf_member(value, "output");
    const struct gltf_accessor *accessor = &values->accessor;
    uint32_t components = path == WEIGHTS ? 1 : sampler->width;
    bool may_be_integer = path == ROTATION || path == WEIGHTS;
    uint64_t keys = (uint64_t)sampler->count * (sampler->interpolation == GLTF_CUBICSPLINE ? 3 : 1);
    uint64_t wanted = keys * (path == WEIGHTS ? sampler->width : 1);
    if (accessor->components != components ||
        !(accessor->component == GLTF_FLOAT || (may_be_integer && accessor->is_normalized)))
        return gltf_refuse(reader->file, BVHD_INVALID, &place, "accessors[%u] has not the type of a %s",
                           accessor->index, path_names[path]);
    if (accessor->elements.count != wanted)
        return gltf_refuse(reader->file, BVHD_INVALID, &place, "accessors[%u] has %u elements, but %u keys need %llu",
                           accessor->index, accessor->elements.count, sampler->count, (unsigned long long)wanted);
    return BVHD_OK;
}

/* Reads a sampler for values of `width` numbers. Its arrays belong to the reader. */
static enum bvhd_status read_sampler(struct reader *reader, const struct gltf_value *value, enum path path,
                                     uint32_t width, struct gltf_sampler *ret_sampler)
{
    struct gltf_sampler sampler = {.is_rotation = path == ROTATION, .width = width};
    uint32_t input = 0, output = 0;
    if (!cJSON_IsObject(value->json))
        return gltf_refuse(reader->file, BVHD_INVALID, value, "not an object");
    enum bvhd_status status = read_interpolation(reader, value, &sampler.interpolation);
    if (!status)
        status = decode(reader, value, "input", &input);
    if (!status)
        status = check_times(reader, input);
    if (!status)
        status = decode(reader, value, "output", &output);
    if (status)
        return status;
    sampler.count = reader->decoded[input].accessor.elements.count;
    sampler.times = reader->decoded[input].floats;
    sampler.values = reader->decoded[output].floats;
    *ret_sampler = sampler;
    return check_values(reader, value, path, &reader->decoded[output], &sampler);
}

/* Keeps what a sampler says about a property of a node. */
static enum bvhd_status take_value(const struct reader *reader, const struct gltf_sampler *sampler, enum path path,
                                   struct gltf_posed_node *node)
{
    double *const vectors[WEIGHTS] = {node->animated.trs.translation, node->animated.trs.rotation,
                                      node->animated.trs.scale};
    bool *const flags[WEIGHTS] = {&node->animated.has_translation, &node->animated.has_rotation,
                                  &node->animated.has_scale};
    if (path != WEIGHTS) {
        *flags[path] = true;
        gltf_sampler_at(sampler, reader->time, vectors[path]);
        return BVHD_OK;
    }
    node->weight_count = sampler->width;
    node->weights = memory_array(reader->file->memory, (uint64_t)sampler->width + 1, sizeof *node->weights);
    if (!node->weights)
        return gltf_no_memory(reader->file);
    gltf_sampler_at(sampler, reader->time, node->weights);
    return BVHD_OK;
}

/* A channel of the animation that says something about a node. */
struct channel {
    struct gltf_value target;
    uint32_t node;
    enum path path;
    uint32_t width; /* numbers in a value */
};

/* Checks that the node of a channel has the property, and that no other channel has set it. */
static enum bvhd_status check_target(const struct reader *reader, struct channel *channel)
{
    struct gltf_file *file = reader->file;
    const struct gltf_posed_node *posed = &reader->pose->nodes[channel->node];
    struct gltf_value node = gltf_item(file, GLTF_NODES, channel->node);
    const bool is_set[PATHS] = {posed->animated.has_translation, posed->animated.has_rotation,
                                posed->animated.has_scale, posed->weights != NULL};
    if (is_set[channel->path])
        return gltf_refuse(file, BVHD_INVALID, &channel->target, "another channel sets the %s of nodes[%u], too",
                           path_names[channel->path], channel->node);
    if (channel->path != WEIGHTS && gltf_member(&node, "matrix").json)
        return gltf_refuse(file, BVHD_INVALID, &channel->target, "nodes[%u] has a matrix, which cannot be animated",
                           channel->node);
    channel->width = channel->path == ROTATION ? 4 : 3;
    if (channel->path != WEIGHTS)
        return BVHD_OK;
    enum bvhd_status status = gltf_deform_targets(file, &node, &channel->width);
    return status || channel->width
               ? status
               : gltf_refuse(file, BVHD_INVALID, &channel->target, "nodes[%u] has no morph targets", channel->node);
}

/* Finds the path of a channel. Returns false for one that only an extension knows. */
static bool find_path(const struct gltf_value *target, enum path *ret_path)
{
    const char *text = gltf_text(target, "path");
    for (int i = 0; text && i < PATHS; i++)
        if (!strcmp(text, path_names[i])) {
            *ret_path = (enum path)i;
            return true;
        }
    return false;
}

static enum bvhd_status read_channel(struct reader *reader, const struct gltf_value *value,
                                     const struct gltf_value *samplers)
{
    struct gltf_file *file = reader->file;
    struct channel channel = {.target = gltf_member(value, "target")};
    struct gltf_value place = gltf_member(value, "sampler");
    struct gltf_sampler sampler;
    bool found = false;
    uint64_t number = 0;
    if (!cJSON_IsObject(value->json) || !cJSON_IsObject(channel.target.json))
        return gltf_refuse(file, BVHD_INVALID, value, "not an object with a target");
    enum bvhd_status status = gltf_reference(file, &channel.target, "node", GLTF_NODES, &channel.node, &found);
    if (!status && (!found || !find_path(&channel.target, &channel.path))) {
        file->counts->channels++;
        return BVHD_OK;
    }
    if (!status)
        status = gltf_integer(file, value, "sampler", (struct gltf_range){0, UINT32_MAX - 1, true, 0}, &number);
    if (!status && number >= reader->sampler_count)
        status = gltf_refuse(file, BVHD_INVALID, &place, "samplers[%llu] does not exist: there are %u",
                             (unsigned long long)number, reader->sampler_count);
    if (!status)
        status = check_target(reader, &channel);
    if (status)
        return status;
    struct gltf_value at = gltf_element(samplers, reader->samplers[number], (int64_t)number);
    status = read_sampler(reader, &at, channel.path, channel.width, &sampler);
    return status ? status : take_value(reader, &sampler, channel.path, &reader->pose->nodes[channel.node]);
}

/* Makes an array of the list of samplers, because cJSON's lists have to be walked from their start. */
static enum bvhd_status list_samplers(struct reader *reader, const struct gltf_value *list)
{
    uint64_t count = (uint64_t)cJSON_GetArraySize(list->json);
    reader->samplers = memory_array(reader->file->memory, count + 1, sizeof *reader->samplers);
    if (!reader->samplers)
        return gltf_no_memory(reader->file);
    for (const cJSON *item = list->json ? list->json->child : NULL; item; item = item->next)
        reader->samplers[reader->sampler_count++] = item;
    return BVHD_OK;
}

static enum bvhd_status read_animation(struct reader *reader, uint32_t index)
{
    struct gltf_value animation = gltf_item(reader->file, GLTF_ANIMATIONS, index), channels, samplers;
    enum bvhd_status status = gltf_array(reader->file, &animation, "channels", &channels);
    if (!status)
        status = gltf_array(reader->file, &animation, "samplers", &samplers);
    if (!status)
        status = list_samplers(reader, &samplers);
    int64_t number = 0;
    for (const cJSON *item = !status && channels.json ? channels.json->child : NULL; item && !status;
         item = item->next) {
        struct gltf_value channel = gltf_element(&channels, item, number++);
        status = read_channel(reader, &channel, &samplers);
    }
    return status;
}

/* Finds the animation that is meant: that of the moment, else the first one, if the file has any. */
static enum bvhd_status choose(const struct gltf_file *file, const struct import_moment *moment, struct gltf_pose *pose)
{
    pose->has_animation = moment->animation || file->lists[GLTF_ANIMATIONS].count > 0;
    return moment->animation ? gltf_named_find(file, GLTF_ANIMATIONS, moment->animation, &pose->animation) : BVHD_OK;
}

enum bvhd_status gltf_pose_read(struct gltf_file *file, const struct import_moment *moment, struct gltf_pose *ret_pose)
{
    uint64_t nodes = (uint64_t)file->lists[GLTF_NODES].count + 1;
    uint64_t accessors = (uint64_t)file->lists[GLTF_ACCESSORS].count + 1;
    uint64_t skins = (uint64_t)file->lists[GLTF_SKINS].count + 1;
    struct reader reader = {.file = file, .pose = ret_pose, .time = moment->time};
    *ret_pose = (struct gltf_pose){.nodes = memory_array(file->memory, nodes, sizeof *ret_pose->nodes),
                                   .skins = memory_array(file->memory, skins, sizeof *ret_pose->skins)};
    reader.decoded = memory_array(file->memory, accessors, sizeof *reader.decoded);
    enum bvhd_status status = ret_pose->nodes && ret_pose->skins && reader.decoded ? BVHD_OK : gltf_no_memory(file);
    if (ret_pose->nodes)
        memset(ret_pose->nodes, 0, nodes * sizeof *ret_pose->nodes);
    if (ret_pose->skins)
        memset(ret_pose->skins, 0, skins * sizeof *ret_pose->skins);
    if (!status) {
        memset(reader.decoded, 0, accessors * sizeof *reader.decoded);
        status = choose(file, moment, ret_pose);
        if (!status && ret_pose->has_animation)
            status = read_animation(&reader, ret_pose->animation);
        for (uint64_t i = 0; i < accessors; i++)
            memory_free(file->memory, reader.decoded[i].floats);
    }
    memory_free(file->memory, reader.samplers);
    memory_free(file->memory, reader.decoded);
    return status;
}

void gltf_pose_finish(const struct gltf_file *file, struct gltf_pose *pose)
{
    for (uint32_t i = 0; pose->nodes && i < file->lists[GLTF_NODES].count; i++)
        memory_free(file->memory, pose->nodes[i].weights);
    for (uint32_t i = 0; pose->skins && i < file->lists[GLTF_SKINS].count; i++)
        gltf_skin_finish(file, &pose->skins[i]);
    memory_free(file->memory, pose->nodes);
    memory_free(file->memory, pose->skins);
    *pose = (struct gltf_pose){0};
}
