/* SPDX-License-Identifier: Apache-2.0 */
/*
 * bench_motion.c - measures meshes that move, beside the same meshes that stand still as they are at half time, and
 * beside Embree's motion blur.
 *
 *     bench_motion [--size N] [--turns N] [--fast | --high] [--one-time] [--builds] MESH.ply...
 *
 * Each vertex moves by a smooth field of up to 2 % of the mesh's size. It prints bytes a triangle, the rate of builds,
 * and rays a second: the primary rays of an N x N picture in tiles, and from their hits diffuse rays and shadow rays to
 * a light. Shadow rays end at any hit. Against the mesh that stands still all rays have the time 0.5, so that the hits
 * are the same; then, unless --one-time, each has a time of its own, as in a picture with motion blur: against the mesh
 * that stands still, against a call for each ray, and against Embree. Rays are traced all in one call of bvhd_cpu.h, or
 * one by one with rtcIntersect1 and rtcOccluded1 in a robust scene. Subjects take turns; the figures are
 * medians over the turns, of rates and of their ratios within a turn, in processor time. With --builds only builds are
 * measured.
 */
#include "builder/update/batch.h"
#include "tests/bench/bench_embree.h"
#include "tests/bench/ply_input.h"

enum who { MOVING, STILL, EMBREE, ALONE, SUBJECTS };

/* The share of the mesh's size by which its vertices move, and how many waves of the field it holds. */
static const double motion_share = 0.02, motion_waves = 2;

struct settings {
    uint32_t size, turns;
    enum build_quality quality;
    bool is_one_time, is_build_only;
};

/* A mesh, and its vertices at t = 0.5 and t = 1. */
struct scene_of {
    struct ply *start;
    struct ply middle, end;
    struct memory memory;
    struct batch_item items[2];
    struct bvhd_cpu_scene *opened[2];
    RTCScene embree;
};

/* The ratios of all scenes, whose geometric means end the output. */
struct totals {
    double still[BENCH_KINDS], embree[BENCH_KINDS], blurred[BENCH_KINDS], alone[BENCH_KINDS], build;
    unsigned scenes;
};

/* ---- The scene ---- */

/* Makes where the vertices are at half time and at the end. */
static void make_motion(struct scene_of *scene)
{
    static const double waves[3][3] = {{0.3, 1, 0.5}, {-0.7, 0.2, 0.9}, {0.8, -0.6, 0.4}};
    const struct ply *from = scene->start;
    const double turn = 6.283185307179586;
    struct box box = box_empty();
    double size = 0;
    scene->middle = scene->end = *from;
    scene->middle.positions = bench_need((uint64_t)12 * from->vertex_count);
    scene->end.positions = bench_need((uint64_t)12 * from->vertex_count);
    for (uint32_t i = 0; i < from->vertex_count; i++)
        box_add_point(&box, from->positions + (size_t)3 * i);
    for (int axis = 0; axis < 3; axis++)
        size += pow((double)box.max[axis] - box.min[axis], 2);
    size = sqrt(size);
    for (uint32_t i = 0; i < from->vertex_count; i++)
        for (int axis = 0; axis < 3; axis++) {
            const float *place = from->positions + (size_t)3 * i;
            double phase = axis;
            for (int k = 0; k < 3; k++)
                phase += motion_waves * turn * waves[axis][k] * ((double)place[k] - box.min[k]) / size;
            const float end = (float)(place[axis] + motion_share * size / sqrt(3) * sin(phase));
            scene->end.positions[(size_t)3 * i + axis] = end;
            scene->middle.positions[(size_t)3 * i + axis] = place[axis] * 0.5f + end * 0.5f;
        }
}

