/* SPDX-License-Identifier: Apache-2.0 */
/* test_picture_motion.c - tests pictures of what moves: the times of rays, surfaces at these times, and the blur. */
#include "tests/support/unit.h"

#include <math.h>

#include "client/bvhctl/oracle/rays.h"
#include "client/bvhctl/picture/agreement.h"
#include "client/bvhctl/picture/picture.h"
#include "tests/support/client/bvhctl/moving_world.h"

enum { WIDTH = 64, HEIGHT = 36, RAYS = 2000, CUBE = 1 };

static const struct camera_options wanted = {
    .aspect = (double)WIDTH / HEIGHT, .has_eye = true, .eye = {0, 6, -18}, .has_target = true, .target = {0, 4, -4}};

/* The world that moves, with what pictures of it need. */
static struct studio {
    struct moving_world world;
    struct surfaces surfaces;
    struct tracer *tracer;
    struct stage stage;
    struct camera camera;
    struct light light;
} studio;

static void open_studio(struct stage_times times)
{
    uint64_t rays;
    moving_world_init(&studio.world, 2);
    struct local *local = &studio.world.local;
    struct structures *structures = &studio.world.structures;
    assert_int_equal(stage_init(&studio.stage, structures, 'y', times, &local->memory, NULL), BVHD_OK);
    assert_int_equal(
        camera_choose(&studio.stage, &wanted, local->parallel, &local->memory, &studio.camera, &rays, NULL), BVHD_OK);
    assert_int_equal(surfaces_init(&studio.surfaces, structures, &local->memory, NULL), BVHD_OK);
    assert_int_equal(tracer_cpu_create(structures, local->parallel, &local->memory, &studio.tracer, NULL), BVHD_OK);
    light_init(&studio.light, &studio.stage, &studio.surfaces, NULL, &studio.camera, HEIGHT);
}

static void close_studio(void)
{
    tracer_destroy(studio.tracer);
    surfaces_finish(&studio.surfaces);
    stage_finish(&studio.stage);
    moving_world_finish(&studio.world);
    assert_int_equal(studio.world.local.memory.live, 0);
}

static struct picture_options picture_options(void)
{
    return (struct picture_options){.light = &studio.light,
                                    .tracer = studio.tracer,
                                    .parallel = studio.world.local.parallel,
                                    .width = WIDTH,
                                    .height = HEIGHT,
                                    .batch = 2048};
}

/* What is seen of the flying cube by the camera's rays through pixel centres at a time. */
static bool sees_cube(int x, int y, float time)
{
    struct stage_hit hit;
    struct vector direction = camera_direction(&studio.camera, (x + 0.5) / WIDTH, (y + 0.5) / HEIGHT);
    return stage_look(&studio.stage, studio.camera.origin, direction, time, &hit) && hit.instance == CUBE;
}

/* The matrix of a hit is that of its instance at the time of the ray. */
static void check_matrix(const struct stage_hit *met, float time)
{
    const struct structure *top = structures_top(&studio.world.structures);
    for (uint32_t row = 0; row < structure_instance_count(top); row++) {
        const struct structure_instance instance = structure_instance(top, row);
        float matrix[12];
        structure_instance_matrix(&instance, time, matrix);
        if (instance.instance == met->instance)
            assert_memory_equal(met->object_to_world, matrix, sizeof matrix);
    }
}

