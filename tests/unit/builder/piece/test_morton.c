/* SPDX-License-Identifier: Apache-2.0 */
/* test_morton.c - tests that refs are sorted along the Morton curve, and that equal ones keep their order. */
#include "tests/support/unit.h"

#include "builder/piece/morton.h"
#include "tests/support/builder/test_refs.h"

/* Returns the cell of a centroid along an axis, as morton.h defines it. */
static uint32_t cell_of(const struct primitive_ref *ref, const struct box *centroids, int axis)
{
    double longest = 0;
    for (int k = 0; k < 3; k++) {
        double size = (double)centroids->max[k] - centroids->min[k];
        longest = size > longest ? size : longest;
    }
    float scale = longest > 0 ? 255.5f / (float)longest : 0;
    return (uint32_t)((ref->min[axis] + ref->max[axis] - centroids->min[axis]) * scale);
}

/* Compares two cells bit by bit, from the highest bit. */
static int compare(const struct primitive_ref *a, const struct primitive_ref *b, const struct box *centroids)
{
    for (int bit = 7; bit >= 0; bit--)
        for (int axis = 2; axis >= 0; axis--) {
            uint32_t x = cell_of(a, centroids, axis) >> bit & 1, y = cell_of(b, centroids, axis) >> bit & 1;
            if (x != y)
                return x < y ? -1 : 1;
        }
    return 0;
}

static void refs_follow_the_curve(void **state)
{
    (void)state;
    for (int kind = 0; kind < REFS_KINDS; kind++)
        for (uint32_t count = 1; count < 5000; count = count * 3 + 1) {
            struct primitive_ref *refs = test_refs_make((enum test_refs_kind)kind, count, count),
                                 *sorted = calloc(count, sizeof *sorted);
            struct morton_key *keys = calloc(count, 2 * sizeof *keys);
            unsigned char *seen = calloc(count, 1);
            struct box bounds, centroids;
            assert_true(sorted && keys && seen);
            primitive_ref_bounds(refs, count, &bounds, &centroids);
            morton_sort(refs, count, keys, sorted);
            for (uint32_t i = 0; i < count; i++) {
                assert_memory_equal(&sorted[i], &refs[sorted[i].id], sizeof *refs);
                assert_true(!seen[sorted[i].id]);
                seen[sorted[i].id] = 1;
                int order = i ? compare(&sorted[i - 1], &sorted[i], &centroids) : -1;
                assert_true(order < 0 || (order == 0 && sorted[i - 1].id < sorted[i].id));
            }
            free(refs);
            free(sorted);
            free(keys);
            free(seen);
        }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(refs_follow_the_curve),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
