/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/scene/gltf_accessor.h"

#include <math.h>
#include <string.h>

#include "client/bvhctl/scene/gltf_buffer.h"

static const uint64_t most_offset = UINT64_C(1) << 40;

static uint32_t component_size(enum gltf_component component)
{
    switch (component) {
    case GLTF_INT8:
    case GLTF_UINT8:
        return 1;
    case GLTF_INT16:
    case GLTF_UINT16:
        return 2;
    case GLTF_UINT32:
    case GLTF_FLOAT:
        return 4;
    default:
        return 0;
    }
}

/* Reads "componentType" of an accessor, or of the indices of a sparse one. */
static enum bvhd_status read_component(const struct gltf_file *file, const struct gltf_value *object,
                                       enum gltf_component *ret_component)
{
    struct gltf_value place = gltf_member(object, "componentType");
    uint64_t number;
    enum bvhd_status status =
        gltf_integer(file, object, "componentType", (struct gltf_range){GLTF_INT8, GLTF_FLOAT, true, 0}, &number);
    if (status)
        return status;
    *ret_component = (enum gltf_component)number;
    return component_size(*ret_component)
               ? BVHD_OK
               : gltf_refuse(file, BVHD_INVALID, &place, "%u is not known", (unsigned)number);
}

/* Matrices are another matter: see gltf_accessor_open_matrices. */
static enum bvhd_status read_type(const struct gltf_file *file, const struct gltf_value *accessor, bool is_matrix,
                                  uint32_t *ret_components)
{
    static const char *const names[] = {"SCALAR", "VEC2", "VEC3", "VEC4"};
    const char *type = gltf_text(accessor, "type");
    struct gltf_value place = gltf_member(accessor, "type");
    if (is_matrix) {
        *ret_components = 16;
        return type && !strcmp(type, "MAT4") ? BVHD_OK : gltf_refuse(file, BVHD_INVALID, &place, "it is not MAT4");
    }
    for (uint32_t i = 0; type && i < 4; i++)
        if (!strcmp(type, names[i])) {
            *ret_components = i + 1;
            return BVHD_OK;
        }
    return gltf_refuse(file, BVHD_INVALID, &place, "'%.20s' is none of SCALAR, VEC2, VEC3, VEC4", type ? type : "");
}

/*
 * Finds elements of `size` bytes, of components of `alignment` bytes, by "bufferView" and "byteOffset" of `object`.
 * The count is set already. `data` stays NULL if there is no buffer view.
 */
static enum bvhd_status find_elements(struct gltf_file *file, const struct gltf_value *object, uint32_t size,
                                      uint32_t alignment, struct gltf_elements *elements)
{
    uint32_t index = 0;
    uint64_t offset = 0;
    bool found;
    enum bvhd_status status = gltf_reference(file, object, "bufferView", GLTF_BUFFER_VIEWS, &index, &found);
    if (!status)
        status = gltf_integer(file, object, "byteOffset", (struct gltf_range){0, most_offset, false, 0}, &offset);
    elements->stride = size;
    if (status || !found)
        return status;
    struct gltf_view view;
    struct gltf_value place = gltf_item(file, GLTF_BUFFER_VIEWS, index), stride = gltf_member(&place, "byteStride");
    status = gltf_buffer_view(file, index, &view);
    if (status)
        return status;
    elements->stride = view.stride ? view.stride : size;
    if (elements->stride < size || elements->stride % alignment)
        return gltf_refuse(file, BVHD_INVALID, &stride, "%u, but elements of accessors in it have %u bytes",
                           elements->stride, size);
    place = gltf_member(object, "byteOffset");
    if ((offset + view.offset) % alignment)
        return gltf_refuse(file, BVHD_INVALID, &place, "not a multiple of %u, together with that of bufferViews[%u]",
                           alignment, index);
    if (elements->count && !bytes_reach(view.bytes.size, offset, elements->stride, elements->count - 1, size))
        return gltf_refuse(file, BVHD_INVALID, &place, "%u elements from %llu on, but bufferViews[%u] has %llu bytes",
                           elements->count, (unsigned long long)offset, index, (unsigned long long)view.bytes.size);
    elements->data = elements->count ? view.bytes.data + offset : NULL;
    return BVHD_OK;
}

