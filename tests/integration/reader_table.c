/* SPDX-License-Identifier: Apache-2.0 */
/*
 * reader_table.c - reads every generated scene file of scene_case.h and prints a table: what the file is about, what is
 * expected, what came of it. With a path of bvhctl each file is also built by it. Its status is 1 if a row is wrong.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include "client/bvhctl/scene/import.h"
#include "proto/base/clock.h"
#include "tests/support/scene/scene_case.h"

enum { RESULT_SIZE = 256, OUTPUT_SIZE = 1 << 16 };

/* The result of reading a file. */
struct found {
    enum bvhd_status status;
    char error[RESULT_SIZE * 2]; /* "where: text" */
    struct scene_expected scene;
    uint32_t lost; /* triangles that assimp did not make, and that `scene` has because they may be missing */
    double milliseconds;
};

static int usage(void)
{
    fputs("usage: reader_table [--write DIR | --soon] [BVHCTL]\n"
          "Prints a table of what is read of each generated scene file. --write writes the files into folders of DIR,\n"
          "one for each reader, and reads nothing. --soon leaves out files whose limit of time sanitizers raise.\n",
          stderr);
    return 2;
}

static void fail(const char *what)
{
    perror(what);
    exit(1);
}

static void write_file(const char *path, const void *data, size_t size)
{
    unlink(path);
    FILE *file = fopen(path, "wb");
    if (!file || fwrite(data, 1, size, file) != size || fclose(file) != 0)
        fail(path);
}

static void extend(const struct import *import, const struct import_instance *instance, bool all_vertices,
                   struct scene_expected *scene)
{
    const struct import_bottom *bottom = &import->bottoms[instance->bottom];
    for (uint32_t m = 0; m < bottom->mesh_count; m++) {
        const struct import_mesh *mesh = &import->meshes[bottom->meshes[m]];
        uint64_t count = all_vertices ? mesh->vertex_count : UINT64_C(3) * mesh->primitive_count;
        for (uint64_t i = 0; i < count; i++) {
            const float *at = mesh->positions + 3 * (all_vertices ? i : mesh->indices[i]), *row = instance->transform;
            for (int axis = 0; axis < 3; axis++, row += 4) {
                float value = row[0] * at[0] + row[1] * at[1] + row[2] * at[2] + row[3];
                scene->low[axis] = value < scene->low[axis] ? value : scene->low[axis];
                scene->high[axis] = value > scene->high[axis] ? value : scene->high[axis];
            }
        }
    }
}

static void measure(const struct import *import, const struct scene_expected *expected, struct found *found)
{
    struct scene_expected *scene = &found->scene;
    *scene = (struct scene_expected){.triangles = (uint32_t)import->triangle_count,
                                     .instances = import->instance_count,
                                     .skipped = (uint32_t)import->skipped_instances,
                                     .low = {INFINITY, INFINITY, INFINITY},
                                     .high = {-INFINITY, -INFINITY, -INFINITY},
                                     .counts = import->counts};
    for (uint32_t i = 0; i < import->instance_count; i++)
        if (!import->instances[i].skipped)
            extend(import, &import->instances[i], expected->has_spare_vertices, scene);
    if (expected->may_lose) {
        found->lost = (uint32_t)import->counts.lost;
        scene->triangles += found->lost;
        scene->counts.lost = 0;
    }
}

static void read_case(const struct scene_case *scene_case, struct found *ret_found)
{
    struct memory memory;
    struct import import;
    struct bvhd_error error = {0};
    double start = clock_ms();
    memory_init(&memory, UINT64_MAX);
    *ret_found = (struct found){0};
    const struct import_moment moment = {.time = scene_case->at ? strtod(scene_case->at, NULL) : 0,
                                         .animation = scene_case->animation,
                                         .is_shutter = scene_case->until != NULL,
                                         .end = scene_case->until ? strtod(scene_case->until, NULL) : 0};
    const struct import_wish wish = {.scene = scene_case->scene, .moment = scene_case->at ? &moment : NULL};
    ret_found->status = import_scene_as(scene_case->file, &wish, &memory, &import, &error);
    ret_found->milliseconds = clock_ms() - start;
    snprintf(ret_found->error, sizeof ret_found->error, "%s: %s", error.where, error.text);
    if (ret_found->status)
        return;
    measure(&import, &scene_case->expected, ret_found);
    import_finish(&import);
}

static void describe(const struct scene_expected *scene, char ret_text[RESULT_SIZE])
{
    size_t used = (size_t)snprintf(ret_text, RESULT_SIZE, "%u triangles, %u instances, %g %g %g to %g %g %g",
                                   scene->triangles, scene->instances, scene->low[0], scene->low[1], scene->low[2],
                                   scene->high[0], scene->high[1], scene->high[2]);
    if (scene->skipped)
        used += (size_t)snprintf(ret_text + used, RESULT_SIZE - used, ", inactive %u", scene->skipped);
    for (int i = 0; i < IMPORT_COUNT_KINDS; i++)
        if (import_counts_get(&scene->counts, i))
            used += (size_t)snprintf(ret_text + used, RESULT_SIZE - used, ", %s %llu", import_count_kinds[i].name,
                                     (unsigned long long)import_counts_get(&scene->counts, i));
}

static bool is_same(const struct scene_expected *a, const struct scene_expected *b)
{
    bool same = a->triangles == b->triangles && a->instances == b->instances && a->skipped == b->skipped;
    for (int axis = 0; axis < 3; axis++)
        same = same && fabsf(a->low[axis] - b->low[axis]) <= 1e-5f && fabsf(a->high[axis] - b->high[axis]) <= 1e-5f;
    for (int i = 0; i < IMPORT_COUNT_KINDS; i++)
        same = same && import_counts_get(&a->counts, i) == import_counts_get(&b->counts, i);
    return same;
}

