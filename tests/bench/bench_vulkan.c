/* SPDX-License-Identifier: Apache-2.0 */
/*
 * bench_vulkan.c - measures rays a second on a Vulkan device: through our structures, and through those that the driver
 * builds from the same triangles. See --help.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "client/bvhctl/picture/agreement.h"
#include "tests/bench/bench_vulkan_busy.h"
#include "tests/bench/bench_vulkan_kernel.h"
#include "tests/bench/bench_vulkan_rays.h"
#include "tests/bench/bench_vulkan_scene.h"
#include "builder/build.h"
#include "client/bvhctl/base/json.h"
#include "tests/support/driver/ray_pipeline.h"
#include "client/bvhctl/picture/surface.h"
#include "client/bvhctl/trace/device_ray.h"
#include "client/bvhctl/trace/tracer_portable.h"
#include "builder/workers.h"

static const char help[] =
    "usage: bench_vulkan [OPTION]... DIR...\n"
    "Traces the same rays through the structures in each DIR (of `bvhctl build`, target portable) and through those "
    "that\n"
    "the driver builds from the same triangles (PREFER_FAST_TRACE, compacted), alternating, and prints medians in\n"
    "millions of rays a second by the device's clock. Ratios are relative to the driver's ray queries where it has "
    "them,\n"
    "else to its ray-tracing pipeline. Of the hits it prints how many are the same in all of t, u, v, primitive, "
    "geometry,\n"
    "instance and custom index; how many are tied (equal t, another primitive); and how many are neither (other).\n"
    "  --device NAME      the device to use; default: the best\n"
    "  --rays N           rays of each kind; default 65536\n"
    "  --kinds LIST       some of primary,diffuse,surface,random; default: all\n"
    "  --runs N           repetitions; default 5\n"
    "  --native           also builds for the driver's own format, in this process, and traces with ray queries\n"
    "  --shuffle SEED     shuffles the triangles of each geometry before all builds\n"
    "  --quality NAME     quality of builds in this process: fast, balanced or high; default balanced\n"
    "  --fast-triangles   builds the portable structures again, with 48-byte triangles\n"
    "  --kernel SPEC      NAME=FILE.spv[:CONSTANT,...], another kernel over the portable structures; may be repeated\n"
    "  --ways             also measures each of the library's own kernels separately\n"
    "  --no-portable      leaves out the library's own kernels\n"
    "  --save-rays DIR    writes the rays of each kind to DIR/SCENE-KIND.rays, as struct bvhd_ray (bvhd_trace.h)\n"
    "  --check            compares with the CPU traversal, and resolves differences by brute force\n"
    "  --statistics       prints the driver's statistics of each --kernel: registers, spills\n"
    "                     (needs VK_KHR_pipeline_executable_properties)\n"
    "  --bottom           leaves out top levels of one instance: the portable structures have none then, and the\n"
    "                     driver's get one of their own\n"
    "  --threads N        threads of this process; default: one for each processor\n"
    "  --json FILE        writes the figures to FILE\n";

enum { BUSY_MS = 15, COUNTED_RAYS = 16384 };

enum { MAX_KERNELS = 64, MAX_CONTESTANTS = MAX_KERNELS + 8, MAX_RUNS = 99 };

struct settings {
    const char *device, *json, *rays_directory;
    uint32_t rays, runs, threads;
    bool kinds[RAYS_KINDS];
    bool is_native, is_shuffled, is_fast_triangles, is_checked, without_portable, has_statistics, is_bottom, has_ways;
    uint64_t seed;
    enum build_quality quality;
    const char *kernels[MAX_KERNELS];
    uint32_t kernel_count;
};

struct contestant {
    const char *name;
    struct tracer *tracer;
    bool has_top; /* its hits name instances */
    struct tracer_hit *hits;
    double seconds[MAX_RUNS];
    uint64_t bytes;
};

struct totals {
    const char *name;
    double log_ratio, worst;
    uint32_t count;
};

struct bench {
    struct settings settings;
    struct memory memory;
    struct workers *workers;
    const struct parallel *parallel;
    struct gpu *gpu;
    struct bench_busy busy;
    struct json json;
    struct totals totals[MAX_CONTESTANTS];
    uint64_t mismatches;

