/* SPDX-License-Identifier: Apache-2.0 */
/* test_update_rules.c - tests that each rule of updates is reported with its VUID and its place. */
#include "tests/support/unit.h"

#include <math.h>

#include "builder/update/update_rules.h"
#include "tests/support/builder/update_bed.h"

/* A change to a request, and what an update with it must report. */
struct change {
    void (*make)(struct test_input *input);
    void (*apply)(struct test_input *input);
    enum bvhd_status status;
    const char *rule, *where; /* without "VUID-vkBuildAccelerationStructuresKHR-" */
};

static void make_triangles(struct test_input *input)
{
    inputs_triangles(input);
    input->input.flags = BUILD_ALLOW_UPDATE;
}

static void make_aabbs(struct test_input *input)
{
    inputs_aabbs(input);
    input->input.flags = BUILD_ALLOW_UPDATE;
}

static void make_instances(struct test_input *input)
{
    inputs_instances(input);
    input->input.flags = BUILD_ALLOW_UPDATE;
}

static void make_spheres(struct test_input *input)
{
    inputs_spheres(input);
    input->input.flags = BUILD_ALLOW_UPDATE;
}

static void make_swept(struct test_input *input)
{
    inputs_swept_spheres(input);
    input->input.flags = BUILD_ALLOW_UPDATE;
}

static void make_motion(struct test_input *input)
{
    inputs_motion_triangles(input);
    input->input.flags |= BUILD_ALLOW_UPDATE;
}

static void make_mixed(struct test_input *input)
{
    inputs_mixed_triangles(input);
    input->input.flags |= BUILD_ALLOW_UPDATE;
}

static void make_motion_instances(struct test_input *input)
{
    inputs_motion_instances(input);
    input->input.flags |= BUILD_ALLOW_UPDATE;
}

static void set_type(struct test_input *input)
{
    make_instances(input);
}

static void set_flags(struct test_input *input)
{
    input->input.flags |= BUILD_ALLOW_COMPACTION;
}

static void clear_flags(struct test_input *input)
{
    input->input.flags = 0;
}

static void set_geometry_count(struct test_input *input)
{
    input->input.geometry_count = 1;
}

static void set_target(struct test_input *input)
{
    input->input.options.target = TARGET_LAVAPIPE;
    input->input.options.device.variant = 1;
}

static void set_layout_flags(struct test_input *input)
{
    input->input.options.layout_flags = PORTABLE_FAST_TRIANGLES;
}

static void make_native(struct test_input *input)
{
    make_triangles(input);
    set_target(input);
}

static void set_device(struct test_input *input)
{
    input->input.options.device.variant = 2;
}

static void set_geometry_type(struct test_input *input)
{
    make_aabbs(input);
}

static void make_one_mesh(struct test_input *input)
{
    make_triangles(input);
    set_geometry_count(input);
}

static void set_geometry_flags(struct test_input *input)
{
    input->geometries[1].flags = GEOMETRY_NO_DUPLICATE_ANY_HIT;
}

static void set_format(struct test_input *input)
{
    input->geometries[0].triangles.vertex_format = 103; /* R32G32_SFLOAT */
}

static void set_max_vertex(struct test_input *input)
{
    input->geometries[1].triangles.max_vertex = 9;
}

static void set_index_type(struct test_input *input)
{
    static const uint32_t wide[7] = {9, 0, 1, 2, 2, 1, 3};
    input->geometries[0].triangles.index_type = INDEX_UINT32;
    input->geometries[0].triangles.indices = (struct bytes){(const unsigned char *)wide, sizeof wide};
}

static void clear_transform(struct test_input *input)
{
    input->geometries[0].triangles.transform = (struct bytes){NULL, 0};
}

static void set_transform(struct test_input *input)
{
    input->geometries[1].triangles.transform =
        (struct bytes){(const unsigned char *)input->transform, sizeof input->transform};
    input->geometries[1].range.transform_offset = 16;
}

static void set_index(struct test_input *input)
{
    input->indices[7] = 0;
}

/* The indices span the same vertices, and only their order changes. */
static void swap_indices(struct test_input *input)
{
    input->indices[2] = 1;
    input->indices[3] = 0;
}

/* All indices grow by one, so that their differences stay. */
static void shift_indices(struct test_input *input)
{
    for (int i = 2; i < 8; i++)
        input->indices[i]++;
}

static void set_primitive_count(struct test_input *input)
{
    input->geometries[1].range.primitive_count = 2;
}

