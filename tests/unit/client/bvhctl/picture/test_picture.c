/* SPDX-License-Identifier: Apache-2.0 */
/* test_picture.c - tests the picture of `bvhctl trace`: stage, camera, sampling and smoothing. */
#include "tests/support/unit.h"

#include <float.h>
#include <math.h>
#include <png.h>
#include <unistd.h>

#include "client/bvhctl/oracle/rays.h"
#include "client/bvhctl/picture/picture.h"
#include "client/bvhctl/picture/smooth.h"
#include "tests/support/client/bvhctl/test_world.h"

enum { WIDTH = 64, HEIGHT = 36 };

static const struct stage_times all_times = {0, 1};
static const struct camera_options wanted = {.aspect = (double)WIDTH / HEIGHT};

/* A world with its stage, camera, light and tracer. */
struct studio {
    struct test_world world;
    struct surfaces surfaces;
    struct tracer *tracer;
    struct stage stage;
    struct camera camera;
    struct light light;
};

static void open_studio(struct studio *studio, uint32_t threads)
{
    uint64_t rays = 0;
    test_world_init(&studio->world, threads);
    struct local *local = &studio->world.local;
    assert_int_equal(stage_init(&studio->stage, &studio->world.structures, 'a', all_times, &local->memory, NULL),
                     BVHD_OK);
    assert_int_equal(
        camera_choose(&studio->stage, &wanted, local->parallel, &local->memory, &studio->camera, &rays, NULL), BVHD_OK);
    assert_true(rays > 0);
    assert_int_equal(surfaces_init(&studio->surfaces, &studio->world.structures, &local->memory, NULL), BVHD_OK);
    assert_int_equal(
        tracer_cpu_create(&studio->world.structures, local->parallel, &local->memory, &studio->tracer, NULL), BVHD_OK);
    light_init(&studio->light, &studio->stage, &studio->surfaces, NULL, &studio->camera, HEIGHT);
}

static void close_studio(struct studio *studio)
{
    tracer_destroy(studio->tracer);
    surfaces_finish(&studio->surfaces);
    surfaces_finish(&studio->surfaces);
    stage_finish(&studio->stage);
    stage_finish(&studio->stage);
    test_world_finish(&studio->world);
    assert_int_equal(studio->world.local.memory.live, 0);
}

static struct picture_options picture_options(const struct studio *studio)
{
    return (struct picture_options){.light = &studio->light,
                                    .tracer = studio->tracer,
                                    .parallel = studio->world.local.parallel,
                                    .width = WIDTH,
                                    .height = HEIGHT,
                                    .batch = 2048};
}

static void take_picture(struct studio *studio, struct picture *ret_picture)
{
    struct picture_options options = picture_options(studio);
    assert_int_equal(picture_render(&options, &studio->world.local.memory, ret_picture, NULL), BVHD_OK);
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
    assert_true(stage_look(stage, vector_make(0.25, 10, 0.5), vector_make(0, -1, 0), 0, &hit));
    assert_true(fabs(hit.distance - 8) < 1e-6 && fabs(hit.normal.y - 1) < 1e-6 && hit.instance == 1);
    assert_true(isinf(stage_clearance(stage, vector_make(20, 10, 0), vector_make(0, -1, 0), 0)));
    close_studio(&studio);
}

