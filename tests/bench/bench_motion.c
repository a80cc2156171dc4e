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
#include <float.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include <bvhd/bvhd_cpu.h>

#include "builder/update/batch.h"
#include "tests/bench/embree_ray.h"
#include "tests/bench/ply_input.h"
#include "tests/support/random.h"

enum { TILE = 8, TURNS_MAX = 1000 };

enum kind { PRIMARY, DIFFUSE, SHADOW, KINDS };

enum who { MOVING, STILL, EMBREE, ALONE, SUBJECTS };

static const char *const kind_names[KINDS] = {"primary", "diffuse", "shadow"};

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

struct rays {
    struct bvhd_cpu_ray *rays;
    struct bvhd_cpu_hit *hits;
    uint32_t count;
};

/* The ratios of all scenes, whose geometric means end the output. */
struct totals {
    double still[KINDS], embree[KINDS], blurred[KINDS], alone[KINDS], build;
    unsigned scenes;
};

static void fail(const char *what)
{
    fprintf(stderr, "bench_motion: %s\n", what);
    exit(1);
}

static void *need(uint64_t size)
{
    void *block = calloc(size ? size : 1, 1);
    if (!block)
        fail("no memory");
    return block;
}

static double now(void)
{
    struct timespec time;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
    return (double)time.tv_sec + 1e-9 * (double)time.tv_nsec;
}

static int compare_doubles(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static double median(double *values, uint32_t count)
{
    qsort(values, count, sizeof *values, compare_doubles);
    return values[count / 2];
}

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
    scene->middle.positions = need((uint64_t)12 * from->vertex_count);
    scene->end.positions = need((uint64_t)12 * from->vertex_count);
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
        fail("a structure does not build");
    }
}

