/* SPDX-License-Identifier: Apache-2.0 */
/*
 * fuzz_structure.c - fuzzes the deserialization of structures into objects: bytes are refused by a rule and change
 * nothing, or give an object whose copies, properties and serialized bytes agree.
 *
 * The input is a byte of choices (bits 0 and 1: what type the object was created as; bit 2: a native format counts as
 * compatible; bit 3: sizes are repaired; bit 4: the object is small), followed by the structure.
 */
#include "tests/fuzz/fuzz.h"

#include <string.h>

#include <bvhd/bvhd_structure.h>

#include "builder/format/serialized.h"
#include "client/library.h"
#include "tests/fuzz/sample_scene.h"

enum { CHOICE_TYPE = 3, CHOICE_NATIVE = 4, CHOICE_REPAIR = 8, CHOICE_SMALL = 16, SMALL_SIZE = 300 };
enum { COMPACTED_SIZE = 1000150000, SERIALIZATION_SIZE, POINTERS = 1000386000, SIZE };

static struct bvhd_structure *create(uint32_t type, uint64_t size)
{
    const VkAccelerationStructureCreateInfoKHR info = {.sType =
                                                           VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_CREATE_INFO_KHR,
                                                       .type = (VkAccelerationStructureTypeKHR)type,
                                                       .size = size};
    struct bvhd_structure *structure = NULL;
    FUZZ_CHECK(bvhd_structure_create(&info, &structure, NULL) == BVHD_OK);
    return structure;
}

static enum bvhd_status query(const struct bvhd_structure *structure, uint32_t type, VkDeviceSize *ret_value)
{
    const VkAccelerationStructureKHR handle = bvhd_structure_handle(structure);
    const struct bvhd_structure_properties properties = {.struct_size = sizeof properties,
                                                         .structure_count = 1,
                                                         .query_type = (VkQueryType)type,
                                                         .structures = &handle,
                                                         .data_size = sizeof *ret_value,
                                                         .data = ret_value,
                                                         .stride = sizeof *ret_value};
    return bvhd_structure_query(&properties, NULL);
}

static void check_serialized(const struct bvhd_structure *structure, const uint8_t *bytes, size_t size)
{
    VkDeviceSize total = 0;
    void *copy;
    FUZZ_CHECK(query(structure, SERIALIZATION_SIZE, &total) == BVHD_OK && total <= size);
    FUZZ_CHECK(posix_memalign(&copy, 16, total) == 0);
    const VkCopyAccelerationStructureToMemoryInfoKHR info = {
        .sType = VK_STRUCTURE_TYPE_COPY_ACCELERATION_STRUCTURE_TO_MEMORY_INFO_KHR,
        .src = bvhd_structure_handle(structure),
        .dst.hostAddress = copy,
        .mode = VK_COPY_ACCELERATION_STRUCTURE_MODE_SERIALIZE_KHR};
    FUZZ_CHECK(bvhd_structure_serialize(&info, total - 1, NULL) == BVHD_INVALID);
    FUZZ_CHECK(bvhd_structure_serialize(&info, total, NULL) == BVHD_OK);
    FUZZ_CHECK(memcmp(copy, bytes, total) == 0);
    free(copy);
}

/* Copies to an object that is just large enough, and to one that is not. */
static void check_copy(const struct bvhd_structure *structure, VkCopyAccelerationStructureModeKHR mode, bool allowed)
{
    VkDeviceSize size = 0;
    struct bvhd_structure_state state;
    FUZZ_CHECK(query(structure, SIZE, &size) == BVHD_OK && size > 0);
    for (int less = 0; less < 2; less++) {
        struct bvhd_structure *copy = create(VK_ACCELERATION_STRUCTURE_TYPE_GENERIC_KHR, size - (uint64_t)less);
        const VkCopyAccelerationStructureInfoKHR info = {.sType =
                                                             VK_STRUCTURE_TYPE_COPY_ACCELERATION_STRUCTURE_INFO_KHR,
                                                         .src = bvhd_structure_handle(structure),
                                                         .dst = bvhd_structure_handle(copy),
                                                         .mode = mode};
        const bool is_ok = bvhd_structure_copy(&info, NULL) == BVHD_OK;
        FUZZ_CHECK(is_ok == (allowed && !less));
        FUZZ_CHECK(bvhd_structure_get(copy, &state) == BVHD_OK && state.is_built == is_ok);
        bvhd_structure_destroy(copy);
    }
}

