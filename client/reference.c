/* SPDX-License-Identifier: Apache-2.0 */
#include "client/reference.h"

#include <string.h>

#include "builder/format/record_kind.h"
#include "builder/format/serialized.h"
#include "proto/base/status.h"

/* The bounds of a structure that is one point at the origin. */
static const float origin[6] = {-0.0f, -0.0f, -0.0f, 0, 0, 0};

bool reference_is_bounded(const struct bvhd_reference *reference)
{
    static const float none[6];
    return memcmp(reference->bounds, none, sizeof none) != 0;
}

/* Returns the content of a structure with this header, or one that there is not if its layout is not portable. */
static uint32_t content_of(struct bytes structure, const struct serialized_header *header)
{
    const uint64_t body = portable_body_of(header);
    const bool is_portable = memcmp(header->driver_uuid, portable_driver_uuid, sizeof header->driver_uuid) == 0;
    if (!is_portable || !bytes_reach(structure.size, body, 0, 0, sizeof(struct portable_header)))
        return PORTABLE_CONTENTS;
    return bytes_get32(structure.data + body + offsetof(struct portable_header, content));
}

bool reference_moves(struct bytes structure)
{
    struct serialized_header header;
    if (serialized_read(structure, &header, NULL) != BVHD_OK)
        return false;
    const struct record_kind *kind = record_kind_of(content_of(structure, &header));
    return kind && record_kind_moves(kind);
}

struct reference reference_convert(const struct bvhd_reference *from)
{
    struct reference reference = {
        .kind = REFERENCE_BLAS, .handle = from->handle, .moves = from->moves != 0, .has_key = from->has_key != 0};
    bool is_origin = memcmp(from->bounds, origin, sizeof origin) == 0;
    memcpy(reference.key.bytes, from->key.bytes, sizeof reference.key.bytes);
    if (!is_origin) {
        memcpy(reference.bounds.min, from->bounds, sizeof reference.bounds.min);
        memcpy(reference.bounds.max, from->bounds + 3, sizeof reference.bounds.max);
    }
    memcpy(&reference.slabs, from->slabs, sizeof reference.slabs);
    return reference;
}

/* A top level has handles. Without instances it has none, and only the portable layout still shows what it is. */
enum bvhd_status reference_check_bottom(const struct bvhd_result *result, struct bvhd_error *error)
{
    struct bytes bytes = {result->data, result->data ? result->size : 0};
    struct serialized_header header;
    enum bvhd_status status = serialized_read(bytes, &header, error);
    if (status != BVHD_OK)
        return status;
    bool is_top = header.handle_count > 0 || record_kind_is_top(content_of(bytes, &header));
    return is_top ? bvhd_error_set(error, BVHD_INVALID, "result", "the structure is a top level, not a bottom level")
                  : BVHD_OK;
}

struct reference reference_take(const struct bvhd_result *result, uint64_t handle)
{
    struct reference reference = {
        .kind = REFERENCE_BLAS, .handle = handle, .moves = result->moves != 0, .has_key = true};
    memcpy(reference.key.bytes, result->key.bytes, sizeof reference.key.bytes);
    memcpy(reference.bounds.min, result->bounds, sizeof reference.bounds.min);
    memcpy(reference.bounds.max, result->bounds + 3, sizeof reference.bounds.max);
    memcpy(&reference.slabs, result->slabs, sizeof reference.slabs);
    return reference;
}

enum bvhd_status bvhd_reference_from_result(const struct bvhd_result *result, uint64_t handle,
                                            struct bvhd_reference *ret_reference)
{
    if (!result || !ret_reference || handle == 0)
        return BVHD_INVALID;
    enum bvhd_status status = result->error.status;
    if (status == BVHD_OK)
        status = reference_check_bottom(result, NULL);
    if (status != BVHD_OK)
        return status;
    struct bvhd_reference reference = {.handle = handle, .has_key = 1, .key = result->key, .moves = result->moves};
    memcpy(reference.bounds, result->bounds, sizeof reference.bounds);
    memcpy(reference.slabs, result->slabs, sizeof reference.slabs);
    if (!reference_is_bounded(&reference))
        memcpy(reference.bounds, origin, sizeof origin);
    *ret_reference = reference;
    return BVHD_OK;
}
