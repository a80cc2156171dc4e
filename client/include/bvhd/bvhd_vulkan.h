/* SPDX-License-Identifier: Apache-2.0 */
/*
 * bvhd_vulkan.h - from serialized structures to a Vulkan device: what the device loads, what to create, the upload.
 *
 * The library does not link the Vulkan loader: it calls the functions that the program's own vkGetInstanceProcAddr
 * finds. It loads two kinds of structures:
 *
 *   native    the device's own format (bvhd_format): becomes a VkAccelerationStructureKHR, by
 *             vkCmdCopyMemoryToAccelerationStructureKHR, for ray queries and ray-tracing pipelines. Needs
 *             VK_KHR_acceleration_structure and bufferDeviceAddress, both enabled.
 *   portable  plain storage, for shaders that include bvhd_ray_query.glsl, on any device with compute shaders. Shaders
 *             reach the structures as storage buffers or, with bufferDeviceAddress enabled, by their addresses.
 *
 * There are two ways to load. A program with an allocator of its own calls bvhd_vulkan_requirements, creates buffers,
 * and records bvhd_vulkan_record_upload into one of its command buffers. Any other program calls
 * bvhd_vulkan_scene_create, which does all of that and waits.
 *
 *     bvhd_vulkan_device_create(&options, &device, &error);
 *     bvhd_vulkan_probe(device, &queue, &probe, &probe_size, &error);         once; or a file from `bvhctl probe`
 *     bvhd_format_from_probe(probe, probe_size, &format, &error);             BVHD_UNSUPPORTED: use the portable target
 *     build with target = format.target, format = &format                     bvhd.h
 *     bvhd_vulkan_scene_create(device, &queue, &options, &scene, &error);
 *
 * A top-level structure names its bottom-level structures by rows: the handles that its instances reference, each once,
 * in the order of their first reference. bvhd_vulkan_rows computes them.
 *
 * Threads: several threads may use a device at once. The caller synchronises command buffers, queues and memory as
 * Vulkan requires. Errors are reported as in bvhd.h; a Vulkan error becomes BVHD_NO_MEMORY, BVHD_UNAVAILABLE (device
 * lost) or BVHD_INTERNAL, with the name of the Vulkan function in `where`.
 */
#ifndef BVHD_BVHD_VULKAN_H
#define BVHD_BVHD_VULKAN_H

#include <bvhd/bvhd.h>

