/* SPDX-License-Identifier: Apache-2.0 */
/* micro_triangle.c - follows the curve from the whole triangle down to one micro-triangle. */
#include "builder/format/micro_triangle.h"

#include <string.h>

/* Which corners and middles each child has: 0 to 2 are the corners, 3 to 5 the middles of ab, bc and ca. */
static const unsigned char children[4][3] = {{0, 3, 5}, {5, 4, 3}, {3, 1, 4}, {4, 5, 2}};

bool micro_triangle_corners(uint32_t index, unsigned level, uint32_t ret_corners[3][2])
{
    const uint32_t parts = UINT32_C(1) << level;
    uint32_t points[6][2] = {{0, 0}, {parts, 0}, {0, parts}};
    while (level-- > 0) {
        const unsigned char *child = children[index >> 2 * level & 3];
        uint32_t next[3][2];
        for (unsigned corner = 0; corner < 3; corner++)
            for (unsigned axis = 0; axis < 2; axis++)
                points[3 + corner][axis] = (points[corner][axis] + points[(corner + 1) % 3][axis]) / 2;
        for (unsigned corner = 0; corner < 3; corner++)
            memcpy(next[corner], points[child[corner]], sizeof next[corner]);
        memcpy(points, next, sizeof next);
    }
    memcpy(ret_corners, points, 3 * sizeof points[0]);
    return (points[0][0] + points[1][0] + points[2][0]) % 3 == 1;
}
