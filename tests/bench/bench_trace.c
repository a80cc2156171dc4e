/* SPDX-License-Identifier: Apache-2.0 */
/*
 * bench_trace.c - measures rays a second through a portable structure, compared with Embree's rtcIntersect1 and
 * rtcOccluded1 on its own robust scene of the same triangles.
 *
 *     bench_trace [--size N] [--seconds S] [--kinds K,...] [--fast-triangles] [--high] SCENE.ply...
 *
 * Times are processor time of one thread. The rays are the primary rays of an N x N picture (in tiles), from their hits
 * (in the same order) diffuse rays and shadow rays to a light above, and random rays through the box. Shadow rays end
 * at any hit. They are traced in turns by Embree, one and eight in a call; by bvhd_cpu.h of libbvhd.so, all in one call
 * and one in each call; and by the internal function over the bytes of the structure. Each turn begins with another
 * way. It prints the rates of the fastest turn, the medians of the rates relative to rtcIntersect1's of the same turn,
 * and in the end their geometric means over the scenes, and the worst.
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
    unsigned kinds; /* bit k: rays of kind k are measured */
};

/*
 * How rays are traced: by Embree, one or eight a call; by bvhd_cpu.h, all in one call or one a call; by the internal
 * function over the bytes of the structure. The first is what the others are compared with.
 */
enum way { EMBREE_1, EMBREE_8, MANY, ONE, DIRECT, WAYS };

static const char *const way_names[WAYS] = {"rtcIntersect1", "rtcIntersect8", "N rays a call", "one ray a call",
                                            "internal, from the bytes"};

/* The order of a turn: no way follows one that reads the same nodes, which it would find in the caches. */
static const enum way order[WAYS] = {EMBREE_1, MANY, EMBREE_8, ONE, DIRECT};

