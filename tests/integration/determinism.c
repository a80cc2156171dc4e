/* SPDX-License-Identifier: Apache-2.0 */
/*
 * determinism.c - tests that the same request gives the same bytes: with 1, 2 and 8 threads, with the tasks of a build
 * in the orders that 1 to 64 threads may give them, and written with other strides, offsets and index widths.
 *
 *     determinism [--kinds flat|round|motion|all] [COUNT [SEED]]
 *     determinism --digest [--kinds flat|round|motion|all] [COUNT [SEED]]
 *
 * The requests are random ones, and generated meshes that are large enough to be cut into several pieces. They are of
 * triangles and boxes unless --kinds says that they are round, that they move, or that they are of all kinds. The exit
 * status is 1 if anything differs. With --digest it prints only one digest over all keys and blobs, which can be
 * compared between compilers and machines.
 */
#include <stdio.h>
#include <stdlib.h>

#include "builder/update/batch.h"
#include "builder/format/lavapipe.h"
#include "tests/support/builder/random_kind.h"
#include "tests/support/builder/random_top.h"
#include "builder/workers.h"

enum { TEAMS = 3, GRID = 260 }; /* 135,200 triangles: at least three pieces */

static const unsigned team_sizes[TEAMS] = {1, 2, 8};

struct run {
    struct memory memory;
    struct workers *workers[TEAMS];
    enum random_choice kinds;
    uint64_t digest, failures, blobs, bytes;
};

/* FNV-1a is good enough, because this test needs no protection against deliberate collisions. */
static void digest_bytes(struct run *run, const void *data, uint64_t size)
{
    const unsigned char *bytes = data;
    for (uint64_t i = 0; i < size; i++)
        run->digest = (run->digest ^ bytes[i]) * UINT64_C(0x100000001b3);
}

static void fail(struct run *run, const char *what, const char *how)
{
    fprintf(stderr, "determinism: %s: %s\n", what, how);
    run->failures++;
}

static bool build_one(struct run *run, const struct build_input *input, int team, const char *what,
                      struct batch_item *ret_item)
{
    struct build_context context = {.memory = &run->memory, .parallel = workers_parallel(run->workers[team])};
    struct limits limits = limits_default();
    struct bvhd_error error;
    enum bvhd_status status = batch_build(input, 1, &limits, &context, ret_item, &error);
    if (status != BVHD_OK || ret_item->status != BVHD_OK) {
        fail(run, what, status != BVHD_OK ? error.text : ret_item->error.text);
        if (status == BVHD_OK)
            batch_finish(ret_item, 1, &run->memory);
        return false;
    }
    return true;
}

static bool items_equal(const struct batch_item *a, const struct batch_item *b)
{
    return key_equal(&a->key, &b->key) && a->size == b->size && memcmp(a->blob, b->blob, a->size) == 0;
}

/*
 * Builds one request with every team of threads. Returns false if it could not be built; otherwise the caller ends
 * *ret_first.
 */
static bool build_with_all(struct run *run, const struct build_input *input, const char *what,
                           struct batch_item *ret_first)
{
    if (!build_one(run, input, 0, what, ret_first))
        return false;
    digest_bytes(run, &ret_first->key, sizeof ret_first->key);
    digest_bytes(run, ret_first->blob, ret_first->size);
    run->blobs++;
    run->bytes += ret_first->size;
    for (int team = 1; team < TEAMS; team++) {
        struct batch_item item;
        if (!build_one(run, input, team, what, &item))
            continue;
        if (!items_equal(ret_first, &item))
            fail(run, what, team == 1 ? "1 and 2 threads differ" : "1 and 8 threads differ");
        batch_finish(&item, 1, &run->memory);
    }
    return true;
}

/* ---- random requests ---- */

/* Makes a third of the requests for a driver's own format, in either variant. */
static void choose_target(struct build_input *input, struct random *random)
{
    if (!random_chance(random, 0.33))
        return;
    input->options.target = TARGET_LAVAPIPE;
    input->options.layout_flags = 0;
    input->options.device =
        (struct device_format){.driver_uuid = "determinism", .variant = 1 + random_below(random, LAVAPIPE_VARIANTS)};
}

