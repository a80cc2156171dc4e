/* SPDX-License-Identifier: Apache-2.0 */
/*
 * bench_trace.c - measures rays a second through a portable structure, compared with Embree's rtcIntersect1 and
 * rtcOccluded1 on its own robust scene of the same triangles.
 *
 *     bench_trace [--size N] [--seconds S] [--fast-triangles] [--high] SCENE.ply...
 *
 * Times are processor time of one thread. The rays are the primary rays of an N x N picture (in tiles), from their hits
 * (in the same order) diffuse rays and shadow rays to a light above, and random rays through the box. Shadow rays end
 * at any hit. Rates are those of the fastest of several alternating repetitions. In the end it prints the geometric
 * mean of the ratios, and the worst.
 *
 * The same rays go through libbvhd.so by bvhd_cpu.h as well, all in one call and one in each call. What that costs is
 * given as the median, over the repetitions, of its time divided by that of the internal function called directly.
 */
#include <float.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include <bvhd/bvhd_cpu.h>

#include "builder/batch.h"
#include "tests/bench/embree_ray.h"
#include "tests/support/scene/ply.h"
#include "tests/support/random.h"
#include "builder/traverse/traverse.h"

enum { TILE = 8, REPEATS_MIN = 15, REPEATS_MAX = 1000 };

enum kind { PRIMARY, DIFFUSE, SHADOW, RANDOM, KINDS };

static const char *const kind_names[KINDS] = {"primary", "diffuse", "shadow", "random"};

struct settings {
    int size;
    double seconds;
    uint32_t layout_flags;
    enum build_quality quality;
};

struct totals {
    double log_ratio[KINDS], worst[KINDS];
    double log_many[KINDS], log_one[KINDS], worst_many[KINDS], worst_one[KINDS]; /* time by the library / directly */
    int scenes;
};

struct subject {
    const struct ply *ply;
    RTCScene embree;
    struct scene scene;
    struct bvhd_cpu_scene *opened;
    float bounds[6];
    double light[3];
};

static double now(void)
{
    struct timespec time;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
    return (double)time.tv_sec + 1e-9 * (double)time.tv_nsec;
}

static void *need(size_t size)
{
    void *block = calloc(size ? size : 1, 1);
    if (!block) {
        fprintf(stderr, "bench_trace: no memory\n");
        exit(1);
    }
    return block;
}

static struct ray make_ray(const double origin[3], const double direction[3], float tmin)
{
    struct ray ray = {.tmin = tmin, .tmax = FLT_MAX, .cull_mask = 0xff};
    double length = sqrt(direction[0] * direction[0] + direction[1] * direction[1] + direction[2] * direction[2]);
    for (int axis = 0; axis < 3; axis++) {
        ray.origin[axis] = (float)origin[axis];
        ray.direction[axis] = (float)(direction[axis] / length);
    }
    return ray;
}

/* The camera looks at the middle of the scene from outside, 40 degrees wide; the light is above the scene and aside. */
static uint32_t make_primary(struct subject *subject, int size, struct ray *ret_rays)
{
    static const double forward[3] = {-0.6, -0.5, -0.6244998}, right[3] = {0.7211103, 0, -0.6928203},
                        up[3] = {-0.3464102, 0.8660254, -0.3605551};
    double centre[3], eye[3], radius = 0;
    for (int axis = 0; axis < 3; axis++) {
        centre[axis] = 0.5 * ((double)subject->bounds[axis] + subject->bounds[3 + axis]);
        radius += pow(subject->bounds[3 + axis] - centre[axis], 2);
    }
    radius = sqrt(radius);
    for (int axis = 0; axis < 3; axis++) {
        eye[axis] = centre[axis] - 1.6 * radius * forward[axis];
        subject->light[axis] = centre[axis] + radius * (2.5 * up[axis] + 1.5 * right[axis]);
    }
    uint32_t count = 0;
    for (int tile = 0; tile < size / TILE * (size / TILE); tile++)
        for (int pixel = 0; pixel < TILE * TILE; pixel++) {
            double x = ((tile % (size / TILE)) * TILE + pixel % TILE + 0.5) / size * 2 - 1, direction[3];
            double y = ((tile / (size / TILE)) * TILE + pixel / TILE + 0.5) / size * 2 - 1;
            for (int axis = 0; axis < 3; axis++)
                direction[axis] = forward[axis] + 0.45 * (x * right[axis] - y * up[axis]);
            ret_rays[count++] = make_ray(eye, direction, 0);
        }
    return count;
}

