/* SPDX-License-Identifier: Apache-2.0 */
/*
 * bvhd_trace.h - traces rays through portable structures on any Vulkan device with compute shaders: the library's own
 * kernels, recorded into the program's command buffers.
 *
 * It is for programs that need a hit for each ray of a buffer. The kernels give the same answers as a shader of the
 * program that includes bvhd_ray_query.glsl, on a GPU at about three times the rate. Programs that decide something
 * during traversal (alpha tests, AABBs with a surface inside) need such a shader.
 *
 *     bvhd_vulkan_scene_create(device, &queue, &scene_options, &scene, &error);              portable structures
 *     bvhd_tracer_create(device, &queue, &tracer_options, &tracer, &error);                  once for a scene
 *     bvhd_tracer_bind(tracer, &buffers, &binding, &error);                                  once for a pair of buffers
 *     bvhd_tracer_record(binding, commands, &trace, &error);                                 each time
 *
 * All work is done on the device: bvhd_tracer_record records a few dispatches without any read-back. A command buffer
 * with them may be submitted any number of times.
 *
 * Threads: a tracer is immutable once it is created, so any number of threads may bind and record with it at once. A
 * binding is used by one thread at a time. The caller synchronises queues and command buffers as Vulkan requires.
 * Errors are reported as in bvhd.h; a Vulkan error becomes BVHD_NO_MEMORY, BVHD_UNAVAILABLE (device lost) or
 * BVHD_INTERNAL, with the name of the Vulkan function in `where`.
 */
#ifndef BVHD_BVHD_TRACE_H
#define BVHD_BVHD_TRACE_H

#include <bvhd/bvhd_vulkan.h>

