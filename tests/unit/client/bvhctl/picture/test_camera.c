/* SPDX-License-Identifier: Apache-2.0 */
/* test_camera.c - tests where the camera stands, by scenes of one mesh each. */
#include "tests/support/unit.h"

#include <math.h>

#include "client/bvhctl/picture/camera.h"
#include "tests/support/client/bvhctl/test_world.h"
#include "tests/support/scene/mesh.h"

enum { WIDTH = 48, HEIGHT = 32 };

static const struct camera_options usual = {.aspect = (double)WIDTH / HEIGHT};

/* A scene of one mesh, with its camera. */
struct set {
    struct test_world world;
    struct stage stage;
    struct camera camera;
};

static char name[] = "mesh";
static uint32_t list[] = {0};
static struct import_bottom bottom = {name, list, 1};
static struct import_instance instance = {.transform = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}};
static struct import_mesh imported;

static void open_set(struct set *set, const struct mesh *mesh, char up, const struct camera_options *options)
{
    uint64_t rays;
    imported = (struct import_mesh){.name = name,
                                    .material = name,
                                    .positions = &mesh->vertices[0][0],
                                    .indices = &mesh->triangles[0][0],
                                    .vertex_count = mesh->vertex_count,
                                    .primitive_count = mesh->triangle_count};
    const struct import import = {.name = name,
                                  .meshes = &imported,
                                  .bottoms = &bottom,
                                  .instances = &instance,
                                  .mesh_count = 1,
                                  .bottom_count = 1,
                                  .instance_count = 1,
                                  .triangle_count = mesh->triangle_count};
    test_world_init_from(&set->world, 2, &import);
    struct local *local = &set->world.local;
    assert_int_equal(
        stage_init(&set->stage, &set->world.structures, up, (struct stage_times){0, 1}, &local->memory, NULL), BVHD_OK);
    assert_int_equal(camera_choose(&set->stage, options, local->parallel, &local->memory, &set->camera, &rays, NULL),
                     BVHD_OK);
}

static void close_set(struct set *set, struct mesh *mesh)
{
    stage_finish(&set->stage);
    test_world_finish(&set->world);
    assert_int_equal(set->world.local.memory.live, 0);
    mesh_finish(mesh);
}

/* Returns the fraction of the picture in which something within `reach` of a point is seen. */
static double part_of_picture(const struct set *set, struct vector middle, double reach)
{
    unsigned hits = 0;
    for (int i = 0; i < WIDTH * HEIGHT; i++) {
        struct stage_hit hit;
        struct vector direction = camera_direction(&set->camera, (i % WIDTH + 0.5) / WIDTH, (i / WIDTH + 0.5) / HEIGHT);
        hits += stage_look(&set->stage, set->camera.origin, direction, 0, &hit) &&
                vector_length(vector_sub(hit.position, middle)) <= reach;
    }
    return hits / (double)(WIDTH * HEIGHT);
}

/* Returns whether a point is in the picture. */
static bool is_in_picture(const struct camera *camera, struct vector point)
{
    struct vector away = vector_sub(point, camera->origin);
    double ahead = vector_dot(away, camera->forward);
    return ahead > 0 && fabs(vector_dot(away, camera->right)) < ahead * camera->half_width &&
           fabs(vector_dot(away, camera->up)) < ahead * camera->half_height;
}

static const struct vector zero;

static void add_ball(struct mesh *mesh)
{
    static const double centre[3] = {0, 0, 0};
    mesh_add_sphere(mesh, centre, 1, 3, NULL, NULL);
}

static void test_sphere(void **state)
{
    (void)state;
    struct mesh mesh = {0};
    struct set set;
    add_ball(&mesh);
    open_set(&set, &mesh, 'a', &usual);
    assert_false(set.camera.is_inside);
    assert_true(vector_length(set.camera.origin) > 2);
    double part = part_of_picture(&set, zero, 2);
    assert_true(part > 0.2 && part < 0.7);
    close_set(&set, &mesh);
}

/* A far triangle, a spike to a far vertex and an endless ground do not make a ball small. */
static void test_outliers(void **state)
{
    (void)state;
    static const double far[3][3] = {{1e6, 0, 0}, {1e6, 1, 0}, {1e6, 0, 1}},
                        spike[3][3] = {{0, 0.5, 0}, {0, 0.6, 0}, {500, 900, 100}},
                        ground[4][3] = {{-900, -1, -900}, {900, -1, -900}, {900, -1, 900}, {-900, -1, 900}};
    for (int kind = 0; kind < 3; kind++) {
        struct mesh mesh = {0};
        struct set set;
        add_ball(&mesh);
        if (kind == 0)
            mesh_add_loose_triangle(&mesh, far[0], far[1], far[2]);
        if (kind == 1)
            mesh_add_loose_triangle(&mesh, spike[0], spike[1], spike[2]);
        if (kind == 2) {
            mesh_add_loose_triangle(&mesh, ground[0], ground[2], ground[1]);
            mesh_add_loose_triangle(&mesh, ground[0], ground[3], ground[2]);
        }
        open_set(&set, &mesh, 'a', &usual);
        assert_true(part_of_picture(&set, zero, 1.01) > 0.12);
        close_set(&set, &mesh);
    }
}

