/* SPDX-License-Identifier: Apache-2.0 */
#include <cjson/cJSON.h>
#include <float.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "client/bvhctl/base/files.h"
#include "builder/format/layout.h"
#include "client/bvhctl/scene/manifest_internal.h"

/* The state of the reader, with its place in the manifest for errors. */
struct manifest_reader {
    struct memory *memory;
    struct bvhd_error *error;
    char path[BVHD_WHERE_SIZE];
    uint32_t entry;
};

static enum bvhd_status corrupt(const struct manifest_reader *reader, const char *member, const char *text)
{
    char where[BVHD_WHERE_SIZE + 64];
    snprintf(where, sizeof where, "%.60s: structures[%u].%s", reader->path, reader->entry, member);
    return bvhd_error_set(reader->error, BVHD_CORRUPT, where, "%s", text);
}

static enum bvhd_status no_memory(const struct manifest_reader *reader)
{
    return bvhd_error_no_memory(reader->error, reader->path, "no memory for the manifest");
}

/* Returns whether the name is that of a file in the same directory. */
static bool is_plain_name(const char *name)
{
    return *name && !strchr(name, '/') && strcmp(name, ".") && strcmp(name, "..");
}

static enum bvhd_status read_text(const struct manifest_reader *reader, const cJSON *object, const char *member,
                                  char **ret_text)
{
    const cJSON *value = cJSON_GetObjectItemCaseSensitive(object, member);
    if (!cJSON_IsString(value))
        return corrupt(reader, member, "not a text");
    *ret_text = files_copy_text(reader->memory, value->valuestring);
    return *ret_text ? BVHD_OK : no_memory(reader);
}

static enum bvhd_status read_key(const struct manifest_reader *reader, const cJSON *object,
                                 struct manifest_entry *entry)
{
    const cJSON *value = cJSON_GetObjectItemCaseSensitive(object, "key");
    entry->key = files_copy_text(reader->memory, cJSON_IsString(value) ? value->valuestring : "");
    return entry->key ? BVHD_OK : no_memory(reader);
}

static enum bvhd_status read_handles(const struct manifest_reader *reader, const cJSON *object,
                                     struct manifest_entry *entry)
{
    const cJSON *list = cJSON_GetObjectItemCaseSensitive(object, "handles"), *value;
    if (!cJSON_IsArray(list))
        return corrupt(reader, "handles", "not a list");
    int count = cJSON_GetArraySize(list);
    entry->handles = memory_array(reader->memory, (uint64_t)count + 1, sizeof *entry->handles);
    if (!entry->handles)
        return no_memory(reader);
    cJSON_ArrayForEach(value, list)
    {
        if (!cJSON_IsString(value) || !is_plain_name(value->valuestring))
            return corrupt(reader, "handles", "not a list of file names");
        char *name = files_copy_text(reader->memory, value->valuestring);
        if (!name)
            return no_memory(reader);
        entry->handles[entry->handle_count++] = name;
    }
    return BVHD_OK;
}

static enum bvhd_status read_target(const struct manifest_reader *reader, const cJSON *object, enum target *ret_target)
{
    const cJSON *value = cJSON_GetObjectItemCaseSensitive(object, "target");
    const struct layout *layout = cJSON_IsString(value) ? layout_find_name(value->valuestring) : NULL;
    if (!layout)
        return corrupt(reader, "target", "not a target that this version knows");
    *ret_target = layout->target;
    return BVHD_OK;
}

static enum bvhd_status read_source(const struct manifest_reader *reader, const cJSON *object,
                                    struct manifest_entry *entry)
{
    const cJSON *source = cJSON_GetObjectItemCaseSensitive(object, "source_scene");
    const cJSON *number = cJSON_GetObjectItemCaseSensitive(source, "number");
    const cJSON *name = cJSON_GetObjectItemCaseSensitive(source, "name");
    if (!source)
        return BVHD_OK;
    if (!cJSON_IsNumber(number) || !(number->valuedouble >= 0 && number->valuedouble < UINT32_MAX) ||
        !cJSON_IsString(name))
        return corrupt(reader, "source_scene", "without a number and a name");
    entry->has_source = true;
    entry->source_number = (uint32_t)number->valuedouble;
    if (*name->valuestring) {
        entry->source_name = files_copy_text(reader->memory, name->valuestring);
        return entry->source_name ? BVHD_OK : no_memory(reader);
    }
    return BVHD_OK;
}