    /* The rest belongs to the scene that is being measured. */
    const char *directory;
    struct bench_scene scene;
    struct bench_driver driver;
    struct structures native, portable; /* built in this process */
    struct bench_rays rays;
    struct contestant contestants[MAX_CONTESTANTS];
    uint32_t contestant_count;
};

static _Noreturn void die(const char *where, const char *text)
{
    fprintf(stderr, "bench_vulkan: %s: %s\n", where, text);
    exit(1);
}

static void must(enum bvhd_status status, const struct bvhd_error *error)
{
    if (status != BVHD_OK)
        die(error->where, error->text);
}

/* ---- One scene ---- */

static const struct structures *portable_of(const struct bench *bench)
{
    return bench->portable.files ? &bench->portable : &bench->scene.given;
}

static uint64_t bytes_of(const struct structures *structures)
{
    uint64_t bytes = 0;
    for (uint32_t i = 0; i < structures->file_count; i++)
        bytes += structures->files[i].is_shared ? 0 : structures->files[i].size;
    return bytes;
}

static struct contestant *add(struct bench *bench, const char *name, bool has_top, uint64_t bytes)
{
    struct contestant *one = &bench->contestants[bench->contestant_count++];
    *one = (struct contestant){.name = name, .has_top = has_top, .bytes = bytes};
    one->hits = memory_array(&bench->memory, bench->settings.rays + 64, sizeof *one->hits);
    if (!one->hits)
        die(name, "no memory");
    return one;
}

static void build_again(struct bench *bench, enum target target, struct structures *ret_structures)
{
    struct bvhd_error error;
    struct build_options options = {.quality = bench->settings.quality, .target = target};
    if (target == TARGET_PORTABLE && bench->settings.is_fast_triangles)
        options.layout_flags = PORTABLE_FAST_TRIANGLES;
    if (target != TARGET_PORTABLE) {
        void *probe;
        uint64_t size;
        struct bvhd_format format;
        must(bvhd_vulkan_probe(bench->gpu->library, &bench->gpu->queue, &probe, &size, &error), &error);
        must(bvhd_format_from_probe(probe, size, &format, &error), &error);
        bvhd_vulkan_free(probe);
        memcpy(options.device.driver_uuid, format.driver_uuid, sizeof format.driver_uuid);
        memcpy(options.device.compatibility_uuid, format.compatibility_uuid, sizeof format.compatibility_uuid);
        options.device.variant = format.variant;
    }
    struct build_context context = {.memory = &bench->memory, .parallel = bench->parallel};
    must(bench_scene_build(&bench->scene, &options, &context, ret_structures, &error), &error);
}

static void add_driver(struct bench *bench)
{
    struct bvhd_error error;
    must(bench_driver_build(bench->gpu, &bench->scene, &bench->memory, &bench->driver, &error), &error);
    if (bench->gpu->properties.has_ray_query) {
        struct contestant *query = add(bench, "driver, ray query", true, bench->driver.bytes);
        must(tracer_query_create(bench->gpu, bench->driver.top.handle, &bench->memory, &query->tracer, &error), &error);
    }
    if (bench->gpu->properties.has_ray_pipeline) {
        struct contestant *pipeline = add(bench, "driver, pipeline", true, bench->driver.bytes);
        must(ray_pipeline_create(bench->gpu, bench->driver.top.handle, &bench->memory, &pipeline->tracer, &error),
             &error);
    }
}