static void face_normal(float corners[3][3], double ret_normal[3])
{
    double a[3], b[3];
    for (int axis = 0; axis < 3; axis++) {
        a[axis] = (double)corners[1][axis] - corners[0][axis];
        b[axis] = (double)corners[2][axis] - corners[0][axis];
    }
    double normal[3] = {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
    double length = sqrt(normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2]);
    for (int axis = 0; axis < 3; axis++)
        ret_normal[axis] = normal[axis] / length;
}

/* A ray from a point, cosine-distributed around a direction. */
static struct ray make_diffuse(struct random *random, const double point[3], const double normal[3], float tmin)
{
    double on_sphere[3], direction[3];
    do {
        random_point(random, on_sphere);
    } while (on_sphere[0] * on_sphere[0] + on_sphere[1] * on_sphere[1] + on_sphere[2] * on_sphere[2] > 1);
    double radius = sqrt(on_sphere[0] * on_sphere[0] + on_sphere[1] * on_sphere[1] + on_sphere[2] * on_sphere[2]);
    for (int axis = 0; axis < 3; axis++)
        direction[axis] = normal[axis] + on_sphere[axis] / radius;
    return make_ray(point, direction, tmin);
}

static struct ray make_shadow(const double point[3], const double light[3], float tmin)
{
    double direction[3] = {light[0] - point[0], light[1] - point[1], light[2] - point[2]};
    struct ray ray = make_ray(point, direction, tmin);
    ray.tmax = (float)sqrt(direction[0] * direction[0] + direction[1] * direction[1] + direction[2] * direction[2]);
    ray.flags = RAY_TERMINATE_ON_FIRST_HIT;
    return ray;
}

/* Makes one diffuse and one shadow ray from each primary hit, on the viewer's side. */
static uint32_t make_secondary(const struct subject *subject, const struct ray *primary, uint32_t primary_count,
                               struct ray *ret_diffuse, struct ray *ret_shadow)
{
    struct random random = {1};
    uint32_t count = 0;
    double size = 0;
    for (int axis = 0; axis < 3; axis++)
        size = fmax(size, (double)subject->bounds[3 + axis] - subject->bounds[axis]);
    for (uint32_t i = 0; i < primary_count; i++) {
        struct ray_hit hit;
        float corners[3][3];
        double point[3], normal[3], facing = 0;
        if (!traverse(&subject->scene, &primary[i], NULL, &hit, NULL))
            continue;
        traverse_positions(&subject->scene, &hit, corners);
        face_normal(corners, normal);
        for (int axis = 0; axis < 3; axis++) {
            point[axis] = primary[i].origin[axis] + (double)hit.t * primary[i].direction[axis];
            facing += normal[axis] * primary[i].direction[axis];
        }
        for (int axis = 0; axis < 3; axis++)
            normal[axis] *= facing < 0 ? 1 : -1;
        ret_diffuse[count] = make_diffuse(&random, point, normal, (float)(1e-5 * size));
        ret_shadow[count++] = make_shadow(point, subject->light, (float)(1e-5 * size));
    }
    return count;
}

static uint32_t make_random(const struct subject *subject, uint32_t wanted, struct ray *ret_rays)
{
    struct random random = {2};
    for (uint32_t i = 0; i < wanted; i++) {
        double origin[3], direction[3];
        random_point(&random, direction);
        for (int axis = 0; axis < 3; axis++)
            origin[axis] = random_between(&random, subject->bounds[axis], subject->bounds[3 + axis]);
        ret_rays[i] = make_ray(origin, direction, 0);
    }
    return wanted;
}

static RTCScene build_embree(RTCDevice device, const struct ply *ply)
{
    RTCScene scene = rtcNewScene(device);
    RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE);
    void *vertices =
        rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, 12, ply->vertex_count);
    void *indices =
        rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, 12, ply->triangle_count);
    memcpy(vertices, ply->positions, (size_t)12 * ply->vertex_count);
    memcpy(indices, ply->indices, (size_t)12 * ply->triangle_count);
    rtcCommitGeometry(geometry);
    rtcAttachGeometry(scene, geometry);
    rtcReleaseGeometry(geometry);
    rtcSetSceneFlags(scene, RTC_SCENE_FLAG_ROBUST);
    rtcSetSceneBuildQuality(scene, RTC_BUILD_QUALITY_MEDIUM);
    rtcCommitScene(scene);
    return scene;
}

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

