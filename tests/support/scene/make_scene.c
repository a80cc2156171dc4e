/* SPDX-License-Identifier: Apache-2.0 */
/* make_scene - writes the generated scenes of tests and of the demonstration. Its usage text is its manual. */
#include <errno.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "tests/support/scene/adversarial.h"
#include "tests/support/scene/dance.h"
#include "tests/support/scene/gallery.h"
#include "tests/support/scene/park.h"

enum { PARK_SIZE = 90000, ADVERSARIAL_SIZE = 20000, MOST = 20000000, EXIT_USAGE = 2 };

static void print_usage(FILE *file)
{
    uint32_t count;
    const struct adversarial *scenes = adversarial_scenes(&count);
    fprintf(
        file,
        "usage: make_scene NAME [--size N] [--seed N] -o FILE\n"
        "       make_scene --list | --gallery\n"
        "\n"
        "Writes a scene that depends only on the arguments. --seed is any number, 1 by default.\n"
        "\n"
        "park: a garden with a temple and woods, most of it instances; FILE ends in .gltf, and a .bin is written "
        "beside it.\n"
        "  --size is the approximate number of triangles of the ground (%d by default).\n"
        "\n"
        "dance: skins, morph targets and nodes that move for four seconds; FILE ends in .glb.\n"
        "\n"
        "gallery-NAME: one of the scenes of the contact sheet, as glTF, of a fixed size; --gallery prints their "
        "names.\n"
        "\n"
        "Each other scene is one mesh in a binary little-endian PLY. --size is the approximate number of triangles\n"
        "(%d by default). --list prints the names, one on each line. What they test:\n",
        PARK_SIZE, ADVERSARIAL_SIZE);
    for (uint32_t i = 0; i < count; i++)
        fprintf(file, "  %-15s %s\n", scenes[i].name, scenes[i].shows);
}

static int print_list(void)
{
    uint32_t count;
    const struct adversarial *scenes = adversarial_scenes(&count);
    for (uint32_t i = 0; i < count; i++)
        puts(scenes[i].name);
    return 0;
}

static int print_gallery(void)
{
    uint32_t count;
    const struct gallery_scene *scenes = gallery_scenes(&count);
    for (uint32_t i = 0; i < count; i++)
        printf("gallery-%s\n", scenes[i].name);
    return 0;
}

struct options {
    const char *name, *path;
    uint64_t size, seed; /* size 0: the default */
};

static int parse_number(const char *text, uint64_t most, uint64_t *ret_number)
{
    char *rest;
    errno = 0;
    unsigned long long number = strtoull(text, &rest, 10);
    if (errno || *rest || text[0] < '0' || text[0] > '9' || number > most)
        return -1;
    *ret_number = number;
    return 0;
}

static int parse(int argc, char **argv, struct options *ret_options)
{
    struct options options = {.seed = 1};
    for (int i = 1; i < argc; i++) {
        const char *next = i + 1 < argc ? argv[i + 1] : "";
        if (strcmp(argv[i], "-o") == 0 && *next)
            options.path = argv[++i];
        else if (strcmp(argv[i], "--size") == 0 && parse_number(next, MOST, &options.size) == 0 && options.size > 0)
            i++;
        else if (strcmp(argv[i], "--seed") == 0 && parse_number(next, UINT64_MAX, &options.seed) == 0)
            i++;
        else if (argv[i][0] != '-' && !options.name)
            options.name = argv[i];
        else
            return -1;
    }
    *ret_options = options;
    return options.name && options.path ? 0 : -1;
}

/* `scene` is NULL for the park. */
static int make_gltf(const struct gallery_scene *scene, const struct options *options)
{
    struct gltf gltf = {0};
    struct random random = {options->seed};
    if (scene)
        scene->make(&gltf, &random);
    else
        park_make(&gltf, (uint32_t)(options->size ? options->size : PARK_SIZE), &random);
    int result = gltf_write(&gltf, options->path);
    if (result == 0)
        printf("%s: %llu triangles, %d nodes, %d meshes\n", options->path, (unsigned long long)gltf_triangles(&gltf),
               gltf.node_count, gltf.mesh_count);
    gltf_finish(&gltf);
    return result;
}

static int make_dance(const struct options *options)
{
    int result = dance_write(options->path, (uint32_t)(options->size ? options->size : DANCE_SIZE));
    if (result == 0)
        printf("%s\n", options->path);
    return result;
}

static int make_adversarial(const struct adversarial *scene, const struct options *options)
{
    struct mesh mesh = {0};
    struct random random = {options->seed};
    scene->make(&mesh, (uint32_t)(options->size ? options->size : ADVERSARIAL_SIZE), &random);
    int result = mesh_write_ply(&mesh, scene->shows, options->path);
    if (result == 0)
        printf("%s: %u triangles\n", options->path, mesh.triangle_count);
    mesh_finish(&mesh);
    return result;
}

int main(int argc, char **argv)
{
    struct options options;
    if (argc == 2 && strcmp(argv[1], "--list") == 0)
        return print_list();
    if (argc == 2 && strcmp(argv[1], "--gallery") == 0)
        return print_gallery();
    if (argc == 2 && strcmp(argv[1], "--help") == 0) {
        print_usage(stdout);
        return 0;
    }
    if (parse(argc, argv, &options) != 0) {
        print_usage(stderr);
        return EXIT_USAGE;
    }
    const struct adversarial *scene = adversarial_find(options.name);
    const struct gallery_scene *in_gallery =
        strncmp(options.name, "gallery-", 8) == 0 ? gallery_find(options.name + 8) : NULL;
    bool is_dance = strcmp(options.name, "dance") == 0;
    if (!scene && !in_gallery && !is_dance && strcmp(options.name, "park") != 0) {
        fprintf(stderr, "make_scene: %s: no such scene; --list and --gallery print the names\n", options.name);
        return EXIT_USAGE;
    }
    if ((is_dance ? make_dance(&options)
         : scene  ? make_adversarial(scene, &options)
                  : make_gltf(in_gallery, &options)) != 0) {
        fprintf(stderr, "make_scene: %s: %s\n", options.path, strerror(errno));
        return 1;
    }
    return 0;
}
