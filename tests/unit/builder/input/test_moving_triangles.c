/* SPDX-License-Identifier: Apache-2.0 */
/* test_moving_triangles.c - tests the canonical form of motion triangles, their rules, and their boxes and refs. */
#include "tests/support/unit.h"

#include <math.h>

#include "builder/input/canonical_form.h"
#include "builder/input/outline.h"
#include "builder/input/primitive.h"
#include "builder/kernel/vec4.h"
#include "tests/support/builder/prepare_bed.h"
#include "tests/support/random.h"

/* Returns the canonical copy of the same triangles that stand still where those of one key are. */
static struct canonical make_still(const struct test_input *test, int key)
{
    static struct test_input still;
    still = *test;
    still.input.geometries = still.geometries;
    still.input.flags &= ~(uint32_t)BUILD_MOTION;
    for (int g = 0; g < 2; g++) {
        still.geometries[g].type = GEOMETRY_TRIANGLES;
        if (key == 1 && still.geometries[g].triangles.end_vertices.data)
            still.geometries[g].triangles.vertices = still.geometries[g].triangles.end_vertices;
    }
    return bed_make(&still);
}

/* The positions of each key, and the indices, are those of triangles that stand still there, also after a transform. */
static void both_keys_are_copied(void **state)
{
    (void)state;
    for (int mixed = 0; mixed < 2; mixed++) {
        struct test_input test;
        inputs_motion_triangles_and(&test, mixed);
        struct canonical canonical = bed_make(&test), stills[2] = {make_still(&test, 0), make_still(&test, 1)};
        assert_int_equal(bytes_get32(canonical.bytes + 4), CANONICAL_VERSION_ROUND);
        assert_true(canonical_moves(&canonical) && !canonical_moves(&stills[0]));
        assert_int_equal(canonical_kind(&canonical), GEOMETRY_MOVING_TRIANGLES);
        for (int g = 0; g < 2; g++) {
            const struct canonical_geometry *own = &canonical.geometries[g];
            assert_int_equal(own->end_positions == NULL, mixed && g == 1);
            for (int key = 0; key < 2; key++) {
                const struct canonical_geometry *still = &stills[key].geometries[g];
                assert_int_equal(own->vertex_count, still->vertex_count);
                assert_memory_equal(canonical_positions(own, key), still->positions, 12 * own->vertex_count);
                if (still->indices)
                    assert_memory_equal(own->indices, still->indices, 12 * own->primitive_count);
                for (uint32_t i = 0; i < own->primitive_count; i++) {
                    float corners[3][3], expected[3][3];
                    canonical_triangle_at(own, i, key, corners);
                    canonical_triangle(still, i, expected);
                    assert_memory_equal(corners, expected, sizeof corners);
                }
            }
        }
        prepare_finish(&stills[0], &bed_memory);
        prepare_finish(&stills[1], &bed_memory);
        bed_finish(&canonical);
    }
}

/* Triangles that all stand still differ from others by the flag, which needs the newer version. */
static void the_flag_alone_is_kept(void **state)
{
    (void)state;
    struct test_input test;
    inputs_triangles(&test);
    test.input.flags = BUILD_MOTION;
    struct canonical canonical = bed_make(&test);
    assert_int_equal(bytes_get32(canonical.bytes + 4), CANONICAL_VERSION_ROUND);
    assert_false(canonical_moves(&canonical));
    bed_finish(&canonical);
    test.input.geometry_count = 0;
    canonical = bed_make(&test);
    assert_int_equal(bytes_get32(canonical.bytes + 4), CANONICAL_VERSION_ROUND);
    bed_finish(&canonical);
}

static void strides_may_be_zero(void **state)
{
    (void)state;
    struct test_input test;
    inputs_motion_triangles(&test);
    for (int g = 0; g < 2; g++) {
        test.geometries[g].triangles.vertex_stride = 0;
        test.geometries[g].triangles.transform.data = NULL;
    }
    struct canonical canonical = bed_make(&test);
    for (int g = 0; g < 2; g++) {
        assert_int_equal(canonical.geometries[g].vertex_count, 1);
        assert_memory_equal(canonical.geometries[g].positions, test.vertices[0], 12);
        assert_memory_equal(canonical.geometries[g].end_positions, test.end_vertices[0], 12);
    }
    bed_finish(&canonical);
}