/* Positions need the flag, which the bytes of portable structures state, and may state of any of them. */
static void check_positions(const struct bvhd_structure *structure, uint32_t flags)
{
    float positions[3][3];
    for (uint32_t i = 0; i < 64; i++) {
        const enum bvhd_status status = bvhd_structure_positions(structure, i / 16, i % 16, positions, NULL);
        FUZZ_CHECK(status == BVHD_INVALID || (status == BVHD_OK && flags & BUILD_ALLOW_DATA_ACCESS));
        const enum bvhd_status at = bvhd_structure_positions_at(structure, i / 16, i % 16, 0.5f, positions, NULL);
        FUZZ_CHECK(at == BVHD_OK || (at == BVHD_INVALID && status == BVHD_INVALID));
    }
}

static void check_object(const struct bvhd_structure *structure, const uint8_t *bytes, size_t size)
{
    struct bvhd_structure_state state;
    VkDeviceSize value;
    FUZZ_CHECK(bvhd_structure_get(structure, &state) == BVHD_OK && state.is_built);
    FUZZ_CHECK(state.created_type == VK_ACCELERATION_STRUCTURE_TYPE_GENERIC_KHR ||
               state.type == VK_ACCELERATION_STRUCTURE_TYPE_GENERIC_KHR || state.type == state.created_type);
    const bool compacts = state.flags & VK_BUILD_ACCELERATION_STRUCTURE_ALLOW_COMPACTION_BIT_KHR;
    const bool is_top = state.type == VK_ACCELERATION_STRUCTURE_TYPE_TOP_LEVEL_KHR;
    FUZZ_CHECK((query(structure, COMPACTED_SIZE, &value) == BVHD_OK) == compacts);
    FUZZ_CHECK((query(structure, POINTERS, &value) == BVHD_OK) == is_top);
    check_serialized(structure, bytes, size);
    check_positions(structure, state.flags);
    check_copy(structure, VK_COPY_ACCELERATION_STRUCTURE_MODE_CLONE_KHR, true);
    check_copy(structure, VK_COPY_ACCELERATION_STRUCTURE_MODE_COMPACT_KHR, compacts);
}

static void deserialize(uint8_t choices, const uint8_t *bytes, size_t size)
{
    struct bvhd_format format = {.struct_size = sizeof format, .target = BVHD_TARGET_LAVAPIPE, .variant = 1};
    struct bvhd_structure *structure =
        create((choices & CHOICE_TYPE) % 3, choices & CHOICE_SMALL ? SMALL_SIZE : FUZZ_ROOM);
    const VkCopyMemoryToAccelerationStructureInfoKHR info = {
        .sType = VK_STRUCTURE_TYPE_COPY_MEMORY_TO_ACCELERATION_STRUCTURE_INFO_KHR,
        .src.hostAddress = bytes,
        .dst = bvhd_structure_handle(structure),
        .mode = VK_COPY_ACCELERATION_STRUCTURE_MODE_DESERIALIZE_KHR};
    struct bvhd_structure_state state;
    struct bvhd_error error = {0};
    if (size >= 2 * VK_UUID_SIZE)
        memcpy(format.driver_uuid, bytes, VK_UUID_SIZE),
            memcpy(format.compatibility_uuid, bytes + VK_UUID_SIZE, VK_UUID_SIZE);
    enum bvhd_status status = bvhd_structure_deserialize(&info, size, choices & CHOICE_NATIVE ? &format : NULL, &error);
    if (status == BVHD_OK) {
        check_object(structure, bytes, size);
    } else {
        FUZZ_CHECK(status == BVHD_INVALID && error.status == status && error.where[0] && error.text[0]);
        FUZZ_CHECK(bvhd_structure_get(structure, &state) == BVHD_OK && !state.is_built);
    }
    bvhd_structure_destroy(structure);
    FUZZ_CHECK(library_memory.live == 0);
}

