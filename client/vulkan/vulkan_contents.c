/* SPDX-License-Identifier: Apache-2.0 */
#include "client/vulkan/vulkan_contents.h"

#include <math.h>
#include <stddef.h>
#include <string.h>

#include "builder/format/record_kind.h"
#include "builder/format/serialized.h"

static const unsigned char *body_of(struct bytes blob)
{
    uint64_t handles = bytes_get64(blob.data + offsetof(struct serialized_header, handle_count));
    return blob.data + portable_body_offset(handles);
}

/*
 * Steps are no larger than the structure's coordinates in what bvhd writes, though the format does not require it. The
 * kernels bound coordinates (FARTHEST in bvhd_closest.glsl) and rely on it when they take steps 2^24 times.
 */
static bool has_large_steps(const unsigned char *body, const struct portable_header *header)
{
    double largest = 0x1p-126;
    int exponent = 0;
    for (int i = 0; i < 6; i++) {
        /* Not fmax: with that, gcc 12 for arm64 ends with an internal error. */
        double coordinate = fabs((double)header->bounds[i]);
        if (coordinate > largest)
            largest = coordinate;
    }
    const uint64_t node_size = record_kind_of(header->content)->node_size;
    for (uint32_t i = 0; i < header->node_count; i++) {
        const uint8_t *exponents =
            body + header->node_offset + i * node_size + offsetof(struct portable_node, exponent);
        for (int axis = 0; axis < 3; axis++)
            exponent = exponents[axis] > exponent ? exponents[axis] : exponent;
    }
    return header->node_count > 0 && ldexp(1, exponent - 127) > largest;
}

uint32_t vulkan_contents_add(struct vulkan_contents *contents, struct bytes blob)
{
    struct portable_header header;
    const unsigned char *body = body_of(blob);
    memcpy(&header, body, sizeof header);
    contents->kinds |= UINT32_C(1) << header.content;
    contents->has_large_steps = contents->has_large_steps || has_large_steps(body, &header);
    return header.content;
}
