/* SPDX-License-Identifier: Apache-2.0 */
#include "unit.h"

#include <math.h>
#include <png.h>
#include <unistd.h>

#include "picture.h"
#include "smooth.h"
#include "test_world.h"

enum { WIDTH = 64, HEIGHT = 36 };

/* A world with its stage, camera and light. */
struct studio {
    struct test_world world;
    struct stage stage;
    struct camera camera;
    struct light light;
};

static void open_studio(struct studio *studio, uint32_t threads)
{
    uint64_t rays = 0;
    test_world_init(&studio->world, threads);
    struct local *local = &studio->world.local;
    assert_int_equal(stage_init(&studio->stage, &studio->world.structures, 'a', &local->memory, NULL), BVHD_OK);
    assert_int_equal(
        camera_choose(&studio->stage, (double)WIDTH / HEIGHT, local->parallel, &local->memory, &studio->camera, &rays, NULL), BVHD_OK);
    assert_true(rays > 0);
    light_init(&studio->light, &studio->stage, &studio->camera);
}

static void close_studio(struct studio *studio)
{
    stage_finish(&studio->stage);
    stage_finish(&studio->stage);
    test_world_finish(&studio->world);
    assert_int_equal(studio->world.local.memory.live, 0);
}

static void take_picture(struct studio *studio, struct picture *ret_picture)
{
    struct local *local = &studio->world.local;
    assert_int_equal(picture_render(&studio->light, WIDTH, HEIGHT, local->parallel, NULL, NULL, &local->memory, ret_picture, NULL),
                     BVHD_OK);
}

static void test_stage(void **state)
{
    (void)state;
    struct studio studio;
    open_studio(&studio, 1);
    const struct stage *stage = &studio.stage;
    assert_true(stage->up.y == 1);
    assert_true(fabs(stage->low.z) < 1e-6 && fabs(stage->high.z - 2) < 1e-6);
    assert_true(stage->sample_count > 0 && stage->sample_count <= STAGE_SAMPLES);
    assert_true(stage->floor < 0 && stage->floor > -0.1);
    struct stage_hit hit;
    assert_true(stage_look(stage, vector_make(0.25, 10, 0.5), vector_make(0, -1, 0), &hit));
    assert_true(fabs(hit.distance - 8) < 1e-6 && fabs(hit.normal.y - 1) < 1e-6 && hit.instance == 1);
    assert_true(isinf(stage_clearance(stage, vector_make(20, 10, 0), vector_make(0, -1, 0))));
    close_studio(&studio);
}

/* Any axis can be called up; the axes stay right-handed. */
static void test_up(void **state)
{
    (void)state;
    struct test_world world;
    test_world_init(&world, 1);
    for (int i = 0; i < 3; i++) {
        struct stage stage;
        assert_int_equal(stage_init(&stage, &world.structures, (char)('x' + i), &world.local.memory, NULL), BVHD_OK);
        struct vector up = vector_cross(stage.east, stage.north);
        assert_true(up.x == stage.up.x && up.y == stage.up.y && up.z == stage.up.z);
        assert_true((i == 0 ? up.x : i == 1 ? up.y : up.z) == 1);
        stage_finish(&stage);
    }
    test_world_finish(&world);
}

static unsigned count_hits(const struct stage *stage, const struct camera *camera)
{
    unsigned hits = 0;
    for (int i = 0; i < WIDTH * HEIGHT; i++) {
        struct stage_hit hit;
        hits +=
            stage_look(stage, camera->origin, camera_direction(camera, (i % WIDTH + 0.5) / WIDTH, (i / WIDTH + 0.5) / HEIGHT), &hit);
    }
    return hits;
}

static void test_camera_sees_the_scene(void **state)
{
    (void)state;
    struct studio studio;
    open_studio(&studio, 2);
    assert_true(count_hits(&studio.stage, &studio.camera) > WIDTH * HEIGHT / 8);
    assert_false(studio.camera.is_inside);
    close_studio(&studio);
}

/* One bottom level of the world as a scene of its own. */
static void open_alone(const struct test_world *world, uint32_t bottom, struct structures *ret_alone)
{
    struct memory *memory = world->import.memory;
    struct structure_file *file = memory_alloc(memory, sizeof *file);
    assert_non_null(file);
    *file = world->structures.files[bottom];
    file->is_shared = true;
    *ret_alone = (struct structures){.files = file, .file_count = 1, .memory = memory};
    assert_int_equal(structures_join(ret_alone, NULL), BVHD_OK);
}

/* A quad, level or upright, and a cube, alone and with too few triangles for one sample each to tell anything. */
static void test_few_triangles(void **state)
{
    (void)state;
    struct test_world world;
    test_world_init(&world, 1);
    for (int i = 0; i < 8; i++) {
        struct stage stage;
        struct camera camera;
        uint64_t rays;
        struct local *local = &world.local;
        struct structures alone;
        open_alone(&world, (uint32_t)i / 4, &alone);
        assert_int_equal(stage_init(&stage, &alone, "xyza"[i % 4], &local -> memory, NULL), BVHD_OK);
        assert_true(stage.even_count >= 256 && stage.even_count <= STAGE_EVEN_SAMPLES);
        assert_true(fabs(stage.size - (i < 4 ? 16 * sqrt(2) : 2 * sqrt(3))) < 1e-3);
        assert_int_equal(camera_choose(&stage, (double)WIDTH / HEIGHT, local->parallel, &local->memory, &camera, &rays, NULL), BVHD_OK);
        unsigned hits = count_hits(&stage, &camera);
        assert_false(camera.is_inside);
        assert_in_range(hits, WIDTH * HEIGHT / 16, WIDTH * HEIGHT * 15 / 16);
        stage_finish(&stage);
        structures_close(&alone);
    }
    test_world_finish(&world);
    assert_int_equal(world.local.memory.live, 0);
}

