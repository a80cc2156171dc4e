/* SPDX-License-Identifier: Apache-2.0 */
/*
 * shader_scenes.c - tests ray queries of the shaders over whole scenes.
 *
 *     shader_scenes [--device NAME] [--rays N] [--seed S] [--address] [--fast-triangles] [--plain-bytes] [--fused-fma]
 *                   SCENE...
 *
 * Each ray is compared with the CPU traversal, and where they differ, with brute force in double. A SCENE is a PLY
 * file, a directory of `bvhctl build`, or the name of an adversarial scene of make_scene. Half of the rays are aimed at
 * triangles from outside, half are random ones inside.
 *
 * It prints one line for each scene. The exit status is 3 when a ray is certainly wrong or more than 1 of 10,000 rays
 * differ, and 77 without such a device.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "tests/support/scene/adversarial.h"
#include "builder/update/batch.h"
#include "client/bvhctl/service/local.h"
#include "tests/bench/ply_input.h"
#include "client/bvhctl/oracle/rays.h"
#include "tests/support/builder/builders.h"
#include "tests/support/shader/shader_judge.h"
#include "client/bvhctl/scene/structures.h"

enum { ADVERSARIAL_SIZE = 4000, MOST_OF_A_CALL = 1 << 20 };

struct arguments {
    struct shader_bed_options bed;
    uint64_t rays, seed;
    bool fast_triangles;
    int scene; /* index of the first one in argv */
};

struct run {
    struct arguments options;
    struct local local;
    struct shader_bed *bed;
    uint64_t scenes; /* that were built */
    bool has_failed;
};

static void must(enum bvhd_status status, const struct bvhd_error *error)
{
    if (status == BVHD_OK)
        return;
    fprintf(stderr, "shader_scenes: %s: %s\n", error->where, error->text);
    exit(1);
}

static void print_tally(const char *name, const struct shader_tally *tally)
{
    printf("%-24s rays %8llu hits %8llu other bits of t %7llu differing %5llu: ties %5llu uncertain %5llu boxes %llu "
           "certain %llu (%.1e of all differ)\n",
           name, (unsigned long long)tally->rays, (unsigned long long)tally->hits,
           (unsigned long long)tally->other_bits, (unsigned long long)tally->differing,
           (unsigned long long)tally->right, (unsigned long long)tally->uncertain, (unsigned long long)tally->boxes,
           (unsigned long long)tally->certain, (double)tally->differing / (double)tally->rays);
    fflush(stdout);
}

static void trace(struct run *run, const char *name, const struct scene *scene)
{
    struct shader_case shared = {.cull_mask = 0xff};
    struct shader_tally tally = {0};
    struct shader_meshes meshes;
    uint32_t most = run->options.rays < MOST_OF_A_CALL ? (uint32_t)run->options.rays : MOST_OF_A_CALL;
    struct ray *rays = calloc(most, sizeof *rays);
    struct shader_answer *answers = calloc(most, sizeof *answers);
    shader_bed_load(run->bed, scene);
    shader_meshes_make(scene, &shared, &meshes);
    for (uint64_t done = 0; done < run->options.rays; done += most) {
        uint32_t count = run->options.rays - done < most ? (uint32_t)(run->options.rays - done) : most;
        rays_make(meshes.meshes, meshes.count, run->options.seed + done, count, rays);
        shader_bed_trace(run->bed, rays, count, shared.policy, answers);
        shader_judge(name, scene, &shared, rays, count, answers, run->local.parallel, &run->local.memory, &tally);
    }
    print_tally(name, &tally);
    run->has_failed = run->has_failed || tally.certain || (tally.differing * 10000 > tally.rays && tally.differing > 3);
    shader_meshes_finish(&meshes);
    free(answers);
    free(rays);
}

static void trace_mesh(struct run *run, const char *name, const struct ply *ply)
{
    struct bvhd_error error;
    struct limits limits = limits_default();
    struct build_context context = {.memory = &run->local.memory, .parallel = run->local.parallel};
    struct geometry geometry;
    struct build_input input = ply_input(ply, QUALITY_BALANCED, &geometry);
    struct batch_item item;
    struct portable_view view;
    const struct portable_view *bottoms[1] = {&view};
    struct scene scene = {.bottoms = bottoms, .bottom_count = 1};
    input.options.layout_flags = run->options.fast_triangles ? PORTABLE_FAST_TRIANGLES : 0;
    input.options.builder = builders_turn(run->scenes++);
    must(batch_build(&input, 1, &limits, &context, &item, &error), &error);
    must(item.status, &item.error);
    must(portable_open((struct bytes){item.blob, item.size}, &run->local.memory, &view, &error), &error);
    trace(run, name, &scene);
    batch_finish(&item, 1, &run->local.memory);
}