static enum bvhd_status read_moment(const struct manifest_reader *reader, const cJSON *object,
                                    struct manifest_entry *entry)
{
    const cJSON *moment = cJSON_GetObjectItemCaseSensitive(object, "source_moment");
    const cJSON *time = cJSON_GetObjectItemCaseSensitive(moment, "time");
    const cJSON *animation = cJSON_GetObjectItemCaseSensitive(moment, "animation");
    const cJSON *end = cJSON_GetObjectItemCaseSensitive(moment, "end");
    if (!moment)
        return BVHD_OK;
    bool is_number = cJSON_IsNumber(animation) && animation->valuedouble >= 0 && animation->valuedouble < UINT32_MAX;
    if (!cJSON_IsNumber(time) || !isfinite(time->valuedouble) || !(is_number || cJSON_IsNull(animation)))
        return corrupt(reader, "source_moment", "without a time and an animation");
    if (end && (!cJSON_IsNumber(end) || !isfinite(end->valuedouble - time->valuedouble) ||
                !(end->valuedouble > time->valuedouble)))
        return corrupt(reader, "source_moment", "with an end that is not after its time");
    entry->is_shutter = end != NULL;
    entry->end = end ? end->valuedouble : 0;
    entry->has_moment = true;
    entry->moment = time->valuedouble;
    entry->has_animation = is_number;
    entry->animation = is_number ? (uint32_t)animation->valuedouble : 0;
    return BVHD_OK;
}

/* Reads a radius, 0 if there is none. */
static enum bvhd_status read_radius(const struct manifest_reader *reader, const cJSON *radii, const char *member,
                                    float *ret_radius)
{
    const cJSON *radius = cJSON_GetObjectItemCaseSensitive(radii, member);
    if (!radius)
        return BVHD_OK;
    double value = cJSON_IsNumber(radius) ? radius->valuedouble : 0;
    *ret_radius = value <= (double)FLT_MAX ? (float)value : 0;
    return *ret_radius > 0 ? BVHD_OK : corrupt(reader, "source_radii", "a radius that is not a positive number");
}

static enum bvhd_status read_radii(const struct manifest_reader *reader, const cJSON *object,
                                   struct manifest_entry *entry)
{
    const cJSON *radii = cJSON_GetObjectItemCaseSensitive(object, "source_radii");
    enum bvhd_status status = read_radius(reader, radii, "points", &entry->point_radius);
    return status ? status : read_radius(reader, radii, "lines", &entry->line_radius);
}

void manifest_wish_init(struct manifest_wish *wish, const struct manifest_entry *top)
{
    *wish = (struct manifest_wish){
        .moment = {
            .time = top->moment, .is_shutter = top->is_shutter, .end = top->end, .is_for_updates = top->is_updatable}};
    snprintf(wish->scene, sizeof wish->scene, "%u", top->source_number);
    snprintf(wish->animation, sizeof wish->animation, "%u", top->animation);
    wish->moment.animation = top->has_animation ? wish->animation : NULL;
    wish->wish.scene = top->has_source ? wish->scene : NULL;
    wish->wish.moment = top->has_moment ? &wish->moment : NULL;
    wish->wish.point_radius = top->point_radius;
    wish->wish.line_radius = top->line_radius;
}

static struct manifest_colour read_colour(const cJSON *geometry)
{
    struct manifest_colour colour;
    const cJSON *list = cJSON_GetObjectItemCaseSensitive(geometry, "color");
    for (int i = 0; i < 3; i++) {
        const cJSON *channel = cJSON_IsArray(list) ? cJSON_GetArrayItem(list, i) : NULL;
        bool is_valid = cJSON_IsNumber(channel) && channel->valuedouble >= 0 && channel->valuedouble <= 1;
        if (!is_valid)
            return (struct manifest_colour){{-1, -1, -1}};
        colour.rgb[i] = (float)channel->valuedouble;
    }
    return colour;
}