/* Any axis can be the one that points up; the axes stay right-handed. */
static void test_up(void **state)
{
    (void)state;
    struct test_world world;
    test_world_init(&world, 1);
    for (int i = 0; i < 3; i++) {
        struct stage stage;
        assert_int_equal(stage_init(&stage, &world.structures, (char)('x' + i), all_times, &world.local.memory, NULL),
                         BVHD_OK);
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
        hits += stage_look(stage, camera->origin,
                           camera_direction(camera, (i % WIDTH + 0.5) / WIDTH, (i / WIDTH + 0.5) / HEIGHT), 0, &hit);
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

/* Opens one bottom level of the world as a scene. */
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

/* Scenes of a level quad, an upright quad and a cube, which have too few triangles for one sample of each. */
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
        assert_int_equal(stage_init(&stage, &alone, "xyza"[i % 4], all_times, &local -> memory, NULL), BVHD_OK);
        assert_true(stage.even_count >= 256 && stage.even_count <= STAGE_EVEN_SAMPLES);
        assert_true(fabs(stage.size - (i < 4 ? 16 * sqrt(2) : 2 * sqrt(3))) < 1e-3);
        assert_int_equal(camera_choose(&stage, &wanted, local->parallel, &local->memory, &camera, &rays, NULL),
                         BVHD_OK);
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

/* The picture is the same for the smallest batch, for all samples at once, and for sizes between them. */
static void test_same_for_any_batch(void **state)
{
    (void)state;
    struct studio studio;
    struct picture expected, picture;
    open_studio(&studio, 2);
    take_picture(&studio, &expected);
    static const uint32_t batches[] = {PICTURE_LEAST_BATCH, 37, 1000, 1 << 16};
    for (size_t i = 0; i < sizeof batches / sizeof *batches; i++) {
        struct picture_options options = picture_options(&studio);
        options.batch = batches[i];
        assert_int_equal(picture_render(&options, &studio.world.local.memory, &picture, NULL), BVHD_OK);
        assert_memory_equal(picture.rgb, expected.rgb, 3 * WIDTH * HEIGHT);
        assert_int_equal(picture.rays, expected.rays);
        picture_finish(&picture);
    }
    picture_finish(&expected);
    close_studio(&studio);
}

struct watcher {
    uint64_t camera_rays, other_rays, hits;
    uint64_t fail_at; /* the wave that fails, from 1 */
    uint64_t waves, pixels, pixels_total;
};

static enum bvhd_status watch(void *context, bool is_camera, const struct ray *rays, const struct tracer_hit *hits,
                              uint64_t count, struct bvhd_error *error)
{
    struct watcher *watcher = context;
    *(is_camera ? &watcher->camera_rays : &watcher->other_rays) += count;
    for (uint64_t i = 0; i < count; i++) {
        watcher->hits += isfinite(hits[i].t);
        assert_true(rays[i].cull_mask == 0xff && (!is_camera || rays[i].flags == 0));
    }
    return ++watcher->waves == watcher->fail_at ? bvhd_error_set(error, BVHD_CANCELLED, "watch", "enough") : BVHD_OK;
}

static void note_progress(void *context, uint64_t done, uint64_t total)
{
    struct watcher *watcher = context;
    assert_true(done > watcher->pixels && done <= total);
    watcher->pixels = done;
    watcher->pixels_total = total;
}

/* The watch sees every ray, and the progress reaches its end. */
static void test_watch(void **state)
{
    (void)state;
    struct studio studio;
    struct picture picture;
    struct watcher watcher = {0};
    open_studio(&studio, 2);
    struct picture_options options = picture_options(&studio);
    options.watch = watch;
    options.progress = note_progress;
    options.watch_context = options.progress_context = &watcher;
    assert_int_equal(picture_render(&options, &studio.world.local.memory, &picture, NULL), BVHD_OK);
    assert_int_equal(watcher.camera_rays + watcher.other_rays, picture.rays);
    assert_true(watcher.camera_rays >= 4 * WIDTH * HEIGHT && watcher.other_rays > watcher.camera_rays &&
                watcher.hits > 0);
    assert_true(picture.seconds > 0);
    assert_int_equal(watcher.pixels, WIDTH * HEIGHT);
    assert_int_equal(watcher.pixels_total, WIDTH * HEIGHT);
    picture_finish(&picture);
    close_studio(&studio);
}

/* A failure of any wave leaves no memory behind. */
static void test_failing_wave(void **state)
{
    (void)state;
    struct studio studio;
    struct picture picture;
    open_studio(&studio, 2);
    uint64_t live = studio.world.local.memory.live;
    enum bvhd_status status = BVHD_CANCELLED;
    for (uint64_t wave = 1; status != BVHD_OK; wave++) {
        struct watcher watcher = {.fail_at = wave};
        struct bvhd_error error = {0};
        struct picture_options options = picture_options(&studio);
        options.watch = watch;
        options.watch_context = &watcher;
        status = picture_render(&options, &studio.world.local.memory, &picture, &error);
        assert_true(status == BVHD_OK ||
                    (status == BVHD_CANCELLED && error.status == BVHD_CANCELLED && watcher.waves == wave));
        assert_true(status == BVHD_OK || studio.world.local.memory.live == live);
        assert_true(status != BVHD_OK || wave > 12);
    }
    picture_finish(&picture);
    close_studio(&studio);
}

/* Answers with triangles that do not exist draw nothing and do not crash. */
static enum bvhd_status trace_nonsense(struct tracer *tracer, const struct ray *rays, uint64_t count,
                                       struct tracer_hit *ret_hits, double *ret_seconds, struct bvhd_error *error)
{
    (void)tracer;
    (void)rays;
    (void)error;
    static const struct tracer_hit nonsense[] = {
        {1, 0, 0, 99, 0, 0, 0, 0},
        {1, 0, 0, 1, 0, 99, 0, 0},
        {1, 0, 0, 1, 0, 0, UINT32_MAX, 0},
        {1, 0, 0, 2, 0, 0, 0, 0},
        {1, 0, 0, RAY_NO_INSTANCE, 0, 0, 0, 0},
        {NAN, 0, 0, 1, 0, 0, 0, 0},
        {-INFINITY, 0, 0, 1, 0, 0, 0, 0},
        {1, 0, 0, 99, 0, 0, 0, TRACER_AABB},
        {-5, 0, 0, 1, 0, 0, 0, 0},
        {FLT_MAX, 0, 0, 1, 0, 0, 1, 0},
    };
    for (uint64_t i = 0; i < count; i++)
        ret_hits[i] = nonsense[i % (sizeof nonsense / sizeof *nonsense)];
    *ret_seconds = 0;
    return BVHD_OK;
}

static void test_nonsense(void **state)
{
    (void)state;
    struct studio studio;
    struct picture picture;
    struct tracer liar = {"liar", TARGET_PORTABLE, trace_nonsense, NULL};
    open_studio(&studio, 2);
    struct picture_options options = picture_options(&studio);
    options.tracer = &liar;
    assert_int_equal(picture_render(&options, &studio.world.local.memory, &picture, NULL), BVHD_OK);
    picture_finish(&picture);
    close_studio(&studio);
}

/* The picture is not empty: shadows are dark, and the sun is bright. */
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
    enum bvhd_status status = BVHD_NO_MEMORY;
    int64_t after = 0;
    for (; status != BVHD_OK; after++) {
        struct picture_options options = picture_options(&studio);
        options.width = options.height = 4;
        atomic_store(&memory->fail_after, after);
        status = picture_render(&options, memory, &picture, NULL);
        assert_true(status == BVHD_OK || (status == BVHD_NO_MEMORY && memory->live == live));
    }
    assert_true(after > 8);
    picture_finish(&picture);
    atomic_store(&memory->fail_after, -1);
    close_studio(&studio);
}

/* Smoothing removes noise on a plane, and does not mix the light on both sides of an edge. */
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
    assert_true(smooth_light(pixels, SIDE, SIDE, 13, &parallel_serial, &memory));
    for (int i = 0; i < SIDE * SIDE; i++)
        assert_true(fabsf(pixels[i].ambient[0] - (i % SIDE < SIDE / 2 ? 1.0f : 5.0f)) < 0.2f);
    assert_int_equal(memory.live, 0);
}