#ifdef __cplusplus
extern "C" {
#endif

/* ---- Rays and hits, as buffers hold them ---- */

/* A ray, which starts at `origin`: 48 bytes, std430. Shaders include bvhd_ray.glsl for the same struct, BvhdRay. */
struct bvhd_ray {
    float origin[3];
    float tmin; /* not negative */
    /*
     * The direction need not have unit length. A ray hits nothing if its direction is zero, or if a component of its
     * origin or direction is not finite.
     */
    float direction[3];
    float tmax; /* may be infinite; nothing is hit unless tmin <= tmax */
    /* SPIR-V's ray flags. They are read only with BVHD_TRACE_RAY_FLAGS, and must be 0 without it. */
    uint32_t flags;
    uint32_t mask; /* bits 7 .. 0: an instance is skipped if its mask has none of these bits; 0xff hits all */
    /* 0 .. 1: when it meets what moves; at any other time it misses that. Scenes without motion do not read it. */
    float time;
    uint32_t reserved; /* not read */
};

#define BVHD_NO_INSTANCE UINT32_C(0xffffffff)

/*
 * The answer to a ray: 32 bytes, std430 (BvhdHit in shaders). A ray that hits nothing has t = +infinity, instance =
 * BVHD_NO_INSTANCE, and 0 in all other fields.
 *
 * A triangle is hit if tmin < t < tmax. If triangles have equal distances, to 32 significant bits, the one with the
 * lowest (instance, geometry, primitive) is reported. No ray slips between two triangles that share an edge. Triangles
 * of geometries without VK_GEOMETRY_OPAQUE_BIT_KHR are hit, too. AABBs are hit where the ray enters them.
 *
 * Spheres and linear swept spheres are hit as triangles are, where the ray enters them from outside. Their facing has
 * no effect, and the ray flag that skips triangles skips them, too.
 */
struct bvhd_hit {
    float t; /* the point is origin + t * direction */
    /*
     * The point of a triangle is (1 - u - v) * v0 + u * v1 + v * v2. Of a linear swept sphere, u says how far the
     * sphere that touches the point has moved: 0 at the first end, 1 at the second. Both are 0 otherwise.
     */
    float u, v;
    uint32_t instance; /* its position among the instances of the top level; BVHD_NO_INSTANCE without a top level */
    uint32_t custom_index; /* instanceCustomIndex, 24 bits */
    uint32_t geometry; /* index in the bottom level */
    uint32_t primitive; /* index in the geometry */
    uint32_t flags; /* BVHD_HIT_ */
};

enum {
    BVHD_HIT_FRONT_FACE = 0x1, /* always set for spheres and linear swept spheres */
    BVHD_HIT_AABB = 0x2,
    BVHD_HIT_SPHERE = 0x4,
    BVHD_HIT_SWEPT_SPHERE = 0x8, /* a linear swept sphere */
};

/* ---- The tracer ---- */

/* Compiled kernels for the rays of one scene. */
struct bvhd_tracer;

struct bvhd_tracer_options {
    size_t struct_size; /* sizeof(struct bvhd_tracer_options) */

    /*
     * A scene of portable structures, which must outlive the tracer. Programs with an allocator of their own set it to
     * NULL, and describe their structures by the fields below.
     */
    const struct bvhd_vulkan_scene *scene;
    /*
     * The index of the structure that rays enter first, a top level or a bottom level: in the scene's blobs or `blobs`.
     */
    uint32_t root;

    /*
     * Without a scene: the one buffer that holds all structures, uploaded as bvhd_vulkan_record_upload says, with
     * VK_BUFFER_USAGE_STORAGE_BUFFER_BIT. It must outlive the tracer and be uploaded before rays are traced.
     */
    VkBuffer buffer;
    VkDeviceSize buffer_size;
    /* The buffer's device address if instances name their bottom levels by addresses; 0 if they do by offsets in it. */
    VkDeviceAddress buffer_address;
    uint64_t root_location; /* where the root begins: an offset in the buffer, or a device address */
    /*
     * The serialized structures in the buffer, which bvhd_vulkan_check has passed: they are read during the call, to
     * choose kernels that fit them, and not needed afterwards. Entries may be {NULL, 0}.
     */
    const struct bvhd_vulkan_bytes *blobs;
    uint32_t blob_count;

    /* The feature shaderFloat64 was enabled when the device was created. On some devices it makes tracing faster. */
    VkBool32 has_shader_float64;
    VkPipelineCache cache; /* for the pipelines; may be VK_NULL_HANDLE */
};

/*
 * Compiles the kernels. With a queue (else NULL) it also submits a test of 256 values and waits, which finds out
 * whether the device keeps denormal halves; if it does, tracing is some percent faster. No other thread may use the
 * queue during the call.
 *
 * The device must have Vulkan 1.1 (else BVHD_UNSUPPORTED) and a queue with compute; no other feature is required. If it
 * has no subgroup ballots in compute shaders, or if the scene has AABBs, spheres, linear swept spheres or anything that
 * moves, or if it is larger than 4 GiB, all rays are traced by the portable ray query, at about a third of the rate.
 * With bufferDeviceAddress enabled (and a scene of BVHD_VULKAN_SCENE_ADDRESSES, or a buffer_address) the scene may be
 * larger than the device can bind, and the kernels that use doubles can be chosen.
 *
 * Returns BVHD_INVALID if an option is wrong or a structure is native, BVHD_NOT_FOUND if there is no structure `root`,
 * BVHD_TOO_LARGE if the buffer is larger than a shader can bind and has no address, and BVHD_NO_MEMORY.
 */
BVHD_API enum bvhd_status bvhd_tracer_create(struct bvhd_vulkan_device *device, const struct bvhd_vulkan_queue *queue,
                                             const struct bvhd_tracer_options *options, struct bvhd_tracer **ret_tracer,
                                             struct bvhd_error *ret_error);
/*
 * Frees a tracer, which the device must not use any more. Its bindings must have been destroyed before. NULL is allowed
 * and does nothing.
 */
BVHD_API void bvhd_tracer_destroy(struct bvhd_tracer *tracer);

/*
 * Returns the largest number of rays that one bvhd_tracer_record can trace, by the device's limits on dispatches and
 * bound buffers. It is more than 2 million.
 */
BVHD_API uint32_t bvhd_tracer_max_rays(const struct bvhd_tracer *tracer);

/* ---- Buffers ---- */

/* Returns the bytes of scratch memory that a binding for max_rays rays needs: about 28 for each ray, or 0. */
BVHD_API VkDeviceSize bvhd_tracer_scratch_size(const struct bvhd_tracer *tracer, uint32_t max_rays);

/* The buffers of rays and hits, which the program creates. */
struct bvhd_trace_buffers {
    size_t struct_size; /* sizeof(struct bvhd_trace_buffers) */
    /*
     * Arrays of max_rays struct bvhd_ray and of max_rays struct bvhd_hit; hit i belongs to ray i. Both buffers have
     * VK_BUFFER_USAGE_STORAGE_BUFFER_BIT. Offsets are multiples of minStorageBufferOffsetAlignment. The spans must not
     * overlap.
     */
    struct bvhd_vulkan_span rays, hits;
    /*
     * Memory for the kernels: at least bvhd_tracer_scratch_size bytes, with the usage bits STORAGE_BUFFER and
     * TRANSFER_DST. If its buffer is VK_NULL_HANDLE, the library allocates the memory and frees it with the binding.
     */
    struct bvhd_vulkan_span scratch;
    uint32_t max_rays; /* 1 .. bvhd_tracer_max_rays */
};

/* A tracer with the buffers that it reads and writes. */
struct bvhd_trace_binding;

/*
 * Binds buffers to a tracer. The tracer and the buffers must outlive the binding, which the caller destroys. Returns
 * BVHD_INVALID if a span is missing, misaligned or too small, BVHD_TOO_LARGE if max_rays is more than
 * bvhd_tracer_max_rays, and BVHD_NO_MEMORY.
 */
BVHD_API enum bvhd_status bvhd_tracer_bind(const struct bvhd_tracer *tracer, const struct bvhd_trace_buffers *buffers,
                                           struct bvhd_trace_binding **ret_binding, struct bvhd_error *ret_error);
/* Frees a binding, which the device must not use any more. NULL is allowed and does nothing. */
BVHD_API void bvhd_trace_binding_destroy(struct bvhd_trace_binding *binding);

/* ---- Tracing ---- */

/*
 * Whether neighbours in the buffer of rays are similar. It decides which kernel runs, and so the rate, but not the
 * hits.
 */
enum bvhd_ray_order {
    /*
     * It is not known. The kernel for incoherent rays runs, which loses less than the other one if it is the wrong one.
     */
    BVHD_RAYS_UNKNOWN = 0,
    /* Neighbours in the buffer go nearly the same way: camera rays in tiles of 8 x 4 pixels, rays to one light. */
    BVHD_RAYS_COHERENT = 1,
    /* Neighbours go different ways: diffuse bounces, rays from random places. */
    BVHD_RAYS_INCOHERENT = 2,
};

/*
 * Decides whether rays in host memory are coherent, from their directions at 64 places. Each ray begins `stride` bytes
 * after the one before it, with the fields of struct bvhd_ray up to its direction.
 */
BVHD_API enum bvhd_ray_order bvhd_rays_order(const void *rays, uint64_t count, size_t stride);

enum {
    /*
     * Any triangle or AABB between tmin and tmax is an answer, not only the closest one: for shadows and visibility.
     * Which one is reported is not defined.
     */
    BVHD_TRACE_ANY_HIT = 0x1,
    /*
     * Rays have flags of their own, or a tmin that may be negative or not a number. They are then traced by the
     * portable ray query, which reads flags, at about a third of the rate.
     */
    BVHD_TRACE_RAY_FLAGS = 0x2,
};

/* The number of rays of one launch, and how they are traced. */
struct bvhd_trace {
    size_t struct_size; /* sizeof(struct bvhd_trace) */
    uint32_t ray_count; /* how many rays to trace, from the start of the buffer: 0 .. the binding's max_rays */
    uint32_t flags; /* BVHD_TRACE_ */
    enum bvhd_ray_order order;
};

/*
 * Records the dispatches that trace the first ray_count rays of the binding's buffer. The call must be outside of a
 * render pass. It replaces the pipeline, descriptor set 0 and the push constants of the compute bind point.
 *
 * The caller records barriers for the rays and hits. Before this call: one that makes the writes of the rays visible to
 * stage COMPUTE_SHADER, access SHADER_READ, and waits for earlier uses of the hits. After this call, before anything
 * reads the hits or overwrites the rays: one with source stage COMPUTE_SHADER, access SHADER_WRITE. Writes by the host
 * before the submission need no barrier. The call itself records the barriers for the scratch memory, between its
 * dispatches and after earlier ones of the same binding on the same queue. If one binding is used on several queues,
 * the caller keeps these uses apart by semaphores.
 *
 * Returns BVHD_INVALID if there are unknown flags or more rays than the binding has; nothing is recorded then.
 */
BVHD_API enum bvhd_status bvhd_tracer_record(const struct bvhd_trace_binding *binding, VkCommandBuffer commands,
                                             const struct bvhd_trace *trace, struct bvhd_error *ret_error);

#ifdef __cplusplus
}
#endif

#endif
