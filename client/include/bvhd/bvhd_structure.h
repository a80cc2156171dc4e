/* SPDX-License-Identifier: Apache-2.0 */
/*
 * bvhd_structure.h - acceleration structures as objects of the host, with Vulkan's rules: the sizes that a build needs,
 * creation, indirect builds, copies, serialization, queries and compatibility, for programs that are written in the
 * terms of Vulkan's host commands.
 *
 * The structs are Vulkan's own, and a broken rule is reported by its VUID. No call here needs a device, a daemon or the
 * builder: what is built comes from bvhd_batch_submit, and an object holds it.
 *
 *     bvhd_structure_sizes(&query, &sizes, &error);                    from counts, before anything is built
 *     create.size = sizes.accelerationStructureSize;
 *     bvhd_structure_create(&create, &structure, &error);
 *     info.dstAccelerationStructure = bvhd_structure_handle(structure);
 *     bvhd_batch_submit(client, &build, &batch, &error), bvhd_batch_wait(batch, -1);
 *     bvhd_structure_hold(structure, &info, ranges, bvhd_batch_result(batch, 0), &error);
 *     bvhd_structure_copy(&copy, &error);                              clone, compact
 *     bvhd_structure_destroy(structure);
 *
 * Memory: VkBuffers are not used. `size` of an object is only compared with what it is going to hold, and an object
 * takes no memory but for the bytes that it holds, which clones and results share.
 *
 * Handles: the VkAccelerationStructureKHR of an object stands for it in Vulkan's structs. Handles that are not those of
 * an object which exists must not be passed to this header's functions, as Vulkan's must not.
 *
 * Threads: several threads may read an object at once. A call that changes one (hold, and the destination of copy and
 * deserialize) needs it alone, as in Vulkan. Different objects are independent.
 *
 * Build flags have these effects, beside the rules above:
 *
 *     ALLOW_UPDATE          no spatial splits; degenerate primitives stay, because an update may move them
 *     ALLOW_COMPACTION      COMPACT and its size are allowed
 *     PREFER_FAST_TRACE     quality high, if the request names none
 *     PREFER_FAST_BUILD     quality fast, if the request names none
 *     LOW_MEMORY            no spatial splits, which bounds the memory of a build as said below
 *     ALLOW_DATA_ACCESS     positions can be read by bvhd_structure_positions, from a hit by bvhd_cpu_scene_corners and
 *                           in shaders; it changes no other byte of a structure, whose positions are exact in any case
 *
 * With LOW_MEMORY a build by bvhd's own builder never takes more bytes at once, on any number of threads, of each
 * quality and in each target, than the sum of
 *
 *     65,536 + 320 * triangles + 320 * boxes + 320 * spheres + 400 * instances + 24 * vertices + 256 * geometries
 *     + 512 * references
 *
 * with its result, and without the program's geometry and the threads' stacks. `spheres` are linear swept spheres, too,
 * `vertices` those of indexed geometries (maxVertex + 1 for each; of spheres, as many as the indices reach), and
 * `references` the bottom levels that are given to a top level. In a structure with geometry that moves, a triangle
 * takes 480, an instance 640 and a vertex 48.
 *
 * Errors are reported as in bvhd.h; a call that fails changes nothing. Places name members of the struct that the call
 * takes, as "info.mode".
 */
#ifndef BVHD_BVHD_STRUCTURE_H
#define BVHD_BVHD_STRUCTURE_H

#include <bvhd/bvhd.h>

