/* SPDX-License-Identifier: Apache-2.0 */
/*
 * vulkan_input_kind.h - how vulkan_input.c converts the kinds of geometry, one file a kind: what their structs begin
 * with, and how much memory they reach. Only for vulkan_input*.c.
 */
#ifndef BVHD_VULKAN_INPUT_KIND_H
#define BVHD_VULKAN_INPUT_KIND_H

#include "client/vulkan_input.h"
#include "proto/base/handle_table.h"
#include "proto/base/kind.h"

/* The memory that one entry owns. */
struct entry_memory {
    struct geometry *geometries;
    struct reference *references;
    uint32_t reference_count;
    unsigned char *records; /* instance records, gathered from pointers or copied */
    unsigned char **usages; /* of micromaps, for each geometry; NULL: none */
    uint32_t usages_count;
};

struct vulkan_input {
    struct memory *memory;
    uint32_t count;
    struct build_input *entries;
    struct entry_memory *owned;
};

/* The arguments of one call, and tables that are derived from them once. */
struct input_call {
    const VkAccelerationStructureBuildGeometryInfoKHR *infos;
    uint32_t count;
    const VkAccelerationStructureBuildRangeInfoKHR *const *ranges;
    const struct reference *references;
    uint32_t reference_count;
    const struct build_options *options;
    struct memory *memory;
    struct handle_entry *known; /* references, sorted by handle */
    struct handle_entry *destinations; /* destinations, sorted by handle */
};

/* The entry that is being converted. */
struct input_entry {
    const struct input_call *call;
    const VkAccelerationStructureBuildGeometryInfoKHR *info;
    uint32_t index;
    struct entry_memory *owned;
    struct bvhd_error *error;
};

struct vulkan_input_kind {
    /*
     * The sType of its struct, which is a member of VkAccelerationStructureGeometryDataKHR or, if is_chained, in the
     * pNext chain of VkAccelerationStructureGeometryKHR.
     */
    VkStructureType head;
    bool is_chained;
    enum bvhd_vuid type_rule; /* about sType of this struct */
    enum bvhd_vuid chain_rule; /* about its pNext; not for chained ones, whose chain is that of the geometry */
    /* The sType of the struct in its chain that says where the geometry is at t = 1; 0: there is none. */
    VkStructureType end;
    bool has_micromaps; /* its chain may say which opacity micromap the geometry has */
    enum bvhd_vuid unique_rule; /* about a second struct of the same type in its chain */

    /*
     * Converts what describes this kind alone: `data` is its struct, whose chain has been checked. The other members
     * of `geometry` are set; entry->owned gets the memory that is made.
     */
    enum bvhd_status (*convert)(const struct input_entry *entry, const void *data, struct geometry *geometry);
};

extern const struct vulkan_input_kind vulkan_input_triangles, vulkan_input_aabbs, vulkan_input_instances,
    vulkan_input_spheres, vulkan_input_swept_spheres, vulkan_input_moving_triangles, vulkan_input_moving_instances,
    vulkan_input_micromap, vulkan_input_baked_micromap;

/* Returns how a kind is converted; NULL for one that no struct of the chain gives. */
const struct vulkan_input_kind *vulkan_input_kind_at(enum kind_number number);

/*
 * Returns offset + stride * (count - 1) + size: the bytes that `count` elements need. It returns 0 if there are no
 * elements, if the sum does not fit 64 bits, or if the stride breaks Vulkan's rules: the memory of a program that
 * passes nonsense must not be read at such lengths. vulkan_input_is_countable does the same for numbers of primitives.
 * The strides of indices have no rule, and vulkan_input_index_extent returns 0 in the first two cases only.
 */
uint64_t vulkan_input_extent(uint64_t offset, uint64_t stride, uint64_t count, uint64_t size);
uint64_t vulkan_input_index_extent(uint64_t offset, uint64_t stride, uint64_t count, uint64_t size);

/* Returns whether a structure can have this many primitives; validate_input refuses others without their data. */
bool vulkan_input_is_countable(const struct geometry_range *range);

/* Returns the bytes behind an address, which may be NULL. */
struct bytes vulkan_input_bytes(const void *address, uint64_t size);

/* Returns the struct of this sType in the chain of `head`, whose own sType does not count; NULL if there is none. */
const VkBaseInStructure *vulkan_input_find(const void *head, VkStructureType type);

/*
 * Gives the entry those of the call's references that are marked, one byte for each of them. Returns BVHD_NO_MEMORY.
 */
enum bvhd_status vulkan_input_copy_marked(const struct input_entry *entry, const unsigned char *marks);

/* Writes the entry's error; returns BVHD_NO_MEMORY. */
enum bvhd_status vulkan_input_no_memory(const struct input_entry *entry);

#endif