#define END_RULE "VUID-vkBuildAccelerationStructuresKHR-pInfos-11820"

static void null_end_vertices(void **state)
{
    (void)state;
    struct test_input test;
    for (int g = 0; g < 2; g++) {
        const char *where = g ? "infos[2].geometries[1].triangles.motion.vertexData"
                              : "infos[2].geometries[0].triangles.motion.vertexData";
        /* The last vertices are 4 of the indexed triangles, from vertex 1 on, and 8 of the others. */
        const uint64_t needed = g ? 8 * 20 + 12 : 4 * 20 + 12;
        inputs_motion_triangles(&test);
        test.geometries[g].triangles.end_vertices.data = NULL;
        bed_refuse(&test, BVHD_INVALID, END_RULE, where);
        inputs_motion_triangles(&test);
        test.geometries[g].triangles.end_vertices.size = needed - 1;
        bed_refuse(&test, BVHD_INVALID, END_RULE, where);
        test.geometries[g].triangles.end_vertices.size = needed;
        struct canonical canonical = bed_make(&test);
        bed_finish(&canonical);
        test.geometries[g].range.primitive_count = 0;
        test.geometries[g].triangles.end_vertices = (struct bytes){NULL, 0};
        canonical = bed_make(&test);
        bed_finish(&canonical);
    }
}

/* A block from elsewhere is opened as it was made, and refused where nobody would have made it. */
static void blocks_are_opened(void **state)
{
    (void)state;
    for (int mixed = 0; mixed < 2; mixed++) {
        struct test_input test;
        struct canonical view;
        inputs_motion_triangles_and(&test, mixed);
        test.input.flags |= BUILD_ALLOW_UPDATE;
        struct canonical canonical = bed_make(&test);
        unsigned char *bytes = malloc(canonical.size);
        assert_non_null(bytes);
        memcpy(bytes, canonical.bytes, canonical.size);
        const struct bytes block = {bytes, canonical.size};
        struct form_header *header = (void *)bytes;
        struct form_geometry *rows = (void *)(header + 1);
        assert_int_equal(prepare_open(block, &bed_memory, &view, NULL), BVHD_OK);
        for (int g = 0; g < 2; g++)
            for (int key = 0; key < 2; key++)
                assert_memory_equal(canonical_positions(&view.geometries[g], key),
                                    canonical_positions(&canonical.geometries[g], key),
                                    12 * view.geometries[g].vertex_count);
        prepare_finish(&view, &bed_memory);
        header->flags &= ~(uint32_t)BUILD_MOTION;
        assert_int_equal(prepare_open(block, &bed_memory, &view, NULL), BVHD_CORRUPT);
        header->flags |= BUILD_MOTION;
        rows[0].radius_format = 100;
        assert_int_equal(prepare_open(block, &bed_memory, &view, NULL), BVHD_CORRUPT);
        rows[0].radius_format = 0;
        rows[1].type = mixed ? GEOMETRY_MOVING_TRIANGLES : GEOMETRY_TRIANGLES; /* with the other size of vertices */
        assert_int_equal(prepare_open(block, &bed_memory, &view, NULL), BVHD_CORRUPT);
        free(bytes);
        bed_finish(&canonical);
    }
}

/* One triangle with these corners at both ends. */
struct moving {
    float keys[2][3][3];
    struct canonical_geometry geometry;
    struct canonical canonical;
};

static struct canonical *set(struct moving *moving, uint32_t flags)
{
    moving->geometry = (struct canonical_geometry){.type = GEOMETRY_MOVING_TRIANGLES,
                                                   .primitive_count = 1,
                                                   .vertex_count = 3,
                                                   .positions = moving->keys[0][0],
                                                   .end_positions = moving->keys[1][0]};
    moving->canonical = (struct canonical){.type = STRUCTURE_BOTTOM,
                                           .flags = BUILD_MOTION | flags,
                                           .geometry_count = 1,
                                           .primitive_count = 1,
                                           .vertex_count = 3,
                                           .geometries = &moving->geometry};
    return &moving->canonical;
}