static void clear_stride(struct test_input *input)
{
    input->geometries[1].triangles.vertex_stride = 0;
}

static void deactivate_triangle(struct test_input *input)
{
    input->vertices[8][1] = NAN; /* the last triangle of the geometry without indices */
}

static void set_ends_format(struct test_input *input)
{
    input->geometries[1].spheres.vertex_format = 103; /* R32G32_SFLOAT */
}

static void set_radius_format(struct test_input *input)
{
    input->geometries[1].spheres.radius_format = 76; /* R16_SFLOAT */
}

static void set_ends_index_type(struct test_input *input)
{
    static const uint32_t wide[8] = {9, 9, 0, 1, 2, 2, 1, 3};
    struct geometry_spheres *ends = &input->geometries[0].spheres;
    ends->index_type = INDEX_UINT32;
    ends->index_stride = 4;
    ends->indices = (struct bytes){(const unsigned char *)wide, sizeof wide};
    input->geometries[0].range.primitive_offset = 8;
}

static void set_mode(struct test_input *input)
{
    struct geometry_swept_spheres *swept = &input->geometries[0].swept_spheres;
    swept->indexing_mode = swept->indexing_mode == SWEPT_LIST ? SWEPT_SUCCESSIVE : SWEPT_LIST;
}

static void set_caps(struct test_input *input)
{
    struct geometry_swept_spheres *swept = &input->geometries[1].swept_spheres;
    swept->end_caps_mode = swept->end_caps_mode == SWEPT_CAPS_NONE ? SWEPT_CAPS_CHAINED : SWEPT_CAPS_NONE;
}

/* The first radius of the geometry without indices. */
static void deactivate_sphere(struct test_input *input)
{
    input->geometries[0] = input->geometries[1];
    input->vertices[0][3] = NAN;
}

static void make_same_spheres(struct test_input *input)
{
    make_spheres(input);
    input->geometries[0] = input->geometries[1];
}

static void make_same_swept(struct test_input *input)
{
    make_swept(input);
    input->geometries[0] = input->geometries[1];
}

/* As many linear swept spheres as the indices hold in either mode. */
static void make_few_swept(struct test_input *input)
{
    make_swept(input);
    input->geometries[0].range.primitive_count = 3;
}

static void activate_box(struct test_input *input)
{
    memcpy(input->boxes[2], input->boxes[0], sizeof input->boxes[0]);
}

static void deactivate_box(struct test_input *input)
{
    input->boxes[0][3] = NAN;
}

static void activate_instance(struct test_input *input)
{
    inputs_set_record(input, 1, 55, 0);
}

static void deactivate_instance(struct test_input *input)
{
    inputs_set_record(input, 2, 0, 0);
}

static void deactivate_end(struct test_input *input)
{
    input->end_vertices[8][1] = NAN; /* the last triangle of the geometry without indices */
}

static void stop(struct test_input *input)
{
    input->geometries[0].type = GEOMETRY_TRIANGLES;
}

/* With the flag MOTION, but nothing that moves. */
static void make_still(struct test_input *input)
{
    make_motion(input);
    input->geometries[0].type = input->geometries[1].type = GEOMETRY_TRIANGLES;
}

static void start(struct test_input *input)
{
    input->geometries[1].type = GEOMETRY_MOVING_TRIANGLES;
    input->geometries[1].triangles.end_vertices = input->geometries[0].triangles.end_vertices;
}

static void become_boxes(struct test_input *input)
{
    make_motion(input);
    input->geometries[0] = (struct geometry){.type = GEOMETRY_AABBS,
                                             .aabbs = {24, {(const unsigned char *)input->boxes, sizeof input->boxes}},
                                             .range = {.primitive_count = 2}};
    input->input.geometry_count = 1;
}

static void make_one_motion(struct test_input *input)
{
    make_motion(input);
    input->input.geometry_count = 1;
}

static void activate_motion_instance(struct test_input *input)
{
    inputs_set_motion_record(input, 4, MOTION_STATIC, 55, 0);
}

static void deactivate_motion_instance(struct test_input *input)
{
    const float nan = NAN;
    memcpy(&input->motion_records[3][33], &nan, sizeof nan); /* the last number at t = 1 */
}