/* Returns where the body of a portable structure begins. */
static uint64_t body_of(const uint8_t *bytes)
{
    return bytes_align(SERIALIZED_HANDLES + 8 * bytes_get64(bytes + 48), PORTABLE_BODY_ALIGNMENT);
}

static bool is_portable(const uint8_t *bytes)
{
    return memcmp(bytes, portable_driver_uuid, VK_UUID_SIZE) == 0;
}

/* Makes the two sizes of the header agree with the number of bytes, so that what lies behind them is read. */
static void repair(uint8_t *bytes, size_t size)
{
    if (size < SERIALIZED_HANDLES)
        return;
    const uint64_t most = (size - SERIALIZED_HANDLES) / 8, handles = bytes_get64(bytes + 48) % 8;
    bytes_put64(bytes + 48, handles < most ? handles : most);
    bytes_put64(bytes + 32, size);
    const uint64_t body = is_portable(bytes) ? body_of(bytes) : SERIALIZED_HANDLES + 8 * bytes_get64(bytes + 48);
    bytes_put64(bytes + 40, size > body ? size - body : 0);
}

/* The bytes are in a block of exactly their size. */
int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    void *block;
    if (size == 0)
        return 0;
    FUZZ_CHECK(posix_memalign(&block, 16, size) == 0);
    memcpy(block, data + 1, size - 1);
    if (data[0] & CHOICE_REPAIR)
        repair(block, size - 1);
    deserialize(data[0], block, size - 1);
    free(block);
    return 0;
}

/*
 * Samples are each structure in each of its targets: in an object of its type, in a GENERIC one and built with
 * ALLOW_COMPACTION and ALLOW_DATA_ACCESS, and repaired.
 */
size_t fuzz_sample(uint32_t index, uint8_t *ret_bytes)
{
    enum { STRUCTURES = 10, ROUND = 6, MOTION = 8, KINDS = 3 };
    struct test_scene scene;
    if (index >= STRUCTURES * KINDS)
        return 0;
    const uint32_t which = index % STRUCTURES, kind = index / STRUCTURES;
    if (which >= MOTION)
        sample_scene_init_motion(&scene);
    else if (which >= ROUND)
        sample_scene_init_round(&scene);
    else
        sample_scene_init(&scene);
    const struct sample_structures structures = sample_scene_structures(&scene, which >= 3 && which < ROUND);
    const uint32_t item_index = which >= MOTION ? 2 * (which - MOTION) : which >= ROUND ? which - ROUND : which % 3;
    const struct batch_item *item = structures.items[item_index];
    const uint32_t own = item_index == 2 ? VK_ACCELERATION_STRUCTURE_TYPE_TOP_LEVEL_KHR
                                         : VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR;
    ret_bytes[0] = (uint8_t)((kind == 1 ? 2 : own) | CHOICE_NATIVE | (kind == 2 ? CHOICE_REPAIR : 0));
    FUZZ_CHECK(item->size < FUZZ_ROOM);
    memcpy(ret_bytes + 1, item->blob, item->size);
    if (kind == 1 && is_portable(ret_bytes + 1)) {
        uint8_t *flags = ret_bytes + 1 + body_of(ret_bytes + 1) + offsetof(struct portable_header, build_flags);
        bytes_put32(flags, bytes_get32(flags) | BUILD_ALLOW_COMPACTION | BUILD_ALLOW_DATA_ACCESS);
    }
    const size_t size = item->size + 1;
    test_scene_finish(&scene);
    return size;
}
