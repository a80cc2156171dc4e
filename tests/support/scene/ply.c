/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/support/scene/ply.h"

#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static bool read_header(FILE *file, struct ply *ply)
{
    char line[512];
    bool in_faces = false, binary = false, lists = false;
    int coordinates = 0, properties = 0;
    if (!fgets(line, sizeof line, file) || strncmp(line, "ply", 3) != 0)
        return false;
    while (fgets(line, sizeof line, file)) {
        if (strncmp(line, "end_header", 10) == 0)
            return binary && lists && coordinates == 3 && properties == 3;
        binary |= strncmp(line, "format binary_little_endian", 27) == 0;
        in_faces |= sscanf(line, "element face %u", &ply->triangle_count) == 1;
        (void)sscanf(line, "element vertex %u", &ply->vertex_count);
        coordinates += strncmp(line, "property float", 14) == 0;
        properties += !in_faces && strncmp(line, "property", 8) == 0;
        lists |= strncmp(line, "property list uchar int", 23) == 0;
    }
    return false;
}

static bool read_faces(FILE *file, struct ply *ply)
{
    unsigned char face[13];
    for (uint32_t i = 0; i < ply->triangle_count; i++) {
        if (fread(face, sizeof face, 1, file) != 1 || face[0] != 3)
            return false;
        memcpy(ply->indices + (uint64_t)3 * i, face + 1, 12);
        for (int k = 0; k < 3; k++)
            if (ply->indices[(uint64_t)3 * i + k] >= ply->vertex_count)
                return false;
    }
    return true;
}

static bool read_body(FILE *file, struct ply *ply)
{
    ply->positions = malloc((size_t)ply->vertex_count * 12 + 1);
    ply->indices = malloc((size_t)ply->triangle_count * 12 + 1);
    return ply->positions && ply->indices && fread(ply->positions, 12, ply->vertex_count, file) == ply->vertex_count &&
           read_faces(file, ply);
}

struct ply *ply_read(const char *path)
{
    FILE *file = fopen(path, "rb");
    struct ply *ply = calloc(1, sizeof *ply);
    bool good = file && ply && read_header(file, ply) && read_body(file, ply);
    if (file)
        fclose(file);
    if (good)
        return ply;
    fprintf(stderr, "%s: not a readable PLY file of triangles\n", path);
    ply_free(ply);
    return NULL;
}

void ply_free(struct ply *ply)
{
    if (!ply)
        return;
    free(ply->positions);
    free(ply->indices);
    free(ply);
}
