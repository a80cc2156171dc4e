/* SPDX-License-Identifier: Apache-2.0 */
/* fake_vulkan_objects.h - the internals of fake_vulkan: its objects, and what makes calls fail. */
#ifndef BVHD_TEST_FAKE_VULKAN_OBJECTS_H
#define BVHD_TEST_FAKE_VULKAN_OBJECTS_H

#include "tests/support/unit.h"

#include <stdbool.h>

#include "tests/support/client/vulkan/fake_vulkan.h"

enum kind { MEMORY, BUFFER, STRUCTURE, POOL, FENCE, QUERIES, SET_LAYOUT, PIPELINE_LAYOUT, MODULE, PIPELINE, SETS };

struct object {
    enum kind kind;
    const VkAllocationCallbacks *allocator;
    uint64_t size;
    unsigned char *block, *bytes; /* memory: the allocated block, and where its bytes begin */
    struct object *memory; /* of a buffer */
    uint32_t type; /* memory type, or structure type */
    VkFlags usage;
    bool has_address, is_mapped, is_signalled;
    struct object *buffer; /* of a structure */
    uint64_t offset, results[8];
};

/* Non-dispatchable handles are pointers here, as on every 64-bit machine. */
#define OBJECT(handle) ((struct object *)(void *)(handle))

extern int fake_instance, fake_physical, fake_device, fake_queue, fake_command_buffer;
extern const VkAllocationCallbacks *fake_allocator; /* for all objects */

/* Returns the failure if this call is to fail, else VK_SUCCESS. */
VkResult fake_turn(void);
#define RETURN_FAILURE                                                                                                 \
    do {                                                                                                               \
        VkResult result_ = fake_turn();                                                                                \
        if (result_ != VK_SUCCESS)                                                                                     \
            return result_;                                                                                            \
    } while (0)

struct object *fake_create(enum kind kind, const VkAllocationCallbacks *allocator);
void fake_destroy(struct object *object, enum kind kind, const VkAllocationCallbacks *allocator);
unsigned char *fake_structure_bytes(const struct object *structure);

/* Return a function of commands and submissions, or of compute pipelines; NULL for another name. */
PFN_vkVoidFunction fake_commands_find(const char *name);
PFN_vkVoidFunction fake_kernels_find(const char *name);
void fake_kernels_reset(void);
void fake_commands_reset(void);
bool fake_commands_are_recording(void);
bool fake_commands_are_under_way(void); /* objects that are in use must not be destroyed */
void fake_commands_run(void);

#endif