static uint32_t run_intersect(RTCScene scene, const struct ray *rays, uint32_t count)
{
    uint32_t hits = 0;
    intersect_arguments arguments;
    init_intersect(&arguments);
    for (uint32_t i = 0; i < count; i++) {
        struct RTCRayHit hit = {.ray = embree_ray(&rays[i]), .hit = {.geomID = RTC_INVALID_GEOMETRY_ID}};
        intersect(scene, &arguments, &hit);
        hits += hit.hit.geomID != RTC_INVALID_GEOMETRY_ID;
    }
    return hits;
}

static uint32_t run_occluded(RTCScene scene, const struct ray *rays, uint32_t count)
{
    uint32_t hits = 0;
    occluded_arguments arguments;
    init_occluded(&arguments);
    for (uint32_t i = 0; i < count; i++) {
        struct RTCRay ray = embree_ray(&rays[i]);
        occluded(scene, &arguments, &ray);
        hits += ray.tfar < 0;
    }
    return hits;
}

static uint32_t run_portable(const struct scene *scene, const struct ray *rays, uint32_t count)
{
    uint32_t hits = 0;
    struct ray_hit hit;
    for (uint32_t i = 0; i < count; i++)
        hits += traverse(scene, &rays[i], NULL, &hit, NULL);
    return hits;
}

/* The rays as a program has them, and room for their hits. */
struct library_rays {
    struct bvhd_cpu_ray *rays;
    struct bvhd_cpu_hit *hits;
    uint32_t count;
};

static struct library_rays make_library_rays(const struct ray *rays, uint32_t count)
{
    struct library_rays made = {need(count * sizeof *made.rays), need(count * sizeof *made.hits), count};
    for (uint32_t i = 0; i < count; i++) {
        struct bvhd_cpu_ray *to = &made.rays[i];
        *to = (struct bvhd_cpu_ray){
            .tmin = rays[i].tmin, .tmax = rays[i].tmax, .flags = rays[i].flags, .mask = rays[i].cull_mask};
        memcpy(to->origin, rays[i].origin, sizeof to->origin);
        memcpy(to->direction, rays[i].direction, sizeof to->direction);
    }
    return made;
}

static struct bvhd_cpu_trace trace_of(const struct library_rays *rays)
{
    return (struct bvhd_cpu_trace){.struct_size = sizeof(struct bvhd_cpu_trace),
                                   .rays = rays->rays,
                                   .ray_size = sizeof *rays->rays,
                                   .hits = rays->hits,
                                   .hit_size = sizeof *rays->hits,
                                   .ray_count = rays->count};
}

static uint32_t count_hits(const struct library_rays *rays)
{
    uint32_t hits = 0;
    for (uint32_t i = 0; i < rays->count; i++)
        hits += rays->hits[i].blob != BVHD_CPU_NO_BLOB;
    return hits;
}

/* The internal function, with the same result: a hit for each ray. */
__attribute__((noinline)) static uint32_t run_direct(const struct scene *scene, const struct ray *rays,
                                                     const struct library_rays *found)
{
    for (uint32_t i = 0; i < found->count; i++) {
        struct ray_hit *hit = (struct ray_hit *)&found->hits[i];
        if (!traverse(scene, &rays[i], NULL, hit, NULL))
            hit->handle = RAY_NO_BOTTOM;
    }
    return count_hits(found);
}

static void must_trace(const struct bvhd_cpu_scene *scene, const struct bvhd_cpu_trace *trace)
{
    struct bvhd_error error;
    if (bvhd_cpu_scene_trace(scene, trace, &error) == BVHD_OK)
        return;
    fprintf(stderr, "bench_trace: %s: %s\n", error.where, error.text);
    exit(1);
}

__attribute__((noinline)) static uint32_t run_library(const struct bvhd_cpu_scene *scene,
                                                      const struct library_rays *rays)
{
    const struct bvhd_cpu_trace trace = trace_of(rays);
    must_trace(scene, &trace);
    return count_hits(rays);
}

__attribute__((noinline)) static uint32_t run_library_singly(const struct bvhd_cpu_scene *scene,
                                                             const struct library_rays *rays)
{
    struct bvhd_cpu_trace trace = trace_of(rays);
    trace.ray_count = 1;
    for (uint32_t i = 0; i < rays->count; i++) {
        trace.rays = &rays->rays[i];
        trace.hits = &rays->hits[i];
        must_trace(scene, &trace);
    }
    return count_hits(rays);
}