static enum bvhd_status read_sparse(struct gltf_file *file, const struct gltf_value *value,
                                    struct gltf_accessor *accessor)
{
    struct gltf_value sparse = gltf_member(value, "sparse");
    struct gltf_value indices = gltf_member(&sparse, "indices"), values = gltf_member(&sparse, "values");
    if (!sparse.json)
        return BVHD_OK;
    uint64_t count = 0;
    enum bvhd_status status =
        gltf_integer(file, &sparse, "count", (struct gltf_range){0, accessor->elements.count, true, 0}, &count);
    if (!status)
        status = read_component(file, &indices, &accessor->sparse_component);
    if (status)
        return status;
    struct gltf_value place = gltf_member(&indices, "componentType");
    enum gltf_component kind = accessor->sparse_component;
    if (kind != GLTF_UINT8 && kind != GLTF_UINT16 && kind != GLTF_UINT32)
        return gltf_refuse(file, BVHD_INVALID, &place, "not an unsigned integer");
    uint32_t size = component_size(kind), value_size = component_size(accessor->component);
    accessor->sparse_indices.count = accessor->sparse_values.count = (uint32_t)count;
    status = find_elements(file, &indices, size, size, &accessor->sparse_indices);
    if (!status)
        status = find_elements(file, &values, value_size * accessor->components, value_size, &accessor->sparse_values);
    if (status || !count || (accessor->sparse_indices.data && accessor->sparse_values.data))
        return status;
    place = gltf_member(accessor->sparse_indices.data ? &values : &indices, "bufferView");
    return gltf_refuse(file, BVHD_INVALID, &place, "missing");
}

/* Elements without a buffer view are zeros, of which there are not more than bytes in the file's JSON and buffers. */
static enum bvhd_status check_zeros(struct gltf_file *file, const struct gltf_value *value,
                                    const struct gltf_accessor *accessor)
{
    uint64_t backing = file->data.size;
    for (uint32_t i = 0; i < file->lists[GLTF_BUFFERS].count; i++)
        backing += file->buffers[i].bytes.size;
    struct gltf_value place = gltf_member(value, "count");
    if (!accessor->elements.data && accessor->elements.count > backing)
        return gltf_refuse(file, BVHD_INVALID, &place, "%u elements without a buffer view in a file of %llu bytes",
                           accessor->elements.count, (unsigned long long)backing);
    return BVHD_OK;
}

static enum bvhd_status open_accessor(struct gltf_file *file, uint32_t index, bool is_matrix,
                                      struct gltf_accessor *ret_accessor)
{
    struct gltf_value value = gltf_item(file, GLTF_ACCESSORS, index), place = gltf_member(&value, "normalized");
    struct gltf_accessor accessor = {.index = index, .is_normalized = cJSON_IsTrue(place.json)};
    uint64_t count = 0;
    enum bvhd_status status = read_component(file, &value, &accessor.component);
    if (!status)
        status = read_type(file, &value, is_matrix, &accessor.components);
    if (!status)
        status = gltf_integer(file, &value, "count", (struct gltf_range){0, UINT32_MAX - 1, true, 0}, &count);
    if (status)
        return status;
    if (accessor.is_normalized && (accessor.component == GLTF_FLOAT || accessor.component == GLTF_UINT32))
        return gltf_refuse(file, BVHD_INVALID, &place, "only integers of 8 or 16 bits are normalized");
    uint32_t size = component_size(accessor.component);
    accessor.elements.count = (uint32_t)count;
    status = find_elements(file, &value, size * accessor.components, size, &accessor.elements);
    if (!status)
        status = read_sparse(file, &value, &accessor);
    if (!status)
        status = check_zeros(file, &value, &accessor);
    *ret_accessor = accessor;
    return status;
}

