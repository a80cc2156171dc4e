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
#include "builder/update/batch.h"
#include "builder/workers.h"
#include "tests/bench/bench_embree.h"
#include "tests/support/scene/hair.h"

enum { SUBJECTS_MAX = 3 };

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
    uint32_t *indices = bench_need((uint64_t)4 * hair->line_count);
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
        bench_fail("a structure does not build");
}

static void open_subject(struct subject *subject)
{
    const struct bvhd_cpu_blob blob = {subject->item.blob, subject->item.size};
    subject->opened = bench_open(&blob, 1);
}

static void finish_subject(struct subject *subject)
{
    bvhd_cpu_scene_destroy(subject->opened);
    if (subject->embree)
        rtcReleaseScene(subject->embree);
    batch_finish(&subject->item, subject->item.blob != NULL, &subject->memory);
}

/* ---- Rays ---- */

static uint32_t trace(const struct subject *subject, const struct bench_rays *rays, enum bench_kind kind)
{
    return subject->embree ? bench_trace_embree(subject->embree, rays, kind) : bench_trace(subject->opened, rays, NULL);
}

/* Finds the direction away from the axis of what was hit, or from the centre. */
static bool find_normal(const void *context, const struct bvhd_cpu_ray *ray, const struct bvhd_cpu_hit *hit,
                        const double point[3], double ret_normal[3])
{
    const struct mesh *mesh = context;
    (void)ray;
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
    return true;
}

/* ---- Measurements ---- */

/* Rays that all subjects trace, and how many of them have hit. */
struct comparison {
    const struct subject *subjects;
    const struct bench_rays *rays;
    enum bench_kind kind;
    uint32_t hits[SUBJECTS_MAX];
};

static void trace_one(void *context, unsigned subject)
{
    struct comparison *all = context;
    all->hits[subject] = trace(&all->subjects[subject], all->rays, all->kind);
}

/* Traces rays of one kind by all subjects in turns. The first subject is the one that is compared. */
static void measure_rays(const struct subject *subjects, unsigned count, const struct settings *settings,
                         const struct bench_rays *rays, enum bench_kind kind)
{
    static double times[SUBJECTS_MAX][BENCH_TURNS_MAX];
    struct comparison all = {.subjects = subjects, .rays = rays, .kind = kind};
    const struct bench_turns turns = {settings->turns, count, CLOCK_THREAD_CPUTIME_ID, trace_one, &all};
    bench_take_turns(&turns, times);
    printf("  %-8s %7u rays:", bench_kind_names[kind], rays->count);
    for (unsigned other = 1; other < count; other++)
        printf(" %.3f of %s,", bench_ratio(times[other], times[0], settings->turns), subjects[other].name);
    for (unsigned i = 0; i < count; i++)
        printf(" %s %.2f Mray/s (%.2f %% hit)%s", subjects[i].name,
               1e-6 * rays->count / bench_median(times[i], settings->turns), 100.0 * all.hits[i] / rays->count,
               i + 1 < count ? "," : "\n");
}

static void measure_all_rays(struct subject *subjects, unsigned count, const struct settings *settings,
                             const struct mesh *mesh)
{
    const uint32_t pixels = settings->size * settings->size;
    struct bench_rays rays[BENCH_KINDS] = {bench_rays_make(pixels), bench_rays_make(pixels), bench_rays_make(pixels)};
    float bounds[6];
    double light[3];
    memcpy(bounds, &subjects[0].item.summary.bounds, sizeof bounds);
    bench_make_primary(bounds, settings->size, &rays[BENCH_PRIMARY], light);
    bench_trace(subjects[0].opened, &rays[BENCH_PRIMARY], NULL);
    const struct bench_surface surface = {find_normal, mesh, 0, 1e-5};
    bench_make_secondary(&surface, &rays[BENCH_PRIMARY], light, &rays[BENCH_DIFFUSE], &rays[BENCH_SHADOW]);
    for (enum bench_kind kind = BENCH_PRIMARY; kind < BENCH_KINDS; kind++) {
        measure_rays(subjects, count, settings, &rays[kind], kind);
        bench_rays_free(&rays[kind]);
    }
}

/* Builds that two subjects make. */
struct builds {
    struct subject *subjects;
    const struct settings *settings;
    const struct parallel *parallel;
};

static void build_one(void *context, unsigned subject)
{
    const struct builds *builds = context;
    build_subject(&builds->subjects[subject], builds->settings, builds->parallel);
}

/* Builds both subjects in turns. */
static void measure_builds(struct subject *subjects, const struct settings *settings, const struct parallel *parallel,
                           uint32_t threads)
{
    static double times[2][BENCH_TURNS_MAX];
    const clockid_t clock = threads == 1 ? CLOCK_THREAD_CPUTIME_ID : CLOCK_PROCESS_CPUTIME_ID;
    struct builds builds = {subjects, settings, parallel};
    const struct bench_turns turns = {settings->turns, 2, clock, build_one, &builds};
    bench_take_turns(&turns, times);
    printf(
        "  built with %u threads: %.2f times as many strands a second; %s %.0f, %s %.0f strands a second and thread\n",
        threads, bench_ratio(times[1], times[0], settings->turns), subjects[0].name,
        settings->strands / bench_median(times[0], settings->turns), subjects[1].name,
        settings->strands / bench_median(times[1], settings->turns));
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
        bench_fail(error.text);
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

int main(int argc, char **argv)
{
    struct settings settings = {256, 15, HAIR_STRANDS, CLOUD_SIZE, 2, QUALITY_BALANCED};
    RTCDevice device = rtcNewDevice("threads=1");
    if (!device)
        bench_fail("no Embree device");
    for (int i = 1; i < argc; i++) {
        if (strcmp(argv[i], "--size") == 0 && i + 1 < argc)
            settings.size = bench_read_number(argv[++i], BENCH_TILE, 8192) / BENCH_TILE * BENCH_TILE;
        else if (strcmp(argv[i], "--turns") == 0 && i + 1 < argc)
            settings.turns = bench_read_number(argv[++i], 1, BENCH_TURNS_MAX);
        else if (strcmp(argv[i], "--strands") == 0 && i + 1 < argc)
            settings.strands = bench_read_number(argv[++i], 1, 1 << 20);
        else if (strcmp(argv[i], "--points") == 0 && i + 1 < argc)
            settings.points = bench_read_number(argv[++i], 1, 1 << 26);
        else if (strcmp(argv[i], "--threads") == 0 && i + 1 < argc)
            settings.threads = bench_read_number(argv[++i], 1, 256);
        else if (strcmp(argv[i], "--high") == 0)
            settings.quality = QUALITY_HIGH;
        else
            bench_fail("unknown option");
    }
    run_hair(&settings, device);
    run_cloud(&settings, device);
    rtcReleaseDevice(device);
    return 0;
}
