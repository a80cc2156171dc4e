/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/scene/polygon.h"

#include <math.h>
#include <string.h>

/*
 * Limits of the search for ears, in tests of a point: for all polygons of a cutter together, and for each corner. They
 * bound the time of hostile files; a thousand polygons of 500 corners take a fraction of it.
 */
enum { FREE_TESTS = 1 << 28, TESTS_A_CORNER = 256 };

/* Cosines whose sum is above this, negated, count as a straight angle and not as a concave one. */
static const double straight = 1e-6;

static void subtract(const float *a, const float *b, double ret_difference[3])
{
    for (int i = 0; i < 3; i++)
        ret_difference[i] = (double)a[i] - (double)b[i];
}

static double dot(const double a[3], const double b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static double cosine(const double a[3], const double b[3])
{
    double lengths = sqrt(dot(a, a)) * sqrt(dot(b, b));
    return lengths > 0 ? dot(a, b) / lengths : 0;
}

/*
 * Returns whether corner i of a quad is concave: the angles on both sides of its diagonal sum to more than 180 degrees,
 * which is so when the sum of their cosines is negative.
 */
static bool is_concave(const float *const points[4], int i)
{
    double before[3], across[3], after[3];
    subtract(points[(i + 3) % 4], points[i], before);
    subtract(points[(i + 2) % 4], points[i], across);
    subtract(points[(i + 1) % 4], points[i], after);
    return cosine(before, across) + cosine(after, across) < -straight;
}

static void cut_quad(const float *positions, const uint32_t *vertices, uint32_t *ret_triangles)
{
    const float *points[4];
    int first = 0;
    for (int i = 0; i < 4; i++)
        points[i] = positions + 3 * (size_t)vertices[i];
    while (first < 4 && !is_concave(points, first))
        first++;
    const int fan[6] = {0, 1, 2, 0, 2, 3};
    for (int i = 0; i < 6; i++)
        ret_triangles[i] = vertices[(first + fan[i]) % 4];
}

/* Makes room for a polygon of `count` corners. */
static bool reserve(struct polygon_cutter *cutter, uint32_t count)
{
    if (count <= cutter->capacity)
        return true;
    uint32_t capacity = count < UINT32_MAX / 2 ? count * 2 : count;
    memory_free(cutter->memory, cutter->corners);
    memory_free(cutter->memory, cutter->reflex);
    cutter->corners = memory_array(cutter->memory, capacity, sizeof *cutter->corners);
    cutter->reflex = memory_array(cutter->memory, capacity, sizeof *cutter->reflex);
    cutter->capacity = cutter->corners && cutter->reflex ? capacity : 0;
    return cutter->capacity > 0;
}

/* Sums up the normal of the polygon, times twice its area. */
static void find_normal(const float *positions, const uint32_t *vertices, uint32_t count, double ret_normal[3])
{
    const float *origin = positions + 3 * (size_t)vertices[0];
    double a[3], b[3], sum[3] = {0};
    subtract(positions + 3 * (size_t)vertices[1], origin, a);
    for (uint32_t i = 2; i < count; i++) {
        subtract(positions + 3 * (size_t)vertices[i], origin, b);
        for (int k = 0; k < 3; k++)
            sum[k] += a[(k + 1) % 3] * b[(k + 2) % 3] - a[(k + 2) % 3] * b[(k + 1) % 3];
        memcpy(a, b, sizeof a);
    }
    memcpy(ret_normal, sum, sizeof sum);
}

/* Projects the polygon along the axis that is nearest to its normal. */
static void project(struct polygon_cutter *cutter, const float *positions, const uint32_t *vertices, uint32_t count)
{
    double normal[3];
    find_normal(positions, vertices, count, normal);
    int axis = 2;
    if (fabs(normal[0]) > fabs(normal[1]))
        axis = fabs(normal[0]) > fabs(normal[2]) ? 0 : 2;
    else if (fabs(normal[1]) > fabs(normal[2]))
        axis = 1;
    int x = (axis + 1) % 3, y = (axis + 2) % 3;
    for (uint32_t i = 0; i < count; i++) {
        const float *position = positions + 3 * (size_t)vertices[i];
        cutter->corners[i] = (struct polygon_corner){.x = (double)position[normal[axis] < 0 ? y : x],
                                                     .y = (double)position[normal[axis] < 0 ? x : y],
                                                     .previous = i ? i - 1 : count - 1,
                                                     .next = i + 1 < count ? i + 1 : 0};
    }
}

/* Returns twice the area of the triangle, which is negative when its corners are in clockwise order. */
static double area(const struct polygon_corner *a, const struct polygon_corner *b, const struct polygon_corner *c)
{
    return (b->x - a->x) * (c->y - a->y) - (b->y - a->y) * (c->x - a->x);
}

static bool is_reflex(const struct polygon_corner *corners, uint32_t i)
{
    return area(&corners[corners[i].previous], &corners[i], &corners[corners[i].next]) < 0;
}

static void find_reflex(struct polygon_cutter *cutter, uint32_t count)
{
    cutter->reflex_count = 0;
    for (uint32_t i = 0; i < count; i++) {
        cutter->corners[i].is_reflex = is_reflex(cutter->corners, i);
        if (cutter->corners[i].is_reflex)
            cutter->reflex[cutter->reflex_count++] = i;
    }
}

static bool same_place(const struct polygon_corner *a, const struct polygon_corner *b)
{
    return a->x == b->x && a->y == b->y;
}

/* Takes tests from the cutter's limit. */
static void use_tests(struct polygon_cutter *cutter, uint64_t count)
{
    cutter->tests -= count < cutter->tests ? count : cutter->tests;
}

/*
 * Returns whether corner i can be cut off: its angle is not reflex, and no reflex corner is inside of the triangle.
 * Only reflex corners are tested, because the triangle contains one if it contains any.
 */
static bool is_ear(struct polygon_cutter *cutter, uint32_t i)
{
    const struct polygon_corner *corners = cutter->corners, *b = &corners[i];
    const struct polygon_corner *a = &corners[b->previous], *c = &corners[b->next];
    use_tests(cutter, 1);
    if (area(a, b, c) < 0)
        return false;
    use_tests(cutter, cutter->reflex_count);
    uint32_t kept = 0;
    bool is_empty = true;
    for (uint32_t k = 0; k < cutter->reflex_count; k++) {
        uint32_t at = cutter->reflex[k];
        const struct polygon_corner *p = &corners[at];
        if (!p->is_reflex)
            continue; /* it was cut off, or its angle has become convex: it leaves the list */
        cutter->reflex[kept++] = at;
        if (!is_empty || same_place(p, a) || same_place(p, b) || same_place(p, c))
            continue;
        is_empty = !(area(a, b, p) > 0 && area(b, c, p) > 0 && area(c, a, p) > 0);
    }
    cutter->reflex_count = kept;
    return is_empty;
}

/* Takes corner i out of the polygon. */
static void unlink_corner(struct polygon_cutter *cutter, uint32_t i)
{
    struct polygon_corner *corners = cutter->corners;
    uint32_t previous = corners[i].previous, next = corners[i].next;
    corners[previous].next = next;
    corners[next].previous = previous;
    corners[i].is_cut = true;
    corners[i].is_reflex = false;
    /* The list of reflex corners only shrinks: in a simple polygon no corner becomes reflex by a cut. */
    corners[previous].is_reflex = corners[previous].is_reflex && is_reflex(corners, previous);
    corners[next].is_reflex = corners[next].is_reflex && is_reflex(corners, next);
}

static uint32_t *put_triangle(uint32_t *out, const uint32_t *vertices, uint32_t a, uint32_t b, uint32_t c)
{
    out[0] = vertices[a];
    out[1] = vertices[b];
    out[2] = vertices[c];
    return out + 3;
}

/* Cuts ears from corner 0 on until three corners are left. Returns how many are left. */
static uint32_t cut_ears(struct polygon_cutter *cutter, const uint32_t *vertices, uint32_t count, uint32_t **out)
{
    cutter->tests += (uint64_t)count * TESTS_A_CORNER;
    uint32_t at = 0, left = count, refused = 0;
    while (left > 3 && refused < left && cutter->tests) {
        uint32_t next = cutter->corners[at].next;
        if (is_ear(cutter, at)) {
            *out = put_triangle(*out, vertices, cutter->corners[at].previous, at, next);
            unlink_corner(cutter, at);
            left--;
            refused = 0;
        } else {
            refused++;
        }
        at = next;
    }
    return left;
}

bool polygon_cut(struct polygon_cutter *cutter, const float *positions, const uint32_t *vertices, uint32_t count,
                 uint32_t *ret_triangles, bool *ret_is_fanned)
{
    *ret_is_fanned = false;
    if (count == 3)
        memcpy(ret_triangles, vertices, 3 * sizeof *vertices);
    if (count == 4)
        cut_quad(positions, vertices, ret_triangles);
    if (count <= 4)
        return true;
    if (!reserve(cutter, count))
        return false;
    project(cutter, positions, vertices, count);
    find_reflex(cutter, count);
    uint32_t left = cut_ears(cutter, vertices, count, &ret_triangles), first = 0;
    *ret_is_fanned = left > 3;
    while (cutter->corners[first].is_cut)
        first++;
    uint32_t second = cutter->corners[first].next;
    for (; left > 2; left--) {
        uint32_t third = cutter->corners[second].next;
        ret_triangles = put_triangle(ret_triangles, vertices, first, second, third);
        second = third;
    }
    return true;
}

void polygon_cutter_init(struct polygon_cutter *cutter, struct memory *memory)
{
    *cutter = (struct polygon_cutter){.memory = memory, .tests = FREE_TESTS};
}

void polygon_cutter_finish(struct polygon_cutter *cutter)
{
    if (!cutter || !cutter->memory)
        return;
    memory_free(cutter->memory, cutter->corners);
    memory_free(cutter->memory, cutter->reflex);
    *cutter = (struct polygon_cutter){0};
}
