/* SPDX-License-Identifier: Apache-2.0 */
/*
 * bench_motion_instances.c - measures rays through instances that move, beside the same instances that stand still as
 * they are at half time.
 *
 *     bench_motion_instances [--size N] [--turns N] [--count N] MESH.ply
 *
 * N instances of the mesh are turned at random and placed in a cube, so that their boxes overlap a little. Each moves
 * by a matrix: by up to a fifth of its size, and it is sheared a little. It prints rays a second of both: the primary
 * rays of a picture in tiles, and rays in all directions from where these hit. All rays are in one call; first all have
 * the time 0.5, so that the hits are the same, then each has a time of its own. Subjects take turns; the figures are
 * medians over the turns, of rates and of their ratios within a turn, in processor time.
 */
#include "builder/traverse/motion.h"
#include "builder/update/batch.h"
#include "tests/bench/bench_rays.h"
#include "tests/bench/ply_input.h"

enum { STILL_WORDS = 16, MOVING_WORDS = 40, MATRIX = 12, MATRIX_FIELDS = 2 + 2 * MATRIX };

enum who { MOVING, STILL, SUBJECTS };

static const char *const names[SUBJECTS] = {"moving", "still"};

/* The words of a record. */
union word {
    uint32_t number;
    float value;
};

struct bed {
    struct memory memory;
    struct batch_item bottom, tops[SUBJECTS];
    struct bvhd_cpu_scene *scenes[SUBJECTS];
    union word *records[SUBJECTS];
    uint32_t count;
};

static void build_one(struct bed *bed, struct build_input *input, struct batch_item *item)
{
    const struct limits limits = limits_default();
    const struct build_context context = {.memory = &bed->memory, .parallel = &parallel_serial};
    struct bvhd_error error = {0};
    if (batch_build(input, 1, &limits, &context, item, &error) != BVHD_OK || item->status != BVHD_OK) {
        fprintf(stderr, "%s %s %s %s\n", error.where, error.text, item->error.where, item->error.text);
        bench_fail("a structure does not build");
    }
}

/* Makes a matrix that turns by an angle about the z axis, after a permutation of the axes, and moves to a place. */
static void place(float matrix[MATRIX], double angle, uint32_t order, const double at[3])
{
    const double rows[3][3] = {{cos(angle), -sin(angle), 0}, {sin(angle), cos(angle), 0}, {0, 0, 1}};
    for (uint32_t row = 0; row < 3; row++) {
        for (uint32_t column = 0; column < 3; column++)
            matrix[4 * row + column] = (float)rows[row][(column + order) % 3];
        matrix[4 * row + 3] = (float)at[row];
    }
}

/* Fills the records of both top levels. Their reference is the number 1. */
static void make_records(struct bed *bed, const struct box *box)
{
    struct random random = {17};
    double size = 0;
    for (int axis = 0; axis < 3; axis++)
        size = fmax(size, (double)box->max[axis] - box->min[axis]);
    for (uint32_t i = 0; i < bed->count; i++) {
        union word *moving = bed->records[MOVING] + (size_t)MOVING_WORDS * i,
                   *still = bed->records[STILL] + (size_t)STILL_WORDS * i;
        float keys[2][MATRIX];
        double at[3], way[3];
        random_point(&random, at);
        random_point(&random, way);
        const double angle = random_between(&random, 0, 6.28);
        const uint32_t order = random_next(&random) % 3;
        for (int axis = 0; axis < 3; axis++)
            at[axis] *= 0.5 * size * cbrt(bed->count);
        place(keys[0], angle, order, at);
        for (int axis = 0; axis < 3; axis++)
            at[axis] += 0.1 * size * way[axis];
        place(keys[1], angle + 0.2, order, at);
        moving[0].number = MOTION_MATRIX;
        for (uint32_t k = 0; k < MATRIX; k++) {
            moving[2 + k].value = keys[0][k];
            moving[2 + MATRIX + k].value = keys[1][k];
            still[k].value = motion_number(keys[0][k], keys[1][k], motion_weights_at(0.5f));
        }
        moving[MATRIX_FIELDS].number = still[MATRIX].number = 0xff000000;
        moving[MATRIX_FIELDS + 2].number = still[MATRIX + 2].number = 1;
    }
}

