/* SPDX-License-Identifier: Apache-2.0 */
#include "client/argument.h"
#include "client/structure/structure.h"

static enum bvhd_status check(const struct bvhd_structure *structure, struct bvhd_error *error)
{
    if (!structure->contents.blob)
        return bvhd_error_set(error, BVHD_INVALID, "structure", "nothing was built into it");
    if (!(structure->contents.flags & BUILD_ALLOW_DATA_ACCESS))
        return bvhd_error_set(error, BVHD_INVALID, "structure", "it was built without ALLOW_DATA_ACCESS");
    return BVHD_OK;
}

/* `time` is NULL if the caller has not said one. */
static enum bvhd_status get(const struct bvhd_structure *structure, uint32_t geometry, uint32_t primitive,
                            const float *time, float ret_positions[3][3], struct bvhd_error *ret_error)
{
    enum bvhd_status status = ARGUMENTS_CHECK(ret_error, {structure, "structure"}, {ret_positions, "ret_positions"});
    if (status == BVHD_OK && time)
        status = argument_check_time(*time, ret_error);
    if (status == BVHD_OK)
        status = check(structure, ret_error);
    if (status != BVHD_OK)
        return status;
    const struct structure_contents *contents = &structure->contents;
    return positions_get(contents->positions, bvhd_blob_data(contents->blob), geometry, primitive, time, ret_positions,
                         ret_error);
}

enum bvhd_status bvhd_structure_positions(const struct bvhd_structure *structure, uint32_t geometry, uint32_t primitive,
                                          float ret_positions[3][3], struct bvhd_error *ret_error)
{
    return get(structure, geometry, primitive, NULL, ret_positions, ret_error);
}

enum bvhd_status bvhd_structure_positions_at(const struct bvhd_structure *structure, uint32_t geometry,
                                             uint32_t primitive, float time, float ret_positions[3][3],
                                             struct bvhd_error *ret_error)
{
    return get(structure, geometry, primitive, &time, ret_positions, ret_error);
}
