/* SPDX-License-Identifier: Apache-2.0 */
#include <stddef.h>
#include <string.h>

#include "builder/format/portable.h"
#include "builder/format/serialized.h"
#include "client/library.h"
#include "client/result_blob.h"
#include "client/structure/structure.h"
#include "proto/base/place.h"

/* Host addresses of serialized structures have this alignment. */
enum { SERIAL_ALIGNMENT = 16 };

/* The rules about a mode: that it is one at all, and that it is the one of the call. */
struct mode_rules {
    enum bvhd_vuid parameter, own;
    uint32_t first, last; /* modes of the call */
};

static enum bvhd_status check_mode(uint32_t mode, const struct mode_rules *rules, struct bvhd_error *error)
{
    if (mode > VK_COPY_ACCELERATION_STRUCTURE_MODE_DESERIALIZE_KHR)
        return bvhd_error_rule(error, rules->parameter, "info.mode",
                               "mode is %u, which is no VkCopyAccelerationStructureModeKHR", mode);
    if (mode < rules->first || mode > rules->last)
        return bvhd_error_rule(error, rules->own, "info.mode", "mode %u is not that of this call", mode);
    return BVHD_OK;
}

static enum bvhd_status check_handle(VkAccelerationStructureKHR handle, const char *where, enum bvhd_vuid rule,
                                     struct bvhd_error *error)
{
    return handle != VK_NULL_HANDLE ? BVHD_OK : bvhd_error_rule(error, rule, where, "it is VK_NULL_HANDLE");
}

static enum bvhd_status check_built(const struct bvhd_structure *structure, enum bvhd_vuid rule,
                                    struct bvhd_error *error)
{
    return structure->contents.blob ? BVHD_OK : bvhd_error_rule(error, rule, "info.src", "nothing was built into it");
}

static enum bvhd_status check_room(const struct bvhd_structure *structure, uint64_t needed, enum bvhd_vuid rule,
                                   struct bvhd_error *error)
{
    if (structure->size >= needed)
        return BVHD_OK;
    return bvhd_error_rule(error, rule, "info.dst", "it was created with %llu bytes, and %llu are needed",
                           (unsigned long long)structure->size, (unsigned long long)needed);
}

/*
 * A copy is made into an object that was created for such a structure: for its type, and with motion if it moves, for
 * as many instances.
 */
static enum bvhd_status check_created(const struct bvhd_structure *structure, const struct structure_contents *contents,
                                      struct bvhd_error *error)
{
    if (!structure_takes(structure, contents->type))
        return bvhd_error_set(error, BVHD_INVALID, "info.dst",
                              "it was created as a %s level, and the source is the other",
                              structure->type == STRUCTURE_TOP ? "top" : "bottom");
    if (!structure_takes_motion(structure, contents->flags))
        return bvhd_error_set(error, BVHD_INVALID, "info.dst", "it was created %s MOTION, and the source was built %s",
                              structure->moves ? "with" : "without", structure->moves ? "without" : "with");
    return structure_check_instances(structure, contents->motion_instances, "info.dst", error);
}

/* ---- clone, compact ---- */

static enum bvhd_status check_copy(const VkCopyAccelerationStructureInfoKHR *info, struct bvhd_error *error)
{
    static const struct structure_head head = {VK_STRUCTURE_TYPE_COPY_ACCELERATION_STRUCTURE_INFO_KHR,
                                               BVHD_VUID_CopyInfo_sType_sType, BVHD_VUID_CopyInfo_pNext_pNext, "info"};
    static const struct mode_rules modes = {BVHD_VUID_CopyInfo_mode_parameter, BVHD_VUID_03410,
                                            VK_COPY_ACCELERATION_STRUCTURE_MODE_CLONE_KHR,
                                            VK_COPY_ACCELERATION_STRUCTURE_MODE_COMPACT_KHR};
    enum bvhd_status status = structure_check_head(&head, info, error);
    if (status == BVHD_OK)
        status = check_handle(info->src, "info.src", BVHD_VUID_CopyInfo_src_parameter, error);
    if (status == BVHD_OK)
        status = check_handle(info->dst, "info.dst", BVHD_VUID_CopyInfo_dst_parameter, error);
    if (status == BVHD_OK)
        status = check_mode((uint32_t)info->mode, &modes, error);
    if (status == BVHD_OK && info->src == info->dst)
        status = bvhd_error_rule(error, BVHD_VUID_07791, "info.dst", "source and destination are the same structure");
    return status;
}

