/* SPDX-License-Identifier: Apache-2.0 */
/* test_bins.c - tests that binned SAH finds the best plane, and gives the same bits on every machine. */
#include "tests/support/unit.h"

#include <math.h>

#include "builder/kernel/bins_kernels.h"
#include "tests/support/builder/test_refs.h"

static void fill(struct bins *bins, struct bins_mapping *mapping, const struct primitive_ref *refs, uint32_t count)
{
    struct vec4_box bounds, centroids;
    bins_bound(refs, count, &bounds, &centroids);
    bins_map(&centroids, count, mapping);
    bins_clear(bins, mapping);
    bins_add(bins, mapping, refs, count);
}

static double area_of(const struct primitive_ref *refs, uint32_t count, const struct bins_mapping *mapping, int axis,
                      uint32_t bin, bool left, uint32_t *ret_count)
{
    struct box box = box_empty();
    *ret_count = 0;
    for (uint32_t i = 0; i < count; i++) {
        float at = (refs[i].min[axis] + refs[i].max[axis] - mapping->base[axis]) * mapping->scale[axis];
        if ((at < (float)bin) != left)
            continue;
        struct box own = primitive_ref_box(&refs[i]);
        box_grow(&box, &own);
        ++*ret_count;
    }
    return box_half_area(&box);
}

/* Compares the chosen plane with every plane, evaluated in double from the refs. */
static void the_plane_is_the_best_of_all(void **state)
{
    (void)state;
    static const uint32_t counts[] = {2, 5, 63, 64, 500, 1100};
    for (int kind = 0; kind < REFS_KINDS; kind++)
        for (size_t c = 0; c < sizeof counts / sizeof *counts; c++) {
            struct bins bins;
            struct bins_mapping mapping;
            struct bins_plane plane;
            uint32_t count = counts[c], left, right;
            struct primitive_ref *refs = test_refs_make((enum test_refs_kind)kind, count, count + 1);
            fill(&bins, &mapping, refs, count);
            bool found = bins_choose(&bins, &mapping, count, &plane);
            double best = INFINITY, chosen = INFINITY;
            for (int axis = 0; axis < 3; axis++)
                for (uint32_t bin = 1; bin < mapping.bins && mapping.scale[axis] > 0; bin++) {
                    double cost = area_of(refs, count, &mapping, axis, bin, true, &left) * left;
                    cost += area_of(refs, count, &mapping, axis, bin, false, &right) * right;
                    best = left && right && cost < best ? cost : best;
                    if (found && (int)plane.axis == axis && plane.bin == bin) {
                        chosen = cost;
                        assert_int_equal(plane.left_count, left);
                    }
                }
            assert_true(found == (best < INFINITY));
            assert_true(!found || chosen <= best * (1 + 1e-5) + 1e-30);
            free(refs);
        }
}

static struct box box_of(const struct primitive_ref *refs, uint32_t count)
{
    struct box box = box_empty();
    for (uint32_t i = 0; i < count; i++) {
        struct box own = primitive_ref_box(&refs[i]);
        box_grow(&box, &own);
    }
    return box;
}

static bool same_box(const struct vec4_box *a, const struct box *b)
{
    struct box box = vec4_box_get(*a);
    return box_contains(&box, b) && box_contains(b, &box);
}

/* A partition is stable and complete, and has the boxes that the plane and the partition promise. */
static void partitions_keep_order_and_boxes(void **state)
{
    (void)state;
    for (int kind = 0; kind < REFS_KINDS; kind++)
        for (uint32_t count = 2; count < 3000; count = count * 2 + 1) {
            struct primitive_ref *refs = test_refs_make((enum test_refs_kind)kind, count, count),
                                 *out = test_refs_make(REFS_SAME, count, 0);
            struct bins bins;
            struct bins_mapping mapping;
            struct bins_plane plane;
            struct vec4_box centroids[2], bounds, expected;
            fill(&bins, &mapping, refs, count);
            if (bins_choose(&bins, &mapping, count, &plane)) {
                uint32_t left = plane.left_count;
                assert_true(left > 0 && left < count);
                assert_int_equal(bins_left_count(&bins, &plane), left);
                bins_partition(&mapping, &plane, refs, count, out, out + left, centroids);
                for (uint32_t i = 0; i < count; i++) {
                    assert_true(i == 0 || i == left || out[i].id > out[i - 1].id);
                    assert_memory_equal(&out[i], &refs[out[i].id], sizeof *out);
                }
                struct box sides[2] = {box_of(out, left), box_of(out + left, count - left)};
                assert_true(same_box(&plane.left, &sides[0]) && same_box(&plane.right, &sides[1]));
                for (int side = 0; side < 2; side++) {
                    bins_bound(out + (side ? left : 0), side ? count - left : left, &bounds, &expected);
                    struct box box = vec4_box_get(expected);
                    assert_true(same_box(&centroids[side], &box));
                }
            }
            free(refs);
            free(out);
        }
}