static void test_same_for_any_threads(void **state)
{
    (void)state;
    struct picture pictures[2];
    struct studio studios[2];
    for (int i = 0; i < 2; i++) {
        open_studio(&studios[i], i ? 4 : 1);
        take_picture(&studios[i], &pictures[i]);
    }
    assert_memory_equal(pictures[0].rgb, pictures[1].rgb, 3 * WIDTH * HEIGHT);
    assert_int_equal(pictures[0].rays, pictures[1].rays);
    for (int i = 0; i < 2; i++) {
        picture_finish(&pictures[i]);
        close_studio(&studios[i]);
    }
}

/* Something is in it: shadows are dark, the sun is bright. */
static void test_contrast(void **state)
{
    (void)state;
    struct studio studio;
    struct picture picture;
    open_studio(&studio, 2);
    take_picture(&studio, &picture);
    uint8_t low = 255, high = 0;
    for (int i = 0; i < 3 * WIDTH * HEIGHT; i++) {
        low = picture.rgb[i] < low ? picture.rgb[i] : low;
        high = picture.rgb[i] > high ? picture.rgb[i] : high;
    }
    assert_true(low < 110 && high > 190);
    picture_finish(&picture);
    close_studio(&studio);
}

static void test_png(void **state)
{
    (void)state;
    struct studio studio;
    struct picture picture;
    char path[] = "/tmp/bvhd-test-picture-XXXXXX";
    int descriptor = mkstemp(path);
    assert_true(descriptor >= 0);
    close(descriptor);
    open_studio(&studio, 2);
    take_picture(&studio, &picture);
    assert_int_equal(picture_write_png(&picture, path, NULL), BVHD_OK);
    png_image image = {.version = PNG_IMAGE_VERSION};
    assert_true(png_image_begin_read_from_file(&image, path));
    image.format = PNG_FORMAT_RGB;
    assert_int_equal(image.width, WIDTH);
    assert_int_equal(image.height, HEIGHT);
    uint8_t read_back[3 * WIDTH * HEIGHT];
    assert_true(png_image_finish_read(&image, NULL, read_back, 0, NULL));
    assert_memory_equal(read_back, picture.rgb, sizeof read_back);
    assert_int_equal(picture_write_png(&picture, "/nowhere/x.png", NULL), BVHD_NOT_FOUND);
    unlink(path);
    picture_finish(&picture);
    picture_finish(&picture);
    close_studio(&studio);
}

static void test_no_memory(void **state)
{
    (void)state;
    struct studio studio;
    struct picture picture;
    open_studio(&studio, 1);
    struct memory *memory = &studio.world.local.memory;
    uint64_t live = memory->live;
    for (int64_t after = 0; after < 4; after++) {
        atomic_store(&memory->fail_after, after);
        enum bvhd_status status = picture_render(&studio.light, 4, 4, studio.world.local.parallel, NULL, NULL, memory, &picture, NULL);
        assert_int_equal(status, BVHD_NO_MEMORY);
        assert_int_equal(memory->live, live);
    }
    atomic_store(&memory->fail_after, -1);
    close_studio(&studio);
}

/* Noise on a plane goes; light on either side of an edge stays apart. */
static void test_smooth(void **state)
{
    (void)state;
    enum { SIDE = 32 };
    static struct pixel pixels[SIDE * SIDE];
    struct memory memory;
    uint32_t random = 1;
    memory_init(&memory, UINT64_MAX);
    for (int i = 0; i < SIDE * SIDE; i++) {
        int x = i % SIDE, y = i / SIDE;
        bool left = x < SIDE / 2;
        random = random * 1664525 + 1013904223;
        float noise = (float)(random >> 8) / (float)(1 << 24) - 0.5f;
        pixels[i] = (struct pixel){.normal = {left ? 1.0f : 0.0f, left ? 0.0f : 1.0f, 0},
                                   .position = {left ? 0 : (float)x / SIDE, (float)y / SIDE, 1},
                                   .depth = 1,
                                   .ambient = {(left ? 1.0f : 5.0f) + noise, 0, 0}};
        if (!left)
            pixels[i].position[1] = 0;
    }
    assert_true(smooth_ambient(pixels, SIDE, SIDE, &parallel_serial, &memory));
    for (int i = 0; i < SIDE * SIDE; i++)
        assert_true(fabsf(pixels[i].ambient[0] - (i % SIDE < SIDE / 2 ? 1.0f : 5.0f)) < 0.2f);
    assert_int_equal(memory.live, 0);
}

static void test_display(void **state)
{
    (void)state;
    double last = -1;
    for (double value = 0; value < 20; value += 0.01) {
        double shown = light_display(vector_make(value, 0, 0)).x;
        assert_true(shown >= last && shown <= 1);
        last = shown;
    }
    assert_true(light_display(vector_make(0, 0, 0)).x == 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_stage),         cmocka_unit_test(test_up),     cmocka_unit_test(test_camera_sees_the_scene),
        cmocka_unit_test(test_contrast),      cmocka_unit_test(test_png),    cmocka_unit_test(test_same_for_any_threads),
        cmocka_unit_test(test_no_memory),     cmocka_unit_test(test_smooth), cmocka_unit_test(test_display),
        cmocka_unit_test(test_few_triangles),
    };
    return cmocka_run_group_tests_name("picture", tests, NULL, NULL);
}
