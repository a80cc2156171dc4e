/* SPDX-License-Identifier: Apache-2.0 */
/*
 * bench_round.c - measures hair as linear swept spheres, beside the same strands as tubes of triangles and as Embree's
 * round linear curves; and a cloud of spheres beside Embree's sphere points.
 *
 *     bench_round [--size N] [--turns N] [--strands N] [--points N] [--threads N] [--high]
 *
 * It prints bytes, strands built a second, and rays a second: the primary rays of an N x N picture in tiles, and from
 * their hits diffuse rays and shadow rays to a light. Shadow rays end at any hit. All subjects get the same rays: all
 * in one call of bvhd_cpu.h, or one by one with rtcIntersect1 and rtcOccluded1 in a robust scene. Subjects take turns,
 * and each turn begins with another one; the figures are medians over the turns, of rates and of their ratios within a
 * turn. Times are processor time of the thread that traces or builds, and of the process for builds with several
 * threads.
 */
#include <float.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include <bvhd/bvhd_cpu.h>

#include "builder/update/batch.h"
#include "builder/workers.h"
#include "tests/bench/embree_ray.h"
#include "tests/support/scene/hair.h"

enum { TILE = 8, TURNS_MAX = 1000, SUBJECTS_MAX = 3 };

enum kind { PRIMARY, DIFFUSE, SHADOW, KINDS };

static const char *const kind_names[KINDS] = {"primary", "diffuse", "shadow"};

struct settings {
    uint32_t size, turns, strands, points, threads;
    enum build_quality quality;
};

/* One form of a scene: a structure, or a scene of Embree. */
struct subject {
    const char *name;
    struct geometry geometry;
    struct memory memory;
    struct batch_item item;
    struct bvhd_cpu_scene *opened;
    RTCScene embree;
};

/* Rays of one kind, as both take them. */
struct rays {
    struct bvhd_cpu_ray *rays;
    struct bvhd_cpu_hit *hits;
    uint32_t count;
};

static void fail(const char *what)
{
    fprintf(stderr, "bench_round: %s\n", what);
    exit(1);
}

static void *need(uint64_t size)
{
    void *block = calloc(size ? size : 1, 1);
    if (!block)
        fail("no memory");
    return block;
}

static double now(clockid_t clock)
{
    struct timespec time;
    clock_gettime(clock, &time);
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

/* ---- The subjects ---- */

static struct geometry_spheres spheres_of(const struct mesh *mesh)
{
    return (struct geometry_spheres){
        .vertex_format = 106,
        .radius_format = 100,
        .index_type = INDEX_NONE,
        .vertex_stride = 12,
        .radius_stride = 4,
        .vertices = {(const unsigned char *)mesh->vertices, (uint64_t)12 * mesh->vertex_count},
        .radii = {(const unsigned char *)mesh->radii, (uint64_t)4 * mesh->vertex_count}};
}

/* The strands as chains, of which the lines name the first vertices. */
static struct geometry hair_geometry(const struct mesh *hair, uint32_t **ret_indices)
{
    uint32_t *indices = need((uint64_t)4 * hair->line_count);
    for (uint32_t i = 0; i < hair->line_count; i++)
        indices[i] = hair->lines[i][0];
    struct geometry_spheres ends = spheres_of(hair);
    ends.index_type = INDEX_UINT32;
    ends.index_stride = 4;
    ends.indices = (struct bytes){(const unsigned char *)indices, (uint64_t)4 * hair->line_count};
    *ret_indices = indices;
    return (struct geometry){.type = GEOMETRY_SWEPT_SPHERES,
                             .flags = GEOMETRY_OPAQUE,
                             .swept_spheres = {ends, SWEPT_SUCCESSIVE, SWEPT_CAPS_CHAINED},
                             .range.primitive_count = hair->line_count};
}

static struct geometry tubes_geometry(const struct mesh *tubes)
{
    return (struct geometry){
        .type = GEOMETRY_TRIANGLES,
        .flags = GEOMETRY_OPAQUE,
        .triangles = {.vertex_format = 106,
                      .max_vertex = tubes->vertex_count - 1,
                      .vertex_stride = 12,
                      .index_type = INDEX_UINT32,
                      .vertices = {(const unsigned char *)tubes->vertices, (uint64_t)12 * tubes->vertex_count},
                      .indices = {(const unsigned char *)tubes->triangles, (uint64_t)12 * tubes->triangle_count}},
        .range.primitive_count = tubes->triangle_count,
    };
}

/* Makes a scene of Embree: curves if the mesh has lines, else points. */
static RTCScene build_embree(RTCDevice device, const struct mesh *mesh)
{
    RTCScene scene = rtcNewScene(device);
    RTCGeometry geometry = rtcNewGeometry(device, mesh->line_count ? RTC_GEOMETRY_TYPE_ROUND_LINEAR_CURVE
                                                                   : RTC_GEOMETRY_TYPE_SPHERE_POINT);
    float *vertices =
        rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT4, 16, mesh->vertex_count);
    for (uint32_t i = 0; i < mesh->vertex_count; i++) {
        memcpy(vertices + (size_t)4 * i, mesh->vertices[i], sizeof mesh->vertices[i]);
        vertices[(size_t)4 * i + 3] = mesh->radii[i];
    }
    if (mesh->line_count) {
        uint32_t *indices =
            rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT, 4, mesh->line_count);
        uint8_t *flags =
            rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_FLAGS, 0, RTC_FORMAT_UCHAR, 1, mesh->line_count);
        for (uint32_t i = 0; i < mesh->line_count; i++) {
            indices[i] = mesh->lines[i][0];
            flags[i] = (uint8_t)((i > 0 && mesh->lines[i - 1][1] == indices[i] ? RTC_CURVE_FLAG_NEIGHBOR_LEFT : 0) |
                                 (i + 1 < mesh->line_count && mesh->lines[i + 1][0] == mesh->lines[i][1]
                                      ? RTC_CURVE_FLAG_NEIGHBOR_RIGHT
                                      : 0));
        }
    }
    rtcCommitGeometry(geometry);
    rtcAttachGeometry(scene, geometry);
    rtcReleaseGeometry(geometry);
    rtcSetSceneFlags(scene, RTC_SCENE_FLAG_ROBUST);
    rtcSetSceneBuildQuality(scene, RTC_BUILD_QUALITY_MEDIUM);
    rtcCommitScene(scene);
    return scene;
}

