/* SPDX-License-Identifier: Apache-2.0 */
/* test_request_update_rules.c - tests each rule about what an update must not change, through a session. */
#include "tests/support/unit.h"

#include "tests/support/builder/inputs.h"
#include "tests/support/daemon/update_request.h"

static struct session_world world;

static int set_up(void **state)
{
    (void)state;
    struct service_options options = world_options();
    world_init(&world, &options);
    return 0;
}

static int tear_down(void **state)
{
    (void)state;
    world_finish(&world);
    return 0;
}

struct rule {
    const char *name;
    void (*make)(struct test_input *test);
    void (*change)(struct test_input *test, struct build_input *update);
    enum bvhd_vuid vuid;
    const char *where; /* NULL: the change is allowed */
};

#define CHANGE(name, ...)                                                                                              \
    static void name(struct test_input *test, struct build_input *update)                                              \
    {                                                                                                                  \
        (void)test, (void)update;                                                                                      \
        __VA_ARGS__;                                                                                                   \
    }

CHANGE(nothing, (void)0)
CHANGE(geometry_count, update->geometry_count = 1)
CHANGE(flags, update->flags |= BUILD_ALLOW_COMPACTION)
CHANGE(no_flag, update->flags = 0)
CHANGE(geometry_flags, test->geometries[1].flags ^= GEOMETRY_OPAQUE)
CHANGE(vertex_format, test->geometries[1].triangles.vertex_format = 103)
CHANGE(max_vertex, test->geometries[1].triangles.max_vertex++)
CHANGE(index_type, test->geometries[1].triangles.index_type = INDEX_UINT16;
       test->geometries[1].triangles.indices = test->geometries[0].triangles.indices;
       test->geometries[1].range.primitive_count = 2; test->geometries[1].range.primitive_offset = 4)
CHANGE(transform_to_null, test->geometries[0].triangles.transform = (struct bytes){NULL, 0})
CHANGE(transform_from_null, test->geometries[1].triangles.transform = test->geometries[0].triangles.transform;
       test->geometries[1].range.transform_offset = 16)
CHANGE(indices, test->indices[3]++)
CHANGE(primitive_count, test->geometries[1].range.primitive_count--)
CHANGE(inactive, test->vertices[4][0] = __builtin_nanf(""))
CHANGE(inactive_box, test->boxes[0][0] = __builtin_nanf(""))
CHANGE(active_box, memset(test->boxes[2], 0, sizeof test->boxes[2]))
CHANGE(inactive_instance, memset(&test->records[0][14], 0, 8))
CHANGE(triangles_for_boxes, {
    struct test_input triangles;
    inputs_triangles(&triangles);
    test->geometries[0] = triangles.geometries[1];
    memcpy(test->vertices, triangles.vertices, sizeof test->vertices);
    test->geometries[0].triangles.vertices.data = (const unsigned char *)test->vertices;
})
CHANGE(moved, for (int i = 0; i < INPUTS_VERTICES; i++) test->vertices[i][1] *= 3; test->transform[4] = 2)
CHANGE(moved_boxes, test->boxes[1][0] = -7)
CHANGE(quality, update->options.quality = QUALITY_HIGH)
CHANGE(layout_flags, update->options.layout_flags = PORTABLE_FAST_TRIANGLES)
CHANGE(target, update->options.target = TARGET_LAVAPIPE; update->options.device.variant = 1)

