/* SPDX-License-Identifier: Apache-2.0 */
/*
 * trace_cpu.c - traces rays on the CPU through structures from files, for example those of `bvhctl build`, and prints a
 * picture of characters: '#' for front faces, '+' for back faces and boxes, '.' for nothing. It needs no daemon.
 *
 *     trace_cpu BOTTOM.as... [TOP.as]      the bottom levels are in the order of the top level's rows
 */
#include <stdio.h>
#include <stdlib.h>

#include <bvhd/bvhd_cpu.h>

enum { WIDTH = 64, HEIGHT = 24, FILES = 64 };

static void must(enum bvhd_status status, const struct bvhd_error *error)
{
    if (status == BVHD_OK)
        return;
    fprintf(stderr, "%s: %s: %s\n", bvhd_status_name(status), error->where, error->text);
    exit(1);
}

/* The memory of malloc is aligned to 16 bytes, as portable structures need it. */
static void read_file(const char *path, struct bvhd_cpu_blob *ret_blob)
{
    FILE *file = fopen(path, "rb");
    long size = file && fseek(file, 0, SEEK_END) == 0 ? ftell(file) : -1;
    char *data = size > 0 && fseek(file, 0, SEEK_SET) == 0 ? malloc((size_t)size) : NULL;
    if (!data || fread(data, 1, (size_t)size, file) != (size_t)size)
        exit(fprintf(stderr, "%s: cannot be read\n", path) > 0);
    fclose(file);
    ret_blob->data = data;
    ret_blob->size = (uint64_t)size;
}

int main(int argc, char **argv)
{
    static struct bvhd_cpu_ray rays[WIDTH * HEIGHT];
    static struct bvhd_cpu_hit hits[WIDTH * HEIGHT];
    struct bvhd_cpu_blob blobs[FILES];
    struct bvhd_cpu_scene *scene;
    struct bvhd_error error;
    float bounds[6];
    int i, count = argc - 1 < FILES ? argc - 1 : FILES;
    for (i = 0; i < count; i++)
        read_file(argv[1 + i], &blobs[i]);
    const struct bvhd_cpu_scene_options options = {
        .struct_size = sizeof options, .blobs = blobs, .blob_count = (uint32_t)count};
    must(bvhd_cpu_scene_create(&options, &scene, &error), &error);
    bvhd_cpu_scene_bounds(scene, bounds);
    for (i = 0; i < WIDTH * HEIGHT; i++) { /* parallel rays towards -z, over the scene's bounds */
        const float x = ((float)(i % WIDTH) + 0.5f) / (float)WIDTH;
        const float y = 1 - ((float)(i / WIDTH) + 0.5f) / (float)HEIGHT;
        const float origin[] = {bounds[0] + x * (bounds[3] - bounds[0]), bounds[1] + y * (bounds[4] - bounds[1])};
        rays[i] = (struct bvhd_cpu_ray){.origin = {origin[0], origin[1], bounds[5] + 1},
                                        .direction = {0, 0, -1},
                                        .tmax = bounds[5] - bounds[2] + 2,
                                        .mask = 0xff};
    }
    const struct bvhd_cpu_trace trace = {.struct_size = sizeof trace,
                                         .rays = rays,
                                         .ray_size = sizeof rays[0],
                                         .hits = hits,
                                         .hit_size = sizeof hits[0],
                                         .ray_count = WIDTH * HEIGHT};
    must(bvhd_cpu_scene_trace(scene, &trace, &error), &error);
    for (i = 0; i < WIDTH * HEIGHT; i++)
        printf("%c%s",
               hits[i].blob == BVHD_CPU_NO_BLOB          ? '.'
               : hits[i].flags & BVHD_CPU_HIT_FRONT_FACE ? '#'
                                                         : '+',
               i % WIDTH == WIDTH - 1 ? "\n" : "");
    bvhd_cpu_scene_destroy(scene);
    while (count > 0)
        free((void *)blobs[--count].data);
    return 0;
}
