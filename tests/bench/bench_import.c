/* SPDX-License-Identifier: Apache-2.0 */
/*
 * bench_import - measures how long scene files take to read: by bvhctl's own reader and by assimp, each alone and as
 * bvhctl runs it. bvhctl runs readers in processes of their own, and assimp twice.
 *
 *     bench_import [--runs N] [--shared | --distinct] [FILE...]
 *
 * Without files it writes a GLB with a million triangles and 10,000 nodes and reads that: --shared with 100 meshes
 * (default), --distinct with 10,000. Each of the N (7) runs takes a new process, the readers one after the other, and
 * medians are printed: wall time, and processor time of all processes, which says more on a machine that is busy
 * otherwise. A ratio is a time of assimp divided by that of bvhctl's reader in the same conditions.
 */
#include <assimp/cimport.h>
#include <assimp/postprocess.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include "client/bvhctl/scene/import.h"
#include "proto/base/clock.h"

enum { MOST_RUNS = 101, NODES = 10000, READERS = 4 };

struct sample {
    double wall, processor; /* ms */
};

static void fail(const char *what)
{
    fprintf(stderr, "bench_import: %s\n", what);
    exit(1);
}

static void put(FILE *file, const void *data, size_t size)
{
    if (fwrite(data, 1, size, file) != size)
        fail("the file cannot be written");
}

/* Vertices and indices of a bumpy square of 2 * side * side triangles, behind each other in one block. */
struct square {
    float *positions;
    uint32_t *indices;
    uint32_t vertex_count, index_count;
};

static struct square make_square(uint32_t side)
{
    struct square square = {.vertex_count = (side + 1) * (side + 1), .index_count = 6 * side * side};
    square.positions = malloc(square.vertex_count * 3 * sizeof(float));
    square.indices = malloc(square.index_count * sizeof(uint32_t));
    if (!square.positions || !square.indices)
        fail("no memory");
    for (uint32_t i = 0; i < square.vertex_count; i++) {
        uint32_t x = i % (side + 1), y = i / (side + 1);
        square.positions[3 * i] = (float)x / (float)side;
        square.positions[3 * i + 1] = (float)y / (float)side;
        square.positions[3 * i + 2] = sinf((float)x * 1.3f + (float)y * 0.7f) * 0.05f;
    }
    for (uint32_t i = 0; i < side * side; i++) {
        uint32_t a = i / side * (side + 1) + i % side, b = a + side + 1;
        memcpy(square.indices + 6 * (size_t)i, (uint32_t[]){a, a + 1, b, a + 1, b + 1, b}, 6 * sizeof(uint32_t));
    }
    return square;
}

/* Writes the members of the JSON that describe `meshes` equal squares, each with bytes of its own. */
static void write_meshes(FILE *text, const struct square *square, uint32_t meshes)
{
    size_t positions = square->vertex_count * 12, indices = square->index_count * 4;
    fprintf(text, "\"buffers\":[{\"byteLength\":%zu}],\"bufferViews\":[", meshes * (positions + indices));
    for (size_t i = 0; i < meshes; i++)
        fprintf(text,
                "%s{\"buffer\":0,\"byteOffset\":%zu,\"byteLength\":%zu},{\"buffer\":0,\"byteOffset\":%zu,"
                "\"byteLength\":%zu}",
                i ? "," : "", i * (positions + indices), positions, i * (positions + indices) + positions, indices);
    fputs("],\"accessors\":[", text);
    for (uint32_t i = 0; i < meshes; i++)
        fprintf(text,
                "%s{\"bufferView\":%u,\"componentType\":5126,\"count\":%u,\"type\":\"VEC3\",\"min\":[0,0,-0.05],"
                "\"max\":[1,1,0.05]},{\"bufferView\":%u,\"componentType\":5125,\"count\":%u,\"type\":\"SCALAR\"}",
                i ? "," : "", 2 * i, square->vertex_count, 2 * i + 1, square->index_count);
    fputs("],\"meshes\":[", text);
    for (uint32_t i = 0; i < meshes; i++)
        fprintf(text, "%s{\"name\":\"mesh %u\",\"primitives\":[{\"attributes\":{\"POSITION\":%u},\"indices\":%u}]}",
                i ? "," : "", i, 2 * i, 2 * i + 1);
    fputs("]", text);
}

static void write_nodes(FILE *text, uint32_t meshes)
{
    fputs("\"nodes\":[", text);
    for (uint32_t i = 0; i < NODES; i++)
        fprintf(text, "%s{\"name\":\"node %u\",\"mesh\":%u,\"translation\":[%u,%u,0],\"rotation\":[0,0,%.9g,%.9g]}",
                i ? "," : "", i, i % meshes, i % 100, i / 100, sin(i), cos(i));
    fputs("],\"scene\":0,\"scenes\":[{\"nodes\":[0", text);
    for (uint32_t i = 1; i < NODES; i++)
        fprintf(text, ",%u", i);
    fputs("]}],", text);
}