/* The surface of a hit is where the ray was, and faces as the cube and the sheet do at that time. */
static void surfaces_are_found_at_the_time_of_the_ray(void **state)
{
    (void)state;
    uint64_t random = 7;
    unsigned hits[MOVING_WORLD_INSTANCES] = {0};
    open_studio((struct stage_times){0, 1});
    for (int i = 0; i < RAYS; i++) {
        struct vector from = vector_make(30 * rays_uniform(&random) - 15, 20 * rays_uniform(&random) - 6,
                                         30 * rays_uniform(&random) - 15);
        struct vector to =
            vector_make(12 * rays_uniform(&random) - 6, 7 * rays_uniform(&random) - 1, 12 * rays_uniform(&random) - 6);
        const float time = (float)rays_uniform(&random);
        const struct ray ray = stage_ray(from, vector_unit(vector_sub(to, from)), time);
        struct ray_hit found;
        struct stage_hit met, looked;
        struct surface surface;
        if (!structures_trace(&studio.world.structures, &ray, &found))
            continue;
        const struct tracer_hit hit = tracer_hit_of(&found);
        hits[hit.instance]++;
        assert_true(surfaces_meet(&studio.surfaces, &ray, &hit, &met));
        assert_true(surfaces_find(&studio.surfaces, &ray, &hit, &surface));
        struct vector away = vector_sub(met.position, surface.corners[0]);
        assert_true(fabs(vector_dot(away, surface_normal(&surface))) < 1e-5);
        assert_true(stage_look(&studio.stage, vector_from_floats(ray.origin), vector_from_floats(ray.direction), time,
                               &looked));
        assert_true(vector_length(vector_sub(met.normal, looked.normal)) < 1e-9);
        check_matrix(&met, time);
        if (hit.instance == CUBE)
            assert_true(fabs(fabs(vector_component(met.position, 0) - (10 * (double)time - 5)) - 1) < 1e-5 ||
                        fabs(fabs(met.position.y - 4) - 1) < 1e-5 || fabs(fabs(met.position.z + 4) - 1) < 1e-5);
    }
    for (int i = 0; i < MOVING_WORLD_INSTANCES; i++)
        assert_true(hits[i] > 20);
    close_studio();
}

/* The times that a picture asked for, and how they are spread over it. */
struct watcher {
    struct stage_times times;
    uint64_t rays, early, late;
    float camera_time;
};

static enum bvhd_status watch(void *context, bool is_camera, const struct ray *rays, const struct tracer_hit *hits,
                              uint64_t count, struct bvhd_error *error)
{
    struct watcher *watcher = context;
    const float middle = (watcher->times.first + watcher->times.last) / 2;
    (void)hits;
    (void)error;
    (void)is_camera;
    for (uint64_t i = 0; i < count; i++) {
        assert_true(rays[i].time >= watcher->times.first && rays[i].time <= watcher->times.last);
        watcher->early += rays[i].time < middle;
        watcher->late += rays[i].time > middle;
    }
    watcher->rays += count;
    return BVHD_OK;
}

static void rays_have_the_times_that_were_asked_for(void **state)
{
    (void)state;
    static const struct stage_times asked[] = {{0, 1}, {0.25f, 0.5f}, {0, 0}, {0.75f, 0.75f}, {1, 1}};
    for (size_t i = 0; i < sizeof asked / sizeof *asked; i++) {
        struct watcher watcher = {.times = asked[i]};
        struct picture picture;
        open_studio(asked[i]);
        assert_int_equal(studio.stage.is_blurred, i < 2);
        struct picture_options options = picture_options();
        options.watch = watch;
        options.watch_context = &watcher;
        assert_int_equal(picture_render(&options, &studio.world.local.memory, &picture, NULL), BVHD_OK);
        assert_int_equal(watcher.rays, picture.rays);
        if (studio.stage.is_blurred) {
            assert_true(watcher.rays > 8 * WIDTH * HEIGHT);
            assert_in_range(watcher.early, watcher.rays * 45 / 100, watcher.rays * 55 / 100);
            assert_in_range(watcher.late, watcher.rays * 45 / 100, watcher.rays * 55 / 100);
        } else {
            assert_int_equal(watcher.early + watcher.late, 0);
        }
        picture_finish(&picture);
        close_studio();
    }
}

static double brightness_at(const struct picture *picture, int x, int y)
{
    const uint8_t *rgb = picture->rgb + 3 * ((size_t)y * WIDTH + (size_t)x);
    return rgb[0] + rgb[1] + rgb[2];
}