#ifdef __cplusplus
extern "C" {
#endif

/* An acceleration structure on the host: empty, or holding a built structure. */
struct bvhd_structure;

/* ---- Sizes ---- */

/* The build whose sizes are wanted. */
struct bvhd_structure_sizes_query {
    size_t struct_size; /* sizeof(struct bvhd_structure_sizes_query) */
    VkAccelerationStructureBuildTypeKHR build_type; /* any: all builds are the host's */
    enum bvhd_target target; /* 0: portable */
    /*
     * As in the build. `mode`, handles and addresses are ignored, except that a transform which is not NULL here may be
     * NULL there, but not the other way round. Vertex strides are not looked at.
     */
    const VkAccelerationStructureBuildGeometryInfoKHR *info;
    const uint32_t *max_primitive_counts; /* info->geometryCount numbers: no build has more in any geometry */
    uint32_t layout_flags; /* of the target, as in struct bvhd_build */
    enum bvhd_quality quality; /* of the build; UNSPECIFIED without PREFER flags, and AUTO: of any quality */
};

/*
 * Computes the sizes that a build needs (vkGetAccelerationStructureBuildSizesKHR), from the query alone. No structure
 * that is built with at most these geometries, primitives and vertices is larger than accelerationStructureSize, which
 * never decreases when one of them grows. It is what the worst tree takes, so that most structures need about a
 * quarter: a copy by COMPACT needs no more than the structure itself. Both scratch sizes are 0, because the library and
 * the service have scratch memory of their own. sType and pNext of *ret_sizes are the caller's.
 *
 * Returns BVHD_INVALID with the rule, at a place such as "infos[0].geometries[2].triangles.vertexFormat", or
 * BVHD_UNSUPPORTED for what bvhd does not build; BVHD_NO_MEMORY.
 */
BVHD_API enum bvhd_status bvhd_structure_sizes(const struct bvhd_structure_sizes_query *query,
                                               VkAccelerationStructureBuildSizesInfoKHR *ret_sizes,
                                               struct bvhd_error *ret_error);

/* ---- Objects ---- */

/*
 * Creates an object that is empty (vkCreateAccelerationStructureKHR). `type` may be GENERIC: the object then may hold
 * either type. `buffer` is ignored. Of the create flags, MOTION can be used: such an object holds only what was built
 * with the flag MOTION, and a top level's info then has a VkAccelerationStructureMotionInfoNV in its chain, with the
 * most instances that it is to have, by copies too. The flags of capture and replay belong to features that are not
 * offered. The caller destroys the object with bvhd_structure_destroy.
 */
BVHD_API enum bvhd_status bvhd_structure_create(const VkAccelerationStructureCreateInfoKHR *info,
                                                struct bvhd_structure **ret_structure, struct bvhd_error *ret_error);

/* Frees an object. NULL is allowed and does nothing. */
BVHD_API void bvhd_structure_destroy(struct bvhd_structure *structure);

/* Returns the handle that stands for an object in Vulkan's structs; VK_NULL_HANDLE for NULL. */
BVHD_API VkAccelerationStructureKHR bvhd_structure_handle(const struct bvhd_structure *structure);

/*
 * Makes the object hold a result, as if it had been built into it: instead of what it held before. `info` and `ranges`
 * are those of the build (`ranges` may be NULL without geometries). The rules are those about the destination of a
 * build: it was created as the type that was built, or as GENERIC, with MOTION exactly if the build has that flag, and
 * at least as large as bvhd_structure_sizes says for the counts in `ranges` and the quality that was built. An info of
 * the mode UPDATE names an object of this header as its source: if that holds what COMPACT made, an update of it or a
 * deserialized structure, the destination needs only the compacted size, which an update does not change. A program
 * that named the source to bvhd_batch_submit by a number of its own sets VK_NULL_HANDLE instead, which counts as a
 * source that is not compacted. The object takes a reference to the result's blob: batch and client are not needed
 * afterwards.
 *
 * Returns the error of a result that has one, and BVHD_INVALID if it is no result of such an info.
 */
BVHD_API enum bvhd_status bvhd_structure_hold(struct bvhd_structure *structure,
                                              const VkAccelerationStructureBuildGeometryInfoKHR *info,
                                              const VkAccelerationStructureBuildRangeInfoKHR *ranges,
                                              const struct bvhd_result *result, struct bvhd_error *ret_error);

/* What an object is. Later versions may append members. */
struct bvhd_structure_state {
    VkAccelerationStructureTypeKHR created_type; /* as it was created */
    uint64_t created_size;
    int is_built; /* 1: it holds a structure; 0: it is empty, and what follows is 0 */
    /* TOP_LEVEL, BOTTOM_LEVEL, or GENERIC for an empty native structure, whose bytes do not reveal it */
    VkAccelerationStructureTypeKHR type;
    /*
     * The flags of the build. COMPACT takes ALLOW_COMPACTION away. A native structure that was deserialized has none,
     * because its bytes do not say.
     */
    VkBuildAccelerationStructureFlagsKHR flags;
    enum bvhd_target target;
    /* The serialized structure, aligned to 16 bytes: unchanged as long as the object holds it. */
    const void *data;
    uint64_t data_size;
};

/* Describes an object. Returns BVHD_INVALID for a NULL pointer. */
BVHD_API enum bvhd_status bvhd_structure_get(const struct bvhd_structure *structure,
                                             struct bvhd_structure_state *ret_state);

/* ---- Positions ---- */

/*
 * Give the corners of a triangle by the number of its geometry and its number there, as in the build's info: of a
 * structure that was built with ALLOW_DATA_ACCESS, in either target. They are the positions that
 * VK_KHR_ray_tracing_position_fetch gives to shaders: those of the last build or update, decoded to floats, after the
 * geometry's transformData, exactly as the builder used them. (In structures for lavapipe before Mesa 26, -0 is 0, as
 * in that driver's own.) The call takes no longer for larger portable structures, unless nearly all of their triangles
 * have no area; their objects hold 4 bytes more for each triangle. With _at the triangle may be one of a structure that
 * moves: its corners are then those at the time, where rays of that time meet it.
 *
 * Return BVHD_INVALID at the place "structure" for an object that is empty, or that was built without the flag, which
 * the bytes of a native structure that was deserialized do not tell; at "time" for one that is not in 0 .. 1; at
 * "geometry" for other primitives than triangles, for what moves if no time is given, and for a geometry that is not
 * there; at "primitive" for a number beyond the geometry's, and for a triangle that the structure does not hold: an
 * inactive one, and in portable structures without ALLOW_UPDATE one that is degenerate or infinite, because no ray hits
 * it.
 */
BVHD_API enum bvhd_status bvhd_structure_positions(const struct bvhd_structure *structure, uint32_t geometry,
                                                   uint32_t primitive, float ret_positions[3][3],
                                                   struct bvhd_error *ret_error);
BVHD_API enum bvhd_status bvhd_structure_positions_at(const struct bvhd_structure *structure, uint32_t geometry,
                                                      uint32_t primitive, float time, float ret_positions[3][3],
                                                      struct bvhd_error *ret_error);

/* ---- Indirect builds ---- */

/* Where the ranges of a build are, as the arguments of vkCmdBuildAccelerationStructuresIndirectKHR. */
struct bvhd_indirect {
    size_t struct_size; /* sizeof(struct bvhd_indirect) */
    uint32_t info_count;
    const VkAccelerationStructureBuildGeometryInfoKHR *infos;
    /* addresses[i] has a VkAccelerationStructureBuildRangeInfoKHR every strides[i] bytes: one for each geometry */
    const void *const *addresses; /* multiples of 4; NULL only without geometries */
    const uint32_t *strides; /* multiples of 4; with 0, all geometries of an info share one range */
    const uint32_t *const *max_primitive_counts; /* [i][j]: at least the primitiveCount that is read */
};

/*
 * Reads the ranges of indirect builds, for the member `ranges` of struct bvhd_build: once, so that they may change as
 * soon as this returns. The caller frees them with bvhd_indirect_free after bvhd_batch_submit, which checks the rest of
 * their rules. Sizes are asked for by the maxima. Places are such as "indirect.strides[2]".
 *
 * Returns BVHD_INVALID with the rule; BVHD_NO_MEMORY.
 */
BVHD_API enum bvhd_status bvhd_indirect_read(const struct bvhd_indirect *indirect,
                                             const VkAccelerationStructureBuildRangeInfoKHR *const **ret_ranges,
                                             struct bvhd_error *ret_error);

/* Frees ranges that were read. NULL is allowed and does nothing. */
BVHD_API void bvhd_indirect_free(const VkAccelerationStructureBuildRangeInfoKHR *const *ranges);

/* ---- Copies ---- */

/*
 * Copies from one object to another (vkCopyAccelerationStructureKHR): CLONE, or COMPACT of one that was built with
 * ALLOW_COMPACTION. Structures are always written as small as they can be, so that COMPACT moves nothing: its bytes are
 * those of a build without that flag, and the destination needs only the size of the property COMPACTED_SIZE, not that
 * of bvhd_structure_sizes. References of top levels are kept. The rules are Vulkan's; the destination was created as
 * the source's type or as GENERIC.
 */
BVHD_API enum bvhd_status bvhd_structure_copy(const VkCopyAccelerationStructureInfoKHR *info,
                                              struct bvhd_error *ret_error);

/*
 * Writes the bytes of an object to `dst.hostAddress`, which is aligned to 16 bytes and has `size` bytes
 * (vkCopyAccelerationStructureToMemoryKHR). They are those of the result, byte for byte.
 */
BVHD_API enum bvhd_status bvhd_structure_serialize(const VkCopyAccelerationStructureToMemoryInfoKHR *info,
                                                   uint64_t size, struct bvhd_error *ret_error);

/*
 * Makes an object hold the serialized structure at `src.hostAddress`, which is aligned to 16 bytes, and `size` bytes
 * long at the most (vkCopyMemoryToAccelerationStructureKHR). The bytes may come from anywhere: they are copied and then
 * checked, each of them, as bvhd_cpu_scene_create does. `format` is the native format that counts as compatible beside
 * the portable one; NULL: there is none.
 *
 * Returns BVHD_INVALID with rule 04960 for bytes that are no serialized structure (the text says why), with 03414 for
 * one of another driver or version, with 03746 if the object is too small; BVHD_NO_MEMORY.
 */
BVHD_API enum bvhd_status bvhd_structure_deserialize(const VkCopyMemoryToAccelerationStructureInfoKHR *info,
                                                     uint64_t size, const struct bvhd_format *format,
                                                     struct bvhd_error *ret_error);

/* ---- Properties ---- */

/* The properties that are wanted, as the arguments of vkWriteAccelerationStructuresPropertiesKHR. */
struct bvhd_structure_properties {
    size_t struct_size; /* sizeof(struct bvhd_structure_properties) */
    uint32_t structure_count; /* accelerationStructureCount */
    VkQueryType query_type;
    const VkAccelerationStructureKHR *structures; /* handles of objects that hold something */
    size_t data_size; /* bytes at `data` */
    void *data;
    size_t stride; /* bytes from one number to the next, a multiple of 8 */
};

/*
 * Writes one property of each object, as a VkDeviceSize every `stride` bytes:
 *
 *     COMPACTED_SIZE                         what the destination of COMPACT needs; of objects with ALLOW_COMPACTION
 *     SIZE                                   what the destination of CLONE needs: the deserialized size
 *     SERIALIZATION_SIZE                     bytes that bvhd_structure_serialize writes
 *     SERIALIZATION_BOTTOM_LEVEL_POINTERS    handles in these bytes; of top levels
 *
 * Places name an object as "structures[3]".
 */
BVHD_API enum bvhd_status bvhd_structure_query(const struct bvhd_structure_properties *properties,
                                               struct bvhd_error *ret_error);

/*
 * Compares the first 32 bytes of a serialized structure with what bvhd_structure_deserialize takes
 * (vkGetDeviceAccelerationStructureCompatibilityKHR). `format` is as there.
 */
BVHD_API enum bvhd_status bvhd_structure_compatibility(const VkAccelerationStructureVersionInfoKHR *info,
                                                       const struct bvhd_format *format,
                                                       VkAccelerationStructureCompatibilityKHR *ret_compatibility,
                                                       struct bvhd_error *ret_error);

#ifdef __cplusplus
}
#endif

#endif