static const struct change changes[] = {
    {make_triangles, set_type, BVHD_INVALID, "pInfos-03760", "infos[2].type"},
    {make_triangles, set_flags, BVHD_INVALID, "pInfos-03759", "infos[2].flags"},
    {make_triangles, clear_flags, BVHD_INVALID, "pInfos-03759", "infos[2].flags"},
    {make_triangles, set_geometry_count, BVHD_INVALID, "pInfos-03758", "infos[2].geometryCount"},
    {make_triangles, set_target, BVHD_INVALID, "", "infos[2].options.target"},
    {make_triangles, set_layout_flags, BVHD_INVALID, "", "infos[2].options.layoutFlags"},
    {make_native, set_device, BVHD_INVALID, "", "infos[2].options.device"},
    {make_one_mesh, set_geometry_type, BVHD_INVALID, "pInfos-03761", "infos[2].geometries[0].geometryType"},
    {make_triangles, set_geometry_flags, BVHD_INVALID, "pInfos-03762", "infos[2].geometries[1].flags"},
    {make_triangles, set_format, BVHD_INVALID, "pInfos-03763", "infos[2].geometries[0].triangles.vertexFormat"},
    {make_triangles, set_max_vertex, BVHD_INVALID, "pInfos-03764", "infos[2].geometries[1].triangles.maxVertex"},
    {make_triangles, set_index_type, BVHD_INVALID, "pInfos-03765", "infos[2].geometries[0].triangles.indexType"},
    {make_triangles, set_transform, BVHD_INVALID, "pInfos-03766", "infos[2].geometries[1].triangles.transformData"},
    {make_triangles, clear_transform, BVHD_INVALID, "pInfos-03767", "infos[2].geometries[0].triangles.transformData"},
    {make_triangles, set_index, BVHD_INVALID, "pInfos-03768", "infos[2].geometries[0].triangles.indexData"},
    {make_triangles, swap_indices, BVHD_INVALID, "pInfos-03768", "infos[2].geometries[0].triangles.indexData"},
    {make_triangles, shift_indices, BVHD_INVALID, "pInfos-03768", "infos[2].geometries[0].triangles.indexData"},
    {make_triangles, set_primitive_count, BVHD_INVALID, "primitiveCount-03769", "ranges[2][1].primitiveCount"},
    {make_triangles, clear_stride, BVHD_UNSUPPORTED, "", "infos[2].geometries[1].triangles.vertexStride"},
    {make_triangles, deactivate_triangle, BVHD_INVALID, "pInfos-03664", "infos[2].geometries[1].triangles[2]"},
    {make_aabbs, activate_box, BVHD_INVALID, "pInfos-03663", "infos[2].geometries[0].aabbs[2]"},
    {make_aabbs, deactivate_box, BVHD_INVALID, "pInfos-03664", "infos[2].geometries[0].aabbs[0]"},
    {make_spheres, set_ends_format, BVHD_INVALID, "", "infos[2].geometries[1].spheres.vertexFormat"},
    {make_spheres, set_radius_format, BVHD_INVALID, "", "infos[2].geometries[1].spheres.radiusFormat"},
    {make_spheres, set_ends_index_type, BVHD_INVALID, "", "infos[2].geometries[0].spheres.indexType"},
    {make_spheres, set_index, BVHD_INVALID, "", "infos[2].geometries[0].spheres.indexData"},
    {make_spheres, swap_indices, BVHD_INVALID, "", "infos[2].geometries[0].spheres.indexData"},
    {make_spheres, shift_indices, BVHD_INVALID, "", "infos[2].geometries[0].spheres.indexData"},
    {make_spheres, set_primitive_count, BVHD_INVALID, "primitiveCount-03769", "ranges[2][1].primitiveCount"},
    {make_same_spheres, deactivate_sphere, BVHD_INVALID, "pInfos-03664", "infos[2].geometries[0].spheres[0]"},
    {make_swept, set_ends_format, BVHD_INVALID, "", "infos[2].geometries[1].linearSweptSpheres.vertexFormat"},
    {make_swept, set_radius_format, BVHD_INVALID, "", "infos[2].geometries[1].linearSweptSpheres.radiusFormat"},
    {make_swept, set_ends_index_type, BVHD_INVALID, "", "infos[2].geometries[0].linearSweptSpheres.indexType"},
    {make_swept, set_caps, BVHD_INVALID, "", "infos[2].geometries[1].linearSweptSpheres.endCapsMode"},
    {make_few_swept, set_mode, BVHD_INVALID, "", "infos[2].geometries[0].linearSweptSpheres.indexingMode"},
    {make_swept, set_index, BVHD_INVALID, "", "infos[2].geometries[0].linearSweptSpheres.indexData"},
    {make_swept, shift_indices, BVHD_INVALID, "", "infos[2].geometries[0].linearSweptSpheres.indexData"},
    {make_same_swept, deactivate_sphere, BVHD_INVALID, "pInfos-03664", "infos[2].geometries[0].linearSweptSpheres[0]"},
    {make_instances, activate_instance, BVHD_INVALID, "pInfos-03663", "infos[2].geometries[0].instances[1]"},
    {make_instances, deactivate_instance, BVHD_INVALID, "pInfos-03664", "infos[2].geometries[0].instances[2]"},
    {make_one_motion, become_boxes, BVHD_INVALID, "pInfos-03761", "infos[2].geometries[0].geometryType"},
    {make_motion, set_geometry_flags, BVHD_INVALID, "pInfos-03762", "infos[2].geometries[1].flags"},
    {make_motion, set_format, BVHD_INVALID, "pInfos-03763", "infos[2].geometries[0].triangles.vertexFormat"},
    {make_motion, set_max_vertex, BVHD_INVALID, "pInfos-03764", "infos[2].geometries[1].triangles.maxVertex"},
    {make_motion, set_index_type, BVHD_INVALID, "pInfos-03765", "infos[2].geometries[0].triangles.indexType"},
    {make_motion, set_transform, BVHD_INVALID, "pInfos-03766", "infos[2].geometries[1].triangles.transformData"},
    {make_motion, clear_transform, BVHD_INVALID, "pInfos-03767", "infos[2].geometries[0].triangles.transformData"},
    {make_motion, set_index, BVHD_INVALID, "pInfos-03768", "infos[2].geometries[0].triangles.indexData"},
    {make_mixed, swap_indices, BVHD_INVALID, "pInfos-03768", "infos[2].geometries[0].triangles.indexData"},
    {make_motion, set_primitive_count, BVHD_INVALID, "primitiveCount-03769", "ranges[2][1].primitiveCount"},
    {make_motion, clear_stride, BVHD_UNSUPPORTED, "", "infos[2].geometries[1].triangles.vertexStride"},
    {make_motion, deactivate_triangle, BVHD_INVALID, "pInfos-03664", "infos[2].geometries[1].triangles[2]"},
    {make_motion, deactivate_end, BVHD_INVALID, "pInfos-03664", "infos[2].geometries[1].triangles[2]"},
    {make_mixed, stop, BVHD_UNSUPPORTED, "", "infos[2].geometries[0].triangles.motion"},
    {make_still, start, BVHD_UNSUPPORTED, "", "infos[2].geometries[1].triangles.motion"},
    {make_motion_instances, activate_motion_instance, BVHD_INVALID, "pInfos-03663",
     "infos[2].geometries[0].instances[4]"},
    {make_motion_instances, deactivate_motion_instance, BVHD_INVALID, "pInfos-03664",
     "infos[2].geometries[0].instances[3]"},
};