/* Adds a box whose faces point to its inside or to its outside. */
static void add_box(struct mesh *mesh, const double low[3], const double high[3], bool inward, unsigned without)
{
    static const int faces[6][4] = {{0, 4, 6, 2}, {1, 3, 7, 5}, {0, 1, 5, 4}, {2, 6, 7, 3}, {0, 2, 3, 1}, {4, 5, 7, 6}};
    uint32_t first = mesh->vertex_count;
    for (int i = 0; i < 8; i++)
        mesh_add_vertex(mesh, i & 1 ? high[0] : low[0], i & 2 ? high[1] : low[1], i & 4 ? high[2] : low[2]);
    for (unsigned i = 0; i < 6; i++) {
        if (without >> i & 1)
            continue;
        uint32_t at[4];
        for (int k = 0; k < 4; k++)
            at[k] = first + (uint32_t)faces[i][inward ? 3 - k : k];
        mesh_add_quad(mesh, at[0], at[1], at[2], at[3]);
    }
}

static void make_room(struct mesh *mesh, unsigned without)
{
    static const double low[3] = {-6, 0, -4}, high[3] = {6, 5, 4};
    add_box(mesh, low, high, true, without);
    for (int i = 0; i < 6; i++) {
        double x = -4 + 4 * (i % 3), z = i < 3 ? -2 : 2;
        const double foot[3] = {x - 0.3, 0, z - 0.3}, head[3] = {x + 0.3, 5, z + 0.3};
        add_box(mesh, foot, head, false, 0);
    }
}

/* A room with columns is seen from inside; without its front, from outside through it. */
static void test_room(void **state)
{
    (void)state;
    enum { FRONT = 1 << 5 };
    struct mesh mesh = {0}, open = {0};
    struct set set;
    make_room(&mesh, 0);
    open_set(&set, &mesh, 'y', &usual);
    assert_true(set.camera.is_inside);
    assert_true(fabs(set.camera.origin.x) < 6 && fabs(set.camera.origin.y - 2.5) < 2.5 &&
                fabs(set.camera.origin.z) < 4);
    close_set(&set, &mesh);
    make_room(&open, FRONT);
    open_set(&set, &open, 'y', &usual);
    assert_false(set.camera.is_inside);
    assert_true(set.camera.origin.z > 4 && set.camera.forward.z < 0);
    close_set(&set, &open);
}

static void test_flat_scenes(void **state)
{
    (void)state;
    static const double corners[2][3][3] = {{{0, 0, 0}, {3, 0, 0}, {0, 0, 2}}, {{0, 0, 0}, {0, 3, 0}, {0, 0, 2}}};
    for (int i = 0; i < 2; i++) {
        struct mesh mesh = {0};
        struct set set;
        mesh_add_loose_triangle(&mesh, corners[i][0], corners[i][1], corners[i][2]);
        open_set(&set, &mesh, 'a', &usual);
        assert_true(part_of_picture(&set, zero, 5) > 0.04);
        for (int k = 0; k < 3; k++)
            assert_true(is_in_picture(&set.camera, vector_make(corners[i][k][0], corners[i][k][1], corners[i][k][2])));
        close_set(&set, &mesh);
    }
}

/* A thin wire is seen from near. */
static void test_wire(void **state)
{
    (void)state;
    static const double from[3] = {-5000, 0, 0}, to[3] = {5000, 0, 0};
    struct mesh mesh = {0};
    struct set set;
    mesh_add_tube(&mesh, from, to, 0.2, 0.2, 6);
    open_set(&set, &mesh, 'a', &usual);
    assert_true(part_of_picture(&set, zero, INFINITY) > 0.002);
    close_set(&set, &mesh);
}

