/* SPDX-License-Identifier: Apache-2.0 */
/*
 * gltf_json.h - typed access to the JSON of a glTF file, with errors that name the place: "accessors[3].byteOffset".
 *
 * A struct gltf_value is a value together with its place. It is small, and its text is only made for an error. All
 * functions that return a status fill the error of the file and return BVHD_INVALID when the JSON breaks a rule.
 */
#ifndef BVHCTL_GLTF_JSON_H
#define BVHCTL_GLTF_JSON_H

#include <cjson/cJSON.h>

#include "client/bvhctl/scene/gltf_file.h"

struct gltf_value {
    const cJSON *json; /* NULL: the file does not have it */
    const struct gltf_value *parent; /* must outlive this value; NULL: a member of the file's outermost object */
    const char *name; /* of the member, or of the array that the value is in */
    int64_t index; /* in the array; -1: it is not in one */
};

/* The range of an integer member. */
struct gltf_range {
    uint64_t lowest, most;
    bool is_required; /* else a missing member has the value `fallback` */
    uint64_t fallback;
};

/* Returns a member of an object. It is absent if the object is absent, or is not an object. */
struct gltf_value gltf_member(const struct gltf_value *object, const char *name);

/* Returns the extension `name` of an object. *ret_extensions is the parent that the result points to. */
struct gltf_value gltf_extension(const struct gltf_value *object, const char *name, struct gltf_value *ret_extensions);

/* Returns an element of an array, which the caller found in its list of children. */
struct gltf_value gltf_element(const struct gltf_value *array, const cJSON *item, int64_t index);

/* Returns an object of one of the lists of the file. `index` is in range. */
struct gltf_value gltf_item(const struct gltf_file *file, enum gltf_list_name list, uint32_t index);

/* Fills the error of the file, with the file's name and the place of `value` (NULL: the whole file). */
enum bvhd_status gltf_refuse(const struct gltf_file *file, enum bvhd_status status, const struct gltf_value *value,
                             const char *format, ...) __attribute__((format(printf, 4, 5)));

enum bvhd_status gltf_no_memory(const struct gltf_file *file);

/* Reads an integer member within a range. */
enum bvhd_status gltf_integer(const struct gltf_file *file, const struct gltf_value *object, const char *name,
                              struct gltf_range range, uint64_t *ret_integer);

/* Reads an array of exactly `count` finite numbers, if the object has it. *ret_found may be NULL. */
enum bvhd_status gltf_numbers(const struct gltf_file *file, const struct gltf_value *object, const char *name,
                              int count, double *ret_numbers, bool *ret_found);

/* Returns a text member, or NULL if there is none. The text belongs to the file. */
const char *gltf_text(const struct gltf_value *object, const char *name);

/* Returns an array member in *ret_array, absent if there is none; another kind of value is an error. */
enum bvhd_status gltf_array(const struct gltf_file *file, const struct gltf_value *object, const char *name,
                            struct gltf_value *ret_array);

/* Converts a value that is the index of an object in a list. */
enum bvhd_status gltf_index(const struct gltf_file *file, const struct gltf_value *value, enum gltf_list_name list,
                            uint32_t *ret_index);

/* Reads a member that is the index of an object in a list. *ret_found is false if there is no such member. */
enum bvhd_status gltf_reference(const struct gltf_file *file, const struct gltf_value *object, const char *name,
                                enum gltf_list_name list, uint32_t *ret_index, bool *ret_found);

#endif