enum bvhd_status gltf_accessor_open(struct gltf_file *file, uint32_t index, struct gltf_accessor *ret_accessor)
{
    return open_accessor(file, index, false, ret_accessor);
}

enum bvhd_status gltf_accessor_open_matrices(struct gltf_file *file, uint32_t index, struct gltf_accessor *ret_accessor)
{
    struct gltf_value value = gltf_item(file, GLTF_ACCESSORS, index), place = gltf_member(&value, "componentType");
    enum bvhd_status status = open_accessor(file, index, true, ret_accessor);
    if (!status && ret_accessor->component != GLTF_FLOAT)
        status = gltf_refuse(file, BVHD_INVALID, &place, "matrices are of floats");
    return status;
}

static float normalize(float value, enum gltf_component component)
{
    switch (component) {
    case GLTF_INT8:
        return fmaxf(value / 127.0f, -1.0f);
    case GLTF_UINT8:
        return value / 255.0f;
    case GLTF_INT16:
        return fmaxf(value / 32767.0f, -1.0f);
    default: /* GLTF_UINT16: others are not normalized */
        return value / 65535.0f;
    }
}

static float read_float(const unsigned char *at, enum gltf_component component)
{
    switch (component) {
    case GLTF_INT8:
        return (float)(int8_t)*at;
    case GLTF_UINT8:
        return (float)*at;
    case GLTF_INT16:
        return (float)(int16_t)bytes_get16(at);
    case GLTF_UINT16:
        return (float)bytes_get16(at);
    case GLTF_UINT32:
        return (float)bytes_get32(at);
    default:
        return bytes_get_float(at);
    }
}

static void decode_element(const struct gltf_accessor *accessor, const unsigned char *at, float *ret_floats)
{
    uint32_t size = component_size(accessor->component);
    for (uint32_t k = 0; k < accessor->components; k++) {
        float value = read_float(at + k * size, accessor->component);
        ret_floats[k] = accessor->is_normalized ? normalize(value, accessor->component) : value;
    }
}

static uint32_t read_index(const unsigned char *at, enum gltf_component component)
{
    return component == GLTF_UINT8 ? *at : component == GLTF_UINT16 ? bytes_get16(at) : bytes_get32(at);
}

/* Returns the index of the next replaced element. They have to ascend, so that each is replaced once. */
static enum bvhd_status sparse_index(const struct gltf_file *file, const struct gltf_accessor *accessor, uint32_t i,
                                     int64_t previous, uint32_t *ret_index)
{
    const struct gltf_elements *indices = &accessor->sparse_indices;
    *ret_index = read_index(indices->data + (size_t)i * indices->stride, accessor->sparse_component);
    if (*ret_index<accessor->elements.count && * ret_index> previous)
        return BVHD_OK;
    struct gltf_value value = gltf_item(file, GLTF_ACCESSORS, accessor->index), sparse = gltf_member(&value, "sparse");
    struct gltf_value place = gltf_member(&sparse, "indices");
    return gltf_refuse(file, BVHD_INVALID, &place, "index %u at %u does not ascend, or is beyond %u elements",
                       *ret_index, i, accessor->elements.count);
}

enum bvhd_status gltf_accessor_floats(const struct gltf_file *file, const struct gltf_accessor *accessor,
                                      float *ret_floats)
{
    const struct gltf_elements *elements = &accessor->elements;
    uint32_t components = accessor->components, index;
    size_t size = components * sizeof(float);
    if (!elements->data)
        memset(ret_floats, 0, elements->count * size);
    else if (accessor->component == GLTF_FLOAT && elements->stride == size)
        memcpy(ret_floats, elements->data, elements->count * size);
    else
        for (size_t i = 0; i < elements->count; i++)
            decode_element(accessor, elements->data + i * elements->stride, ret_floats + i * components);
    int64_t previous = -1;
    for (uint32_t i = 0; i < accessor->sparse_indices.count; i++, previous = index) {
        enum bvhd_status status = sparse_index(file, accessor, i, previous, &index);
        if (status)
            return status;
        decode_element(accessor, accessor->sparse_values.data + (size_t)i * accessor->sparse_values.stride,
                       ret_floats + (size_t)index * components);
    }
    return BVHD_OK;
}