enum { CHANGES = sizeof changes / sizeof *changes };

static void expect(const struct test_input *source, const struct test_input *now, enum bvhd_status status,
                   const char *rule, const char *where)
{
    struct record before = update_bed_record(source), after = update_bed_record(now);
    struct bvhd_error error = {.where = "", .text = ""};
    char vuid[96];
    snprintf(vuid, sizeof vuid, "%s%s", *rule ? "VUID-vkBuildAccelerationStructuresKHR-" : "", rule);
    assert_int_equal(update_rules_check(&before, &after, 2, &error), status);
    if (status != BVHD_OK) {
        assert_string_equal(bvhd_vuid_string(error.vuid), vuid);
        assert_string_equal(error.where, where);
        assert_true(strlen(error.text) > 10);
    }
    record_finish(&before, &bed_memory);
    record_finish(&after, &bed_memory);
    assert_int_equal(bed_memory.live, 0);
}

/* The neighbours of each wrong update are right: the source with itself, and the changed request with itself. */
static void differences_are_named(void **state)
{
    (void)state;
    for (int i = 0; i < CHANGES; i++) {
        static struct test_input source, now;
        changes[i].make(&source);
        changes[i].make(&now);
        expect(&source, &now, BVHD_OK, "", "");
        changes[i].apply(&now);
        expect(&source, &now, changes[i].status, changes[i].rule, changes[i].where);
        expect(&now, &now, BVHD_OK, "", "");
    }
}