/* The boxes that primitive_grow_keys adds are those that primitive_key_boxes finds. */
static void check_keys(const struct canonical *canonical, uint32_t id)
{
    struct primitive_finder finder = {.canonical = canonical};
    struct vec4_box grown[2] = {vec4_box_empty(), vec4_box_empty()};
    struct box boxes[2];
    primitive_key_boxes(canonical, canonical->geometries, id, boxes);
    primitive_grow_keys(&finder, &id, 1, grown);
    for (int key = 0; key < 2; key++) {
        const struct box own = vec4_box_get(grown[key]);
        assert_true(box_contains(&own, &boxes[key]) && box_contains(&boxes[key], &own));
    }
}

/* Checks how the triangle is counted, without and with ALLOW_UPDATE, which keeps all that are active. */
static void check(struct moving *moving, bool active, bool degenerate, bool kept)
{
    for (uint32_t flags = 0; flags < 2; flags++) {
        struct primitive_refs refs;
        struct box boxes[2], both;
        const struct canonical *canonical = set(moving, flags ? BUILD_ALLOW_UPDATE : 0);
        const bool has_ref = flags ? active : kept;
        assert_int_equal(primitive_collect_blocks(canonical, NULL, &bed_context, &refs, NULL), BVHD_OK);
        assert_int_equal(refs.count, has_ref);
        assert_int_equal(refs.inactive, !active);
        assert_int_equal(refs.degenerate, degenerate);
        assert_int_equal(refs.skipped, active && !has_ref);
        primitive_key_boxes(canonical, canonical->geometries, 0, boxes);
        both = primitive_box(canonical, canonical->geometries, 0);
        for (int key = 0; key < 2; key++) {
            assert_int_equal(box_is_empty(&boxes[key]), !has_ref);
            for (int axis = 0; axis < 3; axis++)
                assert_true(isfinite(boxes[key].min[axis]) && isfinite(boxes[key].max[axis]));
            for (int k = 0; kept && k < 3; k++) {
                box_add_point(&boxes[key], moving->keys[key][k]);
                assert_true(box_contains(&both, &boxes[key]));
            }
        }
        if (has_ref) {
            struct box own = primitive_ref_box(refs.refs);
            assert_true(box_contains(&own, &both) && box_contains(&both, &own));
            check_keys(canonical, 0);
        }
        memory_free(&bed_memory, refs.refs);
        memory_free(&bed_memory, refs.blocks);
        assert_int_equal(bed_memory.live, 0);
    }
}

static const struct moving plain = {.keys = {{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}, {{5, 5, 5}, {6, 5, 5}, {5, 6, 7}}}};

static void triangles_are_classified(void **state)
{
    (void)state;
    struct moving moving = plain;
    check(&moving, true, false, true);
    for (int key = 0; key < 2; key++)
        for (int corner = 0; corner < 3; corner++) {
            moving = plain;
            moving.keys[key][corner][0] = NAN;
            check(&moving, false, false, false);
            moving = plain;
            moving.keys[key][corner][2] = -INFINITY;
            check(&moving, true, false, false);
        }
    for (int a = 0; a < 3; a++) { /* two corners are one at both ends, and at one end only */
        moving = plain;
        memcpy(moving.keys[0][a], moving.keys[0][(a + 1) % 3], 12);
        check(&moving, true, false, true);
        memcpy(moving.keys[1][a], moving.keys[1][(a + 1) % 3], 12);
        check(&moving, true, true, false);
    }
    /* On a line along x at both ends, and on lines that cross, between which there is an area. */
    moving = (struct moving){.keys = {{{0, 1, 1}, {1, 1, 1}, {2, 1, 1}}, {{0, 3, 2}, {4, 3, 2}, {2, 3, 2}}}};
    check(&moving, true, true, false);
    moving = (struct moving){.keys = {{{0, 0, 0}, {1, 0, 0}, {2, 0, 0}}, {{0, 0, 0}, {0, 1, 0}, {0, 0, 0}}}};
    check(&moving, true, false, true);
}

enum { MANY = 3000 };