static void open_scene(struct bed *bed, enum who who)
{
    const struct bvhd_cpu_blob blobs[2] = {{bed->bottom.blob, bed->bottom.size},
                                           {bed->tops[who].blob, bed->tops[who].size}};
    bed->scenes[who] = bench_open(blobs, 2);
}

static void make_bed(struct bed *bed, const struct ply *ply)
{
    struct geometry geometry;
    struct build_input bottom = ply_input(ply, QUALITY_BALANCED, &geometry);
    memory_init(&bed->memory, UINT64_MAX);
    build_one(bed, &bottom, &bed->bottom);
    bed->records[MOVING] = bench_need((uint64_t)bed->count * MOVING_WORDS * 4);
    bed->records[STILL] = bench_need((uint64_t)bed->count * STILL_WORDS * 4);
    make_records(bed, &bed->bottom.summary.bounds);
    for (enum who who = MOVING; who < SUBJECTS; who++) {
        const uint64_t size = (uint64_t)bed->count * (who == MOVING ? MOVING_WORDS : STILL_WORDS) * 4;
        const struct reference reference = {.kind = REFERENCE_BLAS,
                                            .handle = 1,
                                            .has_key = true,
                                            .key = bed->bottom.key,
                                            .bounds = bed->bottom.summary.bounds,
                                            .slabs = bed->bottom.summary.slabs};
        const struct geometry instances = {.type = who == MOVING ? GEOMETRY_MOVING_INSTANCES : GEOMETRY_INSTANCES,
                                           .instances.records = {(const unsigned char *)bed->records[who], size},
                                           .range.primitive_count = bed->count};
        struct build_input top = {.type = STRUCTURE_TOP,
                                  .flags = who == MOVING ? BUILD_MOTION : 0,
                                  .geometry_count = 1,
                                  .geometries = &instances,
                                  .references = &reference,
                                  .reference_count = 1,
                                  .options = {.quality = QUALITY_BALANCED, .target = TARGET_PORTABLE}};
        const double start = bench_now(CLOCK_THREAD_CPUTIME_ID);
        build_one(bed, &top, &bed->tops[who]);
        printf("  %-8s built in %.2f ms, %llu bytes\n", names[who], 1e3 * (bench_now(CLOCK_THREAD_CPUTIME_ID) - start),
               (unsigned long long)bed->tops[who].size);
        open_scene(bed, who);
    }
}

/* ---- Rays ---- */

/* Rays of a tile of pixels follow one another. */
static void make_primary(const float bounds[6], uint32_t size, struct bench_rays *rays)
{
    for (uint32_t i = 0; i < rays->count; i++) {
        const uint32_t tile = i / (BENCH_TILE * BENCH_TILE), pixel = i % (BENCH_TILE * BENCH_TILE),
                       row = size / BENCH_TILE;
        const double at[3] = {(tile % row * BENCH_TILE + pixel % BENCH_TILE + 0.5) / size,
                              (tile / row * BENCH_TILE + pixel / BENCH_TILE + 0.5) / size, 0.5};
        struct bvhd_cpu_ray *ray = &rays->rays[i];
        *ray = (struct bvhd_cpu_ray){.tmax = FLT_MAX, .mask = 0xff, .time = 0.5f};
        for (int axis = 0; axis < 3; axis++) {
            const double extent = (double)bounds[3 + axis] - bounds[axis];
            ray->origin[axis] = (float)(bounds[axis] + extent * (axis == 2 ? -1.2 : 0.7));
            ray->direction[axis] = (float)(bounds[axis] + extent * at[axis] - ray->origin[axis]);
        }
    }
}

/* Rays in all directions from where others hit, or begin. */
static void make_scattered(const struct bench_rays *primary, struct bench_rays *rays)
{
    struct random random = {5};
    for (uint32_t i = 0; i < rays->count; i++) {
        const struct bvhd_cpu_ray *from = &primary->rays[i];
        const struct bvhd_cpu_hit *hit = &primary->hits[i];
        const double t = hit->blob == BVHD_CPU_NO_BLOB ? 1 : 0.999 * (double)hit->t;
        double turn[3];
        random_point(&random, turn);
        rays->rays[i] = *from;
        for (int axis = 0; axis < 3; axis++) {
            rays->rays[i].origin[axis] = (float)(from->origin[axis] + t * from->direction[axis]);
            rays->rays[i].direction[axis] = (float)turn[axis];
        }
    }
}