static void merged_bins_are_those_of_all(void **state)
{
    (void)state;
    enum { COUNT = 5000, CUT = 1234 };
    struct primitive_ref *refs = test_refs_make(REFS_CLUSTERS, COUNT, 5);
    struct bins all, first, second;
    struct bins_mapping mapping;
    struct bins_plane planes[2];
    fill(&all, &mapping, refs, COUNT);
    bins_clear(&first, &mapping);
    bins_clear(&second, &mapping);
    bins_add(&first, &mapping, refs, CUT);
    bins_add(&second, &mapping, refs + CUT, COUNT - CUT);
    bins_merge(&first, &mapping, &second);
    assert_true(bins_choose(&all, &mapping, COUNT, &planes[0]) && bins_choose(&first, &mapping, COUNT, &planes[1]));
    assert_int_equal(planes[0].axis, planes[1].axis);
    assert_int_equal(planes[0].bin, planes[1].bin);
    assert_int_equal(planes[0].left_count, planes[1].left_count);
    free(refs);
}

/* Refs that no extent tells apart have no plane; two refs that differ have one. */
static void planes_are_found_where_there_are_any(void **state)
{
    (void)state;
    struct bins bins;
    struct bins_mapping mapping;
    struct bins_plane plane;
    struct primitive_ref *refs = test_refs_make(REFS_SAME, 100, 5);
    fill(&bins, &mapping, refs, 100);
    assert_false(bins_choose(&bins, &mapping, 100, &plane));
    refs[57].max[2] += 1e-6f;
    fill(&bins, &mapping, refs, 100);
    assert_true(bins_choose(&bins, &mapping, 100, &plane));
    assert_true(plane.axis == 2 && plane.left_count == 99);
    free(refs);
}

/* Compares boxes without their fourth lanes, signs of zeros included. */
static void assert_same_bits(const struct vec4_box *a, const struct vec4_box *b)
{
    struct box x = vec4_box_get(*a), y = vec4_box_get(*b);
    assert_memory_equal(&x, &y, sizeof x);
}

static void run_kernels(const struct bins_kernels *kernels, const struct primitive_ref *refs, uint32_t count,
                        struct bins *ret_bins, struct primitive_ref *ret_refs, struct vec4_box ret_centroids[2])
{
    struct bins second, *sets[2] = {ret_bins, &second};
    struct bins_mapping mapping;
    struct bins_plane plane;
    fill(ret_bins, &mapping, refs, count);
    bool found = bins_choose(ret_bins, &mapping, count, &plane);
    bins_clear(ret_bins, &mapping);
    bins_clear(&second, &mapping);
    kernels->add(sets, &mapping, refs, count);
    bins_merge(ret_bins, &mapping, &second);
    if (found)
        kernels->partition(&mapping, &plane, refs, count, ret_refs, ret_refs + plane.left_count, ret_centroids);
}

static void every_machine_gets_the_same_bits(void **state)
{
    (void)state;
    const struct bins_kernels *kernels[2] = {&bins_kernels_plain, bins_kernels_avx2()};
    if (!kernels[1])
        skip();
    for (int kind = 0; kind < REFS_KINDS; kind++)
        for (uint32_t count = 2; count < 3000; count = count * 2 + 1) {
            struct primitive_ref *refs = test_refs_make((enum test_refs_kind)kind, count, count), *out[2];
            struct vec4_box centroids[2][2] = {{vec4_box_empty(), vec4_box_empty()},
                                               {vec4_box_empty(), vec4_box_empty()}};
            struct bins bins[2];
            for (uint32_t i = 0; i < count; i += 3) /* zeros of both signs */
                refs[i].min[i / 3 % 3] = refs[i].max[i / 3 % 3] = i % 2 ? 0.0f : -0.0f;
            for (int i = 0; i < 2; i++) {
                out[i] = test_refs_make(REFS_SAME, count, 0);
                run_kernels(kernels[i], refs, count, &bins[i], out[i], centroids[i]);
            }
            for (uint32_t bin = 0; bin < 4 + count / 16 && bin < BINS_MAX; bin++) {
                assert_memory_equal(&bins[0].counts[bin], &bins[1].counts[bin], 12);
                for (int axis = 0; axis < 3; axis++)
                    assert_same_bits(&bins[0].boxes[axis][bin], &bins[1].boxes[axis][bin]);
            }
            assert_memory_equal(out[0], out[1], count * sizeof *refs);
            assert_same_bits(&centroids[0][0], &centroids[1][0]);
            assert_same_bits(&centroids[0][1], &centroids[1][1]);
            free(refs);
            free(out[0]);
            free(out[1]);
        }
}

static void the_centroid_box_alone_is_the_same(void **state)
{
    (void)state;
    for (int kind = 0; kind < REFS_KINDS; kind++)
        for (uint32_t count = 1; count < 10; count++) {
            struct vec4_box bounds, expected;
            struct primitive_ref *refs = test_refs_make((enum test_refs_kind)kind, count, count);
            bins_bound(refs, count, &bounds, &expected);
            struct vec4_box found = bins_centroids(refs, count);
            for (int axis = 0; axis < 3; axis++) {
                assert_true(found.min[axis] == expected.min[axis]);
                assert_true(found.max[axis] == expected.max[axis]);
            }
            free(refs);
        }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_plane_is_the_best_of_all),     cmocka_unit_test(partitions_keep_order_and_boxes),
        cmocka_unit_test(merged_bins_are_those_of_all),     cmocka_unit_test(planes_are_found_where_there_are_any),
        cmocka_unit_test(every_machine_gets_the_same_bits), cmocka_unit_test(the_centroid_box_alone_is_the_same),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