static void build_mesh(struct scene_of *scene, enum who who, const struct settings *settings)
{
    struct geometry geometry;
    struct build_input input = ply_input(who == MOVING ? scene->start : &scene->middle, settings->quality, &geometry);
    if (who == MOVING) {
        geometry.type = GEOMETRY_MOVING_TRIANGLES;
        geometry.triangles.end_vertices =
            (struct bytes){(const unsigned char *)scene->end.positions, (uint64_t)scene->end.vertex_count * 12};
        input.flags |= BUILD_MOTION;
    }
    const struct limits limits = limits_default();
    const struct build_context context = {.memory = &scene->memory, .parallel = &parallel_serial};
    struct batch_item *item = &scene->items[who];
    struct bvhd_error error = {0};
    batch_finish(item, item->blob != NULL, &scene->memory);
    if (batch_build(&input, 1, &limits, &context, item, &error) != BVHD_OK || item->status != BVHD_OK) {
        fprintf(stderr, "%s %s %s %s\n", error.where, error.text, item->error.where, item->error.text);
        bench_fail("a structure does not build");
    }
}

static void build_embree(struct scene_of *scene, RTCDevice device)
{
    const struct ply *from = scene->start;
    scene->embree = rtcNewScene(device);
    RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE);
    rtcSetGeometryTimeStepCount(geometry, 2);
    for (unsigned key = 0; key < 2; key++)
        memcpy(
            rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, key, RTC_FORMAT_FLOAT3, 12, from->vertex_count),
            key ? scene->end.positions : from->positions, (size_t)12 * from->vertex_count);
    memcpy(rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, 12, from->triangle_count),
           from->indices, (size_t)12 * from->triangle_count);
    rtcCommitGeometry(geometry);
    rtcAttachGeometry(scene->embree, geometry);
    rtcReleaseGeometry(geometry);
    rtcSetSceneFlags(scene->embree, RTC_SCENE_FLAG_ROBUST);
    rtcSetSceneBuildQuality(scene->embree, RTC_BUILD_QUALITY_MEDIUM);
    rtcCommitScene(scene->embree);
}

static void finish_scene(struct scene_of *scene)
{
    for (int i = 0; i < 2; i++) {
        bvhd_cpu_scene_destroy(scene->opened[i]);
        batch_finish(&scene->items[i], true, &scene->memory);
    }
    rtcReleaseScene(scene->embree);
    free(scene->middle.positions);
    free(scene->end.positions);
    ply_free(scene->start);
}

/* ---- Rays ---- */

static uint32_t trace_one_by_one(const struct bvhd_cpu_scene *scene, const struct bench_rays *rays)
{
    uint32_t hits = 0;
    for (uint32_t i = 0; i < rays->count; i++) {
        const struct bench_rays one = {&rays->rays[i], &rays->hits[i], 1};
        hits += bench_trace(scene, &one, NULL);
    }
    return hits;
}

static uint32_t trace(const struct scene_of *scene, enum who who, const struct bench_rays *rays, enum bench_kind kind)
{
    if (who == ALONE)
        return trace_one_by_one(scene->opened[MOVING], rays);
    return who == EMBREE ? bench_trace_embree(scene->embree, rays, kind) : bench_trace(scene->opened[who], rays, NULL);
}

/* Finds the side of a triangle from which a ray hit it. Returns false if it has none. */
static bool find_normal(const void *context, const struct bvhd_cpu_ray *ray, const struct bvhd_cpu_hit *hit,
                        const double point[3], double ret_normal[3])
{
    const struct scene_of *scene = context;
    (void)point;
    float corners[3][3];
    double edges[2][3], length = 0, facing = 0;
    if (bvhd_cpu_scene_corners(scene->opened[STILL], hit, corners, NULL) != BVHD_OK)
        bench_fail("no corners");
    for (int axis = 0; axis < 3; axis++)
        for (int k = 0; k < 2; k++)
            edges[k][axis] = (double)corners[k + 1][axis] - corners[0][axis];
    for (int a = 0; a < 3; a++) {
        const int b = (a + 1) % 3, c = (a + 2) % 3;
        ret_normal[a] = edges[0][b] * edges[1][c] - edges[0][c] * edges[1][b];
        length += ret_normal[a] * ret_normal[a];
        facing += ret_normal[a] * ray->direction[a];
    }
    for (int axis = 0; axis < 3; axis++)
        ret_normal[axis] /= facing > 0 ? -sqrt(length) : sqrt(length);
    return length > 0;
}

