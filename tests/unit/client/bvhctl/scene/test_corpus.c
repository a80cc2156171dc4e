/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_corpus.c - tests that everything that a release of bvhctl has ever written is still read, and that rays still
 * find in it what they found then.
 *
 * tests/corpus/VERSION has directories and containers, and for each a file NAME.answers. With BVHD_WRITE_GOLDEN=1 in
 * the environment, answers that are missing are written; those that are there stay.
 */
#include "tests/support/unit.h"

#include <dirent.h>
#include <math.h>
#include <unistd.h>

#include <bvhd/bvhd_cpu.h>
#include <bvhd/bvhd_scene.h>

#include "client/bvhctl/scene/structures.h"
#include "client/bvhctl/scene/survey.h"
#include "tests/support/random.h"

enum { RAYS = 100, PATH_SIZE = 1024, LINE_SIZE = 160 };

static char corpus[PATH_SIZE / 4];

/* Returns whether a name ends with the ending. */
static bool ends_with(const char *name, const char *ending)
{
    size_t length = strlen(name), wanted = strlen(ending);
    return length > wanted && strcmp(name + length - wanted, ending) == 0;
}

/* The rays depend on the bounds alone: half of them aim from outside into the box, half start inside. */
static struct ray make_ray(struct random *random, const float bounds[6], int number)
{
    struct ray ray = {.tmax = INFINITY, .cull_mask = 0xff};
    double from[3], to[3];
    random_point(random, from);
    random_point(random, to);
    for (int axis = 0; axis < 3; axis++) {
        double centre = ((double)bounds[axis] + (double)bounds[axis + 3]) / 2;
        double half = ((double)bounds[axis + 3] - (double)bounds[axis]) / 2 + 0.01;
        ray.origin[axis] = (float)(centre + from[axis] * half * (number % 2 ? 4 : 1));
        ray.direction[axis] = (float)(centre + to[axis] * half) - ray.origin[axis];
    }
    return ray;
}

static uint32_t bits_of(float value)
{
    uint32_t bits;
    memcpy(&bits, &value, sizeof bits);
    return bits;
}

/* Writes the answer to a ray as a line: "-" or the hit, with the bits of its floats. */
static void answer(const struct structures *structures, const struct ray *ray, char line[LINE_SIZE])
{
    struct ray_hit hit;
    if (!structures_trace(structures, ray, &hit))
        snprintf(line, LINE_SIZE, "-\n");
    else
        snprintf(line, LINE_SIZE, "%08x %08x %08x %u %u %u %u %u\n", bits_of(hit.t), bits_of(hit.u), bits_of(hit.v),
                 hit.instance, hit.custom_index, hit.geometry, hit.primitive, hit.front_face);
}

static void find_bounds(const struct structures *structures, float ret_bounds[6])
{
    structure_bounds(&structures->files[structures->file_count - 1].structure, ret_bounds);
}

static void write_answers(const char *path, const struct structures *structures)
{
    struct random random = {7};
    float bounds[6];
    char line[LINE_SIZE];
    FILE *file = fopen(path, "w");
    assert_non_null(file);
    find_bounds(structures, bounds);
    for (int i = 0; i < RAYS; i++) {
        struct ray ray = make_ray(&random, bounds, i);
        answer(structures, &ray, line);
        fputs(line, file);
    }
    assert_int_equal(fclose(file), 0);
}

static void compare_answers(const char *path, const struct structures *structures)
{
    struct random random = {7};
    float bounds[6];
    char line[LINE_SIZE], stored[LINE_SIZE];
    int hits = 0;
    FILE *file = fopen(path, "r");
    if (!file)
        fail_msg("%s: there are no answers; BVHD_WRITE_GOLDEN=1 writes them", path);
    find_bounds(structures, bounds);
    for (int i = 0; i < RAYS; i++) {
        struct ray ray = make_ray(&random, bounds, i);
        answer(structures, &ray, line);
        if (!fgets(stored, sizeof stored, file) || strcmp(line, stored) != 0)
            fail_msg("%s: ray %d: %s instead of %s", path, i, line, stored);
        hits += line[0] != '-';
    }
    fclose(file);
    if (hits < RAYS / 10)
        fail_msg("%s: only %d rays hit something", path, hits);
}

static void describe(const struct structures *structures, struct memory *memory)
{
    struct bvhd_error error;
    for (uint32_t i = 0; i < structures->file_count; i++) {
        struct survey survey;
        if (survey_take(&structures->files[i].structure, memory, &survey, &error) != BVHD_OK)
            fail_msg("%s: %s: %s", structures->files[i].name, error.where, error.text);
        assert_true(survey.depth > 0 && survey.figure_count > 0);
    }
}