static void run_bottom(struct run *run, struct random *random)
{
    struct random_input bottom;
    struct batch_item item;
    random_input_bottom_of(&bottom, random, 3000, run->kinds);
    if (bottom.kind->shape == ORACLE_TRIANGLES && !random_input_moves(&bottom))
        choose_target(&bottom.input, random);
    if (build_with_all(run, &bottom.input, "a random bottom level", &item))
        batch_finish(&item, 1, &run->memory);
    random_input_finish(&bottom);
}

static void run_top(struct run *run, struct random *random)
{
    struct random_top top;
    struct batch_item item;
    random_top_init_of(&top, random, 200, run->kinds);
    for (uint32_t i = 0; i < top.bottom_count; i++) {
        if (!build_with_all(run, &top.bottoms[i].input, "a bottom level", &item))
            continue;
        top.references[i].key = item.key;
        top.references[i].bounds = item.summary.bounds;
        top.references[i].slabs = item.summary.slabs;
        batch_finish(&item, 1, &run->memory);
    }
    if (!top.moves)
        choose_target(&top.input, random);
    if (build_with_all(run, &top.input, "a random top level", &item))
        batch_finish(&item, 1, &run->memory);
    random_top_finish(&top);
}

/* ---- one mesh, encoded in many ways ---- */

struct mesh {
    float (*positions)[3];
    uint32_t (*triangles)[3];
    uint32_t vertex_count, triangle_count;
};

static void *allocate(size_t size)
{
    void *block = malloc(size);
    if (!block) {
        fprintf(stderr, "determinism: no memory\n");
        exit(1);
    }
    return block;
}

/* Hills on a grid. Some triangles get a random corner, so that boxes overlap. */
static struct mesh make_mesh(uint32_t side, uint64_t seed)
{
    struct mesh mesh = {.vertex_count = (side + 1) * (side + 1), .triangle_count = 2 * side * side};
    struct random random = {seed};
    mesh.positions = allocate(mesh.vertex_count * sizeof *mesh.positions);
    mesh.triangles = allocate(mesh.triangle_count * sizeof *mesh.triangles);
    for (uint32_t i = 0; i < mesh.vertex_count; i++) {
        double x = (double)(i % (side + 1)) / side, y = (double)(i / (side + 1)) / side;
        mesh.positions[i][0] = (float)(x + random_between(&random, -0.3, 0.3) / side);
        mesh.positions[i][1] = (float)(y + random_between(&random, -0.3, 0.3) / side);
        mesh.positions[i][2] = (float)(x * (1 - x) * y * y + random_between(&random, 0, 0.2) / side);
    }
    for (uint32_t i = 0; i < side * side; i++) {
        uint32_t at = i / side * (side + 1) + i % side;
        const uint32_t quad[2][3] = {{at, at + 1, at + side + 2}, {at, at + side + 2, at + side + 1}};
        memcpy(mesh.triangles[2 * (size_t)i], quad, sizeof quad);
        if (random_chance(&random, 0.01)) {
            uint32_t corner = random_below(&random, 3);
            mesh.triangles[2 * (size_t)i][corner] = random_below(&random, mesh.vertex_count);
        }
    }
    return mesh;
}

static void free_mesh(struct mesh *mesh)
{
    free(mesh->positions);
    free(mesh->triangles);
}

/* How a mesh is encoded in a request. */
struct writing {
    const char *name;
    uint32_t format, stride, first_vertex, index_type, offset;
};

static const struct writing writings[] = {
    {"tightly", 106, 12, 0, INDEX_UINT32, 0},
    {"in a wide stride", 106, 36, 0, INDEX_UINT32, 0},
    {"with four components", 109, 16, 0, INDEX_UINT32, 0},
    {"in double", 118, 24, 0, INDEX_UINT32, 0},
    {"behind a first vertex", 106, 16, 5, INDEX_UINT32, 0},
    {"at an index offset", 106, 12, 0, INDEX_UINT32, 20},
    {"with 16-bit indices", 106, 12, 0, INDEX_UINT16, 0},
    {"with 16-bit indices, otherwise too", 121, 40, 3, INDEX_UINT16, 6},
};

enum { WRITINGS = sizeof writings / sizeof writings[0] };