/* ---- Measurements ---- */

/* Rays that two subjects trace, and how many of them have hit. */
struct comparison {
    const struct scene_of *scene;
    enum who whos[2];
    const struct bench_rays *rays;
    enum bench_kind kind;
    uint32_t hits[2];
};

static void trace_one(void *context, unsigned subject)
{
    struct comparison *all = context;
    all->hits[subject] = trace(all->scene, all->whos[subject], all->rays, all->kind);
}

/* Traces rays by two subjects in turns. Returns how much faster the first is. `is_same` says that the hits must be. */
static double compare(const struct scene_of *scene, enum who other, const struct settings *settings,
                      const struct bench_rays *rays, enum bench_kind kind, bool is_same)
{
    static const char *const names[SUBJECTS] = {"moving", "still", "Embree", "alone"};
    static double times[2][BENCH_TURNS_MAX];
    struct comparison all = {.scene = scene, .whos = {MOVING, other}, .rays = rays, .kind = kind};
    const struct bench_turns turns = {settings->turns, 2, CLOCK_THREAD_CPUTIME_ID, trace_one, &all};
    bench_take_turns(&turns, times);
    const double ratio = bench_ratio(times[1], times[0], settings->turns);
    printf("  %-8s %.3f of %-6s (%.2f and %.2f Mray/s, %u and %u of %u hit)\n", bench_kind_names[kind], ratio,
           names[other], 1e-6 * rays->count / bench_median(times[0], settings->turns),
           1e-6 * rays->count / bench_median(times[1], settings->turns), all.hits[0], all.hits[1], rays->count);
    if (is_same && all.hits[0] != all.hits[1])
        bench_fail("the mesh that moves is hit otherwise than the other one");
    return ratio;
}

static void measure_rays(struct scene_of *scene, const struct settings *settings, struct totals *totals)
{
    const uint32_t pixels = settings->size * settings->size;
    struct bench_rays rays[BENCH_KINDS] = {bench_rays_make(pixels), bench_rays_make(pixels), bench_rays_make(pixels)};
    struct random random = {3};
    float bounds[6];
    double light[3];
    bvhd_cpu_scene_bounds(scene->opened[STILL], bounds);
    const double radius = bench_make_primary(bounds, settings->size, &rays[BENCH_PRIMARY], light);
    bench_trace(scene->opened[STILL], &rays[BENCH_PRIMARY], NULL);
    const struct bench_surface surface = {find_normal, scene, 1e-5 * radius, 0};
    bench_make_secondary(&surface, &rays[BENCH_PRIMARY], light, &rays[BENCH_DIFFUSE], &rays[BENCH_SHADOW]);
    for (enum bench_kind kind = BENCH_PRIMARY; kind < BENCH_KINDS; kind++) {
        for (uint32_t i = 0; i < rays[kind].count; i++)
            rays[kind].rays[i].time = 0.5f;
        totals->still[kind] += log(compare(scene, STILL, settings, &rays[kind], kind, true));
        for (uint32_t i = 0; !settings->is_one_time && i < rays[kind].count; i++)
            rays[kind].rays[i].time = (float)random_between(&random, 0, 1);
        if (!settings->is_one_time) {
            printf("  %-8s at times of their own:\n", bench_kind_names[kind]);
            totals->blurred[kind] += log(compare(scene, STILL, settings, &rays[kind], kind, false));
            totals->alone[kind] += log(compare(scene, ALONE, settings, &rays[kind], kind, true));
        }
        totals->embree[kind] += log(compare(scene, EMBREE, settings, &rays[kind], kind, false));
        bench_rays_free(&rays[kind]);
    }
}