struct totals {
    double log_ratio[KINDS][WAYS], worst[KINDS][WAYS];
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
#define intersect_8(valid, scene, arguments, hit) rtcIntersect8(valid, scene, hit, arguments)
#define occluded_8(valid, scene, arguments, ray) rtcOccluded8(valid, scene, ray, (occluded_arguments *)(arguments))
#define coherent_flag RTC_RAY_QUERY_FLAG_COHERENT
#else
typedef struct RTCIntersectContext intersect_arguments, occluded_arguments;
#define init_intersect rtcInitIntersectContext
#define init_occluded rtcInitIntersectContext
#define intersect rtcIntersect1
#define occluded rtcOccluded1
#define intersect_8 rtcIntersect8
#define occluded_8 rtcOccluded8
#define coherent_flag RTC_INTERSECT_CONTEXT_FLAG_COHERENT
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

/* One kind of rays in the forms in which the ways take them. */
struct ray_set {
    const struct ray *rays;
    uint32_t count;
    struct library_rays given;
    struct RTCRayHit8 *packets; /* the last one is filled up with rays that hit nothing */
};

static struct RTCRayHit8 *make_packets(const struct ray *rays, uint32_t count)
{
    struct RTCRayHit8 *packets = aligned_alloc(64, (count + 8) / 8 * sizeof *packets);
    if (!packets)
        exit(1);
    for (uint32_t i = 0; i < (count + 7) / 8 * 8; i++) {
        struct RTCRayHit8 *packet = &packets[i / 8];
        struct RTCRay ray = embree_ray(&rays[i < count ? i : 0]);
        uint32_t k = i % 8;
        packet->ray.org_x[k] = ray.org_x;
        packet->ray.org_y[k] = ray.org_y;
        packet->ray.org_z[k] = ray.org_z;
        packet->ray.dir_x[k] = ray.dir_x;
        packet->ray.dir_y[k] = ray.dir_y;
        packet->ray.dir_z[k] = ray.dir_z;
        packet->ray.tnear[k] = ray.tnear;
        packet->ray.tfar[k] = i < count ? ray.tfar : -1;
        packet->ray.mask[k] = ray.mask;
        packet->ray.time[k] = 0;
        packet->ray.flags[k] = 0;
        packet->hit.geomID[k] = RTC_INVALID_GEOMETRY_ID;
        packet->hit.instID[0][k] = RTC_INVALID_GEOMETRY_ID;
    }
    return packets;
}

/* Eight rays a call. Primary and shadow rays are said to be coherent. */
static uint32_t run_packets(RTCScene scene, enum kind kind, const struct ray_set *set)
{
    static const int valid[8] __attribute__((aligned(32))) = {-1, -1, -1, -1, -1, -1, -1, -1};
    uint32_t hits = 0;
    intersect_arguments arguments;
    init_intersect(&arguments);
    if (kind == PRIMARY || kind == SHADOW)
        arguments.flags = coherent_flag;
    for (uint32_t i = 0; i < (set->count + 7) / 8; i++) {
        struct RTCRayHit8 packet = set->packets[i];
        if (kind == SHADOW)
            occluded_8(valid, scene, &arguments, &packet.ray);
        else
            intersect_8(valid, scene, &arguments, &packet);
        for (int k = 0; k < 8; k++)
            hits += kind == SHADOW ? packet.ray.tfar[k] < 0 && 8 * i + (uint32_t)k < set->count
                                   : packet.hit.geomID[k] != RTC_INVALID_GEOMETRY_ID;
    }
    return hits;
}

static uint32_t run(const struct subject *subject, enum way way, enum kind kind, const struct ray_set *set)
{
    switch (way) {
    case EMBREE_1:
        return (kind == SHADOW ? run_occluded : run_intersect)(subject->embree, set->rays, set->count);
    case EMBREE_8:
        return run_packets(subject->embree, kind, set);
    case MANY:
        return run_library(subject->opened, &set->given);
    case ONE:
        return run_library_singly(subject->opened, &set->given);
    default:
        return run_direct(&subject->scene, set->rays, &set->given);
    }
}

/* Traces in all ways, in turns, each of which begins with another of them. */
static void measure(const struct subject *subject, const struct settings *settings, enum kind kind,
                    const struct ray *rays, uint32_t count, struct totals *totals)
{
    static double ratios[WAYS][REPEATS_MAX];
    double best[WAYS], start = now();
    struct ray_set set = {rays, count, make_library_rays(rays, count), make_packets(rays, count)};
    uint32_t hits[WAYS];
    int repeats = 0;
    for (int way = 0; way < WAYS; way++)
        best[way] = DBL_MAX;
    for (; repeats < REPEATS_MIN || (repeats < REPEATS_MAX && now() - start < settings->seconds); repeats++) {
        double times[WAYS];
        for (int turn = 0; turn < WAYS; turn++) {
            const enum way way = order[(turn + repeats) % WAYS];
            double from = now();
            hits[way] = run(subject, way, kind, &set);
            times[way] = now() - from;
            best[way] = fmin(best[way], times[way]);
        }
        for (int way = 0; way < WAYS; way++)
            ratios[way][repeats] = times[EMBREE_1] / times[way];
    }
    printf("  %-8s %7u rays, hits %6.2f %% (embree %+d); Mray/s, and medians of rates over rtcIntersect1's:\n ",
           kind_names[kind], count, 100.0 * hits[DIRECT] / count, (int)hits[EMBREE_1] - (int)hits[DIRECT]);
    for (int way = 0; way < WAYS; way++) {
        qsort(ratios[way], (size_t)repeats, sizeof **ratios, compare_doubles);
        double ratio = ratios[way][repeats / 2];
        printf("  %s %.2f (%.3f)", way_names[way], 1e-6 * count / best[way], ratio);
        totals->log_ratio[kind][way] += log(ratio);
        totals->worst[kind][way] = fmin(totals->worst[kind][way], ratio);
    }
    printf("%s\n", hits[MANY] == hits[DIRECT] && hits[ONE] == hits[DIRECT] ? "" : "; HITS DIFFER");
    free(set.given.rays);
    free(set.given.hits);
    free(set.packets);
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
        if (counts[kind] > 0 && (settings->kinds >> kind & 1))
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
           item.summary.method, item.summary.sah);
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

/* Reads names of kinds, separated by commas. */
static unsigned read_kinds(const char *names)
{
    unsigned kinds = 0;
    for (int kind = 0; kind < KINDS; kind++)
        kinds |= (unsigned)(strstr(names, kind_names[kind]) != NULL) << kind;
    return kinds;
}

int main(int argc, char **argv)
{
    struct settings settings = {.size = 512, .seconds = 1, .quality = QUALITY_BALANCED, .kinds = (1u << KINDS) - 1};
    struct totals totals = {.scenes = 0};
    for (int i = 0; i < KINDS * WAYS; i++)
        totals.worst[i / WAYS][i % WAYS] = DBL_MAX;
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
        else if (strcmp(argv[i], "--kinds") == 0 && i + 1 < argc)
            settings.kinds = read_kinds(argv[++i]);
        else if (strcmp(argv[i], "--fast-triangles") == 0)
            settings.layout_flags = PORTABLE_FAST_TRIANGLES;
        else if (strcmp(argv[i], "--high") == 0)
            settings.quality = QUALITY_HIGH;
        else
            run_scene(argv[i], &settings, device, &totals);
        fflush(stdout);
    }
    for (int kind = 0; kind < KINDS && totals.scenes > 0; kind++) {
        if (!(settings.kinds >> kind & 1))
            continue;
        printf("%-8s: rates over rtcIntersect1's, geometric mean and worst:", kind_names[kind]);
        for (int way = 1; way < WAYS; way++)
            printf(" %s %.3f %.3f%s", way_names[way], exp(totals.log_ratio[kind][way] / totals.scenes),
                   totals.worst[kind][way], way < WAYS - 1 ? "," : "\n");
    }
    rtcReleaseDevice(device);
    return 0;
}