static int compare_doubles(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* Compares what the library costs with the internal function, in turns, each of which begins with another of them. */
static void measure_library(const struct subject *subject, const struct settings *settings, enum kind kind,
                            const struct ray *rays, uint32_t count, struct totals *totals)
{
    enum { DIRECT, MANY, ONE, WAYS };
    static double many[REPEATS_MAX], one[REPEATS_MAX];
    struct library_rays given = make_library_rays(rays, count);
    uint32_t hits[WAYS];
    int repeats = 0;
    for (double start = now(); repeats < REPEATS_MIN || (repeats < REPEATS_MAX && now() - start < settings->seconds);
         repeats++) {
        double times[WAYS];
        for (int turn = 0; turn < WAYS; turn++) {
            int way = (turn + repeats) % WAYS;
            double from = now();
            hits[way] = way == DIRECT ? run_direct(&subject->scene, rays, &given)
                        : way == MANY ? run_library(subject->opened, &given)
                                      : run_library_singly(subject->opened, &given);
            times[way] = now() - from;
        }
        many[repeats] = times[MANY] / times[DIRECT];
        one[repeats] = times[ONE] / times[DIRECT];
    }
    qsort(many, (size_t)repeats, sizeof *many, compare_doubles);
    qsort(one, (size_t)repeats, sizeof *one, compare_doubles);
    double of_many = many[repeats / 2], of_one = one[repeats / 2];
    printf(
        "           bvhd_cpu.h / the internal function: time %.3f all in one call, %.3f one a call (medians of %d)%s\n",
        of_many, of_one, repeats, hits[MANY] == hits[DIRECT] && hits[ONE] == hits[DIRECT] ? "" : "; HITS DIFFER");
    totals->log_many[kind] += log(of_many);
    totals->log_one[kind] += log(of_one);
    totals->worst_many[kind] = fmax(totals->worst_many[kind], of_many);
    totals->worst_one[kind] = fmax(totals->worst_one[kind], of_one);
    free(given.rays);
    free(given.hits);
}

static void measure(const struct subject *subject, const struct settings *settings, enum kind kind,
                    const struct ray *rays, uint32_t count, struct totals *totals)
{
    double best[2] = {DBL_MAX, DBL_MAX}, start = now();
    uint32_t hits[2] = {0, 0};
    int repeats = 0;
    struct traverse_counters counters = {0};
    struct ray_hit hit;
    if (count == 0)
        return;
    while (repeats < 3 || now() - start < settings->seconds) {
        double from = now();
        hits[0] = (kind == SHADOW ? run_occluded : run_intersect)(subject->embree, rays, count);
        double middle = now();
        hits[1] = run_portable(&subject->scene, rays, count);
        best[0] = fmin(best[0], middle - from);
        best[1] = fmin(best[1], now() - middle);
        repeats++;
    }
    for (uint32_t i = 0; i < count; i++)
        traverse(&subject->scene, &rays[i], NULL, &hit, &counters);
    double embree = 1e-6 * count / best[0], portable = 1e-6 * count / best[1], ratio = portable / embree;
    printf("  %-8s %7u rays, hits %6.2f %% (embree %+d): embree %6.2f, portable %6.2f Mray/s, ratio %5.3f; a ray: "
           "%5.1f nodes, %5.1f triangles\n",
           kind_names[kind], count, 100.0 * hits[1] / count, (int)hits[0] - (int)hits[1], embree, portable, ratio,
           (double)counters.nodes / count, (double)counters.triangles / count);
    totals->log_ratio[kind] += log(ratio);
    totals->worst[kind] = fmin(totals->worst[kind], ratio);
    measure_library(subject, settings, kind, rays, count, totals);
}

static void measure_all(struct subject *subject, const struct settings *settings, struct totals *totals)
{
    uint32_t pixels = (uint32_t)settings->size * (uint32_t)settings->size, counts[KINDS];
    struct ray *rays[KINDS];
    for (int kind = 0; kind < KINDS; kind++)
        rays[kind] = need(pixels * sizeof *rays[kind]);
    counts[PRIMARY] = make_primary(subject, settings->size, rays[PRIMARY]);
    counts[DIFFUSE] = counts[SHADOW] =
        make_secondary(subject, rays[PRIMARY], counts[PRIMARY], rays[DIFFUSE], rays[SHADOW]);
    counts[RANDOM] = make_random(subject, pixels, rays[RANDOM]);
    for (int kind = 0; kind < KINDS; kind++) {
        measure(subject, settings, (enum kind)kind, rays[kind], counts[kind], totals);
        free(rays[kind]);
    }
    totals->scenes++;
}

static void run_scene(const char *path, const struct settings *settings, RTCDevice device, struct totals *totals)
{
    struct memory memory;
    struct bvhd_error error;
    struct batch_item item;
    struct portable_view view;
    const struct portable_view *bottoms[1] = {&view};
    struct ply *ply = ply_read(path);
    if (!ply)
        exit(1);
    memory_init(&memory, UINT64_MAX);
    struct geometry geometry = {
        .type = GEOMETRY_TRIANGLES,
        .flags = GEOMETRY_OPAQUE,
        .triangles = {.vertex_format = 106,
                      .max_vertex = ply->vertex_count - 1,
                      .vertex_stride = 12,
                      .index_type = INDEX_UINT32,
                      .vertices = {(const unsigned char *)ply->positions, (uint64_t)12 * ply->vertex_count},
                      .indices = {(const unsigned char *)ply->indices, (uint64_t)12 * ply->triangle_count}},
        .range.primitive_count = ply->triangle_count,
    };
    struct build_input input = {
        .type = STRUCTURE_BOTTOM,
        .geometry_count = 1,
        .geometries = &geometry,
        .options = {.quality = settings->quality, .target = TARGET_PORTABLE, .layout_flags = settings->layout_flags}};
    struct limits limits = limits_default();
    struct build_context context = {.memory = &memory, .parallel = &parallel_serial};
    if (batch_build(&input, 1, &limits, &context, &item, &error) != BVHD_OK || item.status != BVHD_OK ||
        portable_open((struct bytes){item.blob, item.size}, &memory, &view, &error) != BVHD_OK) {
        fprintf(stderr, "bench_trace: %s does not build\n", path);
        exit(1);
    }
    struct subject subject = {
        .ply = ply, .scene = {.bottoms = bottoms, .bottom_count = 1}, .embree = build_embree(device, ply)};
    memcpy(subject.bounds, view.header->bounds, sizeof subject.bounds);
    printf("%s: %u triangles, %.1f MiB, %s, SAH %.2f\n", path, ply->triangle_count, (double)item.size / 1048576,
           item.stats.method, item.stats.sah);
    const struct bvhd_cpu_blob blob = {item.blob, item.size};
    const struct bvhd_cpu_scene_options options = {.struct_size = sizeof options, .blobs = &blob, .blob_count = 1};
    if (bvhd_cpu_scene_create(&options, &subject.opened, &error) != BVHD_OK) {
        fprintf(stderr, "bench_trace: %s: %s\n", error.where, error.text);
        exit(1);
    }
    measure_all(&subject, settings, totals);
    bvhd_cpu_scene_destroy(subject.opened);
    rtcReleaseScene(subject.embree);
    batch_finish(&item, 1, &memory);
    ply_free(ply);
}

int main(int argc, char **argv)
{
    struct settings settings = {.size = 512, .seconds = 1, .quality = QUALITY_BALANCED};
    struct totals totals = {.worst = {DBL_MAX, DBL_MAX, DBL_MAX, DBL_MAX}};
    RTCDevice device = rtcNewDevice("threads=1");
    if (!device) {
        fprintf(stderr, "bench_trace: no Embree device\n");
        return 1;
    }
    for (int i = 1; i < argc; i++) {
        if (strcmp(argv[i], "--size") == 0 && i + 1 < argc)
            settings.size = atoi(argv[++i]) / TILE * TILE;
        else if (strcmp(argv[i], "--seconds") == 0 && i + 1 < argc)
            settings.seconds = atof(argv[++i]);
        else if (strcmp(argv[i], "--fast-triangles") == 0)
            settings.layout_flags = PORTABLE_FAST_TRIANGLES;
        else if (strcmp(argv[i], "--high") == 0)
            settings.quality = QUALITY_HIGH;
        else
            run_scene(argv[i], &settings, device, &totals);
        fflush(stdout);
    }
    for (int kind = 0; kind < KINDS && totals.scenes > 0; kind++)
        printf("%-8s: geometric mean of portable / embree %.3f, worst %.3f\n", kind_names[kind],
               exp(totals.log_ratio[kind] / totals.scenes), totals.worst[kind]);
    for (int kind = 0; kind < KINDS && totals.scenes > 0; kind++)
        printf(
            "%-8s: time by bvhd_cpu.h / directly: geometric mean %.3f, worst %.3f; one ray a call %.3f, worst %.3f\n",
            kind_names[kind], exp(totals.log_many[kind] / totals.scenes), totals.worst_many[kind],
            exp(totals.log_one[kind] / totals.scenes), totals.worst_one[kind]);
    rtcReleaseDevice(device);
    return 0;
}