static unsigned char *write_vertices(const struct mesh *mesh, const struct writing *writing, uint64_t *ret_size)
{
    uint64_t size = (uint64_t)writing->stride * (writing->first_vertex + mesh->vertex_count);
    unsigned char *bytes = allocate(size);
    memset(bytes, 0x55, size);
    for (uint32_t i = 0; i < mesh->vertex_count; i++) {
        unsigned char *at = bytes + (uint64_t)writing->stride * (writing->first_vertex + i);
        double wide[3] = {mesh->positions[i][0], mesh->positions[i][1], mesh->positions[i][2]};
        if (writing->format >= 115)
            memcpy(at, wide, sizeof wide);
        else
            memcpy(at, mesh->positions[i], sizeof mesh->positions[i]);
    }
    *ret_size = size;
    return bytes;
}

static unsigned char *write_indices(const struct mesh *mesh, const struct writing *writing, uint64_t *ret_size)
{
    uint32_t width = writing->index_type == INDEX_UINT16 ? 2 : 4;
    uint64_t size = writing->offset + (uint64_t)width * 3 * mesh->triangle_count;
    unsigned char *bytes = allocate(size);
    memset(bytes, 0xaa, size);
    for (uint32_t i = 0; i < 3 * mesh->triangle_count; i++)
        memcpy(bytes + writing->offset + (uint64_t)width * i, &mesh->triangles[i / 3][i % 3], width);
    *ret_size = size;
    return bytes;
}

static struct geometry write_mesh(const struct mesh *mesh, const struct writing *writing)
{
    struct geometry geometry = {.type = GEOMETRY_TRIANGLES, .flags = GEOMETRY_OPAQUE};
    struct geometry_triangles *triangles = &geometry.triangles;
    triangles->vertex_format = writing->format;
    triangles->vertex_stride = writing->stride;
    triangles->max_vertex = writing->first_vertex + mesh->vertex_count - 1;
    triangles->index_type = writing->index_type;
    triangles->vertices.data = write_vertices(mesh, writing, &triangles->vertices.size);
    triangles->indices.data = write_indices(mesh, writing, &triangles->indices.size);
    geometry.range = (struct geometry_range){mesh->triangle_count, writing->offset, writing->first_vertex, 0};
    return geometry;
}

static void run_writing(struct run *run, const struct mesh *mesh, const struct writing *writing,
                        const struct build_options *options, const struct batch_item *first)
{
    struct geometry geometry = write_mesh(mesh, writing);
    struct build_input input = {
        .type = STRUCTURE_BOTTOM, .geometry_count = 1, .geometries = &geometry, .options = *options};
    struct batch_item item;
    if (build_one(run, &input, 1, writing->name, &item)) {
        if (!items_equal(first, &item))
            fail(run, writing->name, "the same mesh has another key or other bytes");
        batch_finish(&item, 1, &run->memory);
    }
    free((void *)(uintptr_t)geometry.triangles.vertices.data);
    free((void *)(uintptr_t)geometry.triangles.indices.data);
}

/* Compares every encoding of a mesh with the first; encodings with 16-bit indices only where the indices fit. */
static void run_mesh(struct run *run, uint32_t side, const struct build_options *options)
{
    struct mesh mesh = make_mesh(side, side);
    struct geometry geometry = write_mesh(&mesh, &writings[0]);
    struct build_input input = {.type = STRUCTURE_BOTTOM, .geometry_count = 1, .geometries = &geometry};
    struct batch_item first;
    input.options = *options;
    if (build_with_all(run, &input, build_quality_name(options->quality), &first)) {
        for (int i = 1; i < WRITINGS; i++)
            if (writings[i].index_type == INDEX_UINT32 || mesh.vertex_count <= 65536)
                run_writing(run, &mesh, &writings[i], &input.options, &first);
        batch_finish(&first, 1, &run->memory);
    }
    free((void *)(uintptr_t)geometry.triangles.vertices.data);
    free((void *)(uintptr_t)geometry.triangles.indices.data);
    free_mesh(&mesh);
}

static const struct {
    uint32_t side;
    struct build_options options;
} meshes[] = {
    {40, {.quality = QUALITY_FAST, .target = TARGET_PORTABLE, .layout_flags = PORTABLE_FAST_TRIANGLES}},
    {GRID, {.quality = QUALITY_FAST, .target = TARGET_PORTABLE}},
    {40, {.quality = QUALITY_BALANCED, .target = TARGET_PORTABLE}},
    {GRID, {.quality = QUALITY_BALANCED, .target = TARGET_PORTABLE}},
    {60, {.quality = QUALITY_HIGH, .target = TARGET_PORTABLE}},
    {GRID, {.quality = QUALITY_BALANCED, .target = TARGET_LAVAPIPE, .device = {.variant = LAVAPIPE_PLAIN}}},
    {60, {.quality = QUALITY_HIGH, .target = TARGET_LAVAPIPE, .device = {.variant = LAVAPIPE_COMPACTED}}},
};

