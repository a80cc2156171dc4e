/* SPDX-License-Identifier: Apache-2.0 */
/* manifest_head.c - writes what a manifest begins with: its version, that of the tool, and the options of the build. */
#include <stdio.h>

#include "client/bvhctl/base/options_table.h"
#include "client/bvhctl/scene/manifest.h"

enum { UUID_TEXT = 37 };

static void write_flags(struct json *json, const char *key, const struct name_value *names, uint32_t flags)
{
    json_array(json, key);
    for (; names->name; names++)
        if (names->value && (flags & names->value) == names->value)
            json_text(json, NULL, names->name);
    json_array_end(json);
}

static const char *find_name(const struct name_value *names, uint32_t value)
{
    for (; names->name; names++)
        if (names->value == value)
            return names->name;
    return NULL;
}

static void write_optional(struct json *json, const char *key, const char *text)
{
    if (text)
        json_text(json, key, text);
    else
        json_null(json, key);
}

static void write_uuid(struct json *json, const char *key, const uint8_t *uuid)
{
    char text[UUID_TEXT], *at = text;
    for (int i = 0; i < 16; i++)
        at += sprintf(at, "%s%02x", i == 4 || i == 6 || i == 8 || i == 10 ? "-" : "", uuid[i]);
    json_text(json, key, text);
}

static void write_options(struct json *json, const struct options *options)
{
    json_object(json, "options");
    write_optional(json, "target", find_name(target_names, options->build.target));
    write_optional(json, "quality", find_name(quality_names, options->build.quality));
    if (options->build.builder != BUILDER_OWN)
        json_text(json, "builder", find_name(builder_names, options->build.builder));
    write_flags(json, "flags", build_flag_names, options->build_flags);
    write_flags(json, "layout", layout_flag_names, options->build.layout_flags);
    write_flags(json, "geometry_flags", geometry_flag_names, options->geometry_flags);
    if (options->rays > 0)
        json_float(json, "rays_per_primitive", (float)options->rays);
    else
        json_null(json, "rays_per_primitive");
    write_optional(json, "scene", options->scene);
    if (options->format) {
        write_uuid(json, "driver_uuid", options->format->driver_uuid);
        write_uuid(json, "compatibility_uuid", options->format->compatibility_uuid);
    }
    json_object_end(json);
}

void manifest_begin(struct json *json, const struct options *options)
{
    json_object(json, NULL);
    json_integer(json, "schema", 1);
    json_integer(json, "revision", MANIFEST_REVISION);
    json_object(json, "tool");
    json_text(json, "name", "bvhctl");
    json_text(json, "version", bvhd_version());
    json_object_end(json);
    write_options(json, options);
    json_array(json, "structures");
}

void manifest_end(struct json *json, const struct json *scenes)
{
    json_array_end(json);
    json_array(json, "scenes");
    json_append(json, scenes);
    json_array_end(json);
    json_object_end(json);
    json_newline(json);
}