/* The camera looks at the front if the format says where it is, and nothing is cropped. */
static void test_front(void **state)
{
    (void)state;
    static const double low[3] = {-1, 0, -3}, high[3] = {1, 1.5, 3};
    struct camera_options options = usual;
    struct mesh mesh = {0};
    struct set set;
    options.knows_front = true;
    add_box(&mesh, low, high, false, 0);
    open_set(&set, &mesh, 'y', &options);
    assert_true(set.camera.forward.z < -0.5 && set.camera.forward.y < 0);
    for (int i = 0; i < 8; i++)
        assert_true(is_in_picture(&set.camera, vector_make(i & 1 ? 1 : -1, i & 2 ? 1.5 : 0, i & 4 ? 3 : -3)));
    close_set(&set, &mesh);
}

/* Maps are wide along two axes; a tower with a base stands on it. */
static void test_up(void **state)
{
    (void)state;
    static const double low[3] = {-9, -8, 0}, high[3] = {9, 8, 1}, base_low[3] = {-3, -3, 0},
                        base_high[3] = {3, 3, 0.3}, tower_low[3] = {-1, -1, 0.3}, tower_high[3] = {1, 1, 3};
    for (int i = 0; i < 2; i++) {
        struct mesh mesh = {0};
        struct set set;
        add_box(&mesh, i ? base_low : low, i ? base_high : high, false, 0);
        if (i)
            add_box(&mesh, tower_low, tower_high, false, 0);
        open_set(&set, &mesh, 'a', &usual);
        assert_true(set.stage.up.z == 1);
        close_set(&set, &mesh);
    }
}

static void test_options(void **state)
{
    (void)state;
    struct camera_options options = usual;
    struct mesh mesh = {0};
    struct set set;
    uint64_t rays;
    options.has_eye = options.has_target = true;
    options.eye = vector_make(3, 4, 5);
    options.target = vector_make(1, 0, 0);
    options.fov = 0.5;
    add_ball(&mesh);
    open_set(&set, &mesh, 'y', &options);
    struct vector wanted = vector_unit(vector_sub(options.target, options.eye));
    assert_true(vector_length(vector_sub(set.camera.origin, options.eye)) < 1e-12);
    assert_true(vector_length(vector_sub(set.camera.forward, wanted)) < 1e-12);
    assert_true(fabs(set.camera.half_height - tan(0.25)) < 1e-12);
    assert_true(fabs(set.camera.half_width - tan(0.25) * 1.5) < 1e-12);
    struct local *local = &set.world.local;
    struct bvhd_error error;
    options.target = options.eye;
    assert_int_equal(camera_choose(&set.stage, &options, local->parallel, &local->memory, &set.camera, &rays, &error),
                     BVHD_INVALID);
    options.target = vector_make(3, -4, 5); /* straight down */
    assert_int_equal(camera_choose(&set.stage, &options, local->parallel, &local->memory, &set.camera, &rays, &error),
                     BVHD_OK);
    assert_true(fabs(vector_length(set.camera.right) - 1) < 1e-9 && fabs(vector_length(set.camera.up) - 1) < 1e-9);
    close_set(&set, &mesh);
}

/* From every side of a turn the whole scene is in the picture, and the camera keeps its distance and height. */
static void test_turn(void **state)
{
    (void)state;
    static const double low[3] = {-1, 0, -5}, high[3] = {1, 2, 5};
    struct camera_options options = usual;
    struct mesh mesh = {0};
    struct set set;
    options.turns = true;
    add_box(&mesh, low, high, false, 0);
    open_set(&set, &mesh, 'y', &options);
    for (int i = 0; i < 12; i++) {
        struct camera camera = camera_turn(&set.stage, &set.camera, i * 3.14159265358979 / 6);
        assert_true(fabs(camera.origin.y - set.camera.origin.y) < 1e-9);
        assert_true(fabs(vector_length(vector_sub(camera.origin, camera.pivot)) -
                         vector_length(vector_sub(set.camera.origin, camera.pivot))) < 1e-9);
        for (int k = 0; k < 8; k++)
            assert_true(is_in_picture(&camera, vector_make(k & 1 ? 1 : -1, k & 2 ? 2 : 0, k & 4 ? 5 : -5)));
    }
    struct camera quarter = camera_turn(&set.stage, &set.camera, 3.14159265358979 / 2);
    struct vector before = vector_sub(set.camera.origin, set.camera.pivot),
                  after = vector_sub(quarter.origin, quarter.pivot);
    assert_true(vector_cross(before, after).y > 0); /* counterclockwise seen from above */
    close_set(&set, &mesh);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_sphere),      cmocka_unit_test(test_outliers), cmocka_unit_test(test_room),
        cmocka_unit_test(test_flat_scenes), cmocka_unit_test(test_wire),     cmocka_unit_test(test_front),
        cmocka_unit_test(test_up),          cmocka_unit_test(test_options),  cmocka_unit_test(test_turn),
    };
    return cmocka_run_group_tests_name("camera", tests, NULL, NULL);
}
