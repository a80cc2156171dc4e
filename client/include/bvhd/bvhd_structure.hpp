/* SPDX-License-Identifier: Apache-2.0 */
/*
 * bvhd_structure.hpp - the interface of bvhd_structure.h for C++17 and newer: structures as objects of the host, and
 * indirect builds.
 *
 *     bvhd::IndirectRanges ranges = bvhd::IndirectRanges::read(indirect).value();
 *     bvhd::Batch batch = client.submit(infos, ranges.span()).value();
 *     batch.wait();
 *     bvhd::Structure structure = bvhd::Structure::create(create_info).value();
 *     structure.hold(infos[0], ranges.span()[0], *bvhd_batch_result(batch.get(), 0)).value();
 *
 * Objects can be moved but not copied. The calls that take only Vulkan's structs, such as bvhd_structure_copy, are used
 * as they are, with handles of objects. Rules and threads are those of bvhd_structure.h, errors those of
 * bvhd_values.hpp.
 */
#ifndef BVHD_BVHD_STRUCTURE_HPP
#define BVHD_BVHD_STRUCTURE_HPP

#include <bvhd/bvhd_structure.h>
#include <bvhd/bvhd_values.hpp>

#include <array>
#include <cstdint>
#include <memory>

namespace bvhd
{

/* Ranges of indirect builds. The object owns copies of them, so that the memory they were read from may change. */
class IndirectRanges
{
  public:
    /* Reads ranges, as bvhd_indirect_read does, and sets struct_size. */
    static Expected<IndirectRanges> read(bvhd_indirect indirect)
    {
        const VkAccelerationStructureBuildRangeInfoKHR *const *ranges = nullptr;
        Error error;
        indirect.struct_size = sizeof indirect;
        if (bvhd_indirect_read(&indirect, &ranges, &error) != BVHD_OK)
            return error;
        return IndirectRanges(ranges, indirect.info_count);
    }
    /* Returns a pointer for each info, as Client::submit takes them. They live as long as this object. */
    Span<const VkAccelerationStructureBuildRangeInfoKHR *const> span() const
    {
        return {ranges_.get(), count_};
    }

  private:
    struct Free {
        using pointer = const VkAccelerationStructureBuildRangeInfoKHR *const *;
        void operator()(pointer ranges) const
        {
            bvhd_indirect_free(ranges);
        }
    };
    IndirectRanges(Free::pointer ranges, std::size_t count) : ranges_(ranges), count_(count)
    {
    }
    std::unique_ptr<Free::pointer, Free> ranges_;
    std::size_t count_;
};

/* An acceleration structure on the host: empty, or holding a built structure. */
class Structure
{
  public:
    /* Creates an object that is empty. */
    static Expected<Structure> create(const VkAccelerationStructureCreateInfoKHR &info)
    {
        bvhd_structure *structure = nullptr;
        Error error;
        if (bvhd_structure_create(&info, &structure, &error) != BVHD_OK)
            return error;
        return Structure(structure);
    }
    /* Returns the handle that stands for the object in Vulkan's structs. */
    VkAccelerationStructureKHR handle() const
    {
        return bvhd_structure_handle(structure_.get());
    }
    /* Makes the object hold a result, as if it had been built into it. `ranges` may be NULL without geometries. */
    Expected<void> hold(const VkAccelerationStructureBuildGeometryInfoKHR &info,
                        const VkAccelerationStructureBuildRangeInfoKHR *ranges, const bvhd_result &result)
    {
        Error error;
        if (bvhd_structure_hold(structure_.get(), &info, ranges, &result, &error) != BVHD_OK)
            return error;
        return {};
    }
    /* Returns what the object holds. `data` lives until it holds something else, or ends. */
    bvhd_structure_state state() const
    {
        bvhd_structure_state state = {};
        bvhd_structure_get(structure_.get(), &state);
        return state;
    }
    /*
     * Return the corners of a triangle, as bvhd_structure_positions and bvhd_structure_positions_at give them. They
     * need ALLOW_DATA_ACCESS.
     */
    Expected<std::array<std::array<float, 3>, 3>> positions(std::uint32_t geometry, std::uint32_t primitive) const
    {
        float numbers[3][3];
        Error error;
        if (bvhd_structure_positions(structure_.get(), geometry, primitive, numbers, &error) != BVHD_OK)
            return error;
        return corners_of(numbers);
    }
    Expected<std::array<std::array<float, 3>, 3>> positions_at(std::uint32_t geometry, std::uint32_t primitive,
                                                               float time) const
    {
        float numbers[3][3];
        Error error;
        if (bvhd_structure_positions_at(structure_.get(), geometry, primitive, time, numbers, &error) != BVHD_OK)
            return error;
        return corners_of(numbers);
    }
    bvhd_structure *get() const
    {
        return structure_.get();
    }

  private:
    static std::array<std::array<float, 3>, 3> corners_of(const float numbers[3][3])
    {
        std::array<std::array<float, 3>, 3> corners = {};
        for (std::size_t corner = 0; corner < 3; corner++)
            for (std::size_t axis = 0; axis < 3; axis++)
                corners[corner][axis] = numbers[corner][axis];
        return corners;
    }
    struct Destroy {
        void operator()(bvhd_structure *structure) const
        {
            bvhd_structure_destroy(structure);
        }
    };
    explicit Structure(bvhd_structure *structure) : structure_(structure)
    {
    }
    std::unique_ptr<bvhd_structure, Destroy> structure_;
};

} /* namespace bvhd */

#endif