/* Corners at one end; one in eight is where another one is, one in thirty is no number, or infinite. */
static void fill(float (*corners)[3], struct random *random)
{
    for (uint32_t i = 0; i < 3 * MANY; i++)
        for (int axis = 0; axis < 3; axis++)
            corners[i][axis] = (float)random_between(random, -1, 1);
    for (uint32_t i = 0; i < 3 * MANY; i++) {
        if (random_between(random, 0, 1) < 0.125)
            memcpy(corners[i], corners[i - i % 3], sizeof *corners);
        if (random_between(random, 0, 1) < 1.0 / 30)
            corners[i][random_next(random) % 3] = random_between(random, 0, 1) < 0.5 ? NAN : INFINITY;
    }
}

/* The refs of many triangles, made by the quick ways, are those that a look at each one gives. */
static void quick_refs_are_those_of_single_looks(void **state)
{
    (void)state;
    static float keys[2][3 * MANY][3];
    static uint32_t indices[3 * MANY];
    struct random random = {5};
    for (int key = 0; key < 2; key++)
        fill(keys[key], &random);
    for (uint32_t i = 0; i < 3 * MANY; i++) /* neighbours share corners at both ends, but not all of them */
        indices[i] = random_between(&random, 0, 1) < 0.05 ? i - i % 3 : i;
    for (unsigned variant = 0; variant < 4; variant++) {
        struct moving moving = plain;
        struct primitive_refs refs;
        struct canonical *canonical = set(&moving, variant & 1 ? BUILD_ALLOW_UPDATE : 0);
        moving.geometry.primitive_count = canonical->primitive_count = MANY;
        moving.geometry.vertex_count = canonical->vertex_count = 3 * MANY;
        moving.geometry.positions = keys[0][0];
        moving.geometry.end_positions = keys[1][0];
        moving.geometry.indices = variant & 2 ? indices : NULL;
        assert_int_equal(primitive_collect_blocks(canonical, NULL, &bed_context, &refs, NULL), BVHD_OK);
        assert_true(primitive_close_gaps(&refs, &bed_context));
        uint32_t next = 0;
        for (uint32_t id = 0; id < MANY; id++) {
            const struct box both = primitive_box(canonical, canonical->geometries, id);
            if (box_is_empty(&both))
                continue;
            assert_true(next < refs.count);
            const struct box own = primitive_ref_box(&refs.refs[next]);
            assert_int_equal(refs.refs[next].id, id);
            assert_int_equal(refs.refs[next++].link, 0);
            assert_true(box_contains(&own, &both) && box_contains(&both, &own));
            check_keys(canonical, id);
        }
        assert_int_equal(next, refs.count);
        assert_true(next > MANY / 3 && next < MANY && refs.inactive > 0);
        memory_free(&bed_memory, refs.refs);
    }
    assert_int_equal(bed_memory.live, 0);
}

/* Boxes of keys are exact, and slabs hold the corners of both. */
static void boxes_and_slabs_hold_both_keys(void **state)
{
    (void)state;
    struct moving moving = plain;
    struct box boxes[2];
    struct slabs slabs, start;
    const struct canonical *canonical = set(&moving, 0);
    primitive_key_boxes(canonical, canonical->geometries, 0, boxes);
    const struct box expected[2] = {{{0, 0, 0}, {1, 1, 0}}, {{5, 5, 5}, {6, 6, 7}}};
    assert_memory_equal(boxes, expected, sizeof boxes);
    assert_true(outline_find(canonical, &bed_context, &slabs));
    assert_true(slabs.min[0] <= 0 && slabs.max[0] >= 11 && slabs.max[9] >= 18);
    moving.geometry.end_positions = moving.geometry.positions;
    assert_true(outline_find(canonical, &bed_context, &start));
    assert_true(start.max[0] < 2);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(both_keys_are_copied),
        cmocka_unit_test(the_flag_alone_is_kept),
        cmocka_unit_test(strides_may_be_zero),
        cmocka_unit_test(null_end_vertices),
        cmocka_unit_test(blocks_are_opened),
        cmocka_unit_test(triangles_are_classified),
        cmocka_unit_test(quick_refs_are_those_of_single_looks),
        cmocka_unit_test(boxes_and_slabs_hold_both_keys),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