static void open_structure(struct scene_of *scene, enum who who)
{
    const struct bvhd_cpu_blob blob = {scene->items[who].blob, scene->items[who].size};
    const struct bvhd_cpu_scene_options options = {.struct_size = sizeof options, .blobs = &blob, .blob_count = 1};
    struct bvhd_error error;
    if (bvhd_cpu_scene_create(&options, &scene->opened[who], &error) != BVHD_OK)
        fail(error.text);
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

#if RTC_VERSION_MAJOR >= 4
typedef struct RTCIntersectArguments intersect_arguments;
typedef struct RTCOccludedArguments occluded_arguments;
#define init_intersect rtcInitIntersectArguments
#define init_occluded rtcInitOccludedArguments
#define intersect(scene, arguments, hit) rtcIntersect1(scene, hit, arguments)
#define occluded(scene, arguments, ray) rtcOccluded1(scene, ray, arguments)
#else
typedef struct RTCIntersectContext intersect_arguments, occluded_arguments;
#define init_intersect rtcInitIntersectContext
#define init_occluded rtcInitIntersectContext
#define intersect rtcIntersect1
#define occluded rtcOccluded1
#endif

static uint32_t trace_embree(RTCScene scene, const struct rays *rays, enum kind kind)
{
    uint32_t hits = 0;
    intersect_arguments closest;
    occluded_arguments any;
    init_intersect(&closest);
    init_occluded(&any);
    for (uint32_t i = 0; i < rays->count; i++) {
        struct RTCRayHit hit = {.ray = embree_ray((const struct ray *)&rays->rays[i]),
                                .hit = {.geomID = RTC_INVALID_GEOMETRY_ID}};
        hit.ray.time = rays->rays[i].time;
        if (kind == SHADOW)
            occluded(scene, &any, &hit.ray);
        else
            intersect(scene, &closest, &hit);
        hits += kind == SHADOW ? hit.ray.tfar < 0 : hit.hit.geomID != RTC_INVALID_GEOMETRY_ID;
    }
    return hits;
}

static uint32_t trace_opened(const struct bvhd_cpu_scene *scene, const struct rays *rays)
{
    const struct bvhd_cpu_trace trace = {.struct_size = sizeof trace,
                                         .rays = rays->rays,
                                         .ray_size = sizeof *rays->rays,
                                         .hits = rays->hits,
                                         .hit_size = sizeof *rays->hits,
                                         .ray_count = rays->count};
    struct bvhd_error error;
    uint32_t hits = 0;
    if (bvhd_cpu_scene_trace(scene, &trace, &error) != BVHD_OK)
        fail(error.text);
    for (uint32_t i = 0; i < rays->count; i++)
        hits += rays->hits[i].blob != BVHD_CPU_NO_BLOB;
    return hits;
}

static uint32_t trace_one_by_one(const struct bvhd_cpu_scene *scene, const struct rays *rays)
{
    uint32_t hits = 0;
    for (uint32_t i = 0; i < rays->count; i++) {
        const struct rays one = {&rays->rays[i], &rays->hits[i], 1};
        hits += trace_opened(scene, &one);
    }
    return hits;
}

static uint32_t trace(const struct scene_of *scene, enum who who, const struct rays *rays, enum kind kind)
{
    if (who == ALONE)
        return trace_one_by_one(scene->opened[MOVING], rays);
    return who == EMBREE ? trace_embree(scene->embree, rays, kind) : trace_opened(scene->opened[who], rays);
}

static struct bvhd_cpu_ray make_ray(const double origin[3], const double direction[3], double tmin)
{
    struct bvhd_cpu_ray ray = {.tmin = (float)tmin, .tmax = FLT_MAX, .mask = 0xff, .time = 0.5f};
    const double length = sqrt(direction[0] * direction[0] + direction[1] * direction[1] + direction[2] * direction[2]);
    for (int axis = 0; axis < 3; axis++) {
        ray.origin[axis] = (float)origin[axis];
        ray.direction[axis] = (float)(direction[axis] / length);
    }
    return ray;
}

static struct rays make_rays(uint32_t count)
{
    return (struct rays){need((uint64_t)count * sizeof(struct bvhd_cpu_ray)),
                         need((uint64_t)count * sizeof(struct bvhd_cpu_hit)), count};
}

/* The camera looks at the middle from outside; rays of a tile of pixels follow one another. */
static double make_primary(const float bounds[6], uint32_t size, struct rays *rays, double ret_light[3])
{
    static const double forward[3] = {-0.6, -0.5, -0.6244998}, right[3] = {0.7211103, 0, -0.6928203},
                        up[3] = {-0.3464102, 0.8660254, -0.3605551};
    double eye[3], radius = 0;
    for (int axis = 0; axis < 3; axis++)
        radius += pow(((double)bounds[3 + axis] - bounds[axis]) / 2, 2);
    radius = sqrt(radius);
    for (int axis = 0; axis < 3; axis++) {
        const double centre = ((double)bounds[axis] + bounds[3 + axis]) / 2;
        eye[axis] = centre - 1.6 * radius * forward[axis];
        ret_light[axis] = centre + radius * (2.5 * up[axis] + 1.5 * right[axis]);
    }
    for (uint32_t i = 0; i < rays->count; i++) {
        const uint32_t tile = i / (TILE * TILE), pixel = i % (TILE * TILE), row = size / TILE;
        const double x = (tile % row * TILE + pixel % TILE + 0.5) / size * 2 - 1,
                     y = (tile / row * TILE + pixel / TILE + 0.5) / size * 2 - 1;
        double direction[3];
        for (int axis = 0; axis < 3; axis++)
            direction[axis] = forward[axis] + 0.45 * (x * right[axis] - y * up[axis]);
        rays->rays[i] = make_ray(eye, direction, 0);
    }
    return radius;
}

/* Finds the side of a triangle from which a ray hit it. Returns false if it has none. */
static bool find_normal(const struct scene_of *scene, const struct bvhd_cpu_ray *ray, const struct bvhd_cpu_hit *hit,
                        double ret_normal[3])
{
    float corners[3][3];
    double edges[2][3], length = 0, facing = 0;
    if (bvhd_cpu_scene_corners(scene->opened[STILL], hit, corners, NULL) != BVHD_OK)
        fail("no corners");
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

/* Makes a diffuse ray from each hit, and a shadow ray where the surface is turned to the light. */
static void make_secondary(const struct scene_of *scene, const struct rays *primary, const double light[3],
                           double radius, struct rays *diffuse, struct rays *shadow)
{
    struct random random = {1};
    diffuse->count = shadow->count = 0;
    for (uint32_t i = 0; i < primary->count; i++) {
        const struct bvhd_cpu_ray *ray = &primary->rays[i];
        const struct bvhd_cpu_hit *hit = &primary->hits[i];
        double point[3], normal[3], on_sphere[3], length, direction[3], to_light[3], facing = 0;
        if (hit->blob == BVHD_CPU_NO_BLOB || !find_normal(scene, ray, hit, normal))
            continue;
        do {
            random_point(&random, on_sphere);
            length = sqrt(on_sphere[0] * on_sphere[0] + on_sphere[1] * on_sphere[1] + on_sphere[2] * on_sphere[2]);
        } while (length > 1);
        for (int axis = 0; axis < 3; axis++) {
            point[axis] = ray->origin[axis] + (double)hit->t * ray->direction[axis] + 1e-5 * radius * normal[axis];
            direction[axis] = normal[axis] + on_sphere[axis] / length;
            to_light[axis] = light[axis] - point[axis];
            facing += to_light[axis] * normal[axis];
        }
        diffuse->rays[diffuse->count++] = make_ray(point, direction, 0);
        if (facing <= 0)
            continue;
        shadow->rays[shadow->count] = make_ray(point, to_light, 0);
        shadow->rays[shadow->count].flags = BVHD_CPU_RAY_TERMINATE_ON_FIRST_HIT;
        shadow->rays[shadow->count++].tmax =
            (float)sqrt(to_light[0] * to_light[0] + to_light[1] * to_light[1] + to_light[2] * to_light[2]);
    }
}

/* ---- Measurements ---- */

/* Traces rays by two subjects in turns. Returns how much faster the first is. `is_same` says that the hits must be. */
static double compare(const struct scene_of *scene, enum who other, const struct settings *settings,
                      const struct rays *rays, enum kind kind, bool is_same)
{
    static const char *const names[SUBJECTS] = {"moving", "still", "Embree", "alone"};
    static double times[2][TURNS_MAX], ratios[TURNS_MAX];
    const enum who whos[2] = {MOVING, other};
    uint32_t hits[2];
    for (uint32_t turn = 0; turn < settings->turns; turn++) {
        for (unsigned i = 0; i < 2; i++) {
            const unsigned which = (i + turn) % 2;
            const double start = now();
            hits[which] = trace(scene, whos[which], rays, kind);
            times[which][turn] = now() - start;
        }
        ratios[turn] = times[1][turn] / times[0][turn];
    }
    const double ratio = median(ratios, settings->turns);
    printf("  %-8s %.3f of %-6s (%.2f and %.2f Mray/s, %u and %u of %u hit)\n", kind_names[kind], ratio, names[other],
           1e-6 * rays->count / median(times[0], settings->turns),
           1e-6 * rays->count / median(times[1], settings->turns), hits[0], hits[1], rays->count);
    if (is_same && hits[0] != hits[1])
        fail("the mesh that moves is hit otherwise than the other one");
    return ratio;
}

static void measure_rays(struct scene_of *scene, const struct settings *settings, struct totals *totals)
{
    const uint32_t pixels = settings->size * settings->size;
    struct rays rays[KINDS] = {make_rays(pixels), make_rays(pixels), make_rays(pixels)};
    struct random random = {3};
    float bounds[6];
    double light[3];
    bvhd_cpu_scene_bounds(scene->opened[STILL], bounds);
    const double radius = make_primary(bounds, settings->size, &rays[PRIMARY], light);
    trace_opened(scene->opened[STILL], &rays[PRIMARY]);
    make_secondary(scene, &rays[PRIMARY], light, radius, &rays[DIFFUSE], &rays[SHADOW]);
    for (enum kind kind = PRIMARY; kind < KINDS; kind++) {
        totals->still[kind] += log(compare(scene, STILL, settings, &rays[kind], kind, true));
        for (uint32_t i = 0; !settings->is_one_time && i < rays[kind].count; i++)
            rays[kind].rays[i].time = (float)random_between(&random, 0, 1);
        if (!settings->is_one_time) {
            printf("  %-8s at times of their own:\n", kind_names[kind]);
            totals->blurred[kind] += log(compare(scene, STILL, settings, &rays[kind], kind, false));
            totals->alone[kind] += log(compare(scene, ALONE, settings, &rays[kind], kind, true));
        }
        totals->embree[kind] += log(compare(scene, EMBREE, settings, &rays[kind], kind, false));
        free(rays[kind].rays);
        free(rays[kind].hits);
    }
}

static void measure_builds(struct scene_of *scene, const struct settings *settings, struct totals *totals)
{
    static double times[2][TURNS_MAX], ratios[TURNS_MAX];
    for (uint32_t turn = 0; turn < settings->turns; turn++) {
        for (unsigned i = 0; i < 2; i++) {
            const unsigned which = (i + turn) % 2;
            const double start = now();
            build_mesh(scene, (enum who)which, settings);
            times[which][turn] = now() - start;
        }
        ratios[turn] = times[1][turn] / times[0][turn];
    }
    const double count = scene->start->triangle_count, ratio = median(ratios, settings->turns);
    printf("  built    %.3f of still  (%.2f and %.2f Mtri/s), %.1f and %.1f bytes a triangle\n", ratio,
           1e-6 * count / median(times[0], settings->turns), 1e-6 * count / median(times[1], settings->turns),
           (double)scene->items[MOVING].size / count, (double)scene->items[STILL].size / count);
    totals->build += log(ratio);
}

static void run_scene(const char *path, const struct settings *settings, RTCDevice device, struct totals *totals)
{
    struct scene_of scene = {.start = ply_read(path)};
    if (!scene.start)
        fail(path);
    make_motion(&scene);
    memory_init(&scene.memory, UINT64_MAX);
    printf("%s: %u triangles\n", path, scene.start->triangle_count);
    measure_builds(&scene, settings, totals);
    totals->scenes++;
    for (int i = 0; i < 2 && !settings->is_build_only; i++)
        open_structure(&scene, (enum who)i);
    if (!settings->is_build_only) {
        build_embree(&scene, device);
        measure_rays(&scene, settings, totals);
    }
    finish_scene(&scene);
    fflush(stdout);
}

static uint32_t read_number(const char *text, uint32_t least, uint32_t most)
{
    const unsigned long number = strtoul(text, NULL, 10);
    return number < least ? least : number > most ? most : (uint32_t)number;
}

int main(int argc, char **argv)
{
    struct settings settings = {256, 15, QUALITY_BALANCED, false, false};
    struct totals totals = {.scenes = 0};
    RTCDevice device = rtcNewDevice("threads=1");
    if (!device)
        fail("no Embree device");
    for (int i = 1; i < argc; i++) {
        if (strcmp(argv[i], "--size") == 0 && i + 1 < argc)
            settings.size = read_number(argv[++i], TILE, 8192) / TILE * TILE;
        else if (strcmp(argv[i], "--turns") == 0 && i + 1 < argc)
            settings.turns = read_number(argv[++i], 1, TURNS_MAX);
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
    for (enum kind kind = PRIMARY; totals.scenes > 0 && !settings.is_build_only && kind < KINDS; kind++)
        printf("%u scenes, %s: %.3f of still, %.3f of Embree; different times: %.3f of still, %.3f of alone\n",
               totals.scenes, kind_names[kind], exp(totals.still[kind] / totals.scenes),
               exp(totals.embree[kind] / totals.scenes), exp(totals.blurred[kind] / totals.scenes),
               exp(totals.alone[kind] / totals.scenes));
    if (totals.scenes > 0)
        printf("%u scenes, built: %.3f of still\n", totals.scenes, exp(totals.build / totals.scenes));
    rtcReleaseDevice(device);
    return 0;
}