static void add_ours(struct bench *bench)
{
    struct bvhd_error error;
    const struct settings *settings = &bench->settings;
    if (settings->is_native) {
        build_again(bench, TARGET_LAVAPIPE, &bench->native);
        struct contestant *native = add(bench, "native, ray query", bench->native.has_top, bytes_of(&bench->native));
        must(tracer_native_create(bench->gpu, &bench->native, &bench->memory, &native->tracer, &error), &error);
    }
    if (settings->is_shuffled || settings->is_fast_triangles)
        build_again(bench, TARGET_PORTABLE, &bench->portable);
    const struct structures *portable = portable_of(bench);
    for (int way = TRACER_WAY_AUTO; way <= (settings->has_ways ? TRACER_WAY_INCOHERENT : TRACER_WAY_AUTO); way++) {
        static const char *const names[] = {"portable", "portable, query", "portable, coherent",
                                            "portable, incoherent"};
        if (settings->without_portable)
            break;
        struct contestant *one = add(bench, names[way], portable->has_top, bytes_of(portable));
        must(tracer_portable_create(bench->gpu, portable, &bench->memory, &one->tracer, &error), &error);
        tracer_portable_set_way(one->tracer, (enum tracer_way)way);
    }
    for (uint32_t i = 0; i < settings->kernel_count; i++) {
        struct contestant *one = add(bench, settings->kernels[i], portable->has_top, bytes_of(portable));
        must(bench_kernel_create(bench->gpu, settings->kernels[i], settings->has_statistics, portable, &bench->memory,
                                 &one->tracer, &error),
             &error);
        one->name = one->tracer->device;
    }
}