/* Rays that both subjects trace, and how many of them have hit. */
struct comparison {
    const struct bed *bed;
    const struct bench_rays *rays;
    uint32_t hits[SUBJECTS];
};

static void trace_one(void *context, unsigned subject)
{
    struct comparison *all = context;
    all->hits[subject] = bench_trace(all->bed->scenes[subject], all->rays, NULL);
}

/* Traces rays by both subjects in turns. `is_same` says that the hits must be. */
static void compare(const struct bed *bed, const struct bench_rays *rays, uint32_t turns, const char *what,
                    bool is_same)
{
    static double times[SUBJECTS][BENCH_TURNS_MAX];
    struct comparison all = {.bed = bed, .rays = rays};
    const struct bench_turns in_turns = {turns, SUBJECTS, CLOCK_THREAD_CPUTIME_ID, trace_one, &all};
    struct bvhd_cpu_counters counters[SUBJECTS] = {{.struct_size = sizeof *counters},
                                                   {.struct_size = sizeof *counters}};
    bench_take_turns(&in_turns, times);
    for (unsigned i = 0; i < SUBJECTS; i++)
        bench_trace(bed->scenes[i], rays, &counters[i]);
    const double ratio = bench_ratio(times[STILL], times[MOVING], turns);
    printf("  %-24s %.3f of still (%.2f and %.2f Mray/s, %.1f and %.1f nodes, %.2f and %.2f instances a ray)\n", what,
           ratio, 1e-6 * rays->count / bench_median(times[MOVING], turns),
           1e-6 * rays->count / bench_median(times[STILL], turns), (double)counters[MOVING].nodes / rays->count,
           (double)counters[STILL].nodes / rays->count, (double)counters[MOVING].instances / rays->count,
           (double)counters[STILL].instances / rays->count);
    if (is_same && all.hits[MOVING] != all.hits[STILL])
        bench_fail("instances that move are hit otherwise than those that stand still");
}

static void run(const char *path, uint32_t count, uint32_t size, uint32_t turns)
{
    struct ply *ply = ply_read(path);
    struct bed bed = {.count = count};
    struct random random = {3};
    float bounds[6];
    if (!ply)
        bench_fail(path);
    printf("%s: %u triangles, %u instances\n", path, ply->triangle_count, count);
    make_bed(&bed, ply);
    struct bench_rays primary = bench_rays_make(size * size), scattered = bench_rays_make(size * size);
    bvhd_cpu_scene_bounds(bed.scenes[STILL], bounds);
    make_primary(bounds, size, &primary);
    bench_trace(bed.scenes[STILL], &primary, NULL);
    make_scattered(&primary, &scattered);
    compare(&bed, &primary, turns, "primary", true);
    compare(&bed, &scattered, turns, "scattered", true);
    for (uint32_t i = 0; i < primary.count; i++)
        primary.rays[i].time = scattered.rays[i].time = (float)random_between(&random, 0, 1);
    compare(&bed, &primary, turns, "primary, own times", false);
    compare(&bed, &scattered, turns, "scattered, own times", false);
    for (unsigned i = 0; i < SUBJECTS; i++) {
        bvhd_cpu_scene_destroy(bed.scenes[i]);
        batch_finish(&bed.tops[i], 1, &bed.memory);
        free(bed.records[i]);
    }
    batch_finish(&bed.bottom, 1, &bed.memory);
    bench_rays_free(&primary);
    bench_rays_free(&scattered);
    ply_free(ply);
}

int main(int argc, char **argv)
{
    uint32_t size = 256, turns = 9, count = 1000;
    for (int i = 1; i < argc; i++) {
        if (strcmp(argv[i], "--size") == 0 && i + 1 < argc)
            size = bench_read_number(argv[++i], BENCH_TILE, 8192) / BENCH_TILE * BENCH_TILE;
        else if (strcmp(argv[i], "--turns") == 0 && i + 1 < argc)
            turns = bench_read_number(argv[++i], 1, BENCH_TURNS_MAX);
        else if (strcmp(argv[i], "--count") == 0 && i + 1 < argc)
            count = bench_read_number(argv[++i], 1, 1000000);
        else
            run(argv[i], count, size, turns);
    }
    return 0;
}