/* Writes a GLB of `meshes` squares, about a million triangles in all. */
static void write_glb(const char *path, uint32_t meshes)
{
    char *json = NULL;
    size_t length = 0;
    struct square square = make_square(meshes == 100 ? 71 : 7);
    FILE *text = open_memstream(&json, &length), *file = fopen(path, "wb");
    if (!text || !file)
        fail("the file cannot be written");
    fputs("{\"asset\":{\"version\":\"2.0\"},", text);
    write_nodes(text, meshes);
    write_meshes(text, &square, meshes);
    fputs("}", text);
    fflush(text);
    fprintf(text, "%*s", (int)((4 - length % 4) % 4), "");
    fclose(text);
    uint32_t bytes = square.vertex_count * 12 + square.index_count * 4, bin = meshes * bytes;
    put(file, "glTF", 4);
    put(file, (uint32_t[]){2, 28 + (uint32_t)length + bin, (uint32_t)length}, 12);
    put(file, "JSON", 4);
    put(file, json, length);
    put(file, &bin, sizeof bin);
    put(file, "BIN", 4);
    for (uint32_t i = 0; i < meshes; i++) {
        put(file, square.positions, square.vertex_count * 12);
        put(file, square.indices, square.index_count * 4);
    }
    if (fclose(file) != 0)
        fail("the file cannot be written");
    free(square.positions);
    free(square.indices);
    free(json);
}

/* Pairs that are compared with each other. */
enum reader { OURS_ALONE, ASSIMP_ALONE, OURS, ASSIMP };

static const char *const names[READERS] = {
    [OURS_ALONE] = "bvhctl's reader, alone",
    [ASSIMP_ALONE] = "assimp, alone",
    [OURS] = "bvhctl's reader, in bvhctl",
    [ASSIMP] = "assimp, in bvhctl",
};

/* Reads the file once. The process ends, and frees what was read. Returns whether that worked. */
static bool read_once(enum reader reader, const char *path)
{
    struct memory memory;
    struct import import;
    struct bvhd_error error = {0};
    enum bvhd_status status = BVHD_OK;
    memory_init(&memory, UINT64_MAX);
    switch (reader) {
    case OURS_ALONE:
        status = import_read(path, NULL, &memory, &import, &error);
        break;
    case ASSIMP_ALONE:
        return aiImportFile(path, aiProcess_Triangulate) != NULL;
    case OURS:
        status = import_scene(path, NULL, &memory, &import, &error);
        break;
    case ASSIMP:
        status = import_scene_by_assimp(path, &memory, &import, &error);
        break;
    }
    if (status)
        fprintf(stderr, "bench_import: %s: %s\n", error.where, error.text);
    return status == BVHD_OK;
}

static double processor_ms(void)
{
    struct rusage usage;
    getrusage(RUSAGE_CHILDREN, &usage);
    return (double)(usage.ru_utime.tv_sec + usage.ru_stime.tv_sec) * 1e3 +
           (double)(usage.ru_utime.tv_usec + usage.ru_stime.tv_usec) * 1e-3;
}

/* Measures a run in a process of its own, so that no run finds the memory of another. */
static struct sample measure(enum reader reader, const char *path)
{
    double processor = processor_ms(), start = clock_ms();
    pid_t child = fork();
    if (child == 0)
        _exit(read_once(reader, path) ? 0 : 1);
    int status;
    if (child < 0 || waitpid(child, &status, 0) != child || status)
        fail("a reader failed");
    return (struct sample){clock_ms() - start, processor_ms() - processor};
}

static int compare(const void *a, const void *b)
{
    double left = *(const double *)a, right = *(const double *)b;
    return left < right ? -1 : left > right;
}

static double median(double *values, int count)
{
    qsort(values, (size_t)count, sizeof *values, compare);
    return values[count / 2];
}

static void measure_file(const char *path, int runs)
{
    static double wall[READERS][MOST_RUNS], processor[READERS][MOST_RUNS];
    double first[2] = {1, 1};
    for (int run = 0; run < runs; run++)
        for (int reader = 0; reader < READERS; reader++) {
            struct sample sample = measure((enum reader)reader, path);
            wall[reader][run] = sample.wall;
            processor[reader][run] = sample.processor;
        }
    printf("%s, medians of %d runs\n", path, runs);
    for (int reader = 0; reader < READERS; reader++) {
        double both[2] = {median(wall[reader], runs), median(processor[reader], runs)};
        if (reader % 2 == 0)
            memcpy(first, both, sizeof first);
        printf("  %-26s wall %8.1f ms (ratio %5.2f)   processor %8.1f ms (ratio %5.2f)\n", names[reader], both[0],
               both[0] / first[0], both[1], both[1] / first[1]);
    }
}

static int usage(void)
{
    fputs("usage: bench_import [--runs N] [--shared | --distinct] [FILE...]\n", stderr);
    return 2;
}

int main(int argc, char **argv)
{
    long runs = 7;
    uint32_t meshes = 100;
    int i = 1;
    for (; i < argc && argv[i][0] == '-'; i++) {
        if (!strcmp(argv[i], "--runs") && i + 1 < argc)
            runs = strtol(argv[++i], NULL, 10);
        else if (!strcmp(argv[i], "--distinct"))
            meshes = NODES;
        else if (strcmp(argv[i], "--shared") != 0)
            return usage();
    }
    if (runs < 1 || runs > MOST_RUNS)
        return usage();
    char path[64];
    snprintf(path, sizeof path, "/tmp/bench_import_%d.glb", (int)getpid());
    if (i == argc) {
        write_glb(path, meshes);
        measure_file(path, (int)runs);
        unlink(path);
    }
    for (; i < argc; i++)
        measure_file(argv[i], (int)runs);
    return 0;
}
