/* SPDX-License-Identifier: Apache-2.0 */
#include <inttypes.h>
#include <stdio.h>
#include <string.h>

#include "builder/format/serialized.h"
#include "client/bvhctl/base/options_table.h"
#include "client/bvhctl/commands.h"
#include "client/bvhctl/gpu/inspect_probe.h"
#include "client/bvhctl/gpu/probe_source.h"
#include "client/bvhctl/scene/held.h"

enum { PROPERTIES = 4 };

/* One of Vulkan's queries of a structure. */
struct property {
    const char *name, *text; /* in JSON, and for people */
    VkQueryType type;
    bool has_value; /* false: a rule says that this structure has none */
    uint64_t value;
    struct bvhd_error reason; /* then */
};

struct query {
    const struct options *options;
    struct memory memory;
    struct held held;
    struct serialized_header header;
    struct property properties[PROPERTIES];
    bool is_judged; /* it is known whether it can be loaded: by this library, or by the device of the probe */
    bool is_compatible;
};

static const char *type_name(const struct query *query)
{
    switch (query->held.state.type) {
    case VK_ACCELERATION_STRUCTURE_TYPE_TOP_LEVEL_KHR:
        return "tlas";
    case VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR:
        return "blas";
    default:
        return NULL;
    }
}

static void read_properties(struct query *query)
{
    static const struct property all[PROPERTIES] = {
        {.name = "size", .text = "size", .type = VK_QUERY_TYPE_ACCELERATION_STRUCTURE_SIZE_KHR},
        {.name = "compacted_size",
         .text = "compacted size",
         .type = VK_QUERY_TYPE_ACCELERATION_STRUCTURE_COMPACTED_SIZE_KHR},
        {.name = "serialization_size",
         .text = "serialization size",
         .type = VK_QUERY_TYPE_ACCELERATION_STRUCTURE_SERIALIZATION_SIZE_KHR},
        {.name = "bottom_level_pointers",
         .text = "bottom level pointers",
         .type = VK_QUERY_TYPE_ACCELERATION_STRUCTURE_SERIALIZATION_BOTTOM_LEVEL_POINTERS_KHR}};
    memcpy(query->properties, all, sizeof all);
    for (int i = 0; i < PROPERTIES; i++) {
        struct property *property = &query->properties[i];
        property->has_value =
            held_property(&query->held, property->type, &property->value, &property->reason) == BVHD_OK;
    }
}

/*
 * Asks whether the structure can be loaded: a portable one by this library, a native one by the device of --probe, and
 * without it nobody knows.
 */
static enum bvhd_status judge(struct query *query, struct bvhd_error *error)
{
    struct bvhd_format format = {.struct_size = sizeof format};
    const VkAccelerationStructureVersionInfoKHR info = {
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_VERSION_INFO_KHR, .pVersionData = query->held.state.data};
    VkAccelerationStructureCompatibilityKHR found = VK_ACCELERATION_STRUCTURE_COMPATIBILITY_INCOMPATIBLE_KHR;
    const char *probe = query->options->probe;
    const struct probe_source source = {probe, (enum target)0};
    enum bvhd_status status = probe ? probe_source_read(&source, &query->memory, &format, error) : BVHD_OK;
    query->is_judged = probe || query->held.state.target == BVHD_TARGET_PORTABLE;
    if (status == BVHD_OK)
        status = bvhd_structure_compatibility(&info, probe ? &format : NULL, &found, error);
    query->is_compatible = found == VK_ACCELERATION_STRUCTURE_COMPATIBILITY_COMPATIBLE_KHR;
    return status;
}

static enum bvhd_status ask(struct query *query, struct bvhd_error *error)
{
    enum bvhd_status status = held_open(query->options->operands[0], &query->memory, &query->held, error);
    if (status != BVHD_OK)
        return status;
    const struct bytes bytes = {query->held.state.data, query->held.state.data_size};
    status = serialized_read(bytes, &query->header, error);
    if (status == BVHD_OK)
        read_properties(query);
    return status == BVHD_OK ? judge(query, error) : status;
}

enum { FLAGS_MOST = 32 };

/* Lists the names of flags: those of --flags, and that of what moves, which no option gives. Returns how many. */
static int name_flags(uint32_t flags, const char *ret_names[FLAGS_MOST])
{
    int count = 0;
    for (const struct name_value *row = build_flag_names; row->name && count < FLAGS_MOST - 1; row++)
        if (flags & row->value)
            ret_names[count++] = row->name;
    if (flags & BUILD_MOTION)
        ret_names[count++] = "motion";
    return count;
}

/* ---- for people ---- */