static void take_picture(struct stage_times times, uint32_t samples, struct picture *ret_picture)
{
    open_studio(times);
    struct picture_options options = picture_options();
    options.samples = samples;
    options.exposure = 1;
    assert_int_equal(picture_render(&options, &studio.world.local.memory, ret_picture, NULL), BVHD_OK);
    /* the picture's bytes do not outlive its memory */
    uint8_t *rgb = malloc((size_t)3 * WIDTH * HEIGHT);
    assert_non_null(rgb);
    memcpy(rgb, ret_picture->rgb, (size_t)3 * WIDTH * HEIGHT);
    picture_finish(ret_picture);
    ret_picture->rgb = rgb;
    close_studio();
}

/*
 * Before the sky, where the cube is seen during a part of the time, the blurred picture is between the two pictures in
 * which it is always there and never there.
 */
static void the_picture_is_blurred(void **state)
{
    (void)state;
    enum { TIMES = 101 };
    struct picture blurred, start, end;
    take_picture((struct stage_times){0, 1}, 64, &blurred);
    take_picture((struct stage_times){0, 0}, 16, &start);
    take_picture((struct stage_times){1, 1}, 16, &end);
    open_studio((struct stage_times){0, 1});
    unsigned partly = 0, between = 0;
    for (int y = 0; y < HEIGHT; y++)
        for (int x = 0; x < WIDTH; x++) {
            int seen = 0;
            for (int i = 0; i < TIMES; i++)
                seen += sees_cube(x, y, (float)i / (TIMES - 1));
            if (!sees_cube(x, y, 0) || seen > TIMES / 3)
                continue;
            double sharp = brightness_at(&start, x, y), clear = brightness_at(&end, x, y),
                   mixed = brightness_at(&blurred, x, y);
            partly++;
            between += fabs(mixed - clear) < fabs(sharp - clear);
        }
    assert_true(partly > 40);
    assert_true(between > partly * 9 / 10);
    close_studio();
    free(blurred.rgb);
    free(start.rgb);
    free(end.rgb);
}

/* Any number of samples is spread over the pixel: as many rays, and the same picture for any batch. */
static void samples_are_as_many_as_asked(void **state)
{
    (void)state;
    static const uint32_t counts[] = {1, 2, 3, 7, 16, 33};
    open_studio((struct stage_times){0, 1});
    assert_int_equal(picture_samples(&studio.stage, 0).all, 8);
    assert_int_equal(picture_samples(&studio.stage, 0).edges, 24);
    for (size_t i = 0; i < sizeof counts / sizeof *counts; i++) {
        struct picture pictures[2];
        for (int k = 0; k < 2; k++) {
            struct picture_options options = picture_options();
            options.samples = counts[i];
            options.batch = k ? 64 : 5000;
            assert_int_equal(picture_render(&options, &studio.world.local.memory, &pictures[k], NULL), BVHD_OK);
        }
        assert_true(pictures[0].rays >= (uint64_t)counts[i] * WIDTH * HEIGHT);
        assert_true(pictures[0].rays <= (uint64_t)counts[i] * WIDTH * HEIGHT * 6);
        assert_int_equal(pictures[0].rays, pictures[1].rays);
        assert_memory_equal(pictures[0].rgb, pictures[1].rgb, 3 * WIDTH * HEIGHT);
        picture_finish(&pictures[0]);
        picture_finish(&pictures[1]);
    }
    close_studio();
}

/* The camera's search sees where things are at all times: the samples of the flying cube reach from end to end. */
static void the_stage_knows_all_times(void **state)
{
    (void)state;
    double least = INFINITY, most = -INFINITY;
    open_studio((struct stage_times){0.25f, 1});
    for (uint32_t i = 0; i < studio.stage.sample_count; i++) {
        const struct stage_sample *sample = &studio.stage.samples[i];
        assert_true(sample->time >= 0.25f && sample->time <= 1);
        if (sample->at.z > -2.9 || sample->at.y < 2.9)
            continue;
        least = fmin(least, sample->at.x);
        most = fmax(most, sample->at.x);
        double middle = 10 * (double)sample->time - 5;
        assert_true(sample->at.x > middle - 1.001 && sample->at.x < middle + 1.001);
    }
    assert_true(least > -3.6 && least < -3 && most > 5.5 && most < 6.1);
    close_studio();
}