static void move_triangles(struct test_input *input)
{
    for (int i = 0; i < INPUTS_VERTICES; i++)
        input->vertices[i][1] = 100 - input->vertices[i][1];
    input->transform[7] = 12;
    input->geometries[0].triangles.vertices.data += 20; /* one vertex more before the first one */
    input->geometries[0].range.first_vertex = 0;
}

static void move_round(struct test_input *input)
{
    for (int i = 0; i < INPUTS_VERTICES; i++) {
        input->vertices[i][1] = 100 - input->vertices[i][1];
        input->vertices[i][3] = 1 + input->vertices[i][3];
    }
    input->geometries[0].spheres.vertices.data += 20; /* one vertex more before the first one */
    input->geometries[0].spheres.radii.data += 20;
    input->geometries[0].range.first_vertex = 0;
}

static void move_boxes(struct test_input *input)
{
    input->boxes[0][0] -= 10;
    input->boxes[1][5] += 2;
}

static void move_instances(struct test_input *input)
{
    for (int i = 0; i < INPUTS_RECORDS; i++)
        if (i != 1)
            inputs_set_record(input, i, 55, INSTANCE_FLIP_FACING);
    input->references[2].bounds.max[2] = 9;
}

static void move_motion(struct test_input *input)
{
    move_triangles(input);
    for (int i = 0; i < INPUTS_VERTICES; i++)
        input->end_vertices[i][2] *= 3;
    input->geometries[0].triangles.end_vertices.data += 20;
}

/* Each instance gets the type of another one. */
static void move_motion_instances(struct test_input *input)
{
    inputs_set_motion_record(input, 0, MOTION_SRT, 55, INSTANCE_FLIP_FACING);
    inputs_set_motion_record(input, 2, MOTION_STATIC, 77, 0);
    inputs_set_motion_record(input, 3, MOTION_MATRIX, 77, 0);
    inputs_set_motion_record(input, 4, MOTION_MATRIX, 0, 0);
}

static void what_may_change(void **state)
{
    static const struct {
        void (*make)(struct test_input *input), (*move)(struct test_input *input);
    } moves[] = {{make_triangles, move_triangles},
                 {make_aabbs, move_boxes},
                 {make_instances, move_instances},
                 {make_spheres, move_round},
                 {make_swept, move_round},
                 {make_motion, move_motion},
                 {make_mixed, move_motion},
                 {make_motion, stop}, /* one geometry, while the other one moves */
                 {make_mixed, start},
                 {make_motion_instances, move_motion_instances}};
    (void)state;
    for (size_t i = 0; i < sizeof moves / sizeof *moves; i++) {
        static struct test_input source, now;
        moves[i].make(&source);
        moves[i].make(&now);
        moves[i].move(&now);
        expect(&source, &now, BVHD_OK, "", "");
    }
}

/* Pairs of an inactive and an active primitive: each of them is found in both directions, wherever it is. */
static void activity_may_not_change(void **state)
{
    enum { BOXES = 200 };
    static float before[BOXES][6], now[BOXES][6];
    (void)state;
    for (uint32_t place = 0; place < BOXES; place += place % 64 == 62 ? 1 : 3) {
        static struct test_input source, update;
        char where[64];
        make_aabbs(&source);
        make_aabbs(&update);
        memset(before, 0, sizeof before);
        memset(now, 0, sizeof now);
        before[place][0] = NAN;
        for (int i = 0; i < 2; i++) {
            struct test_input *input = i ? &update : &source;
            input->geometries[1] = input->geometries[0];
            input->geometries[1].aabbs.boxes = (struct bytes){(const unsigned char *)(i ? now : before), sizeof now};
            input->geometries[1].range.primitive_count = BOXES;
            input->input.geometry_count = 2;
        }
        snprintf(where, sizeof where, "infos[2].geometries[1].aabbs[%u]", place);
        expect(&source, &update, BVHD_INVALID, "pInfos-03663", where);
        expect(&update, &source, BVHD_INVALID, "pInfos-03664", where);
        now[place][3] = NAN;
        expect(&source, &update, BVHD_OK, "", "");
    }
}

static void sources_without_a_record(void **state)
{
    struct bvhd_error error;
    (void)state;
    assert_int_equal(update_rules_not_updatable(7, &error), BVHD_INVALID);
    assert_int_equal(error.vuid, BVHD_VUID_03667);
    assert_string_equal(error.where, "infos[7].srcAccelerationStructure");
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(differences_are_named),
        cmocka_unit_test(what_may_change),
        cmocka_unit_test(activity_may_not_change),
        cmocka_unit_test(sources_without_a_record),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
