/* SPDX-License-Identifier: Apache-2.0 */
/*
 * bvhd_vulkan.h - from serialized structures to a Vulkan device: what it loads, what to create, the upload.
 *
 * The library does not link the Vulkan loader: it calls what the program's own vkGetInstanceProcAddr finds. Two kinds
 * of structures can be loaded:
 *
 *   native    the device's own format (bvhd_format): becomes a VkAccelerationStructureKHR, by vkCmdCopyMemoryToAccelerationStructureKHR,
 *             for ray queries and ray-tracing pipelines. Needs VK_KHR_acceleration_structure and bufferDeviceAddress, both enabled.
 *   portable  plain storage, for shaders that include bvhd_ray_query.glsl: any device with compute shaders. Structures are bound as
 *             storage buffers, or, with bufferDeviceAddress enabled, found by their addresses.
 *
 * There are two ways. Programs with an allocator of their own ask bvhd_vulkan_requirements, create buffers, and record
 * bvhd_vulkan_record_upload into a command buffer of theirs. Programs without one let bvhd_vulkan_scene_create do all
 * of it and wait.
 *
 *     bvhd_vulkan_device_create(&options, &device, &error);
 *     bvhd_vulkan_probe(device, &queue, &probe, &probe_size, &error);               once; or a file from `bvhctl probe`
 *     bvhd_format_from_probe(probe, probe_size, &format, &error);                    BVHD_UNSUPPORTED: use the portable target
 *     build with target = format.target, format = &format                           bvhd.h
 *     bvhd_vulkan_scene_create(device, &queue, &options, &scene, &error);
 *
 * A top level names its bottom levels by rows: the handles that its instances name, each once, in the order in which
 * the instances first name them. bvhd_vulkan_rows tells them.
 *
 * Threads: a device may be used by several threads at once; command buffers, queues and memory are synchronised by the
 * caller as Vulkan wants it. Errors as in bvhd.h; what Vulkan reports becomes BVHD_NO_MEMORY, BVHD_UNAVAILABLE (device
 * lost) or BVHD_INTERNAL, with the name of the call in `where`.
 */
#ifndef BVHD_BVHD_VULKAN_H
#define BVHD_BVHD_VULKAN_H

#include <bvhd/bvhd.h>