/* Builds a subject, in place of what it was. */
static void build_subject(struct subject *subject, const struct settings *settings, const struct parallel *parallel)
{
    const struct build_input input = {.type = STRUCTURE_BOTTOM,
                                      .geometry_count = 1,
                                      .geometries = &subject->geometry,
                                      .options = {.quality = settings->quality, .target = TARGET_PORTABLE}};
    const struct limits limits = limits_default();
    const struct build_context context = {.memory = &subject->memory, .parallel = parallel};
    struct bvhd_error error;
    batch_finish(&subject->item, subject->item.blob != NULL, &subject->memory);
    if (batch_build(&input, 1, &limits, &context, &subject->item, &error) != BVHD_OK || subject->item.status != BVHD_OK)
        fail("a structure does not build");
}

static void open_subject(struct subject *subject)
{
    const struct bvhd_cpu_blob blob = {subject->item.blob, subject->item.size};
    const struct bvhd_cpu_scene_options options = {.struct_size = sizeof options, .blobs = &blob, .blob_count = 1};
    struct bvhd_error error;
    if (bvhd_cpu_scene_create(&options, &subject->opened, &error) != BVHD_OK)
        fail(error.text);
}

static void finish_subject(struct subject *subject)
{
    bvhd_cpu_scene_destroy(subject->opened);
    if (subject->embree)
        rtcReleaseScene(subject->embree);
    batch_finish(&subject->item, subject->item.blob != NULL, &subject->memory);
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
        const struct RTCRay ray = embree_ray((const struct ray *)&rays->rays[i]);
        struct RTCRayHit hit = {.ray = ray, .hit = {.geomID = RTC_INVALID_GEOMETRY_ID}};
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

static uint32_t trace(const struct subject *subject, const struct rays *rays, enum kind kind)
{
    return subject->embree ? trace_embree(subject->embree, rays, kind) : trace_opened(subject->opened, rays);
}

static struct bvhd_cpu_ray make_ray(const double origin[3], const double direction[3], double tmin)
{
    struct bvhd_cpu_ray ray = {.tmin = (float)tmin, .tmax = FLT_MAX, .mask = 0xff};
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
static void make_primary(const float bounds[6], uint32_t size, struct rays *rays, double ret_light[3])
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
}

/* Finds the direction away from the axis of what was hit, or from the centre. */
static void find_normal(const struct mesh *mesh, const struct bvhd_cpu_hit *hit, const double point[3],
                        double ret_normal[3])
{
    const uint32_t first = mesh->line_count ? mesh->lines[hit->primitive][0] : hit->primitive,
                   second = mesh->line_count ? mesh->lines[hit->primitive][1] : hit->primitive;
    double length = 0;
    for (int axis = 0; axis < 3; axis++) {
        const double from = mesh->vertices[first][axis], to = mesh->vertices[second][axis];
        ret_normal[axis] = point[axis] - (from + (double)hit->u * (to - from));
        length += ret_normal[axis] * ret_normal[axis];
    }
    for (int axis = 0; axis < 3; axis++)
        ret_normal[axis] /= sqrt(length);
}

/* Makes a diffuse ray from each hit, and a shadow ray where the surface is turned to the light. */
static void make_secondary(const struct mesh *mesh, const struct rays *primary, const double light[3],
                           struct rays *diffuse, struct rays *shadow)
{
    struct random random = {1};
    uint32_t count = 0, lit = 0;
    for (uint32_t i = 0; i < primary->count; i++) {
        const struct bvhd_cpu_ray *ray = &primary->rays[i];
        const struct bvhd_cpu_hit *hit = &primary->hits[i];
        double point[3], normal[3], on_sphere[3], length, direction[3], to_light[3], facing = 0;
        if (hit->blob == BVHD_CPU_NO_BLOB)
            continue;
        for (int axis = 0; axis < 3; axis++)
            point[axis] = ray->origin[axis] + (double)hit->t * ray->direction[axis];
        find_normal(mesh, hit, point, normal);
        do {
            random_point(&random, on_sphere);
            length = sqrt(on_sphere[0] * on_sphere[0] + on_sphere[1] * on_sphere[1] + on_sphere[2] * on_sphere[2]);
        } while (length > 1);
        for (int axis = 0; axis < 3; axis++) {
            direction[axis] = normal[axis] + on_sphere[axis] / length;
            to_light[axis] = light[axis] - point[axis];
            facing += to_light[axis] * normal[axis];
        }
        diffuse->rays[count++] = make_ray(point, direction, 1e-5);
        if (facing <= 0)
            continue;
        shadow->rays[lit] = make_ray(point, to_light, 1e-5);
        shadow->rays[lit].flags = BVHD_CPU_RAY_TERMINATE_ON_FIRST_HIT;
        shadow->rays[lit++].tmax =
            (float)sqrt(to_light[0] * to_light[0] + to_light[1] * to_light[1] + to_light[2] * to_light[2]);
    }
    diffuse->count = count;
    shadow->count = lit;
}

/* ---- Measurements ---- */

/* Traces rays of one kind by all subjects in turns. The first subject is the one that is compared. */
static void measure_rays(const struct subject *subjects, unsigned count, const struct settings *settings,
                         const struct rays *rays, enum kind kind)
{
    static double times[SUBJECTS_MAX][TURNS_MAX], ratios[TURNS_MAX];
    uint32_t hits[SUBJECTS_MAX];
    for (uint32_t turn = 0; turn < settings->turns; turn++)
        for (unsigned i = 0; i < count; i++) {
            const unsigned which = (i + turn) % count;
            const double start = now(CLOCK_THREAD_CPUTIME_ID);
            hits[which] = trace(&subjects[which], rays, kind);
            times[which][turn] = now(CLOCK_THREAD_CPUTIME_ID) - start;
        }
    printf("  %-8s %7u rays:", kind_names[kind], rays->count);
    for (unsigned other = 1; other < count; other++) {
        for (uint32_t turn = 0; turn < settings->turns; turn++)
            ratios[turn] = times[other][turn] / times[0][turn];
        printf(" %.3f of %s,", median(ratios, settings->turns), subjects[other].name);
    }
    for (unsigned i = 0; i < count; i++)
        printf(" %s %.2f Mray/s (%.2f %% hit)%s", subjects[i].name,
               1e-6 * rays->count / median(times[i], settings->turns), 100.0 * hits[i] / rays->count,
               i + 1 < count ? "," : "\n");
}

static void measure_all_rays(struct subject *subjects, unsigned count, const struct settings *settings,
                             const struct mesh *mesh)
{
    const uint32_t pixels = settings->size * settings->size;
    struct rays rays[KINDS] = {make_rays(pixels), make_rays(pixels), make_rays(pixels)};
    float bounds[6];
    double light[3];
    memcpy(bounds, &subjects[0].item.summary.bounds, sizeof bounds);
    make_primary(bounds, settings->size, &rays[PRIMARY], light);
    trace_opened(subjects[0].opened, &rays[PRIMARY]);
    make_secondary(mesh, &rays[PRIMARY], light, &rays[DIFFUSE], &rays[SHADOW]);
    for (enum kind kind = PRIMARY; kind < KINDS; kind++) {
        measure_rays(subjects, count, settings, &rays[kind], kind);
        free(rays[kind].rays);
        free(rays[kind].hits);
    }
}

/* Builds both subjects in turns. */
static void measure_builds(struct subject *subjects, const struct settings *settings, const struct parallel *parallel,
                           uint32_t threads)
{
    static double times[2][TURNS_MAX], ratios[TURNS_MAX];
    const clockid_t clock = threads == 1 ? CLOCK_THREAD_CPUTIME_ID : CLOCK_PROCESS_CPUTIME_ID;
    for (uint32_t turn = 0; turn < settings->turns; turn++) {
        for (unsigned i = 0; i < 2; i++) {
            const unsigned which = (i + turn) % 2;
            const double start = now(clock);
            build_subject(&subjects[which], settings, parallel);
            times[which][turn] = now(clock) - start;
        }
        ratios[turn] = times[1][turn] / times[0][turn];
    }
    printf(
        "  built with %u threads: %.2f times as many strands a second; %s %.0f, %s %.0f strands a second and thread\n",
        threads, median(ratios, settings->turns), subjects[0].name,
        settings->strands / median(times[0], settings->turns), subjects[1].name,
        settings->strands / median(times[1], settings->turns));
}

static void run_hair(const struct settings *settings, RTCDevice device)
{
    struct random random = {1};
    struct mesh hair = {0}, tubes = {0};
    uint32_t *indices;
    struct workers *workers;
    struct bvhd_error error;
    hair_make(&hair, settings->strands, &random);
    hair_make_tubes(&hair, HAIR_SIDES, &tubes);
    struct subject subjects[3] = {{.name = "swept spheres", .geometry = hair_geometry(&hair, &indices)},
                                  {.name = "tubes", .geometry = tubes_geometry(&tubes)},
                                  {.name = "Embree's curves", .embree = build_embree(device, &hair)}};
    if (workers_create(settings->threads, &workers, &error) != BVHD_OK)
        fail(error.text);
    for (int i = 0; i < 2; i++)
        memory_init(&subjects[i].memory, UINT64_MAX);
    printf("%u strands: %u swept spheres, %u triangles\n", settings->strands, hair.line_count, tubes.triangle_count);
    measure_builds(subjects, settings, workers_parallel(workers), settings->threads);
    measure_builds(subjects, settings, &parallel_serial, 1);
    printf("  bytes: %lu of %lu, 1 / %.2f\n", (unsigned long)subjects[0].item.size,
           (unsigned long)subjects[1].item.size, (double)subjects[1].item.size / (double)subjects[0].item.size);
    for (int i = 0; i < 2; i++)
        open_subject(&subjects[i]);
    measure_all_rays(subjects, 3, settings, &hair);
    for (int i = 0; i < 3; i++)
        finish_subject(&subjects[i]);
    workers_destroy(workers);
    free(indices);
    mesh_finish(&hair);
    mesh_finish(&tubes);
}

static void run_cloud(const struct settings *settings, RTCDevice device)
{
    struct random random = {1};
    struct mesh cloud = {0};
    cloud_make(&cloud, &cloud, settings->points, &random);
    struct subject subjects[2] = {{.name = "spheres",
                                   .geometry = {.type = GEOMETRY_SPHERES,
                                                .flags = GEOMETRY_OPAQUE,
                                                .spheres = spheres_of(&cloud),
                                                .range.primitive_count = cloud.vertex_count}},
                                  {.name = "Embree's points", .embree = build_embree(device, &cloud)}};
    memory_init(&subjects[0].memory, UINT64_MAX);
    build_subject(&subjects[0], settings, &parallel_serial);
    printf("%u spheres: %lu bytes\n", cloud.vertex_count, (unsigned long)subjects[0].item.size);
    open_subject(&subjects[0]);
    measure_all_rays(subjects, 2, settings, &cloud);
    for (int i = 0; i < 2; i++)
        finish_subject(&subjects[i]);
    mesh_finish(&cloud);
}

static uint32_t read_number(const char *text, uint32_t least, uint32_t most)
{
    const unsigned long number = strtoul(text, NULL, 10);
    return number < least ? least : number > most ? most : (uint32_t)number;
}

int main(int argc, char **argv)
{
    struct settings settings = {256, 15, HAIR_STRANDS, CLOUD_SIZE, 2, QUALITY_BALANCED};
    RTCDevice device = rtcNewDevice("threads=1");
    if (!device)
        fail("no Embree device");
    for (int i = 1; i < argc; i++) {
        if (strcmp(argv[i], "--size") == 0 && i + 1 < argc)
            settings.size = read_number(argv[++i], TILE, 8192) / TILE * TILE;
        else if (strcmp(argv[i], "--turns") == 0 && i + 1 < argc)
            settings.turns = read_number(argv[++i], 1, TURNS_MAX);
        else if (strcmp(argv[i], "--strands") == 0 && i + 1 < argc)
            settings.strands = read_number(argv[++i], 1, 1 << 20);
        else if (strcmp(argv[i], "--points") == 0 && i + 1 < argc)
            settings.points = read_number(argv[++i], 1, 1 << 26);
        else if (strcmp(argv[i], "--threads") == 0 && i + 1 < argc)
            settings.threads = read_number(argv[++i], 1, 256);
        else if (strcmp(argv[i], "--high") == 0)
            settings.quality = QUALITY_HIGH;
        else
            fail("unknown option");
    }
    run_hair(&settings, device);
    run_cloud(&settings, device);
    rtcReleaseDevice(device);
    return 0;
}