/* The noise of a shadow's soft edge is smoothed if it is the mean of few samples, and left as it is if of many. */
static void test_smooth_shadow(void **state)
{
    (void)state;
    enum { SIDE = 32 };
    static const uint32_t samples[] = {13, 32, 64};
    double noise[3] = {0};
    struct memory memory;
    memory_init(&memory, UINT64_MAX);
    for (int k = 0; k < 3; k++) {
        static struct pixel pixels[SIDE * SIDE];
        uint64_t random = 1;
        for (int i = 0; i < SIDE * SIDE; i++)
            pixels[i] = (struct pixel){.normal = {0, 1, 0},
                                       .position = {(float)(i % SIDE) / SIDE, 0, 1},
                                       .depth = 1,
                                       .lit = (float)(0.3 + 0.4 * rays_uniform(&random))};
        assert_true(smooth_light(pixels, SIDE, SIDE, samples[k], &parallel_serial, &memory));
        for (int i = 0; i < SIDE * SIDE; i++)
            noise[k] += pow((double)pixels[i].lit - 0.5, 2) / (SIDE * SIDE);
    }
    assert_true(noise[0] < 0.5 * noise[1] && noise[1] < 0.2 * noise[2]);
    assert_true(fabs(noise[2] - 0.4 * 0.4 / 12) < 0.002);
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
        cmocka_unit_test(test_stage),
        cmocka_unit_test(test_up),
        cmocka_unit_test(test_camera_sees_the_scene),
        cmocka_unit_test(test_contrast),
        cmocka_unit_test(test_png),
        cmocka_unit_test(test_same_for_any_threads),
        cmocka_unit_test(test_no_memory),
        cmocka_unit_test(test_smooth),
        cmocka_unit_test(test_smooth_shadow),
        cmocka_unit_test(test_display),
        cmocka_unit_test(test_few_triangles),
        cmocka_unit_test(test_same_for_any_batch),
        cmocka_unit_test(test_watch),
        cmocka_unit_test(test_failing_wave),
        cmocka_unit_test(test_nonsense),
    };
    return cmocka_run_group_tests_name("picture", tests, NULL, NULL);
}