/* Builds that two subjects make. */
struct builds {
    struct scene_of *scene;
    const struct settings *settings;
};

static void build_one(void *context, unsigned subject)
{
    const struct builds *builds = context;
    build_mesh(builds->scene, (enum who)subject, builds->settings);
}

static void measure_builds(struct scene_of *scene, const struct settings *settings, struct totals *totals)
{
    static double times[2][BENCH_TURNS_MAX];
    struct builds builds = {scene, settings};
    const struct bench_turns turns = {settings->turns, 2, CLOCK_THREAD_CPUTIME_ID, build_one, &builds};
    bench_take_turns(&turns, times);
    const double count = scene->start->triangle_count, ratio = bench_ratio(times[1], times[0], settings->turns);
    printf("  built    %.3f of still  (%.2f and %.2f Mtri/s), %.1f and %.1f bytes a triangle\n", ratio,
           1e-6 * count / bench_median(times[0], settings->turns),
           1e-6 * count / bench_median(times[1], settings->turns), (double)scene->items[MOVING].size / count,
           (double)scene->items[STILL].size / count);
    totals->build += log(ratio);
}

static void run_scene(const char *path, const struct settings *settings, RTCDevice device, struct totals *totals)
{
    struct scene_of scene = {.start = ply_read(path)};
    if (!scene.start)
        bench_fail(path);
    make_motion(&scene);
    memory_init(&scene.memory, UINT64_MAX);
    printf("%s: %u triangles\n", path, scene.start->triangle_count);
    measure_builds(&scene, settings, totals);
    totals->scenes++;
    for (int i = 0; i < 2 && !settings->is_build_only; i++)
        scene.opened[i] = bench_open(&(struct bvhd_cpu_blob){scene.items[i].blob, scene.items[i].size}, 1);
    if (!settings->is_build_only) {
        build_embree(&scene, device);
        measure_rays(&scene, settings, totals);
    }
    finish_scene(&scene);
    fflush(stdout);
}

int main(int argc, char **argv)
{
    struct settings settings = {256, 15, QUALITY_BALANCED, false, false};
    struct totals totals = {.scenes = 0};
    RTCDevice device = rtcNewDevice("threads=1");
    if (!device)
        bench_fail("no Embree device");
    for (int i = 1; i < argc; i++) {
        if (strcmp(argv[i], "--size") == 0 && i + 1 < argc)
            settings.size = bench_read_number(argv[++i], BENCH_TILE, 8192) / BENCH_TILE * BENCH_TILE;
        else if (strcmp(argv[i], "--turns") == 0 && i + 1 < argc)
            settings.turns = bench_read_number(argv[++i], 1, BENCH_TURNS_MAX);
        else if (strcmp(argv[i], "--high") == 0)
            settings.quality = QUALITY_HIGH;
        else if (strcmp(argv[i], "--fast") == 0)
            settings.quality = QUALITY_FAST;
        else if (strcmp(argv[i], "--builds") == 0)
            settings.is_build_only = true;
        else if (strcmp(argv[i], "--one-time") == 0)
            settings.is_one_time = true;
        else
            run_scene(argv[i], &settings, device, &totals);
    }
    for (enum bench_kind kind = BENCH_PRIMARY; totals.scenes > 0 && !settings.is_build_only && kind < BENCH_KINDS;
         kind++)
        printf("%u scenes, %s: %.3f of still, %.3f of Embree; different times: %.3f of still, %.3f of alone\n",
               totals.scenes, bench_kind_names[kind], exp(totals.still[kind] / totals.scenes),
               exp(totals.embree[kind] / totals.scenes), exp(totals.blurred[kind] / totals.scenes),
               exp(totals.alone[kind] / totals.scenes));
    if (totals.scenes > 0)
        printf("%u scenes, built: %.3f of still\n", totals.scenes, exp(totals.build / totals.scenes));
    rtcReleaseDevice(device);
    return 0;
}