static const struct rule rules[] = {
    {"nothing", inputs_triangles, nothing, BVHD_VUID_NONE, NULL},
    {"moved", inputs_triangles, moved, BVHD_VUID_NONE, NULL},
    {"moved_boxes", inputs_aabbs, moved_boxes, BVHD_VUID_NONE, NULL},
    {"quality", inputs_triangles, quality, BVHD_VUID_NONE, NULL},
    {"geometry_count", inputs_triangles, geometry_count, BVHD_VUID_03758, "infos[0].geometryCount"},
    {"flags", inputs_triangles, flags, BVHD_VUID_03759, "infos[0].flags"},
    {"no_flag", inputs_triangles, no_flag, BVHD_VUID_03759, "infos[0].flags"},
    {"triangles_for_boxes", inputs_aabbs, triangles_for_boxes, BVHD_VUID_03761, "infos[0].geometries[0].geometryType"},
    {"geometry_flags", inputs_triangles, geometry_flags, BVHD_VUID_03762, "infos[0].geometries[1].flags"},
    {"vertex_format", inputs_triangles, vertex_format, BVHD_VUID_03763,
     "infos[0].geometries[1].triangles.vertexFormat"},
    {"max_vertex", inputs_triangles, max_vertex, BVHD_VUID_03764, "infos[0].geometries[1].triangles.maxVertex"},
    {"index_type", inputs_triangles, index_type, BVHD_VUID_03765, "infos[0].geometries[1].triangles.indexType"},
    {"transform_from_null", inputs_triangles, transform_from_null, BVHD_VUID_03766,
     "infos[0].geometries[1].triangles.transformData"},
    {"transform_to_null", inputs_triangles, transform_to_null, BVHD_VUID_03767,
     "infos[0].geometries[0].triangles.transformData"},
    {"indices", inputs_triangles, indices, BVHD_VUID_03768, "infos[0].geometries[0].triangles.indexData"},
    {"primitive_count", inputs_triangles, primitive_count, BVHD_VUID_03769, "ranges[0][1].primitiveCount"},
    {"inactive", inputs_triangles, inactive, BVHD_VUID_03664, "infos[0].geometries[0].triangles[1]"},
    {"inactive_box", inputs_aabbs, inactive_box, BVHD_VUID_03664, "infos[0].geometries[0].aabbs[0]"},
    {"active_box", inputs_aabbs, active_box, BVHD_VUID_03663, "infos[0].geometries[0].aabbs[2]"},
    {"inactive_instance", inputs_instances, inactive_instance, BVHD_VUID_03664, "infos[0].geometries[0].instances[0]"},
    {"layout_flags", inputs_triangles, layout_flags, BVHD_VUID_NONE, "infos[0].options.layoutFlags"},
    {"target", inputs_triangles, target, BVHD_VUID_NONE, "infos[0].options.target"},
};

/* Each rule is reported by its VUID and place; a neighbour that breaks none passes. */
static void test_rules(void **state)
{
    (void)state;
    struct world_client *client = world_join(&world);
    for (size_t i = 0; i < sizeof rules / sizeof *rules; i++) {
        const struct rule *rule = &rules[i];
        struct test_input test;
        rule->make(&test);
        test.input.flags = BUILD_ALLOW_UPDATE;
        struct key key = update_build(client, &test.input);
        struct build_input update = update_of(&test.input);
        rule->change(&test, &update);
        const struct world_event *event = update_await(client, update_ask(client, &update, &key));
        print_message("%s\n", rule->name);
        if (rule->where)
            update_expect(event, BVHD_INVALID, rule->vuid, rule->where);
        else
            update_expect(event, BVHD_OK, BVHD_VUID_NONE, "");
    }
}

/* Keys that lead to other structures than the request can update. */
static void test_wrong_sources(void **state)
{
    (void)state;
    struct world_client *client = world_join(&world);
    struct test_input triangles, boxes, instances;
    inputs_triangles(&triangles);
    inputs_aabbs(&boxes);
    inputs_instances(&instances);
    struct key plain = update_build(client, &triangles.input);
    triangles.input.flags = boxes.input.flags = instances.input.flags = BUILD_ALLOW_UPDATE;
    struct key other = update_build(client, &boxes.input), top = update_build(client, &instances.input);
    const struct build_input update = update_of(&triangles.input), update_top = update_of(&instances.input);
    update_expect(update_await(client, update_ask(client, &update, &plain)), BVHD_INVALID, BVHD_VUID_03667,
                  "infos[0].srcAccelerationStructure");
    update_expect(update_await(client, update_ask(client, &update, &top)), BVHD_INVALID, BVHD_VUID_03760,
                  "infos[0].type");
    update_expect(update_await(client, update_ask(client, &update_top, &other)), BVHD_INVALID, BVHD_VUID_03760,
                  "infos[0].type");
    update_expect(update_await(client, update_ask(client, &update, &other)), BVHD_INVALID, BVHD_VUID_03758,
                  "infos[0].geometryCount");
    struct build_input unnamed = update;
    unnamed.source = 0;
    update_expect(update_await(client, update_ask(client, &unnamed, &other)), BVHD_INVALID, BVHD_VUID_04630,
                  "infos[0].srcAccelerationStructure");
    /* The key of a build is ignored. */
    assert_true(key_equal(&update_await(client, update_ask(client, &triangles.input, &top))->result->key,
                          &update_await(client, update_ask(client, &triangles.input, NULL))->result->key));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(test_rules, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_wrong_sources, set_up, tear_down),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
