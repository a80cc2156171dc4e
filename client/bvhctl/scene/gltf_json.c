/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/scene/gltf_json.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

enum { NAME_ROOM = 48 }; /* of the file's name in the place of an error */

struct gltf_value gltf_member(const struct gltf_value *object, const char *name)
{
    const cJSON *json = cJSON_IsObject(object->json) ? cJSON_GetObjectItemCaseSensitive(object->json, name) : NULL;
    return (struct gltf_value){json, object->name ? object : NULL, name, -1};
}

struct gltf_value gltf_extension(const struct gltf_value *object, const char *name, struct gltf_value *ret_extensions)
{
    *ret_extensions = gltf_member(object, "extensions");
    return gltf_member(ret_extensions, name);
}

struct gltf_value gltf_element(const struct gltf_value *array, const cJSON *item, int64_t index)
{
    return (struct gltf_value){item, array->parent, array->name, index};
}

struct gltf_value gltf_item(const struct gltf_file *file, enum gltf_list_name list, uint32_t index)
{
    return (struct gltf_value){file->lists[list].items[index], NULL, gltf_list_text(list), index};
}

static void append(char *text, size_t room, const char *more)
{
    size_t used = strlen(text);
    snprintf(text + used, room - used, "%s", more);
}

static void write_place(const struct gltf_value *value, char *ret_text, size_t room)
{
    const struct gltf_value *path[8];
    int depth = 0;
    for (; value && depth < 8; value = value->parent)
        path[depth++] = value;
    for (int i = depth; i-- > 0;) {
        char index[32] = "";
        if (path[i]->index >= 0)
            snprintf(index, sizeof index, "[%lld]", (long long)path[i]->index);
        append(ret_text, room, path[i]->name ? path[i]->name : "");
        append(ret_text, room, index);
        append(ret_text, room, i ? "." : "");
    }
}

enum bvhd_status gltf_refuse(const struct gltf_file *file, enum bvhd_status status, const struct gltf_value *value,
                             const char *format, ...)
{
    char where[BVHD_WHERE_SIZE] = "", text[BVHD_TEXT_SIZE];
    if (value && value->name) {
        const char *slash = strrchr(file->path, '/');
        snprintf(where, sizeof where, "%.*s: ", NAME_ROOM, slash ? slash + 1 : file->path);
        write_place(value, where, sizeof where);
    }
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    return bvhd_error_set(file->error, status, *where ? where : file->path, "%s", text);
}

enum bvhd_status gltf_no_memory(const struct gltf_file *file)
{
    return bvhd_error_no_memory(file->error, file->path, "no memory for the scene, or more than --memory allows");
}

enum bvhd_status gltf_integer(const struct gltf_file *file, const struct gltf_value *object, const char *name,
                              struct gltf_range range, uint64_t *ret_integer)
{
    struct gltf_value value = gltf_member(object, name);
    if (!value.json && !range.is_required) {
        *ret_integer = range.fallback;
        return BVHD_OK;
    }
    if (!value.json)
        return gltf_refuse(file, BVHD_INVALID, &value, "missing");
    double number = cJSON_IsNumber(value.json) ? value.json->valuedouble : -1;
    if (!(number >= (double)range.lowest && number <= (double)range.most) || number != floor(number))
        return gltf_refuse(file, BVHD_INVALID, &value, "not an integer from %llu to %llu",
                           (unsigned long long)range.lowest, (unsigned long long)range.most);
    *ret_integer = (uint64_t)number;
    return BVHD_OK;
}

enum bvhd_status gltf_numbers(const struct gltf_file *file, const struct gltf_value *object, const char *name,
                              int count, double *ret_numbers, bool *ret_found)
{
    struct gltf_value value = gltf_member(object, name);
    if (ret_found)
        *ret_found = value.json != NULL;
    if (!value.json)
        return BVHD_OK;
    int found = 0;
    const cJSON *item = cJSON_IsArray(value.json) ? value.json->child : NULL;
    for (; item && found < count; item = item->next, found++) {
        struct gltf_value element = gltf_element(&value, item, found);
        if (!cJSON_IsNumber(item) || !isfinite(item->valuedouble))
            return gltf_refuse(file, BVHD_INVALID, &element, "not a finite number");
        ret_numbers[found] = item->valuedouble;
    }
    return item || found < count ? gltf_refuse(file, BVHD_INVALID, &value, "not an array of %d numbers", count)
                                 : BVHD_OK;
}

const char *gltf_text(const struct gltf_value *object, const char *name)
{
    struct gltf_value value = gltf_member(object, name);
    return cJSON_IsString(value.json) ? value.json->valuestring : NULL;
}

enum bvhd_status gltf_array(const struct gltf_file *file, const struct gltf_value *object, const char *name,
                            struct gltf_value *ret_array)
{
    *ret_array = gltf_member(object, name);
    return !ret_array->json || cJSON_IsArray(ret_array->json) ? BVHD_OK
                                                              : gltf_refuse(file, BVHD_INVALID, ret_array, "no array");
}

enum bvhd_status gltf_index(const struct gltf_file *file, const struct gltf_value *value, enum gltf_list_name list,
                            uint32_t *ret_index)
{
    double number = cJSON_IsNumber(value->json) ? value->json->valuedouble : -1;
    if (!(number >= 0) || number != floor(number))
        return gltf_refuse(file, BVHD_INVALID, value, "not an index");
    if (number >= file->lists[list].count)
        return gltf_refuse(file, BVHD_INVALID, value, "%s[%.0f] does not exist: there are %u", gltf_list_text(list),
                           number, file->lists[list].count);
    *ret_index = (uint32_t)number;
    return BVHD_OK;
}

enum bvhd_status gltf_reference(const struct gltf_file *file, const struct gltf_value *object, const char *name,
                                enum gltf_list_name list, uint32_t *ret_index, bool *ret_found)
{
    struct gltf_value value = gltf_member(object, name);
    *ret_found = value.json != NULL;
    return value.json ? gltf_index(file, &value, list, ret_index) : BVHD_OK;
}