static void trace_adversarial(struct run *run, const struct adversarial *adversarial)
{
    struct mesh mesh = {0};
    struct random random = {run->options.seed};
    adversarial->make(&mesh, ADVERSARIAL_SIZE, &random);
    struct ply ply = {mesh.vertex_count, mesh.triangle_count, mesh.vertices[0], mesh.triangles[0]};
    trace_mesh(run, adversarial->name, &ply);
    mesh_finish(&mesh);
}

static void trace_directory(struct run *run, const char *name)
{
    struct bvhd_error error;
    struct structures structures;
    must(structures_open(name, NULL, &run->local.memory, &structures, &error), &error);
    const struct portable_view **bottoms = memory_array(&run->local.memory, structures.file_count, sizeof *bottoms);
    if (!bottoms)
        exit(1);
    for (uint32_t i = 0; i < structures.file_count; i++) {
        bottoms[i] = structures.blobs[i].data ? &structures.files[i].structure.view.portable : NULL;
        if (structures.files[i].structure.moves) {
            fprintf(stderr, "shader_scenes: %s: it moves; shader_agreement --kinds motion tests that\n", name);
            exit(1);
        }
    }
    const struct scene scene = {.top = structures.has_top ? bottoms[structures.bottom_count] : NULL,
                                .bottoms = bottoms,
                                .bottom_count = structures.bottom_count};
    trace(run, name, &scene);
    memory_free(&run->local.memory, bottoms);
    structures_close(&structures);
}

static void trace_scene(struct run *run, const char *name)
{
    struct stat status;
    const struct adversarial *adversarial = adversarial_find(name);
    if (adversarial) {
        trace_adversarial(run, adversarial);
    } else if (stat(name, &status) == 0 && S_ISDIR(status.st_mode)) {
        trace_directory(run, name);
    } else {
        struct ply *ply = ply_read(name);
        if (!ply)
            exit(1);
        const char *slash = strrchr(name, '/');
        trace_mesh(run, slash ? slash + 1 : name, ply);
        ply_free(ply);
    }
}

static struct arguments parse(int argc, char **argv)
{
    struct arguments options = {.bed.device = "auto", .rays = 20000, .seed = 1, .scene = 1};
    for (; options.scene < argc && argv[options.scene][0] == '-'; options.scene++) {
        const char *name = argv[options.scene], *next = options.scene + 1 < argc ? argv[options.scene + 1] : "";
        if (strcmp(name, "--address") == 0)
            options.bed.by_address = true;
        else if (strcmp(name, "--fast-triangles") == 0)
            options.fast_triangles = true;
        else if (strcmp(name, "--plain-bytes") == 0)
            options.bed.plain_bytes = true;
        else if (strcmp(name, "--fused-fma") == 0)
            options.bed.fused_fma = true;
        else if (strcmp(name, "--device") == 0)
            options.bed.device = next, options.scene++;
        else if (strcmp(name, "--rays") == 0)
            options.rays = strtoull(next, NULL, 10), options.scene++;
        else if (strcmp(name, "--seed") == 0)
            options.seed = strtoull(next, NULL, 10), options.scene++;
        else
            options.scene = argc;
    }
    if (options.scene >= argc || options.rays == 0) {
        fprintf(stderr, "usage: shader_scenes [--device NAME] [--rays N] [--seed S] [--address] [--fast-triangles] "
                        "[--plain-bytes] [--fused-fma] SCENE...\n");
        exit(2);
    }
    return options;
}

int main(int argc, char **argv)
{
    struct bvhd_error error;
    struct run run = {.options = parse(argc, argv)};
    must(local_open(&run.local, 0, UINT64_C(1) << 34, &error), &error);
    if (shader_bed_create(&run.options.bed, &run.local.memory, &run.bed, &error) != BVHD_OK) {
        fprintf(stderr, "shader_scenes: skipped: %s\n", error.text);
        local_close(&run.local);
        return 77;
    }
    printf("%s\n", shader_bed_device(run.bed));
    for (int i = run.options.scene; i < argc; i++)
        trace_scene(&run, argv[i]);
    shader_bed_destroy(run.bed);
    local_close(&run.local);
    return run.has_failed || gpu_messages() ? 3 : 0;
}
