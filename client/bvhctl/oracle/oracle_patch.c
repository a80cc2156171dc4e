/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/oracle/oracle_patch.h"

static bool corners_equal(const double a[3], const double b[3])
{
    return a[0] == b[0] && a[1] == b[1] && a[2] == b[2];
}

/*
 * Compares edge k of triangle a with edge m of triangle b. Returns 1 for the same edge in the same direction, -1 for
 * the same edge in the opposite direction, 0 for different edges.
 */
static int compare_edges(const struct oracle_patch_triangle *a, int k, const struct oracle_patch_triangle *b, int m)
{
    const double *from = a->outline.corners[(k + 1) % 3], *to = a->outline.corners[(k + 2) % 3];
    if (a->instance != b->instance)
        return 0;
    if (corners_equal(from, b->outline.corners[(m + 1) % 3]) && corners_equal(to, b->outline.corners[(m + 2) % 3]))
        return 1;
    if (corners_equal(from, b->outline.corners[(m + 2) % 3]) && corners_equal(to, b->outline.corners[(m + 1) % 3]))
        return -1;
    return 0;
}

static bool are_neighbours(const struct oracle_patch_triangle *a, const struct oracle_patch_triangle *b)
{
    for (int k = 0; k < 3; k++)
        for (int m = 0; m < 3; m++)
            if (compare_edges(a, k, b, m))
                return true;
    return false;
}

void oracle_patch_find(const struct oracle_patch_triangle *triangles, uint32_t count,
                       uint32_t ret_patch[ORACLE_PATCH_MAX])
{
    for (uint32_t i = 0; i < count; i++) {
        ret_patch[i] = i;
        for (uint32_t k = 0; k < i; k++) {
            uint32_t mine = ret_patch[i], other = ret_patch[k];
            if (mine == other || !are_neighbours(&triangles[i], &triangles[k]))
                continue;
            uint32_t low = mine < other ? mine : other, high = mine < other ? other : mine;
            for (uint32_t m = 0; m <= i; m++)
                ret_patch[m] = ret_patch[m] == high ? low : ret_patch[m];
        }
    }
}

struct patch {
    const struct oracle_patch_triangle *triangles;
    uint32_t count;
    const uint32_t *member_of;
    uint32_t which;
    bool by_area; /* false: triangles keep their winding; true: they are reversed so that all areas are positive */
};

static int orientation(const struct patch *patch, uint32_t triangle)
{
    return patch->by_area && !patch->triangles[triangle].outline.positive ? -1 : 1;
}

/*
 * Returns how often the patch has this edge, minus how often it has it in the opposite direction. It is 0 for edges
 * inside the patch.
 */
static int multiplicity(const struct patch *patch, uint32_t triangle, int edge)
{
    int sum = 0;
    for (uint32_t i = 0; i < patch->count; i++) {
        if (patch->member_of[i] != patch->which)
            continue;
        for (int k = 0; k < 3; k++)
            sum += orientation(patch, i) * compare_edges(&patch->triangles[triangle], edge, &patch->triangles[i], k);
    }
    return sum;
}

/* Returns what an edge adds to the winding number: 1 or -1, by direction, if it crosses the positive x axis, else 0. */
static int crossing_of(const double from[2], const double to[2])
{
    double side = from[0] * to[1] - to[0] * from[1];
    if (from[1] <= 0)
        return to[1] > 0 && side > 0;
    return to[1] <= 0 && side < 0 ? -1 : 0;
}

/* Returns the winding number of the boundary, or 0 when the boundary may touch the ray. */
static int winding_number(const struct patch *patch)
{
    int winding = 0;
    for (uint32_t i = 0; i < patch->count; i++) {
        if (patch->member_of[i] != patch->which)
            continue;
        const struct oracle_outline *outline = &patch->triangles[i].outline;
        for (int k = 0; k < 3; k++) {
            if (multiplicity(patch, i, k) == 0)
                continue;
            if (!outline->sure[k])
                return 0;
            winding += orientation(patch, i) * crossing_of(outline->seen[(k + 1) % 3], outline->seen[(k + 2) % 3]);
        }
    }
    return winding;
}

bool oracle_patch_covers(const struct oracle_patch_triangle *triangles, uint32_t count, const uint32_t *patch,
                         uint32_t which)
{
    /*
     * The first choice is for meshes with a consistent winding, the second one for other triangles. Either proves a hit
     * if its winding number is not 0.
     */
    struct patch as_given = {triangles, count, patch, which, false}, by_area = {triangles, count, patch, which, true};
    return winding_number(&as_given) != 0 || winding_number(&by_area) != 0;
}