static enum bvhd_status check_ends(const VkCopyAccelerationStructureInfoKHR *info, struct bvhd_error *error)
{
    const struct bvhd_structure *source = structure_of(info->src), *destination = structure_of(info->dst);
    const bool compacts = info->mode == VK_COPY_ACCELERATION_STRUCTURE_MODE_COMPACT_KHR;
    enum bvhd_status status = check_built(source, BVHD_VUID_04963, error);
    if (status == BVHD_OK && compacts && !(source->contents.flags & BUILD_ALLOW_COMPACTION))
        status = bvhd_error_rule(error, BVHD_VUID_03411, "info.src", "it was built without ALLOW_COMPACTION");
    if (status == BVHD_OK)
        status = check_created(destination, &source->contents, error);
    if (status == BVHD_OK)
        status =
            check_room(destination, source->contents.body_size, compacts ? BVHD_VUID_12419 : BVHD_VUID_12418, error);
    return status;
}

/*
 * The flags of the build are the only bytes in which a structure that may be compacted differs from one that may not;
 * native structures do not store them.
 */
static void clear_compaction(unsigned char *blob, const struct structure_contents *contents)
{
    if (contents->target != TARGET_PORTABLE)
        return;
    const uint64_t body = contents->body_offset;
    unsigned char *flags = blob + body + offsetof(struct portable_header, build_flags);
    bytes_put32(flags, bytes_get32(flags) & ~(uint32_t)BUILD_ALLOW_COMPACTION);
}

static enum bvhd_status compact(struct structure_contents *contents, struct bvhd_error *error)
{
    const uint64_t size = bvhd_blob_size(contents->blob);
    unsigned char *copy = memory_alloc(&library_memory, size);
    if (!copy)
        return bvhd_error_no_memory(error, "info.dst", "no memory for %llu bytes", (unsigned long long)size);
    memcpy(copy, bvhd_blob_data(contents->blob), size);
    clear_compaction(copy, contents);
    contents->flags &= ~(uint32_t)BUILD_ALLOW_COMPACTION;
    contents->is_compacted = true;
    return result_blob_take(copy, size, &contents->blob, error);
}

enum bvhd_status bvhd_structure_copy(const VkCopyAccelerationStructureInfoKHR *info, struct bvhd_error *ret_error)
{
    enum bvhd_status status = structure_check_argument(info, "info", BVHD_VUID_Copy_pInfo_parameter, ret_error);
    if (status == BVHD_OK)
        status = check_copy(info, ret_error);
    if (status == BVHD_OK)
        status = check_ends(info, ret_error);
    if (status != BVHD_OK)
        return status;
    struct structure_contents contents = structure_of(info->src)->contents;
    if (info->mode == VK_COPY_ACCELERATION_STRUCTURE_MODE_COMPACT_KHR)
        status = compact(&contents, ret_error);
    else
        bvhd_blob_ref(contents.blob);
    if (status != BVHD_OK)
        return status;
    positions_ref(contents.positions);
    structure_replace(structure_of(info->dst), &contents);
    return BVHD_OK;
}

/* ---- serialize ---- */

