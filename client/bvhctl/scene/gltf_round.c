/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/scene/gltf_round.h"

#include "client/bvhctl/scene/gltf_accessor.h"
#include "client/bvhctl/scene/import_round.h"

uint32_t gltf_round_count(enum gltf_mode mode, uint32_t corners)
{
    if (mode == GLTF_POINTS)
        return corners;
    if (mode == GLTF_LINES)
        return corners / 2;
    return corners < 2 ? 0 : mode == GLTF_LINE_LOOP ? corners : corners - 1;
}

void gltf_round_place(enum gltf_mode mode, const uint32_t *corners, uint32_t corner_count, uint32_t *ret_indices)
{
    uint32_t count = gltf_round_count(mode, corner_count), step = mode == GLTF_LINES ? 2 : 1;
    uint32_t ends = mode == GLTF_POINTS ? 1 : 2;
    for (uint32_t i = 0; i < count; i++)
        for (uint32_t end = 0; end < ends; end++) {
            uint32_t corner = i * step + end;
            corner = corner < corner_count ? corner : 0; /* the last line of a loop ends where the first begins */
            *ret_indices++ = corners ? corners[corner] : corner;
        }
}

/* Opens the accessor of an attribute of radii. *ret_found is false if there is no such attribute. */
static enum bvhd_status open_attribute(struct gltf_file *file, const struct gltf_value *attributes, const char *name,
                                       uint32_t vertex_count, struct gltf_accessor *ret_accessor, bool *ret_found)
{
    uint32_t index = 0;
    enum bvhd_status status = gltf_reference(file, attributes, name, GLTF_ACCESSORS, &index, ret_found);
    if (!status && *ret_found)
        status = gltf_accessor_open(file, index, ret_accessor);
    if (status || !*ret_found)
        return status;
    struct gltf_value place = gltf_item(file, GLTF_ACCESSORS, index);
    if (ret_accessor->components != 1 || ret_accessor->component == GLTF_UINT32 ||
        ret_accessor->elements.count != vertex_count)
        return gltf_refuse(file, BVHD_INVALID, &place,
                           "%s is a SCALAR of floats, or of 8 or 16 bit integers, for each of %u vertices", name,
                           vertex_count);
    return BVHD_OK;
}

static enum bvhd_status read_attribute(const struct gltf_file *file, const char *name,
                                       const struct gltf_accessor *accessor, float factor, struct import_mesh *mesh)
{
    struct gltf_value place = gltf_item(file, GLTF_ACCESSORS, accessor->index);
    uint32_t wrong = 0;
    enum bvhd_status status = gltf_accessor_floats(file, accessor, mesh->radii);
    if (!status && import_round_find_wrong(mesh->radii, mesh->vertex_count, &wrong))
        status = gltf_refuse(file, BVHD_INVALID, &place, "%s of vertex %u is %g: it has to be finite and not negative",
                             name, wrong, (double)mesh->radii[wrong]);
    for (uint32_t i = 0; i < mesh->vertex_count && !status; i++)
        mesh->radii[i] *= factor;
    return status;
}

enum bvhd_status gltf_round_read_radii(struct gltf_file *file, const struct gltf_value *primitive, float fallback,
                                       struct import_mesh *mesh)
{
    static const struct {
        const char *name;
        float factor;
    } kinds[] = {{"_RADIUS", 1}, {"_WIDTH", 0.5f}};
    struct gltf_value attributes = gltf_member(primitive, "attributes");
    mesh->radii = memory_array(file->memory, (uint64_t)mesh->vertex_count + 1, sizeof *mesh->radii);
    if (!mesh->radii)
        return gltf_no_memory(file);
    for (size_t i = 0; i < sizeof kinds / sizeof *kinds; i++) {
        struct gltf_accessor accessor;
        bool found = false;
        enum bvhd_status status =
            open_attribute(file, &attributes, kinds[i].name, mesh->vertex_count, &accessor, &found);
        if (status || found)
            return status ? status : read_attribute(file, kinds[i].name, &accessor, kinds[i].factor, mesh);
    }
    for (uint32_t i = 0; i < mesh->vertex_count; i++)
        mesh->radii[i] = fallback;
    return BVHD_OK;
}