enum bvhd_status gltf_accessor_indices(const struct gltf_file *file, const struct gltf_accessor *accessor,
                                       uint32_t *ret_indices)
{
    struct gltf_value value = gltf_item(file, GLTF_ACCESSORS, accessor->index);
    enum gltf_component kind = accessor->component;
    if (accessor->components != 1 || accessor->is_normalized ||
        (kind != GLTF_UINT8 && kind != GLTF_UINT16 && kind != GLTF_UINT32))
        return gltf_refuse(file, BVHD_INVALID, &value, "indices are unsigned SCALARs that are not normalized");
    const struct gltf_elements *elements = &accessor->elements;
    if (!elements->data)
        memset(ret_indices, 0, elements->count * sizeof *ret_indices);
    else if (kind == GLTF_UINT32 && elements->stride == sizeof *ret_indices)
        memcpy(ret_indices, elements->data, elements->count * sizeof *ret_indices);
    else
        for (size_t i = 0; i < elements->count; i++)
            ret_indices[i] = read_index(elements->data + i * elements->stride, kind);
    int64_t previous = -1;
    uint32_t index;
    for (uint32_t i = 0; i < accessor->sparse_indices.count; i++, previous = index) {
        enum bvhd_status status = sparse_index(file, accessor, i, previous, &index);
        if (status)
            return status;
        ret_indices[index] =
            read_index(accessor->sparse_values.data + (size_t)i * accessor->sparse_values.stride, kind);
    }
    return BVHD_OK;
}

/* Computes the bounds of points; NaN is in none. */
static void find_bounds(const float *positions, uint32_t count, float ret_low[3], float ret_high[3])
{
    for (int axis = 0; axis < 3; axis++) {
        ret_low[axis] = INFINITY;
        ret_high[axis] = -INFINITY;
    }
    for (size_t i = 0; i < count; i++)
        for (int axis = 0; axis < 3; axis++) {
            float value = positions[3 * i + (size_t)axis];
            ret_low[axis] = value < ret_low[axis] ? value : ret_low[axis];
            ret_high[axis] = value > ret_high[axis] ? value : ret_high[axis];
        }
}

bool gltf_accessor_bounds_agree(const struct gltf_file *file, const struct gltf_accessor *accessor,
                                const float *positions)
{
    static const double tolerance = 1e-4; /* of the extent and of the largest coordinate: writers round */
    struct gltf_value value = gltf_item(file, GLTF_ACCESSORS, accessor->index);
    float low[3], high[3];
    double bounds[2][3];
    bool found[2] = {false, false};
    struct bvhd_error ignored;
    struct gltf_file quiet = *file;
    quiet.error = &ignored;
    if (gltf_numbers(&quiet, &value, "min", 3, bounds[0], &found[0]) ||
        gltf_numbers(&quiet, &value, "max", 3, bounds[1], &found[1]))
        return false;
    if (accessor->elements.count == 0)
        return true;
    find_bounds(positions, accessor->elements.count, low, high);
    for (int axis = 0; axis < 3; axis++) {
        double extent = fmax((double)high[axis] - low[axis], fmax(fabs((double)low[axis]), fabs((double)high[axis])));
        for (int side = 0; side < 2 && low[axis] <= high[axis]; side++) {
            double stored = bounds[side][axis], read = side ? high[axis] : low[axis];
            if (found[side] && accessor->is_normalized)
                stored = normalize((float)stored, accessor->component);
            if (found[side] && fabs(stored - read) > tolerance * extent)
                return false;
        }
    }
    return true;
}
