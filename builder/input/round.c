/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/input/round.h"

#include "builder/input/reach.h"
#include "builder/input/validate.h"
#include "builder/input/vertex_format.h"
#include "proto/base/kind.h"
#include "proto/base/place.h"

/* A number of vertices that stay in the first-level cache between two passes over them. */
enum { BLOCK = 512 };

const struct geometry_spheres *round_arrays(const struct geometry *geometry)
{
    return geometry->type == GEOMETRY_SPHERES ? &geometry->spheres : &geometry->swept_spheres.ends;
}

bool round_is_one_vertex(const struct geometry *geometry)
{
    const struct geometry_spheres *arrays = round_arrays(geometry);
    return arrays->vertex_stride == 0 && arrays->radius_stride == 0;
}

static uint64_t elements(const struct bytes *array, uint64_t stride)
{
    return stride == 0 ? UINT64_MAX : array->size / stride + (array->size % stride != 0);
}

uint64_t round_room(const struct geometry *geometry)
{
    const struct geometry_spheres *arrays = round_arrays(geometry);
    const uint64_t most = (uint64_t)1 << (arrays->index_type == INDEX_UINT16 ? 16 : 32);
    const uint64_t centres = elements(&arrays->vertices, arrays->vertex_stride);
    const uint64_t radii = elements(&arrays->radii, arrays->radius_stride), both = centres < radii ? centres : radii;
    return both < most ? both : most;
}

static uint32_t index_size(const struct geometry_spheres *arrays)
{
    return arrays->index_type == INDEX_UINT16 ? 2 : 4;
}

/* Reports an array that is missing or too short. */
static enum bvhd_status refuse(const struct validate_subject *subject, enum bvhd_vuid rule, const char *field,
                               const struct bytes *memory, const char *contents)
{
    const char *member = kind_find(subject->geometry->type)->member;
    return validate_refuse_memory(subject, rule, place("%s.%s", member, field).text, memory, contents);
}

static enum bvhd_status check_indices(const struct validate_subject *subject, const struct round_rules *rules,
                                      uint32_t per_primitive)
{
    const struct geometry_spheres *arrays = round_arrays(subject->geometry);
    const struct geometry_range *range = &subject->geometry->range;
    const uint32_t size = index_size(arrays);
    const uint64_t last = (uint64_t)per_primitive * range->primitive_count - 1;
    if (arrays->indices.data &&
        bytes_reach(arrays->indices.size, range->primitive_offset, arrays->index_stride, last, size))
        return BVHD_OK;
    return refuse(subject, rules->indices, "indexData", &arrays->indices, "indices");
}

/* Without indices, the first vertices of the arrays lie at the offset. */
static bool reaches(const struct validate_subject *subject, const struct bytes *array, uint64_t stride, uint32_t size,
                    uint32_t per_primitive)
{
    const struct geometry_range *range = &subject->geometry->range;
    const uint64_t last = range->first_vertex + (uint64_t)per_primitive * range->primitive_count - 1;
    const bool is_indexed = round_arrays(subject->geometry)->index_type != INDEX_NONE;
    return array->data && (is_indexed || (last <= UINT32_MAX &&
                                          bytes_reach(array->size, range->primitive_offset, stride, last, size)));
}

enum bvhd_status round_check_memory(const struct validate_subject *subject, const struct round_rules *rules,
                                    uint32_t per_primitive)
{
    const struct geometry_spheres *arrays = round_arrays(subject->geometry);
    if (subject->geometry->range.primitive_count == 0)
        return BVHD_OK;
    if (arrays->index_type == INDEX_NONE && arrays->indices.data)
        return bvhd_error_rule(
            subject->error, rules->indices_given,
            VALIDATE_GEOMETRY_PLACE(subject, place("%s.indexData", kind_find(subject->geometry->type)->member).text),
            "it is given, but indexType is NONE");
    if (!reaches(subject, &arrays->vertices, arrays->vertex_stride, vertex_format_find(arrays->vertex_format)->size,
                 per_primitive))
        return refuse(subject, rules->vertices, "vertexData", &arrays->vertices, "vertices");
    if (!reaches(subject, &arrays->radii, arrays->radius_stride, radius_format_find(arrays->radius_format)->size,
                 per_primitive))
        return refuse(subject, rules->radii, "radiusData", &arrays->radii, "radii");
    return arrays->index_type == INDEX_NONE ? BVHD_OK : check_indices(subject, rules, per_primitive);
}

void round_describe(const struct geometry *geometry, bool is_update, struct form_geometry *row)
{
    const struct geometry_spheres *arrays = round_arrays(geometry);
    if (!is_update)
        return;
    row->update = FORM_UPDATE_RECORDED;
    row->vertex_format = arrays->vertex_format;
    row->radius_format = arrays->radius_format;
    row->index_type = arrays->index_type;
}

void round_view(const void *data, struct canonical_geometry *geometry)
{
    geometry->positions = data;
}