/* ---- round primitives of several pieces ---- */

enum { LARGE = 50000 };

static void run_large(struct run *run, const struct random_kind *kind, enum build_quality quality, uint64_t seed)
{
    struct random random = {seed};
    struct random_input input = {.kind = kind};
    struct batch_item item;
    input.input = (struct build_input){.type = STRUCTURE_BOTTOM,
                                       .geometry_count = 1,
                                       .geometries = input.geometries,
                                       .options = {.quality = quality, .target = TARGET_PORTABLE}};
    kind->make(&input, 0, LARGE, &random);
    if (build_with_all(run, &input.input, build_quality_name(quality), &item))
        batch_finish(&item, 1, &run->memory);
    random_input_finish(&input);
}

static void run_round(struct run *run)
{
    for (enum build_quality quality = QUALITY_FAST; quality <= QUALITY_HIGH; quality++) {
        run_large(run, &random_spheres, quality, (uint64_t)quality);
        run_large(run, &random_swept_spheres, quality, 7 * (uint64_t)quality);
    }
}

/* ---- meshes that move, of several pieces ---- */

struct moving_mesh {
    struct mesh start, end;
    struct geometry geometry;
};

static struct moving_mesh make_moving(uint32_t side)
{
    struct moving_mesh moving = {make_mesh(side, side), make_mesh(side, side + 1), {0}};
    moving.geometry = write_mesh(&moving.start, &writings[0]);
    moving.geometry.type = GEOMETRY_MOVING_TRIANGLES;
    struct geometry_triangles *triangles = &moving.geometry.triangles;
    triangles->end_vertices.data = write_vertices(&moving.end, &writings[0], &triangles->end_vertices.size);
    return moving;
}

static void free_moving(struct moving_mesh *moving)
{
    free((void *)(uintptr_t)moving->geometry.triangles.vertices.data);
    free((void *)(uintptr_t)moving->geometry.triangles.end_vertices.data);
    free((void *)(uintptr_t)moving->geometry.triangles.indices.data);
    free_mesh(&moving->start);
    free_mesh(&moving->end);
}

static void run_moving(struct run *run)
{
    struct moving_mesh moving = make_moving(GRID);
    for (enum build_quality quality = QUALITY_FAST; quality <= QUALITY_HIGH; quality++) {
        const struct build_input input = {.type = STRUCTURE_BOTTOM,
                                          .flags = BUILD_MOTION,
                                          .geometry_count = 1,
                                          .geometries = &moving.geometry,
                                          .options = {.quality = quality, .target = TARGET_PORTABLE}};
        struct batch_item item;
        if (build_with_all(run, &input, build_quality_name(quality), &item))
            batch_finish(&item, 1, &run->memory);
    }
    free_moving(&moving);
}

/* ---- every number of threads ---- */

enum { MOST_THREADS = 64, PIECES_GRID = 72 }; /* 10,368 triangles: several pieces in each quality */

/*
 * Takes the place of a number of threads, because 64 real ones take minutes on a busy machine of two processors. The
 * tasks run in an order that depends on the number of threads, and in which later tasks come before earlier ones.
 */
static void shuffled_for_each(const struct parallel *self, size_t count, parallel_task task, void *context)
{
    const size_t steps = self->threads < count ? self->threads : count;
    for (size_t start = steps; start-- > 0;)
        for (size_t i = start; i < count; i += steps)
            task(context, i);
}

/* Builds the mesh as if with each number of threads, and compares with the expected result. */
static void run_numbers(struct run *run, const struct build_input *input, const struct batch_item *expected)
{
    const struct limits limits = limits_default();
    for (unsigned threads = 1; threads <= MOST_THREADS; threads++) {
        const struct parallel parallel = {.threads = threads, .for_each = shuffled_for_each};
        const struct build_context context = {.memory = &run->memory, .parallel = &parallel};
        struct batch_item item;
        struct bvhd_error error;
        char what[64];
        snprintf(what, sizeof what, "%s, %u threads", build_quality_name(input->options.quality), threads);
        if (batch_build(input, 1, &limits, &context, &item, &error) != BVHD_OK) {
            fail(run, what, error.text);
            continue;
        }
        if (item.status != BVHD_OK || !items_equal(expected, &item))
            fail(run, what, "other bytes than with 1 thread");
        batch_finish(&item, 1, &run->memory);
    }
}

