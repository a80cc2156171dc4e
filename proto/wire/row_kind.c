/* SPDX-License-Identifier: Apache-2.0 */
#include "proto/wire/row_kind.h"

#include <stddef.h>

#include "proto/base/kind.h"

#define AT(member) offsetof(struct geometry, member)
#define SIZE(type, member) sizeof(((type *)0)->member)

/* The array's length is negative, which no compiler accepts, unless both sizes are equal. */
#define EQUAL(a, b) sizeof(char[(a) == (b) ? (int)(a) : -1])

#define FIELD(field, member)                                                                                           \
    {                                                                                                                  \
        offsetof(struct geometry_row, field), AT(member),                                                              \
            EQUAL(SIZE(struct geometry_row, field), SIZE(struct geometry, member))                                     \
    }

static const struct row_kind kinds[KIND_COUNT] = {
    [KIND_TRIANGLES] =
        {
            .arrays =
                {
                    [ROW_DATA] = AT(triangles.vertices),
                    [ROW_INDICES] = AT(triangles.indices),
                    [ROW_TRANSFORM] = AT(triangles.transform),
                },
            .fields =
                {
                    FIELD(vertex_format, triangles.vertex_format),
                    FIELD(max_vertex, triangles.max_vertex),
                    FIELD(index_type, triangles.index_type),
                    FIELD(stride, triangles.vertex_stride),
                },
        },
    [KIND_AABBS] = {.arrays = {[ROW_DATA] = AT(aabbs.boxes)}, .fields = {FIELD(stride, aabbs.stride)}},
    [KIND_INSTANCES] = {.arrays = {[ROW_DATA] = AT(instances.records)}},
};

const struct row_kind *row_kind_find(uint32_t type)
{
    static const struct row_kind nothing;
    const struct kind *kind = kind_find(type);
    return kind ? &kinds[kind->number] : &nothing;
}
