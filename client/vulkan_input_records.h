/* SPDX-License-Identifier: Apache-2.0 */
/*
 * vulkan_input_records.h - how the records of instances are read: of those of a top level that stands still, and of
 * those of one that moves. Only for vulkan_input*instances.c.
 */
#ifndef BVHD_VULKAN_INPUT_RECORDS_H
#define BVHD_VULKAN_INPUT_RECORDS_H

#include "client/vulkan_input_kind.h"

struct input_records {
    uint32_t stride, size; /* bytes from one record of an array to the next, and of a record */

    /* Returns the structure that a record names; 0 for none, and for a record that is not valid. */
    uint64_t (*reference)(const unsigned char *record);

    /*
     * Writes the record that element `index` of an array of pointers leads to. The rest of the stride is 0. Returns
     * BVHD_INVALID with the rule for a pointer that leads nowhere.
     */
    enum bvhd_status (*gather)(const struct input_entry *entry, uint32_t index, uint64_t pointer,
                               unsigned char *ret_record);
};

extern const struct input_records input_records, input_motion_records;

/* Converts instances with records of this format; VkAccelerationStructureGeometryInstancesDataKHR is their struct. */
enum bvhd_status vulkan_input_convert_records(const struct input_entry *entry, const struct input_records *records,
                                              const void *data, struct geometry *geometry);

/* Refuses a pointer that is NULL. */
enum bvhd_status vulkan_input_refuse_pointer(const struct input_entry *entry, uint32_t index);

#endif