static int compare_doubles(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static void run_all(struct bench *bench, const struct ray *rays, uint32_t count)
{
    struct bvhd_error error;
    double unused;
    for (uint32_t i = 0; i < bench->contestant_count; i++)
        must(bench->contestants[i].tracer->trace(bench->contestants[i].tracer, rays, count, bench->contestants[i].hits,
                                                 &unused, &error),
             &error);
    for (uint32_t run = 0; run < bench->settings.runs; run++)
        for (uint32_t i = 0; i < bench->contestant_count; i++) {
            struct contestant *one = &bench->contestants[i];
            must(bench_busy_run(&bench->busy, &error), &error);
            must(one->tracer->trace(one->tracer, rays, count, one->hits, &one->seconds[run], &error), &error);
        }
    for (uint32_t i = 0; i < bench->contestant_count; i++)
        qsort(bench->contestants[i].seconds, bench->settings.runs, sizeof(double), compare_doubles);
}

struct comparison {
    uint64_t same, tied, other;
};

static bool is_same(const struct tracer_hit *a, const struct tracer_hit *b, bool instances)
{
    return memcmp(&a->t, &b->t, 3 * sizeof(float)) == 0 && a->geometry == b->geometry && a->primitive == b->primitive &&
           (!instances || (a->instance == b->instance && a->custom_index == b->custom_index));
}

static struct comparison compare(const struct contestant *one, const struct contestant *other, uint32_t count)
{
    struct comparison all = {0};
    for (uint32_t i = 0; i < count; i++) {
        if (is_same(&one->hits[i], &other->hits[i], one->has_top && other->has_top))
            all.same++;
        else if (memcmp(&one->hits[i].t, &other->hits[i].t, sizeof(float)) == 0 && isfinite(one->hits[i].t))
            all.tied++;
        else
            all.other++;
    }
    return all;
}

static void check(struct bench *bench, const struct contestant *one, const struct ray *rays, uint32_t count,
                  const char *kind)
{
    struct bvhd_error error;
    struct surfaces surfaces;
    struct agreement agreement;
    must(surfaces_init(&surfaces, portable_of(bench), &bench->memory, &error), &error);
    agreement_init(&agreement, &surfaces, count, bench->parallel, &bench->memory);
    agreement.camera_stride = agreement.other_stride = 1;
    must(agreement_watch(&agreement, true, rays, one->hits, count, &error), &error);
    must(agreement_judge(&agreement, INFINITY, NULL, NULL, &error), &error);
    printf("  %-8s %-20s against the CPU: %llu rays, %llu differ, %llu of them uncertain, %llu wrong\n", kind,
           one->name, (unsigned long long)agreement.checked, (unsigned long long)agreement.differing,
           (unsigned long long)agreement.uncertain, (unsigned long long)agreement.mismatches);
    bench->mismatches += agreement.mismatches;
    agreement_finish(&agreement);
    surfaces_finish(&surfaces);
}

static void count_ratio(struct bench *bench, uint32_t index, double ratio)
{
    struct totals *totals = &bench->totals[index];
    totals->name = bench->contestants[index].name;
    totals->worst = totals->count == 0 || ratio < totals->worst ? ratio : totals->worst;
    totals->log_ratio += log(ratio);
    totals->count++;
}

static void write_row(struct bench *bench, const char *kind, uint32_t count, const struct contestant *one, double rate,
                      double ratio, const struct comparison *same)
{
    struct json *json = &bench->json;
    json_object(json, NULL);
    json_text(json, "scene", bench->scene.given.name);
    json_text(json, "kind", kind);
    json_text(json, "tracer", one->name);
    json_integer(json, "rays", count);
    json_integer(json, "bytes", one->bytes);
    json_number(json, "mrays_s", rate);
    json_number(json, "fastest", count / one->seconds[0] * 1e-6);
    json_number(json, "slowest", count / one->seconds[bench->settings.runs - 1] * 1e-6);
    json_number(json, "ratio", ratio);
    json_integer(json, "same", same->same);
    json_integer(json, "tied", same->tied);
    json_integer(json, "other", same->other);
    json_object_end(json);
}

static void report(struct bench *bench, const char *kind, uint32_t count)
{
    uint32_t runs = bench->settings.runs, middle = runs / 2;
    const struct contestant *first = &bench->contestants[0];
    for (uint32_t i = 0; i < bench->contestant_count; i++) {
        const struct contestant *one = &bench->contestants[i];
        struct comparison same = compare(one, first, count);
        double rate = count / one->seconds[middle] * 1e-6, ratio = first->seconds[middle] / one->seconds[middle];
        printf("  %-8s %-20s %9.3f Mray/s (%.3f - %.3f)  ratio %6.3f  %6.1f MiB  same %llu, tied %llu, other %llu\n",
               kind, one->name, rate, count / one->seconds[runs - 1] * 1e-6, count / one->seconds[0] * 1e-6, ratio,
               (double)one->bytes / 1048576, (unsigned long long)same.same, (unsigned long long)same.tied,
               (unsigned long long)same.other);
        count_ratio(bench, i, ratio);
        write_row(bench, kind, count, one, rate, ratio, &same);
    }
    fflush(stdout);
}

/* Prints the mean work of the CPU traversal for one of the rays. */
static void print_work(const struct bench *bench, const char *kind, const struct ray *rays, uint32_t count)
{
    static struct ray_hit found[COUNTED_RAYS + 1];
    struct bvhd_cpu_counters all = {.struct_size = sizeof all};
    uint32_t step = count / COUNTED_RAYS + 1, counted = (count + step - 1) / step, hits = 0;
    const struct bvhd_cpu_trace trace = {
        .struct_size = sizeof trace,
        .rays = rays,
        .ray_size = sizeof *rays,
        .ray_stride = step * sizeof *rays,
        .hits = found,
        .hit_size = sizeof *found,
        .ray_count = counted,
        .counters = &all,
    };
    bvhd_cpu_scene_trace(portable_of(bench)->scene, &trace, NULL);
    for (uint32_t i = 0; i < counted; i++)
        hits += found[i].handle != RAY_NO_BOTTOM;
    printf("  %-8s %u rays; in the portable structure a ray visits %.1f nodes, %.1f triangles, %.1f instances; %.0f %% "
           "hit\n",
           kind, count, (double)all.nodes / counted, (double)all.triangles / counted, (double)all.instances / counted,
           100.0 * hits / counted);
}

/* For programs that are to trace the same rays. */
static void save_rays(const struct bench *bench, const char *kind, const struct ray *rays, uint32_t count)
{
    char path[4096];
    struct bvhd_ray one;
    snprintf(path, sizeof path, "%s/%s-%s.rays", bench->settings.rays_directory, bench->scene.given.name, kind);
    FILE *file = fopen(path, "wb");
    bool is_written = file;
    for (uint32_t i = 0; i < count && is_written; i++) {
        device_rays_put(&rays[i], 1, &one);
        is_written = fwrite(&one, sizeof one, 1, file) == 1;
    }
    if (!is_written || fclose(file))
        die(path, "cannot be written");
}

static void measure(struct bench *bench)
{
    for (int kind = 0; kind < RAYS_KINDS; kind++) {
        uint32_t count = bench->rays.count[kind];
        if (!bench->settings.kinds[kind] || !count)
            continue;
        print_work(bench, bench_rays_names[kind], bench->rays.rays[kind], count);
        if (bench->settings.rays_directory)
            save_rays(bench, bench_rays_names[kind], bench->rays.rays[kind], count);
        run_all(bench, bench->rays.rays[kind], count);
        report(bench, bench_rays_names[kind], count);
        for (uint32_t i = 0; bench->settings.is_checked && i < bench->contestant_count; i++)
            if (bench->contestants[i].tracer->target == TARGET_PORTABLE)
                check(bench, &bench->contestants[i], bench->rays.rays[kind], count, bench_rays_names[kind]);
    }
}

static void run_scene(struct bench *bench, const char *directory)
{
    struct bvhd_error error;
    struct bench_rays_options rays = {.count = bench->settings.rays};
    const struct bench_scene_options options = {directory, bench->settings.is_bottom, bench->settings.is_shuffled,
                                                bench->settings.seed};
    bench->contestant_count = 0;
    must(bench_scene_open(&options, &bench->memory, bench->parallel, &bench->scene, &error), &error);
    memcpy(rays.kinds, bench->settings.kinds, sizeof rays.kinds);
    must(bench_rays_make(&bench->scene, &rays, bench->parallel, &bench->memory, &bench->rays, &error), &error);
    add_driver(bench);
    add_ours(bench);
    printf("%s: %llu triangles%s; the driver's build took %.1f ms\n", bench->scene.given.name,
           (unsigned long long)bench->scene.triangle_count, bench->settings.is_shuffled ? ", shuffled" : "",
           bench->driver.build_ms);
    measure(bench);
    for (uint32_t i = 0; i < bench->contestant_count; i++) {
        tracer_destroy(bench->contestants[i].tracer);
        memory_free(&bench->memory, bench->contestants[i].hits);
    }
    bench_rays_finish(&bench->rays);
    structures_close(&bench->native);
    structures_close(&bench->portable);
    bench_driver_destroy(&bench->driver);
    bench_scene_close(&bench->scene);
}

/* ---- All scenes ---- */

static void summarise(struct bench *bench)
{
    struct json *json = &bench->json;
    json_array_end(json);
    json_array(json, "summary");
    for (uint32_t i = 0; i < MAX_CONTESTANTS && bench->totals[i].count; i++) {
        struct totals *totals = &bench->totals[i];
        double mean = exp(totals->log_ratio / totals->count);
        printf("%-20s geometric mean of ratios %.3f, worst %.3f, of %u\n", totals->name, mean, totals->worst,
               totals->count);
        json_object(json, NULL);
        json_text(json, "tracer", totals->name);
        json_number(json, "mean", mean);
        json_number(json, "worst", totals->worst);
        json_object_end(json);
    }
    json_array_end(json);
}

static void write_json(struct bench *bench)
{
    json_object_end(&bench->json);
    json_newline(&bench->json);
    FILE *file = bench->settings.json ? fopen(bench->settings.json, "w") : NULL;
    if (bench->settings.json &&
        (!file || bench->json.failed || fwrite(bench->json.data, 1, bench->json.size, file) != bench->json.size ||
         fclose(file)))
        die(bench->settings.json, "cannot be written");
    json_finish(&bench->json);
}

static uint32_t number(const char *option, const char *text, uint32_t most)
{
    char *end;
    unsigned long value = text ? strtoul(text, &end, 10) : 0;
    if (!text || *end || end == text || value > most)
        die(option, "a number is needed");
    return (uint32_t)value;
}

static void choose_kinds(struct settings *settings, const char *list)
{
    for (int kind = 0; kind < RAYS_KINDS; kind++)
        settings->kinds[kind] = list && strstr(list, bench_rays_names[kind]);
}

static enum build_quality quality_of(const char *name)
{
    for (enum build_quality quality = QUALITY_FAST; quality <= QUALITY_HIGH; quality++)
        if (name && !strcmp(name, build_quality_name(quality)))
            return quality;
    die("--quality", "fast, balanced or high");
}

/* Returns how many arguments the option took: 0 when it is none. */
static int take_option(struct settings *settings, char **arguments)
{
    const char *name = arguments[0], *value = arguments[1];
    const struct {
        const char *name;
        bool *flag;
    } flags[] = {{"--native", &settings->is_native},
                 {"--fast-triangles", &settings->is_fast_triangles},
                 {"--no-portable", &settings->without_portable},
                 {"--statistics", &settings->has_statistics},
                 {"--bottom", &settings->is_bottom},
                 {"--ways", &settings->has_ways},
                 {"--check", &settings->is_checked}};
    for (size_t i = 0; i < sizeof flags / sizeof *flags; i++)
        if (!strcmp(name, flags[i].name)) {
            *flags[i].flag = true;
            return 1;
        }
    if (!strcmp(name, "--device"))
        settings->device = value;
    else if (!strcmp(name, "--json"))
        settings->json = value;
    else if (!strcmp(name, "--save-rays"))
        settings->rays_directory = value;
    else if (!strcmp(name, "--rays"))
        settings->rays = number(name, value, 1 << 26);
    else if (!strcmp(name, "--runs"))
        settings->runs = number(name, value, MAX_RUNS);
    else if (!strcmp(name, "--threads"))
        settings->threads = number(name, value, WORKERS_MAX_THREADS);
    else if (!strcmp(name, "--kinds"))
        choose_kinds(settings, value);
    else if (!strcmp(name, "--quality"))
        settings->quality = quality_of(value);
    else if (!strcmp(name, "--shuffle")) {
        settings->is_shuffled = true;
        settings->seed = number(name, value, UINT32_MAX);
    } else if (!strcmp(name, "--kernel") && settings->kernel_count < MAX_KERNELS)
        settings->kernels[settings->kernel_count++] = value;
    else
        return 0;
    return value ? 2 : 0;
}

/* Returns the index of the first argument that is no option. */
static int take_options(struct settings *settings, int argc, char **argv)
{
    int at = 1;
    while (at < argc && argv[at][0] == '-') {
        int taken = take_option(settings, argv + at);
        if (!taken) {
            bool asked = !strcmp(argv[at], "--help");
            fputs(help, asked ? stdout : stderr);
            exit(asked ? 0 : 2);
        }
        at += taken;
    }
    if (at == argc || !settings->runs || !settings->device) {
        fputs(help, stderr);
        exit(2);
    }
    return at;
}

int main(int argc, char **argv)
{
    static struct bench bench = {.settings = {.device = "auto",
                                              .rays = 65536,
                                              .runs = 5,
                                              .kinds = {true, true, true, true},
                                              .quality = QUALITY_BALANCED}};
    struct bvhd_error error;
    int at = take_options(&bench.settings, argc, argv);
    setvbuf(stdout, NULL, _IOLBF, 0);
    memory_init(&bench.memory, UINT64_MAX);
    must(workers_create(bench.settings.threads, &bench.workers, &error), &error);
    bench.parallel = workers_parallel(bench.workers);
    must(gpu_open(bench.settings.device, &bench.memory, &bench.gpu, &error), &error);
    must(bench_busy_init(&bench.busy, bench.gpu, BUSY_MS, &error), &error);
    json_init(&bench.json, &bench.memory, true);
    json_object(&bench.json, NULL);
    json_integer(&bench.json, "schema", 1);
    json_text(&bench.json, "device", bench.gpu->properties.name);
    json_text(&bench.json, "driver", bench.gpu->properties.driver);
    json_array(&bench.json, "results");
    printf("%s, %s\n", bench.gpu->properties.name, bench.gpu->properties.driver);
    for (; at < argc; at++)
        run_scene(&bench, argv[at]);
    summarise(&bench);
    write_json(&bench);
    bench_busy_finish(&bench.busy);
    gpu_close(bench.gpu);
    workers_destroy(bench.workers);
    return bench.mismatches ? 3 : 0;
}