static enum bvhd_status check_address(const void *address, const char *where, enum bvhd_vuid null_rule,
                                      enum bvhd_vuid alignment_rule, struct bvhd_error *error)
{
    if (!address)
        return bvhd_error_rule(error, null_rule, where, "the address is NULL");
    if ((uintptr_t)address % SERIAL_ALIGNMENT != 0)
        return bvhd_error_rule(error, alignment_rule, where, "the address is not aligned to 16 bytes");
    return BVHD_OK;
}

static enum bvhd_status check_serialize(const VkCopyAccelerationStructureToMemoryInfoKHR *info,
                                        struct bvhd_error *error)
{
    static const struct structure_head head = {VK_STRUCTURE_TYPE_COPY_ACCELERATION_STRUCTURE_TO_MEMORY_INFO_KHR,
                                               BVHD_VUID_ToMemoryInfo_sType_sType, BVHD_VUID_ToMemoryInfo_pNext_pNext,
                                               "info"};
    static const struct mode_rules modes = {BVHD_VUID_ToMemoryInfo_mode_parameter, BVHD_VUID_03412,
                                            VK_COPY_ACCELERATION_STRUCTURE_MODE_SERIALIZE_KHR,
                                            VK_COPY_ACCELERATION_STRUCTURE_MODE_SERIALIZE_KHR};
    enum bvhd_status status = structure_check_head(&head, info, error);
    if (status == BVHD_OK)
        status = check_handle(info->src, "info.src", BVHD_VUID_ToMemoryInfo_src_parameter, error);
    if (status == BVHD_OK)
        status = check_mode((uint32_t)info->mode, &modes, error);
    if (status == BVHD_OK)
        status = check_address(info->dst.hostAddress, "info.dst", BVHD_VUID_03732, BVHD_VUID_03751, error);
    if (status == BVHD_OK)
        status = check_built(structure_of(info->src), BVHD_VUID_04959, error);
    return status;
}

enum bvhd_status bvhd_structure_serialize(const VkCopyAccelerationStructureToMemoryInfoKHR *info, uint64_t size,
                                          struct bvhd_error *ret_error)
{
    enum bvhd_status status = structure_check_argument(info, "info", BVHD_VUID_CopyToMemory_pInfo_parameter, ret_error);
    if (status == BVHD_OK)
        status = check_serialize(info, ret_error);
    if (status != BVHD_OK)
        return status;
    const struct bvhd_blob *blob = structure_of(info->src)->contents.blob;
    if (size < bvhd_blob_size(blob))
        return bvhd_error_rule(ret_error, BVHD_VUID_03561, "info.dst", "it has %llu bytes, and %llu are needed",
                               (unsigned long long)size, (unsigned long long)bvhd_blob_size(blob));
    memcpy(info->dst.hostAddress, bvhd_blob_data(blob), bvhd_blob_size(blob));
    return BVHD_OK;
}

/* ---- deserialize ---- */

static enum bvhd_status check_deserialize(const VkCopyMemoryToAccelerationStructureInfoKHR *info,
                                          struct bvhd_error *error)
{
    static const struct structure_head head = {VK_STRUCTURE_TYPE_COPY_MEMORY_TO_ACCELERATION_STRUCTURE_INFO_KHR,
                                               BVHD_VUID_FromMemoryInfo_sType_sType,
                                               BVHD_VUID_FromMemoryInfo_pNext_pNext, "info"};
    static const struct mode_rules modes = {BVHD_VUID_FromMemoryInfo_mode_parameter, BVHD_VUID_03413,
                                            VK_COPY_ACCELERATION_STRUCTURE_MODE_DESERIALIZE_KHR,
                                            VK_COPY_ACCELERATION_STRUCTURE_MODE_DESERIALIZE_KHR};
    enum bvhd_status status = structure_check_head(&head, info, error);
    if (status == BVHD_OK)
        status = check_handle(info->dst, "info.dst", BVHD_VUID_FromMemoryInfo_dst_parameter, error);
    if (status == BVHD_OK)
        status = check_mode((uint32_t)info->mode, &modes, error);
    if (status == BVHD_OK)
        status = check_address(info->src.hostAddress, "info.src", BVHD_VUID_03729, BVHD_VUID_03750, error);
    return status;
}

