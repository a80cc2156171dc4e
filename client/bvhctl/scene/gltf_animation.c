/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/scene/gltf_animation.h"

#include <math.h>
#include <string.h>

#include "client/bvhctl/scene/gltf_accessor.h"
#include "client/bvhctl/scene/gltf_deform.h"

static const char *const path_names[GLTF_PATHS] = {"translation", "rotation", "scale", "weights"};

/* An accessor that was decoded, which several samplers may share. */
struct gltf_decoded {
    struct gltf_accessor accessor;
    float *floats; /* NULL: it was not decoded yet */
    bool are_times; /* they are finite and ascend */
};

struct reader {
    struct gltf_file *file;
    struct gltf_animation *animation;
    const cJSON **samplers; /* of the animation */
    uint32_t sampler_count;
    uint8_t *set; /* for each node, a bit for each path that a channel has set */
};

static enum bvhd_status decode(struct reader *reader, const struct gltf_value *sampler, const char *member,
                               uint32_t *ret_index)
{
    struct gltf_value place = gltf_member(sampler, member);
    bool found;
    enum bvhd_status status = gltf_reference(reader->file, sampler, member, GLTF_ACCESSORS, ret_index, &found);
    if (status || !found)
        return status ? status : gltf_refuse(reader->file, BVHD_INVALID, &place, "missing");
    struct gltf_decoded *decoded = &reader->animation->decoded[*ret_index];
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
    struct gltf_decoded *decoded = &reader->animation->decoded[index];
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
static enum bvhd_status check_values(const struct reader *reader, const struct gltf_value *value, enum gltf_path path,
                                     const struct gltf_decoded *values, const struct gltf_sampler *sampler)
{
    struct gltf_value place = gltf_member(value, "output");
    const struct gltf_accessor *accessor = &values->accessor;
    uint32_t components = path == GLTF_WEIGHTS ? 1 : sampler->width;
    bool may_be_integer = path == GLTF_ROTATION || path == GLTF_WEIGHTS;
    uint64_t keys = (uint64_t)sampler->count * (sampler->interpolation == GLTF_CUBICSPLINE ? 3 : 1);
    uint64_t wanted = keys * (path == GLTF_WEIGHTS ? sampler->width : 1);
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
static enum bvhd_status read_sampler(struct reader *reader, const struct gltf_value *value, enum gltf_path path,
                                     uint32_t width, struct gltf_sampler *ret_sampler)
{
    struct gltf_sampler sampler = {.is_rotation = path == GLTF_ROTATION, .width = width};
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
    sampler.count = reader->animation->decoded[input].accessor.elements.count;
    sampler.times = reader->animation->decoded[input].floats;
    sampler.values = reader->animation->decoded[output].floats;
    *ret_sampler = sampler;
    return check_values(reader, value, path, &reader->animation->decoded[output], &sampler);
}

/* What a channel of the animation says something about. */
struct target {
    struct gltf_value value;
    uint32_t node;
    enum gltf_path path;
    uint32_t width; /* numbers in a value */
};

/* Checks that the node of a channel has the property, and that no other channel has set it. */
static enum bvhd_status check_target(const struct reader *reader, struct target *target)
{
    struct gltf_file *file = reader->file;
    struct gltf_value node = gltf_item(file, GLTF_NODES, target->node);
    if (reader->set[target->node] >> target->path & 1)
        return gltf_refuse(file, BVHD_INVALID, &target->value, "another channel sets the %s of nodes[%u], too",
                           path_names[target->path], target->node);
    if (target->path != GLTF_WEIGHTS && gltf_member(&node, "matrix").json)
        return gltf_refuse(file, BVHD_INVALID, &target->value, "nodes[%u] has a matrix, which cannot be animated",
                           target->node);
    target->width = target->path == GLTF_ROTATION ? 4 : 3;
    if (target->path != GLTF_WEIGHTS)
        return BVHD_OK;
    enum bvhd_status status = gltf_deform_targets(file, &node, &target->width);
    return status || target->width
               ? status
               : gltf_refuse(file, BVHD_INVALID, &target->value, "nodes[%u] has no morph targets", target->node);
}

/* Finds the path of a target. Returns false for one that only an extension knows. */
static bool find_path(const struct gltf_value *target, enum gltf_path *ret_path)
{
    const char *text = gltf_text(target, "path");
    for (int i = 0; text && i < GLTF_PATHS; i++)
        if (!strcmp(text, path_names[i])) {
            *ret_path = (enum gltf_path)i;
            return true;
        }
    return false;
}

static enum bvhd_status read_channel(struct reader *reader, const struct gltf_value *value,
                                     const struct gltf_value *samplers)
{
    struct gltf_file *file = reader->file;
    struct target target = {.value = gltf_member(value, "target")};
    struct gltf_value place = gltf_member(value, "sampler");
    struct gltf_sampler sampler;
    bool found = false;
    uint64_t number = 0;
    if (!cJSON_IsObject(value->json) || !cJSON_IsObject(target.value.json))
        return gltf_refuse(file, BVHD_INVALID, value, "not an object with a target");
    enum bvhd_status status = gltf_reference(file, &target.value, "node", GLTF_NODES, &target.node, &found);
    if (!status && (!found || !find_path(&target.value, &target.path))) {
        file->counts->channels++;
        return BVHD_OK;
    }
    if (!status)
        status = gltf_integer(file, value, "sampler", (struct gltf_range){0, UINT32_MAX - 1, true, 0}, &number);
    if (!status && number >= reader->sampler_count)
        status = gltf_refuse(file, BVHD_INVALID, &place, "samplers[%llu] does not exist: there are %u",
                             (unsigned long long)number, reader->sampler_count);
    if (!status)
        status = check_target(reader, &target);
    if (status)
        return status;
    struct gltf_value at = gltf_element(samplers, reader->samplers[number], (int64_t)number);
    status = read_sampler(reader, &at, target.path, target.width, &sampler);
    if (status)
        return status;
    struct gltf_animation *animation = reader->animation;
    reader->set[target.node] |= (uint8_t)(1 << target.path);
    animation->channels[animation->count++] = (struct gltf_channel){target.node, target.path, sampler};
    return BVHD_OK;
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

/* Makes room for all channels, and for the marks of the nodes. */
static enum bvhd_status make_tables(struct reader *reader, const struct gltf_value *channels)
{
    struct gltf_file *file = reader->file;
    struct gltf_animation *animation = reader->animation;
    uint64_t count = channels->json ? (uint64_t)cJSON_GetArraySize(channels->json) : 0;
    uint64_t nodes = (uint64_t)file->lists[GLTF_NODES].count + 1;
    uint64_t accessors = (uint64_t)file->lists[GLTF_ACCESSORS].count + 1;
    animation->channels = memory_array(file->memory, count + 1, sizeof *animation->channels);
    animation->decoded = memory_array(file->memory, accessors, sizeof *animation->decoded);
    reader->set = memory_array(file->memory, nodes, sizeof *reader->set);
    if (animation->decoded)
        memset(animation->decoded, 0, accessors * sizeof *animation->decoded);
    if (reader->set)
        memset(reader->set, 0, nodes * sizeof *reader->set);
    return animation->channels && animation->decoded && reader->set ? BVHD_OK : gltf_no_memory(file);
}

enum bvhd_status gltf_animation_read(struct gltf_file *file, uint32_t index, struct gltf_animation *ret_animation)
{
    struct reader reader = {.file = file, .animation = ret_animation};
    struct gltf_value animation = gltf_item(file, GLTF_ANIMATIONS, index), channels, samplers;
    *ret_animation = (struct gltf_animation){0};
    enum bvhd_status status = gltf_array(file, &animation, "channels", &channels);
    if (!status)
        status = gltf_array(file, &animation, "samplers", &samplers);
    if (!status)
        status = list_samplers(&reader, &samplers);
    if (!status)
        status = make_tables(&reader, &channels);
    int64_t number = 0;
    for (const cJSON *item = !status && channels.json ? channels.json->child : NULL; item && !status;
         item = item->next) {
        struct gltf_value channel = gltf_element(&channels, item, number++);
        status = read_channel(&reader, &channel, &samplers);
    }
    memory_free(file->memory, reader.samplers);
    memory_free(file->memory, reader.set);
    return status;
}

void gltf_animation_finish(const struct gltf_file *file, struct gltf_animation *animation)
{
    for (uint32_t i = 0; animation->decoded && i < file->lists[GLTF_ACCESSORS].count; i++)
        memory_free(file->memory, animation->decoded[i].floats);
    memory_free(file->memory, animation->decoded);
    memory_free(file->memory, animation->channels);
    *animation = (struct gltf_animation){0};
}