/* Runs bvhctl and returns its exit status, with the start of its output. */
static int run_bvhctl(const char *bvhctl, const struct scene_case *scene_case, char ret_output[OUTPUT_SIZE])
{
    char command[1024];
    snprintf(command, sizeof command, "'%s' --local build %s -o out --json --threads 1 %s%s %s%s%s%s %s%s 2>/dev/null",
             bvhctl, scene_case->file, scene_case->scene ? "--scene " : "", scene_case->scene ? scene_case->scene : "",
             scene_case->until ? "--shutter="
             : scene_case->at  ? "--at="
                               : "",
             scene_case->at ? scene_case->at : "", scene_case->until ? ":" : "",
             scene_case->until ? scene_case->until : "", scene_case->animation ? "--animation " : "",
             scene_case->animation ? scene_case->animation : "");
    FILE *pipe = popen(command, "r");
    if (!pipe)
        fail("popen");
    size_t size = fread(ret_output, 1, OUTPUT_SIZE - 1, pipe);
    ret_output[size] = '\0';
    int status = pclose(pipe);
    return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
}

/* Returns whether bvhctl ends with the right status, and builds as many triangles and instances as were read. */
static bool check_bvhctl(const char *bvhctl, const struct scene_case *scene_case, const struct found *found)
{
    static char output[OUTPUT_SIZE];
    char wanted[128];
    int status = run_bvhctl(bvhctl, scene_case, output);
    if (scene_case->status)
        return status == 1;
    snprintf(wanted, sizeof wanted, "\"triangles\":%u,\"instances\":%u,", found->scene.triangles - found->lost,
             found->scene.instances);
    const char *scenes = strstr(output, "\"scenes\":");
    return status == 0 && scenes && strstr(scenes, wanted);
}

static void print_row(const struct scene_case *scene_case, const struct found *found, const char *verdict)
{
    char expected[RESULT_SIZE], got[RESULT_SIZE];
    describe(&scene_case->expected, expected);
    if (scene_case->status)
        snprintf(expected, sizeof expected, "refused: %.200s", *scene_case->text ? scene_case->text : "by assimp");
    describe(&found->scene, got);
    if (found->status)
        snprintf(got, sizeof got, "refused: %.240s", found->error);
    printf("%-5s| %-38s| %-6s| %5.0f ms | %s\n", scene_case->format, scene_case->name, verdict, found->milliseconds,
           expected);
    if (scene_case->status || strcmp(expected, got) != 0)
        printf("%-5s| %-38s| %-6s| %8s | %s\n", "", "", "", "got", got);
}

/* Reads one file and prints its row. Returns whether it is right. */
static bool run_case(const struct scene_case *scene_case, const char *bvhctl)
{
    struct found found;
    write_file(scene_case->file, scene_case->bytes, scene_case->size);
    if (scene_case->second)
        write_file(scene_case->second, scene_case->second_bytes, scene_case->second_size);
    read_case(scene_case, &found);
    bool ok = found.status == scene_case->status;
    if (ok && found.status)
        ok = strstr(found.error, scene_case->text) != NULL;
    else if (ok)
        ok = is_same(&scene_case->expected, &found.scene);
    bool is_built = !bvhctl || check_bvhctl(bvhctl, scene_case, &found);
    print_row(scene_case, &found, !ok ? "WRONG" : is_built ? "right" : "BUILD");
    unlink(scene_case->file);
    return ok && is_built;
}

static int write_all(const char *folder)
{
    static struct scene_case scene_case;
    if (chdir(folder) != 0)
        fail(folder);
    for (uint32_t i = 0; i < scene_case_count(); i++) {
        scene_case_make(i, &scene_case);
        bool is_gltf = !strcmp(scene_case.format, "glTF"), is_ply = !strcmp(scene_case.format, "PLY");
        const char *reader = is_gltf ? "gltf" : is_ply ? "ply" : "assimp";
        char path[160];
        mkdir(reader, 0777);
        snprintf(path, sizeof path, "%s/%03u-%s", reader, i, scene_case.file);
        write_file(path, scene_case.bytes, scene_case.size);
    }
    return 0;
}

/* Reads all files in a scratch folder, which is removed again. */
static int run_all(const char *bvhctl, bool soon)
{
    static struct scene_case scene_case;
    char folder[] = "/tmp/bvhd-reader-table-XXXXXX", command[64];
    uint32_t right = 0, refused = 0, count = 0;
    if (!mkdtemp(folder) || chdir(folder) != 0)
        fail(folder);
    for (uint32_t i = 0; i < scene_case_count(); i++) {
        scene_case_make(i, &scene_case);
        if (soon && scene_case.is_endless)
            continue;
        count++;
        bool ok = run_case(&scene_case, bvhctl);
        right += ok && !scene_case.status;
        refused += ok && scene_case.status;
    }
    printf("%u files: %u read right, with all that is left out counted; %u refused by name; %u wrong\n", count, right,
           refused, count - right - refused);
    snprintf(command, sizeof command, "rm -rf '%s'", folder);
    return chdir("/") == 0 && system(command) == 0 && right + refused == count ? 0 : 1;
}

int main(int argc, char **argv)
{
    static char bvhctl[4096];
    if (argc == 3 && !strcmp(argv[1], "--write"))
        return write_all(argv[2]);
    bool soon = argc > 1 && !strcmp(argv[1], "--soon");
    argc -= soon;
    argv += soon;
    if (argc > 2 || (argc == 2 && argv[1][0] == '-'))
        return usage();
    if (argc == 2 && !realpath(argv[1], bvhctl))
        fail(argv[1]);
    return run_all(argc == 2 ? bvhctl : NULL, soon);
}