static enum bvhd_status read_colours(const struct manifest_reader *reader, const cJSON *object,
                                     struct manifest_entry *entry)
{
    const cJSON *list = cJSON_GetObjectItemCaseSensitive(object, "geometries"), *geometry;
    if (!cJSON_IsArray(list))
        return corrupt(reader, "geometries", "not a list");
    entry->colours = memory_array(reader->memory, (uint64_t)cJSON_GetArraySize(list) + 1, sizeof *entry->colours);
    if (!entry->colours)
        return no_memory(reader);
    cJSON_ArrayForEach(geometry, list) entry->colours[entry->colour_count++] = read_colour(geometry);
    return BVHD_OK;
}

static uint64_t read_bytes(const cJSON *object)
{
    const cJSON *value = cJSON_GetObjectItemCaseSensitive(object, "bytes");
    bool is_size = cJSON_IsNumber(value) && value->valuedouble >= 0 && value->valuedouble < 9e15;
    return is_size ? (uint64_t)value->valuedouble : 0;
}

static enum bvhd_status read_entry(const struct manifest_reader *reader, const cJSON *object,
                                   struct manifest_entry *entry)
{
    enum bvhd_status status = read_text(reader, object, "file", &entry->file);
    if (!status && !is_plain_name(entry->file))
        status = corrupt(reader, "file", "not a plain file name");
    if (!status)
        status = read_text(reader, object, "scene", &entry->scene);
    if (!status)
        status = read_text(reader, object, "name", &entry->name);
    if (!status)
        status = read_key(reader, object, entry);
    if (!status)
        status = read_target(reader, object, &entry->target);
    if (!status)
        status = read_colours(reader, object, entry);
    if (!status)
        status = read_source(reader, object, entry);
    if (!status)
        status = read_moment(reader, object, entry);
    if (!status)
        status = read_radii(reader, object, entry);
    if (status)
        return status;
    entry->bytes = read_bytes(object);
    const cJSON *type = cJSON_GetObjectItemCaseSensitive(object, "type");
    entry->is_top = cJSON_IsString(type) && !strcmp(type->valuestring, "tlas");
    if (!entry->is_top && !(cJSON_IsString(type) && !strcmp(type->valuestring, "blas")))
        return corrupt(reader, "type", "neither blas nor tlas");
    return entry->is_top ? read_handles(reader, object, entry) : BVHD_OK;
}

/* Finds the names of the scenes' files. Manifests of revision 1 do not have them. */
static enum bvhd_status read_source_files(const struct manifest_reader *reader, const cJSON *root,
                                          struct manifest *manifest)
{
    const cJSON *scenes = cJSON_GetObjectItemCaseSensitive(root, "scenes"), *object;
    cJSON_ArrayForEach(object, scenes)
    {
        const cJSON *top = cJSON_GetObjectItemCaseSensitive(object, "file");
        const cJSON *file = cJSON_GetArrayItem(cJSON_GetObjectItemCaseSensitive(object, "files"), 0);
        const cJSON *path = cJSON_GetObjectItemCaseSensitive(file, "path");
        for (uint32_t i = 0; i < manifest->count && cJSON_IsString(top) && cJSON_IsString(path); i++) {
            struct manifest_entry *entry = &manifest->entries[i];
            if (strcmp(entry->file, top->valuestring) || entry->source_file || !is_plain_name(path->valuestring))
                continue;
            entry->source_file = files_copy_text(reader->memory, path->valuestring);
            if (!entry->source_file)
                return no_memory(reader);
        }
    }
    return BVHD_OK;
}

static enum bvhd_status read_entries(struct manifest_reader *reader, const cJSON *root, struct manifest *manifest)
{
    const cJSON *schema = cJSON_GetObjectItemCaseSensitive(root, "schema"), *object;
    const cJSON *list = cJSON_GetObjectItemCaseSensitive(root, "structures");
    if (!cJSON_IsNumber(schema) || schema->valuedouble != 1 || !cJSON_IsArray(list))
        return bvhd_error_set(reader->error, BVHD_CORRUPT, reader->path, "not a manifest of schema 1");
    manifest->entries = memory_array(reader->memory, (uint64_t)cJSON_GetArraySize(list) + 1, sizeof *manifest->entries);
    if (!manifest->entries)
        return no_memory(reader);
    cJSON_ArrayForEach(object, list)
    {
        reader->entry = manifest->count;
        struct manifest_entry *entry = &manifest->entries[manifest->count++];
        *entry = (struct manifest_entry){0};
        enum bvhd_status status = read_entry(reader, object, entry);
        if (status)
            return status;
    }
    manifest->options = manifest_read_options(root);
    for (uint32_t i = 0; i < manifest->count; i++)
        manifest->entries[i].is_updatable = manifest->options.build_flags & BUILD_ALLOW_UPDATE;
    return read_source_files(reader, root, manifest);
}