static void print_flags(const struct query *query)
{
    const char *names[FLAGS_MOST];
    int count = name_flags(query->held.state.flags, names);
    if (query->held.state.target != BVHD_TARGET_PORTABLE) {
        printf("  %-22s not in the bytes of a native structure\n", "flags");
        return;
    }
    printf("  %-22s%s", "flags", count ? "" : " none");
    for (int i = 0; i < count; i++)
        printf(" %s", names[i]);
    printf("\n");
}

static void print_properties(const struct query *query)
{
    for (int i = 0; i < PROPERTIES; i++) {
        const struct property *property = &query->properties[i];
        if (property->has_value)
            printf("  %-22s %" PRIu64 "\n", property->text, property->value);
        else
            printf("  %-22s none: %s\n", property->text, property->reason.text);
    }
}

static void print_handles(const struct query *query)
{
    enum { SHOWN = 8 };
    const unsigned char *handles = (const unsigned char *)query->held.state.data + SERIALIZED_HANDLES;
    if (!query->header.handle_count)
        return;
    printf("  %-22s", "references");
    for (uint64_t i = 0; i < query->header.handle_count && i < SHOWN; i++)
        printf(" %" PRIu64, bytes_get64(handles + 8 * i));
    printf("%s\n", query->header.handle_count > SHOWN ? " ..." : "");
}

static void print_compatibility(const struct query *query)
{
    const char *who = query->options->probe ? "the device of the probe" : "this version of bvhd";
    if (query->is_judged)
        printf("  %-22s %s, with %s\n", "compatible", query->is_compatible ? "yes" : "no", who);
    else
        printf("  %-22s not known: --probe names a device\n", "compatible");
}

static void print_text(const struct query *query)
{
    const char *target = bvhd_target_name(query->held.state.target), *type = type_name(query);
    printf("%s\n  %-22s %s\n  %-22s %s\n", query->options->operands[0], "type", type ? type : "not in the bytes",
           "target", target ? target : "");
    print_flags(query);
    print_properties(query);
    print_handles(query);
    print_compatibility(query);
}

/* ---- as JSON ---- */

static void write_flags(const struct query *query, struct json *json)
{
    if (query->held.state.target != BVHD_TARGET_PORTABLE) {
        json_null(json, "flags");
        return;
    }
    const char *names[FLAGS_MOST];
    int count = name_flags(query->held.state.flags, names);
    json_array(json, "flags");
    for (int i = 0; i < count; i++)
        json_text(json, NULL, names[i]);
    json_array_end(json);
}

static void write_handles(const struct query *query, struct json *json)
{
    const unsigned char *handles = (const unsigned char *)query->held.state.data + SERIALIZED_HANDLES;
    json_array(json, "references");
    for (uint64_t i = 0; i < query->header.handle_count; i++)
        json_integer(json, NULL, bytes_get64(handles + 8 * i));
    json_array_end(json);
}

static void write_members(const struct query *query, struct json *json)
{
    char uuid[INSPECT_UUID];
    const char *target = bvhd_target_name(query->held.state.target);
    json_object(json, NULL);
    json_integer(json, "schema", 1);
    json_text(json, "path", query->options->operands[0]);
    if (type_name(query))
        json_text(json, "type", type_name(query));
    else
        json_null(json, "type");
    json_text(json, "target", target ? target : "");
    write_flags(query, json);
    for (int i = 0; i < PROPERTIES; i++)
        if (query->properties[i].has_value)
            json_integer(json, query->properties[i].name, query->properties[i].value);
        else
            json_null(json, query->properties[i].name);
    write_handles(query, json);
    inspect_uuid(query->header.driver_uuid, uuid);
    json_text(json, "driver_uuid", uuid);
    inspect_uuid(query->header.compatibility_uuid, uuid);
    json_text(json, "compatibility_uuid", uuid);
    if (query->is_judged)
        json_bool(json, "compatible", query->is_compatible);
    else
        json_null(json, "compatible");
    json_object_end(json);
}

static bool print_result(struct query *query)
{
    struct json json;
    if (!query->options->json) {
        print_text(query);
        return report_flush();
    }
    json_init(&json, &query->memory, false);
    write_members(query, &json);
    bool ok = report_print(&json);
    json_finish(&json);
    return ok;
}

enum exit_code command_query(const struct options *options)
{
    struct query query = {.options = options};
    struct bvhd_error error = {0};
    enum exit_code code;
    memory_init(&query.memory, options->memory);
    if (ask(&query, &error) != BVHD_OK) {
        memory_explain(&query.memory, &error);
        code = report_failure(options->json, "query", &error);
    } else {
        code = print_result(&query) ? EXIT_DONE : EXIT_FAILED;
    }
    bvhd_structure_destroy(query.held.structure);
    return code;
}