#ifdef __cplusplus
extern "C" {
#endif

/* ---- The device ---- */

/* A Vulkan device, as the library uses it. */
struct bvhd_vulkan_device;

/* The program's device, and the functions and features that the library may use. */
struct bvhd_vulkan_device_options {
    size_t struct_size; /* sizeof(struct bvhd_vulkan_device_options) */
    PFN_vkGetInstanceProcAddr get_instance_proc_addr;
    VkInstance instance; /* created for Vulkan 1.1 or newer */
    VkPhysicalDevice physical_device;
    VkDevice device;
    /* The features that were enabled when the device was created. The library uses nothing else. */
    VkBool32 has_acceleration_structure; /* VK_KHR_acceleration_structure and its feature accelerationStructure */
    /* the feature bufferDeviceAddress of Vulkan 1.2 or of VK_KHR_buffer_device_address */
    VkBool32 has_buffer_device_address;
    /* Used for every object that the library creates. May be NULL; must outlive the device. */
    const VkAllocationCallbacks *allocator;
};

/*
 * Creates a device object, which looks up Vulkan's functions. The Vulkan objects must outlive it; the struct `options`
 * need not. Fails with BVHD_INVALID if a function is missing, and with BVHD_NO_MEMORY.
 */
BVHD_API enum bvhd_status bvhd_vulkan_device_create(const struct bvhd_vulkan_device_options *options,
                                                    struct bvhd_vulkan_device **ret_device,
                                                    struct bvhd_error *ret_error);
/* Frees the device object. NULL is allowed and does nothing. */
BVHD_API void bvhd_vulkan_device_destroy(struct bvhd_vulkan_device *device);

/*
 * A queue with compute support, for work that the library submits itself. No other thread may use it during the call.
 */
struct bvhd_vulkan_queue {
    VkQueue queue;
    uint32_t family;
};

/* ---- The format that the device loads ---- */

/*
 * Builds a few tiny structures on the device, serializes them, and packs the bytes into a probe, which
 * bvhd_format_from_probe reads. The call submits work and waits for it. The caller frees the block with
 * bvhd_vulkan_free. Returns BVHD_UNSUPPORTED if the device has no acceleration structures: it can then load only the
 * portable target.
 */
BVHD_API enum bvhd_status bvhd_vulkan_probe(struct bvhd_vulkan_device *device, const struct bvhd_vulkan_queue *queue,
                                            void **ret_probe, uint64_t *ret_size, struct bvhd_error *ret_error);
/* Frees the block of a probe. NULL is allowed and does nothing. */
BVHD_API void bvhd_vulkan_free(void *block);

/*
 * Checks whether the device can load a serialized structure from an untrusted source. A structure that passes can be
 * uploaded and traced without harm to the driver: the check reads the whole structure, each byte once. (The driver's
 * own check compares 16 bytes and accepts everything else.) The check does not cover what the contents mean to the
 * program: in ray-tracing pipelines, geometry indices and instance offsets select records of the program's shader
 * binding table, and may lead beyond its end.
 *
 * `format` is the result of a probe of this device; a format that is out of date is detected. With NULL only portable
 * structures pass. `data` is aligned to 16 bytes.
 *
 * Returns BVHD_INCOMPATIBLE if the structure was made for another driver or version; the text names its target and the
 * one that this device needs. BVHD_UNSUPPORTED: the structure is native, but the device has no acceleration structures,
 * so that it can load only the portable target. BVHD_TOO_LARGE: the structure exceeds the device's limits, or is
 * portable and larger than 8 GiB. BVHD_CORRUPT: the bytes are not a valid structure. BVHD_INVALID: an argument is
 * wrong, for example a native structure without a format. BVHD_NO_MEMORY.
 */
BVHD_API enum bvhd_status bvhd_vulkan_check(struct bvhd_vulkan_device *device, const struct bvhd_format *format,
                                            const void *data, uint64_t size, struct bvhd_error *ret_error);

/*
 * Finds the row in a top-level structure of each reference of its request. Writes reference_count numbers to ret_rows,
 * UINT32_MAX for a reference that no instance names, and the number of rows to *ret_row_count. `references` and
 * `instances` are those of the request, as plain arrays. Returns BVHD_INVALID if an instance names a handle that is not
 * among the references, and BVHD_NO_MEMORY.
 */
BVHD_API enum bvhd_status bvhd_vulkan_rows(const struct bvhd_reference *references, uint32_t reference_count,
                                           const VkAccelerationStructureInstanceKHR *instances, uint32_t instance_count,
                                           uint32_t *ret_rows, uint32_t *ret_row_count, struct bvhd_error *ret_error);

/* ---- Loading with the program's own allocator ---- */

/* The buffers that the program has to create for one serialized structure. Sizes and alignments are in bytes. */
struct bvhd_vulkan_requirements {
    enum bvhd_target target;
    /*
     * VK_ACCELERATION_STRUCTURE_TYPE_TOP_LEVEL_KHR or BOTTOM; GENERIC for an empty native structure, whose bytes do not
     * reveal its type.
     */
    VkAccelerationStructureTypeKHR type;
    uint32_t handle_count; /* of a top level: the number of handles that the upload fills in */
    uint32_t reference_count; /* of a top level: the number of its rows */
    /*
     * The staging memory is host-visible. It is coherent, or the caller flushes it after the call that fills it. It is
     * needed until the copy has executed.
     */
    VkDeviceSize staging_size;
    /* portable: alignment of the offset in the staging buffer; native: of the device address there */
    VkDeviceSize staging_alignment;
    VkBufferUsageFlags staging_usage;
    /*
     * The storage is where the structure lives. If a usage contains VK_BUFFER_USAGE_SHADER_DEVICE_ADDRESS_BIT, the
     * memory must be allocated with VK_MEMORY_ALLOCATE_DEVICE_ADDRESS_BIT.
     */
    VkDeviceSize storage_size;
    VkDeviceSize storage_alignment;
    VkBufferUsageFlags storage_usage;
};

/*
 * Reads the header and the handles of a structure that has passed bvhd_vulkan_check. Fails with BVHD_CORRUPT,
 * BVHD_INCOMPATIBLE or BVHD_INVALID.
 */
BVHD_API enum bvhd_status bvhd_vulkan_requirements(struct bvhd_vulkan_device *device, const void *data, uint64_t size,
                                                   struct bvhd_vulkan_requirements *ret_requirements,
                                                   struct bvhd_error *ret_error);

/* A range of a buffer that has memory bound. */
struct bvhd_vulkan_span {
    VkBuffer buffer;
    VkDeviceSize offset;
    /* bytes, at least the required size; an acceleration structure is created with exactly that size */
    VkDeviceSize size;
};

/* The upload of one structure: its bytes, the staging memory, and the storage where it is going to live. */
struct bvhd_vulkan_upload {
    size_t struct_size; /* sizeof(struct bvhd_vulkan_upload) */
    const void *data; /* a serialized structure that has passed bvhd_vulkan_check; not needed after the call */
    uint64_t size;
    struct bvhd_vulkan_span staging;
    void *staging_mapped; /* host address of staging.offset */
    struct bvhd_vulkan_span storage;
    /*
     * For a top level: references[r] is the location of the structure of row r. Native: its device address, from
     * bvhd_vulkan_address. Portable: the start of its storage, either as the device address or, when the whole scene
     * lies in one buffer, as the offset in that buffer; the same kind for all rows. Entries of rows that no instance
     * names are ignored.
     */
    const uint64_t *references;
    uint32_t reference_count;
};

/*
 * Fills the staging memory and records the upload into `commands`, outside of a render pass. On failure nothing is
 * recorded.
 *
 * Native: creates *ret_structure over the storage; the caller destroys it with vkDestroyAccelerationStructureKHR and
 * the device's allocator. Portable: *ret_structure is VK_NULL_HANDLE. The storage receives the body of the portable
 * layout (FORMATS.md, chapter 2), whose instances hold the locations of their bottom levels; bvhd_ray_query.glsl takes
 * the start of the storage as its root.
 *
 * Barriers before the copy: none are needed. The copy sees what the host wrote before the submission; the storage must
 * not be in use. After the copy, before anything reads the structure or builds upon it, the caller records a barrier of
 * its own or calls bvhd_vulkan_record_barrier. Native: source stage ACCELERATION_STRUCTURE_BUILD, access
 * ACCELERATION_STRUCTURE_WRITE; portable: source stage TRANSFER, access TRANSFER_WRITE. Uploads need no barriers
 * between each other. A top level may be uploaded before its bottom levels have been, as long as those structures have
 * been created.
 *
 * Returns BVHD_INVALID if a span is too small or misaligned, or if a row that an instance names has no reference;
 * BVHD_NO_MEMORY; and the errors of bvhd_vulkan_requirements.
 */
BVHD_API enum bvhd_status bvhd_vulkan_record_upload(struct bvhd_vulkan_device *device, VkCommandBuffer commands,
                                                    const struct bvhd_vulkan_upload *upload,
                                                    VkAccelerationStructureKHR *ret_structure,
                                                    struct bvhd_error *ret_error);

/*
 * Records one barrier after any number of uploads: it makes their writes visible to later ray queries, ray-tracing
 * pipelines, shaders and copies.
 */
BVHD_API void bvhd_vulkan_record_barrier(struct bvhd_vulkan_device *device, VkCommandBuffer commands);

/* Returns the device address of a native structure, by which instances reference it. */
BVHD_API uint64_t bvhd_vulkan_address(struct bvhd_vulkan_device *device, VkAccelerationStructureKHR structure);

/* ---- Loading a whole scene in one call ---- */

/* Structures in a device's memory. */
struct bvhd_vulkan_scene;

/* The bytes of one structure. */
struct bvhd_vulkan_bytes {
    const void *data;
    uint64_t size;
};

enum {
    /* portable: instances name bottom levels by device address instead of the offset in the buffer */
    BVHD_VULKAN_SCENE_ADDRESSES = 0x1,
};

/* The structures of a scene, and how to load them. */
struct bvhd_vulkan_scene_options {
    size_t struct_size; /* sizeof(struct bvhd_vulkan_scene_options) */
    /*
     * The bottom levels and, last, the top level over them; or one bottom level alone. blobs[r] is row r of the top
     * level, and may be {NULL, 0} if no instance names that row. All blobs have the same target. Rows with the same
     * `data` pointer are loaded once. The blobs are not needed after the call.
     */
    const struct bvhd_vulkan_bytes *blobs;
    uint32_t blob_count;
    uint32_t flags; /* BVHD_VULKAN_SCENE_ flags */
    const struct bvhd_format *format; /* the device's format, for native structures; NULL: the call probes the device */
};

/*
 * Checks every blob as bvhd_vulkan_check does, uploads all of them and waits. It allocates a few large blocks, of
 * device-local memory if there is any, for any number of structures, and uploads in steps of at most 32 MiB (or the
 * size of the largest native structure). Fails as bvhd_vulkan_check does, with "blobs[3]: ..." as the place; with
 * BVHD_INVALID if an instance names a row that has no structure; and with BVHD_NO_MEMORY. On failure nothing stays
 * allocated.
 */
BVHD_API enum bvhd_status bvhd_vulkan_scene_create(struct bvhd_vulkan_device *device,
                                                   const struct bvhd_vulkan_queue *queue,
                                                   const struct bvhd_vulkan_scene_options *options,
                                                   struct bvhd_vulkan_scene **ret_scene, struct bvhd_error *ret_error);
/* Frees the scene, which the device must not use any more. NULL is allowed and does nothing. */
BVHD_API void bvhd_vulkan_scene_destroy(struct bvhd_vulkan_scene *scene);

/* Returns the target of the scene's structures. */
BVHD_API enum bvhd_target bvhd_vulkan_scene_target(const struct bvhd_vulkan_scene *scene);

/*
 * Native scenes: returns the structure of blob `index`, for descriptors and instances; VK_NULL_HANDLE if that blob was
 * empty.
 */
BVHD_API VkAccelerationStructureKHR bvhd_vulkan_scene_structure(const struct bvhd_vulkan_scene *scene, uint32_t index);

/*
 * Portable scenes: finds the storage of blob `index`. One buffer of *ret_buffer_size bytes holds the whole scene;
 * shaders bind it as a whole. Returns BVHD_NOT_FOUND if that blob was empty, and for native scenes.
 */
BVHD_API enum bvhd_status bvhd_vulkan_scene_storage(const struct bvhd_vulkan_scene *scene, uint32_t index,
                                                    struct bvhd_vulkan_span *ret_span, VkDeviceSize *ret_buffer_size);

/*
 * Returns the root that a shader takes for blob `index`. Portable: its offset in the scene's buffer or, with
 * BVHD_VULKAN_SCENE_ADDRESSES, its device address. Native: its device address. UINT64_MAX if there is no such
 * structure.
 */
BVHD_API uint64_t bvhd_vulkan_scene_location(const struct bvhd_vulkan_scene *scene, uint32_t index);

#ifdef __cplusplus
}
#endif

#endif