/* Rays of many times: all answers agree, and brute force finds those that were falsified. */
static void answers_are_judged_at_the_time_of_the_ray(void **state)
{
    (void)state;
    static struct ray rays[RAYS];
    static struct tracer_hit hits[RAYS];
    for (int lies = 0; lies < 2; lies++) {
        struct agreement agreement;
        uint64_t random = 3, changed = 0;
        open_studio((struct stage_times){0, 1});
        struct local *local = &studio.world.local;
        agreement_init(&agreement, &studio.surfaces, RAYS, local->parallel, &local->memory);
        for (int i = 0; i < RAYS; i++) {
            struct vector to = vector_make(12 * rays_uniform(&random) - 6, 7 * rays_uniform(&random) - 1,
                                           12 * rays_uniform(&random) - 6);
            struct vector from = vector_make(0, 30 * rays_uniform(&random) - 10, -20);
            rays[i] = stage_ray(from, vector_unit(vector_sub(to, from)), (float)rays_uniform(&random));
        }
        assert_int_equal(studio.tracer->trace(studio.tracer, rays, RAYS, hits, NULL, NULL), BVHD_OK);
        for (int i = 0; i < RAYS && lies; i += 7) {
            struct ray other = rays[i];
            struct tracer_hit at_other;
            other.time = 1 - other.time;
            assert_int_equal(studio.tracer->trace(studio.tracer, &other, 1, &at_other, NULL, NULL), BVHD_OK);
            if (hits[i].instance == at_other.instance && hits[i].primitive == at_other.primitive)
                continue;
            hits[i] = at_other;
            changed++;
        }
        assert_int_equal(agreement_watch(&agreement, true, rays, hits, RAYS, NULL), BVHD_OK);
        assert_int_equal(agreement_judge(&agreement, INFINITY, NULL, NULL, NULL), BVHD_OK);
        assert_int_equal(agreement.checked, RAYS);
        assert_int_equal(agreement.differing, changed);
        assert_int_equal(agreement.mismatches + agreement.uncertain, changed);
        assert_true(lies ? agreement.mismatches > 60 : agreement.mismatches == 0);
        agreement_finish(&agreement);
        close_studio();
    }
}

/* The CPU's own answers, of few times, are right. */
static void brute_force_finds_no_fault(void **state)
{
    (void)state;
    static struct ray rays[RAYS];
    static struct tracer_hit hits[RAYS];
    struct agreement agreement;
    open_studio((struct stage_times){0, 1});
    struct local *local = &studio.world.local;
    agreement_init(&agreement, &studio.surfaces, RAYS, local->parallel, &local->memory);
    for (int i = 0; i < RAYS; i++)
        rays[i] =
            stage_ray(studio.camera.origin, camera_direction(&studio.camera, (i % 50 + 0.5) / 50, (i / 50 + 0.5) / 40),
                      (float)(i % 8) / 7);
    assert_int_equal(studio.tracer->trace(studio.tracer, rays, RAYS, hits, NULL, NULL), BVHD_OK);
    assert_int_equal(agreement_doubt(&agreement, rays, hits, RAYS, NULL), BVHD_OK);
    assert_int_equal(agreement_judge(&agreement, INFINITY, NULL, NULL, NULL), BVHD_OK);
    assert_int_equal(agreement.judged, RAYS);
    assert_int_equal(agreement.mismatches, 0);
    agreement_finish(&agreement);
    close_studio();
}

int main(void)
{
    static const struct CMUnitTest tests[] = {
        cmocka_unit_test(answers_are_judged_at_the_time_of_the_ray),
        cmocka_unit_test(brute_force_finds_no_fault),
        cmocka_unit_test(rays_have_the_times_that_were_asked_for),
        cmocka_unit_test(samples_are_as_many_as_asked),
        cmocka_unit_test(surfaces_are_found_at_the_time_of_the_ray),
        cmocka_unit_test(the_picture_is_blurred),
        cmocka_unit_test(the_stage_knows_all_times),
    };
    return cmocka_run_group_tests_name("picture_motion", tests, NULL, NULL);
}