static void run_all_qualities(struct run *run, const struct geometry *geometry, uint32_t flags)
{
    for (enum build_quality quality = QUALITY_FAST; quality <= QUALITY_HIGH; quality++) {
        const struct build_input input = {.type = STRUCTURE_BOTTOM,
                                          .flags = flags,
                                          .geometry_count = 1,
                                          .geometries = geometry,
                                          .options = {.quality = quality, .target = TARGET_PORTABLE}};
        struct batch_item expected;
        if (!build_one(run, &input, 0, "a mesh of several pieces", &expected))
            continue;
        run_numbers(run, &input, &expected);
        batch_finish(&expected, 1, &run->memory);
    }
}

static void run_all_numbers(struct run *run)
{
    struct mesh mesh = make_mesh(PIECES_GRID, PIECES_GRID);
    struct geometry geometry = write_mesh(&mesh, &writings[0]);
    run_all_qualities(run, &geometry, 0);
    free((void *)(uintptr_t)geometry.triangles.vertices.data);
    free((void *)(uintptr_t)geometry.triangles.indices.data);
    free_mesh(&mesh);
}

static void run_all_numbers_moving(struct run *run)
{
    struct moving_mesh moving = make_moving(PIECES_GRID);
    run_all_qualities(run, &moving.geometry, BUILD_MOTION);
    free_moving(&moving);
}

/* ---- all cases ---- */

static bool run_init(struct run *run)
{
    struct bvhd_error error;
    *run = (struct run){.digest = UINT64_C(0xcbf29ce484222325)};
    memory_init(&run->memory, UINT64_MAX);
    enum bvhd_status status = BVHD_OK;
    for (int team = 0; team < TEAMS && status == BVHD_OK; team++)
        status = workers_create(team_sizes[team], &run->workers[team], &error);
    if (status != BVHD_OK)
        fprintf(stderr, "determinism: %s\n", error.text);
    return status == BVHD_OK;
}

static void run_finish(struct run *run)
{
    for (int team = 0; team < TEAMS; team++)
        workers_destroy(run->workers[team]);
    if (run->memory.live)
        fail(run, "memory", "something is left");
}

int main(int argc, char **argv)
{
    bool digest_only = argc > 1 && strcmp(argv[1], "--digest") == 0;
    char **rest = argv + (digest_only ? 2 : 1);
    int rest_count = argc - (digest_only ? 2 : 1);
    enum random_choice kinds = RANDOM_FLAT;
    if (rest_count > 1 && strcmp(rest[0], "--kinds") == 0) {
        if (!random_choice_from_name(rest[1], &kinds))
            return 2;
        rest += 2;
        rest_count -= 2;
    }
    uint64_t count = rest_count > 0 ? strtoull(rest[0], NULL, 10) : 100;
    uint64_t seed = rest_count > 1 ? strtoull(rest[1], NULL, 10) : 1;
    struct run run;
    if (!run_init(&run))
        return 1;
    run.kinds = kinds;
    for (uint64_t i = seed; i < seed + count; i++) {
        struct random random = {i * UINT64_C(0x632be59bd9b4e019)};
        (i % 4 ? run_bottom : run_top)(&run, &random);
    }
    for (size_t i = 0; kinds != RANDOM_ROUND && i < sizeof meshes / sizeof meshes[0]; i++)
        run_mesh(&run, meshes[i].side, &meshes[i].options);
    if (kinds != RANDOM_ROUND && !digest_only)
        run_all_numbers(&run);
    if (kinds != RANDOM_FLAT)
        run_round(&run);
    if (kinds == RANDOM_MOTION || kinds == RANDOM_ALL)
        run_moving(&run);
    if ((kinds == RANDOM_MOTION || kinds == RANDOM_ALL) && !digest_only)
        run_all_numbers_moving(&run);
    run_finish(&run);
    if (digest_only)
        printf("%016llx\n", (unsigned long long)run.digest);
    else
        printf("digest %016llx over %llu structures, %llu bytes; %llu differences\n", (unsigned long long)run.digest,
               (unsigned long long)run.blobs, (unsigned long long)run.bytes, (unsigned long long)run.failures);
    return run.failures != 0;
}