#ifdef __cplusplus
extern "C" {
#endif

/* ---- The device ---- */

struct bvhd_vulkan_device;

struct bvhd_vulkan_device_options {
    size_t struct_size; /* sizeof(struct bvhd_vulkan_device_options) */
    PFN_vkGetInstanceProcAddr get_instance_proc_addr;
    VkInstance instance; /* of Vulkan 1.1 or newer */
    VkPhysicalDevice physical_device;
    VkDevice device;
    /* What was enabled when the device was created; the library calls nothing else. */
    VkBool32 has_acceleration_structure; /* VK_KHR_acceleration_structure and its feature accelerationStructure */
    /* the feature bufferDeviceAddress, of Vulkan 1.2 or of VK_KHR_buffer_device_address */
    VkBool32 has_buffer_device_address;
    /* for every object that the library creates; may be NULL; outlives the device */
    const VkAllocationCallbacks *allocator;
};

/*
 * Looks the functions up. The Vulkan objects must outlive it, the struct need not. BVHD_INVALID when a function is
 * missing, BVHD_NO_MEMORY.
 */
BVHD_API enum bvhd_status bvhd_vulkan_device_create(const struct bvhd_vulkan_device_options *options,
                                                    struct bvhd_vulkan_device **ret_device,
                                                    struct bvhd_error *ret_error);
/* NULL-safe. */
BVHD_API void bvhd_vulkan_device_destroy(struct bvhd_vulkan_device *device);

/* A queue for work that the library submits by itself: with compute. No other thread may use it during the call. */
struct bvhd_vulkan_queue {
    VkQueue queue;
    uint32_t family;
};

/* ---- What the device loads ---- */

/*
 * Builds a few tiny structures on the device, serializes them, and packs the bytes: what bvhd_format_from_probe reads.
 * Submits and waits. The block is freed with bvhd_vulkan_free. BVHD_UNSUPPORTED for a device without acceleration
 * structures: it takes the portable target.
 */
BVHD_API enum bvhd_status bvhd_vulkan_probe(struct bvhd_vulkan_device *device, const struct bvhd_vulkan_queue *queue,
                                            void **ret_probe, uint64_t *ret_size, struct bvhd_error *ret_error);
BVHD_API void bvhd_vulkan_free(void *block);

/*
 * Whether the device can take a serialized structure that anybody may have written. What passes can be uploaded and
 * traced without harm to the driver: the whole structure is looked at, each byte once. (The driver's own check compares
 * 16 bytes and lets everything else through.) What it means is not looked at: with ray-tracing pipelines, numbers of
 * geometries and offsets of instances lead into the program's shader binding table, beyond its end too. `format` is
 * what a probe of this device gave (one that is out of date is found out); without one (NULL) only portable structures
 * pass. `data` is aligned to 16 bytes.
 *
 * BVHD_INCOMPATIBLE: made for another driver or version; the text says for which target, and which one this device
 * needs. BVHD_UNSUPPORTED: a native structure, but the device has no acceleration structures: it takes the portable
 * target. BVHD_TOO_LARGE: over the device's limits, or a portable structure above 8 GiB. BVHD_CORRUPT: the bytes are
 * not sound. BVHD_INVALID: arguments, a native structure without a format among them. BVHD_NO_MEMORY.
 */
BVHD_API enum bvhd_status bvhd_vulkan_check(struct bvhd_vulkan_device *device, const struct bvhd_format *format,
                                            const void *data, uint64_t size, struct bvhd_error *ret_error);

/*
 * Which row of a top level each of the references of its request is: *ret_rows of reference_count numbers, UINT32_MAX
 * where no instance names it. `references` and `instances` as they were asked for, in one array. BVHD_INVALID: an
 * instance names what is not among the references; BVHD_NO_MEMORY.
 */
BVHD_API enum bvhd_status bvhd_vulkan_rows(const struct bvhd_reference *references, uint32_t reference_count,
                                           const VkAccelerationStructureInstanceKHR *instances, uint32_t instance_count,
                                           uint32_t *ret_rows, uint32_t *ret_row_count, struct bvhd_error *ret_error);

/* ---- With an allocator of the program's own ---- */

/* What to create for one serialized structure. */
struct bvhd_vulkan_requirements {
    enum bvhd_target target;
    /*
     * VK_ACCELERATION_STRUCTURE_TYPE_TOP_LEVEL_KHR or BOTTOM; of a native one with nothing in it, which does not say
     * what it is, GENERIC.
     */
    VkAccelerationStructureTypeKHR type;
    uint32_t handle_count; /* of a top level: places that upload fills */
    uint32_t reference_count; /* of a top level: its rows */
    /*
     * Host-visible and coherent, or flushed by the caller after the call that fills it. Needed until the copy has
     * executed.
     */
    VkDeviceSize staging_size;
    VkDeviceSize staging_alignment; /* portable: of the offset in its buffer; native: of the device address there */
    VkBufferUsageFlags staging_usage;
    /*
     * Where the structure lives. With VK_BUFFER_USAGE_SHADER_DEVICE_ADDRESS_BIT in a usage, memory is allocated with
     * VK_MEMORY_ALLOCATE_DEVICE_ADDRESS_BIT.
     */
    VkDeviceSize storage_size;
    VkDeviceSize storage_alignment;
    VkBufferUsageFlags storage_usage;
};

/*
 * Reads the head and the handles of a structure that bvhd_vulkan_check has passed. BVHD_CORRUPT, BVHD_INCOMPATIBLE,
 * BVHD_INVALID.
 */
BVHD_API enum bvhd_status bvhd_vulkan_requirements(struct bvhd_vulkan_device *device, const void *data, uint64_t size,
                                                   struct bvhd_vulkan_requirements *ret_requirements,
                                                   struct bvhd_error *ret_error);

/* A part of a buffer with memory bound. */
struct bvhd_vulkan_span {
    VkBuffer buffer;
    VkDeviceSize offset;
    VkDeviceSize size; /* at least what is required; an acceleration structure is created with exactly that */
};

struct bvhd_vulkan_upload {
    size_t struct_size; /* sizeof(struct bvhd_vulkan_upload) */
    const void *data; /* a serialized structure that bvhd_vulkan_check has passed; not needed after the call */
    uint64_t size;
    struct bvhd_vulkan_span staging;
    void *staging_mapped; /* host address of staging.offset */
    struct bvhd_vulkan_span storage;
    /*
     * Of a top level: references[r] is where the structure of row r is. Native: its device address, from
     * bvhd_vulkan_address. Portable: where its storage begins, as the device address or, when the whole scene lies in
     * one buffer, as the offset in that buffer, the same kind for all. Rows that no instance names are not looked at.
     */
    const uint64_t *references;
    uint32_t reference_count;
};

/*
 * Fills the staging memory and records the upload. Native: creates *ret_structure over the storage, which the caller
 * destroys with vkDestroyAccelerationStructureKHR and the device's allocator. Portable: *ret_structure is
 * VK_NULL_HANDLE; the storage becomes the layout's body (FORMATS.md, chapter 2), whose instances hold the locations of
 * their bottom levels, and where it begins is what bvhd_ray_query.glsl takes as its root. Outside of a render pass. On
 * failure nothing is recorded.
 *
 * Barriers. Before the copy: none; what the host wrote before the submission is visible to it, and storage must not be
 * in use. After it, before anything reads or builds upon the structure, the caller's own, or
 * bvhd_vulkan_record_barrier: native: source stage ACCELERATION_STRUCTURE_BUILD, access ACCELERATION_STRUCTURE_WRITE;
 * portable: source stage TRANSFER, access TRANSFER_WRITE. Uploads need none between each other. A top level may be
 * uploaded before what it names has been, as long as those structures have been created.
 *
 * BVHD_INVALID: a span is too small or misaligned, a row that an instance names has no reference. BVHD_NO_MEMORY, and
 * as bvhd_vulkan_requirements.
 */
BVHD_API enum bvhd_status bvhd_vulkan_record_upload(struct bvhd_vulkan_device *device, VkCommandBuffer commands,
                                                    const struct bvhd_vulkan_upload *upload,
                                                    VkAccelerationStructureKHR *ret_structure,
                                                    struct bvhd_error *ret_error);

/*
 * One barrier after any number of uploads: what they wrote is visible to ray queries, ray-tracing pipelines, shaders
 * and copies afterwards.
 */
BVHD_API void bvhd_vulkan_record_barrier(struct bvhd_vulkan_device *device, VkCommandBuffer commands);

/* What instances name: the device address of a native structure. */
BVHD_API uint64_t bvhd_vulkan_address(struct bvhd_vulkan_device *device, VkAccelerationStructureKHR structure);

/* ---- Without one ---- */

struct bvhd_vulkan_scene;

struct bvhd_vulkan_bytes {
    const void *data;
    uint64_t size;
};

enum {
    BVHD_VULKAN_SCENE_ADDRESSES =
        0x1, /* portable: instances name bottom levels by device address, not by offset in the buffer */
};

struct bvhd_vulkan_scene_options {
    size_t struct_size; /* sizeof(struct bvhd_vulkan_scene_options) */
    /*
     * Bottom levels and, last, the top level over them, or one bottom level alone: blobs[r] is row r of the top level,
     * and may be {NULL, 0} where no instance names it. All are of one target. Rows with the same `data` are loaded
     * once. Not needed after the call.
     */
    const struct bvhd_vulkan_bytes *blobs;
    uint32_t blob_count;
    uint32_t flags; /* BVHD_VULKAN_SCENE_ */
    const struct bvhd_format *format; /* of native structures: the device's; NULL: the device is probed */
};

/*
 * Checks every blob as bvhd_vulkan_check, allocates device-local memory where there is any, a few large pieces for any
 * number of structures, uploads in steps of at most 32 MiB (or the largest native structure), submits, waits. Fails as
 * bvhd_vulkan_check, with "blobs[3]: ..." as its place; BVHD_INVALID when an instance names a row that has no
 * structure; BVHD_NO_MEMORY. On failure nothing is held.
 */
BVHD_API enum bvhd_status bvhd_vulkan_scene_create(struct bvhd_vulkan_device *device,
                                                   const struct bvhd_vulkan_queue *queue,
                                                   const struct bvhd_vulkan_scene_options *options,
                                                   struct bvhd_vulkan_scene **ret_scene, struct bvhd_error *ret_error);
/* The device must not use it any more. NULL-safe. */
BVHD_API void bvhd_vulkan_scene_destroy(struct bvhd_vulkan_scene *scene);

BVHD_API enum bvhd_target bvhd_vulkan_scene_target(const struct bvhd_vulkan_scene *scene);

/* Native: the structure of blob `index`, for descriptors and instances; VK_NULL_HANDLE where there was none. */
BVHD_API VkAccelerationStructureKHR bvhd_vulkan_scene_structure(const struct bvhd_vulkan_scene *scene, uint32_t index);

/*
 * Portable: where blob `index` lies, in the one buffer that holds the whole scene and that is bound whole,
 * *ret_buffer_size bytes. BVHD_NOT_FOUND where there was none, and for native structures.
 */
BVHD_API enum bvhd_status bvhd_vulkan_scene_storage(const struct bvhd_vulkan_scene *scene, uint32_t index,
                                                    struct bvhd_vulkan_span *ret_span, VkDeviceSize *ret_buffer_size);

/*
 * What a shader takes as its root for blob `index`. Portable: its offset in the scene's buffer, or with
 * BVHD_VULKAN_SCENE_ADDRESSES its device address. Native: its device address. Without such a structure UINT64_MAX.
 */
BVHD_API uint64_t bvhd_vulkan_scene_location(const struct bvhd_vulkan_scene *scene, uint32_t index);

#ifdef __cplusplus
}
#endif

#endif