/* Makes a scene for the CPU of a top level, as a program does: of the structures in place, in the order of rows. */
static void trace_in_place(const char *path, const struct bvhd_scene *scene, uint32_t top_number)
{
    const struct bvhd_scene_structure *top = bvhd_scene_get_structure(scene, top_number);
    struct bvhd_cpu_blob *blobs = calloc((size_t)top->bottom_count + 1, sizeof *blobs);
    struct bvhd_cpu_scene *traced;
    struct bvhd_error error;
    float bounds[6];
    assert_non_null(blobs);
    for (uint32_t r = 0; r < top->bottom_count; r++) {
        const struct bvhd_scene_structure *bottom = bvhd_scene_get_structure(scene, top->bottoms[r]);
        blobs[r] = (struct bvhd_cpu_blob){bottom->data, bottom->size};
    }
    blobs[top->bottom_count] = (struct bvhd_cpu_blob){top->data, top->size};
    const struct bvhd_cpu_scene_options options = {
        .struct_size = sizeof options, .blobs = blobs, .blob_count = top->bottom_count + 1};
    if (bvhd_cpu_scene_create(&options, &traced, &error) != BVHD_OK)
        fail_msg("%s: %s: %s", path, error.where, error.text);
    bvhd_cpu_scene_bounds(traced, bounds);
    for (int axis = 0; axis < 3; axis++) {
        float size = top->bounds[axis + 3] - top->bounds[axis];
        assert_true(fabsf(bounds[axis] - top->bounds[axis]) <= 1e-4f * (1 + size));
        assert_true(fabsf(bounds[axis + 3] - top->bounds[axis + 3]) <= 1e-4f * (1 + size));
    }
    bvhd_cpu_scene_destroy(traced);
    free(blobs);
}

static void read_by_library(const char *path)
{
    struct bvhd_scene *scene;
    struct bvhd_error error;
    if (bvhd_scene_open(path, 0, &scene, &error) != BVHD_OK)
        fail_msg("%s: %s: %s", path, error.where, error.text);
    assert_true(bvhd_scene_structure_count(scene) > 1 && bvhd_scene_top_count(scene) > 0);
    for (uint32_t i = 0; i < bvhd_scene_top_count(scene); i++)
        trace_in_place(path, scene, bvhd_scene_top(scene, i));
    bvhd_scene_close(scene);
}

/* Opens one entry, as a directory or as a container. */
static void check_entry(const char *path)
{
    char answers[PATH_SIZE];
    struct memory memory;
    struct structures structures;
    struct bvhd_error error;
    memory_init(&memory, UINT64_MAX);
    if (structures_open(path, NULL, &memory, &structures, &error) != BVHD_OK)
        fail_msg("%s: %s: %s", path, error.where, error.text);
    describe(&structures, &memory);
    snprintf(answers, sizeof answers, "%s.answers", path);
    if (getenv("BVHD_WRITE_GOLDEN") && access(answers, F_OK) != 0)
        write_answers(answers, &structures);
    compare_answers(answers, &structures);
    structures_close(&structures);
    assert_int_equal(memory.live, 0);
    if (ends_with(path, ".bvhd"))
        read_by_library(path);
}

/* Calls the function for what is in a folder, in any order, and returns how much that is. */
static int for_each(const char *folder, int (*call)(const char *path))
{
    int count = 0;
    DIR *directory = opendir(folder);
    if (!directory)
        fail_msg("%s: there is no such folder", folder);
    for (struct dirent *entry; (entry = readdir(directory));) {
        char path[PATH_SIZE];
        bool is_entry = entry->d_name[0] != '.' && !ends_with(entry->d_name, ".answers") &&
                        !ends_with(entry->d_name, ".md") && !ends_with(entry->d_name, ".sh");
        snprintf(path, sizeof path, "%.*s/%s", PATH_SIZE / 2, folder, entry->d_name);
        count += is_entry ? call(path) : 0;
    }
    closedir(directory);
    return count;
}

static int check_and_count(const char *path)
{
    check_entry(path);
    return 1;
}

static int check_release(const char *path)
{
    int count = for_each(path, check_and_count);
    if (count == 0)
        fail_msg("%s: it has no files", path);
    return count;
}

/* The number may only grow. */
static void every_release_is_read(void **state)
{
    (void)state;
    assert_true(for_each(corpus, check_release) >= 7);
}

static int find_corpus(void **state)
{
    (void)state;
    const char *golden = getenv("BVHD_GOLDEN");
    snprintf(corpus, sizeof corpus, "%.200s/../corpus", golden ? golden : "tests/golden");
    return 0;
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(every_release_is_read)};
    return cmocka_run_group_tests(tests, find_corpus, NULL);
}