/* Reports bytes that no structure could have been serialized to, with the reader's place and reason. */
static enum bvhd_status refuse_bytes(const struct bvhd_error *reason, struct bvhd_error *error)
{
    if (reason->status == BVHD_NO_MEMORY)
        return bvhd_error_no_memory(error, "info.src", "%s", reason->text);
    return bvhd_error_rule(error, BVHD_VUID_04960, "info.src", "%.60s: %s", reason->where, reason->text);
}

/* Copies as many bytes as the header says, which is all that is read of the program's memory, once. */
static enum bvhd_status copy_bytes(const unsigned char *source, uint64_t size, const struct bvhd_format *format,
                                   struct bvhd_blob **ret_blob, struct bvhd_error *error)
{
    unsigned char head[SERIALIZED_HANDLES];
    if (size < sizeof head)
        return bvhd_error_rule(error, BVHD_VUID_04960, "info.src", "%llu bytes hold no header",
                               (unsigned long long)size);
    memcpy(head, source, sizeof head);
    const uint64_t total = bytes_get64(head + 2 * VK_UUID_SIZE);
    if (!structure_is_compatible(head, format))
        return bvhd_error_rule(error, BVHD_VUID_03414, "info.src", "it was made for another driver or version");
    if (total < sizeof head || total > size)
        return bvhd_error_rule(error, BVHD_VUID_04960, "info.src", "its header says %llu bytes, and there are %llu",
                               (unsigned long long)total, (unsigned long long)size);
    return result_blob_copy((struct bytes){source, total}, ret_blob, error);
}

/* Checks that an object may hold what was read. The memory may have changed after the header was compared. */
static enum bvhd_status check_read(const struct bvhd_structure *structure, const struct structure_contents *contents,
                                   const struct bvhd_format *format, struct bvhd_error *error)
{
    if (!structure_is_compatible(bvhd_blob_data(contents->blob), format))
        return bvhd_error_rule(error, BVHD_VUID_03414, "info.src", "it was made for another driver or version");
    enum bvhd_status status = check_created(structure, contents, error);
    return status == BVHD_OK ? check_room(structure, contents->body_size, BVHD_VUID_03746, error) : status;
}

static enum bvhd_status deserialize(struct bvhd_structure *structure, struct bvhd_blob *blob,
                                    const struct bvhd_format *format, struct bvhd_error *error)
{
    struct structure_contents contents;
    struct bvhd_error reason = {.status = BVHD_OK};
    enum bvhd_status status = structure_read(blob, &contents, &reason);
    if (status != BVHD_OK)
        return refuse_bytes(&reason, error);
    contents.is_compacted = true;
    status = check_read(structure, &contents, format, error);
    if (status == BVHD_OK)
        structure_replace(structure, &contents);
    else
        structure_release(&contents);
    return status;
}

enum bvhd_status bvhd_structure_deserialize(const VkCopyMemoryToAccelerationStructureInfoKHR *info, uint64_t size,
                                            const struct bvhd_format *format, struct bvhd_error *ret_error)
{
    struct bvhd_blob *blob = NULL;
    enum bvhd_status status =
        structure_check_argument(info, "info", BVHD_VUID_CopyFromMemory_pInfo_parameter, ret_error);
    if (status == BVHD_OK)
        status = check_deserialize(info, ret_error);
    if (status == BVHD_OK)
        status = copy_bytes(info->src.hostAddress, size, format, &blob, ret_error);
    if (status != BVHD_OK)
        return status;
    status = deserialize(structure_of(info->dst), blob, format, ret_error);
    if (status != BVHD_OK)
        bvhd_blob_unref(blob);
    return status;
}