/* Parses a text that has no zero byte in it. */
static enum bvhd_status parse(struct manifest_reader *reader, char *text, uint64_t size, struct manifest *manifest)
{
    size = manifest_drop_nodes(text, size);
    cJSON *root = size ? cJSON_ParseWithLength(text, size) : NULL;
    enum bvhd_status status =
        root ? read_entries(reader, root, manifest)
             : bvhd_error_set(reader->error, BVHD_CORRUPT, reader->path, "not JSON, or nested too deep");
    cJSON_Delete(root);
    return status;
}

/* Parses a copy, because the text in a container stays as it is. */
static enum bvhd_status parse_copy(struct manifest_reader *reader, const struct built_bytes *text,
                                   struct manifest *manifest)
{
    if (text->owned)
        return parse(reader, (char *)text->owned, text->bytes.size, manifest);
    char *copy = memory_alloc(reader->memory, text->bytes.size + 1);
    if (!copy)
        return no_memory(reader);
    memcpy(copy, text->bytes.data, text->bytes.size);
    enum bvhd_status status = parse(reader, copy, text->bytes.size, manifest);
    memory_free(reader->memory, copy);
    return status;
}

enum bvhd_status manifest_read_built(const struct built *built, struct memory *memory, struct manifest *ret_manifest,
                                     struct bvhd_error *error)
{
    struct manifest manifest = {.memory = memory};
    struct manifest_reader reader = {.memory = memory, .error = error};
    struct built_bytes text;
    enum bvhd_status status = built_manifest(built, &text, reader.path, error);
    if (status != BVHD_OK)
        return status;
    status = parse_copy(&reader, &text, &manifest);
    memory_free(memory, text.owned);
    if (status != BVHD_OK)
        manifest_finish(&manifest);
    else
        *ret_manifest = manifest;
    return status;
}

enum bvhd_status manifest_read(const char *path, struct memory *memory, struct manifest *ret_manifest,
                               struct bvhd_error *error)
{
    struct built built;
    enum bvhd_status status = built_open(path, memory, &built, error);
    if (status != BVHD_OK)
        return status;
    status = manifest_read_built(&built, memory, ret_manifest, error);
    built_close(&built);
    return status;
}

static bool has_source(const struct manifest_entry *entry, const char *scene)
{
    char number[16];
    snprintf(number, sizeof number, "%u", entry->source_number);
    return entry->has_source && (!strcmp(scene, number) || (entry->source_name && !strcmp(scene, entry->source_name)));
}

const struct manifest_entry *manifest_find_top(const struct manifest *manifest, const char *file, const char *scene)
{
    const struct manifest_entry *found = NULL;
    uint32_t matches = 0;
    for (uint32_t i = 0; i < manifest->count; i++)
        if (manifest->entries[i].is_top && !strcmp(manifest->entries[i].scene, scene))
            return &manifest->entries[i];
    for (uint32_t i = 0; i < manifest->count; i++) {
        const struct manifest_entry *entry = &manifest->entries[i];
        if (!entry->is_top || !has_source(entry, scene))
            continue;
        if (file && !strcmp(entry->scene, file))
            return entry;
        found = entry;
        matches++;
    }
    return matches == 1 ? found : NULL;
}

static void finish_entry(struct manifest_entry *entry, struct memory *memory)
{
    memory_free(memory, entry->file);
    memory_free(memory, entry->scene);
    memory_free(memory, entry->name);
    memory_free(memory, entry->key);
    memory_free(memory, entry->source_name);
    memory_free(memory, entry->source_file);
    for (uint32_t i = 0; i < entry->handle_count; i++)
        memory_free(memory, entry->handles[i]);
    memory_free(memory, entry->handles);
    memory_free(memory, entry->colours);
}

void manifest_finish(struct manifest *manifest)
{
    if (!manifest || !manifest->memory)
        return;
    for (uint32_t i = 0; i < manifest->count; i++)
        finish_entry(&manifest->entries[i], manifest->memory);
    memory_free(manifest->memory, manifest->entries);
    *manifest = (struct manifest){0};
}