void round_read_indices(const struct geometry *geometry, uint64_t first, uint64_t count, uint32_t *ret_indices)
{
    const struct geometry_spheres *arrays = round_arrays(geometry);
    const uint64_t stride = arrays->index_stride;
    const unsigned char *source = arrays->indices.data + geometry->range.primitive_offset + first * stride;
    if (arrays->index_type == INDEX_UINT16)
        for (uint64_t i = 0; i < count; i++)
            ret_indices[i] = bytes_get16(source + i * stride);
    else if (stride == sizeof *ret_indices)
        memcpy(ret_indices, source, count * sizeof *ret_indices);
    else
        for (uint64_t i = 0; i < count; i++)
            ret_indices[i] = bytes_get32(source + i * stride);
    fetch_settle();
}

/* Returns whether a vertex, to which firstVertex is still to be added, is a vertex of the arrays. */
static bool is_there(const struct geometry *geometry, uint64_t vertex)
{
    const struct geometry_spheres *arrays = round_arrays(geometry);
    const uint64_t number = geometry->range.first_vertex + vertex;
    return number <= UINT32_MAX &&
           bytes_reach(arrays->vertices.size, 0, arrays->vertex_stride, number,
                       vertex_format_find(arrays->vertex_format)->size) &&
           bytes_reach(arrays->radii.size, 0, arrays->radius_stride, number,
                       radius_format_find(arrays->radius_format)->size);
}

enum bvhd_status round_check_named(const struct fetch *fetch, uint32_t index, const struct round_rules *rules,
                                   const uint32_t *values, uint64_t count, uint32_t per_index, struct bvhd_error *error)
{
    const struct geometry *geometry = &fetch->input->geometries[index];
    const struct geometry_spheres *arrays = round_arrays(geometry);
    if (is_there(geometry, (uint64_t)fetch->sources[index].highest + per_index - 1))
        return BVHD_OK;
    uint64_t k = 0;
    while (k + 1 < count && is_there(geometry, (uint64_t)values[k] + per_index - 1))
        k++;
    const uint64_t number = (uint64_t)geometry->range.first_vertex + values[k] + per_index - 1;
    const bool lacks_vertex = !bytes_reach(arrays->vertices.size, 0, arrays->vertex_stride, number,
                                           vertex_format_find(arrays->vertex_format)->size);
    const bool lacks_radius = !lacks_vertex && number <= UINT32_MAX;
    return bvhd_error_rule(error, lacks_radius ? rules->radii : rules->vertices,
                           place("infos[%u].geometries[%u].%s.indices[%llu]", fetch->index, index,
                                 kind_find(geometry->type)->member, (unsigned long long)k)
                               .text,
                           "firstVertex %u + index %u reaches to vertex %llu, which %s does not hold",
                           geometry->range.first_vertex, values[k], (unsigned long long)number,
                           lacks_radius ? "radiusData" : "vertexData");
}

enum bvhd_status round_count_vertices(struct fetch *fetch, uint32_t index, uint64_t vertices, uint64_t most,
                                      struct bvhd_error *error)
{
    if (vertices > most)
        return bvhd_error_set(error, BVHD_TOO_LARGE, place("infos[%u].geometries[%u]", fetch->index, index).text,
                              "%llu vertices, at most %llu", (unsigned long long)vertices, (unsigned long long)most);
    fetch->view.geometries[index].vertex_count = (uint32_t)vertices;
    return BVHD_OK;
}

static void interleave(const float *centres, const float *radii, uint32_t count, float *ret_vertices)
{
    for (uint32_t i = 0; i < count; i++, centres += 3, ret_vertices += 4) {
        memcpy(ret_vertices, centres, 3 * sizeof *centres);
        ret_vertices[3] = radii[i];
    }
}

/* Comparisons with NaN are false. */
static bool any_negative(const float *radii, uint32_t count)
{
    bool found = false;
    for (uint32_t i = 0; i < count; i++)
        found |= radii[i] < 0;
    return found;
}

void round_read_vertices(struct fetch *fetch, uint32_t index, uint64_t vertex, uint32_t count, float *ret_vertices)
{
    const struct geometry *geometry = &fetch->input->geometries[index];
    const struct geometry_spheres *arrays = round_arrays(geometry);
    const struct vertex_format *format = vertex_format_find(arrays->vertex_format);
    const struct radius_format *radius = radius_format_find(arrays->radius_format);
    const uint64_t offset = arrays->index_type == INDEX_NONE ? geometry->range.primitive_offset : 0;
    const uint64_t first = geometry->range.first_vertex + vertex;
    const unsigned char *vertices = arrays->vertices.data + offset + arrays->vertex_stride * first;
    const unsigned char *radii = arrays->radii.data + offset + arrays->radius_stride * first;
    for (uint32_t at = 0; at < count; at += BLOCK) {
        float centre_block[3 * BLOCK], radius_block[BLOCK];
        const uint32_t some = count - at < BLOCK ? count - at : BLOCK;
        format->decode(vertices + at * arrays->vertex_stride, arrays->vertex_stride, some, centre_block);
        radius->decode(radii + at * arrays->radius_stride, arrays->radius_stride, some, radius_block);
        fetch_settle();
        if (any_negative(radius_block, some))
            fetch_suspect(fetch);
        interleave(centre_block, radius_block, some, ret_vertices + (size_t)4 * at);
    }
}

void round_outline(const struct canonical_geometry *geometry, uint32_t first, uint32_t count, struct reach *reach)
{
    reach_add_spheres(reach, geometry->positions + (size_t)4 * first, count);
}
