/* SPDX-License-Identifier: Apache-2.0 */
/* make_scene - writes the generated scenes of tests and of the demonstration. Its usage text is its manual. */
#include <errno.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "tests/support/scene/adversarial.h"
#include "tests/support/scene/dance.h"
#include "tests/support/scene/fair.h"
#include "tests/support/scene/gallery.h"
#include "tests/support/scene/hair.h"
#include "tests/support/scene/mill.h"
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
        "hair, hair-tubes: strands on a scalp, as lines with radii or as tubes of triangles; FILE ends in .gltf. "
        "--size "
        "is the\n"
        "  number of strands (%d by default), of %d points each.\n"
        "\n"
        "cloud: a sea shell of points with radii; FILE ends in .gltf or .ply. --size is their number (%d by default).\n"
        "\n"
        "dance: skins, morph targets and nodes that move for four seconds; FILE ends in .glb.\n"
        "\n"
        "fair: a fan, a flag, a carousel and balls that move for four seconds; FILE ends in .glb. --size is the "
        "number\n"
        "  of triangles of the flag (%d by default).\n"
        "\n"
        "mill: a windmill whose sails turn, and planes that fly, for four seconds; FILE ends in .gltf.\n"
        "\n"
        "gallery-NAME: one of the scenes of the contact sheet, as glTF, of a fixed size; --gallery prints their "
        "names.\n"
        "\n"
        "Each other scene is one mesh in a binary little-endian PLY. --size is the approximate number of triangles\n"
        "(%d by default). --list prints the names, one on each line. What they test:\n",
        PARK_SIZE, HAIR_STRANDS, HAIR_POINTS, CLOUD_SIZE, FAIR_SIZE, ADVERSARIAL_SIZE);
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

static int write_gltf(const struct options *options, struct gltf *gltf)
{
    int result = gltf_write(gltf, options->path);
    if (result == 0)
        printf("%s: %llu triangles, %d nodes, %d meshes\n", options->path, (unsigned long long)gltf_triangles(gltf),
               gltf->node_count, gltf->mesh_count);
    gltf_finish(gltf);
    return result;
}

static int make_gallery(const struct gallery_scene *scene, const struct options *options)
{
    struct gltf gltf = {0};
    struct random random = {options->seed};
    scene->make(&gltf, &random);
    return write_gltf(options, &gltf);
}

static int make_park(const struct options *options)
{
    struct gltf gltf = {0};
    struct random random = {options->seed};
    park_make(&gltf, (uint32_t)(options->size ? options->size : PARK_SIZE), &random);
    return write_gltf(options, &gltf);
}

static int make_hair(const struct options *options)
{
    struct gltf gltf = {0};
    struct random random = {options->seed};
    hair_make_scene(&gltf, (uint32_t)(options->size ? options->size : HAIR_STRANDS),
                    strcmp(options->name, "hair-tubes") == 0, &random);
    return write_gltf(options, &gltf);
}

static int make_cloud(const struct options *options)
{
    struct gltf gltf = {0};
    struct mesh mesh = {0};
    struct random random = {options->seed};
    uint32_t size = (uint32_t)(options->size ? options->size : CLOUD_SIZE);
    size_t length = strlen(options->path);
    if (length < 4 || strcmp(options->path + length - 4, ".ply") != 0) {
        cloud_make_scene(&gltf, size, &random);
        return write_gltf(options, &gltf);
    }
    cloud_make(&mesh, &mesh, size, &random);
    int result = mesh_write_ply(&mesh, "a sea shell of points", options->path);
    if (result == 0)
        printf("%s: %u points\n", options->path, mesh.vertex_count);
    mesh_finish(&mesh);
    return result;
}

static int make_dance(const struct options *options)
{
    int result = dance_write(options->path, (uint32_t)(options->size ? options->size : DANCE_SIZE));
    if (result == 0)
        printf("%s\n", options->path);
    return result;
}

static int make_mill(const struct options *options)
{
    struct gltf gltf = {0};
    mill_make(&gltf);
    return write_gltf(options, &gltf);
}

static int make_fair(const struct options *options)
{
    int result = fair_write(options->path, (uint32_t)(options->size ? options->size : FAIR_SIZE));
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

/* The scenes that are not in a table elsewhere. */
static const struct {
    const char *name;
    int (*make)(const struct options *options);
} single_scenes[] = {
    {"park", make_park},       {"dance", make_dance}, {"fair", make_fair}, {"hair", make_hair},
    {"hair-tubes", make_hair}, {"cloud", make_cloud}, {"mill", make_mill},
};

/* Returns 0, -1 with errno set, or 1: there is no such scene. */
static int make(const struct options *options)
{
    const struct adversarial *scene = adversarial_find(options->name);
    const struct gallery_scene *in_gallery =
        strncmp(options->name, "gallery-", 8) == 0 ? gallery_find(options->name + 8) : NULL;
    for (size_t i = 0; i < sizeof single_scenes / sizeof *single_scenes; i++)
        if (strcmp(options->name, single_scenes[i].name) == 0)
            return single_scenes[i].make(options);
    if (in_gallery)
        return make_gallery(in_gallery, options);
    return scene ? make_adversarial(scene, options) : 1;
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
    int result = make(&options);
    if (result > 0)
        fprintf(stderr, "make_scene: %s: no such scene; --list and --gallery print the names\n", options.name);
    else if (result < 0)
        fprintf(stderr, "make_scene: %s: %s\n", options.path, strerror(errno));
    return result > 0 ? EXIT_USAGE : result < 0;
}
