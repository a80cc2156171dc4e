/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/support/scene/glb.h"

#include <stdlib.h>
#include <string.h>

static void end(const char *why)
{
    fprintf(stderr, "glb: %s\n", why);
    exit(1);
}

void glb_init(struct glb *glb)
{
    *glb = (struct glb){0};
    FILE **const files[GLB_LISTS] = {&glb->json,      &glb->bin,      &glb->views,
                                     &glb->accessors, &glb->channels, &glb->samplers};
    for (int i = 0; i < GLB_LISTS; i++) {
        *files[i] = open_memstream(&glb->texts[i], &glb->sizes[i]);
        if (!*files[i])
            end("no memory");
    }
    fputs("{\"asset\":{\"version\":\"2.0\"},", glb->json);
}

int glb_put(struct glb *glb, const void *data, size_t size, enum glb_component component, uint64_t count,
            const char *type)
{
    const char *comma = glb->accessor_count ? "," : "";
    fprintf(glb->views, "%s{\"buffer\":0,\"byteOffset\":%ld,\"byteLength\":%zu}", comma, ftell(glb->bin), size);
    fprintf(glb->accessors, "%s{\"bufferView\":%d,\"componentType\":%d,\"count\":%llu,\"type\":\"%s\"}", comma,
            glb->accessor_count, component, (unsigned long long)count, type);
    if (fwrite(data, 1, size, glb->bin) != size || fflush(glb->bin) != 0)
        end("no memory");
    return glb->accessor_count++;
}

int glb_put_positions(struct glb *glb, const struct mesh *mesh)
{
    return glb_put(glb, mesh->vertices, mesh->vertex_count * sizeof *mesh->vertices, GLB_FLOAT, mesh->vertex_count,
                   "VEC3");
}

int glb_put_indices(struct glb *glb, const struct mesh *mesh)
{
    return glb_put(glb, mesh->triangles, mesh->triangle_count * sizeof *mesh->triangles, GLB_UINT32,
                   UINT64_C(3) * mesh->triangle_count, "SCALAR");
}

void glb_put_channel(struct glb *glb, int node, const char *path, const char *interpolation, int times, int values)
{
    const char *comma = glb->sampler_count ? "," : "";
    fprintf(glb->channels, "%s{\"sampler\":%d,\"target\":{\"node\":%d,\"path\":\"%s\"}}", comma, glb->sampler_count,
            node, path);
    fprintf(glb->samplers, "%s{\"input\":%d,\"output\":%d,\"interpolation\":\"%s\"}", comma, times, values,
            interpolation);
    glb->sampler_count++;
}

static void put32(FILE *file, uint64_t value)
{
    for (int i = 0; i < 4; i++)
        fputc((int)(value >> 8 * i & 0xff), file);
}

/* Writes a chunk of a GLB, of which `padding` fills the last four bytes. */
static void put_chunk(FILE *file, const char kind[4], const char *data, size_t size, char padding)
{
    put32(file, (size + 3) & ~(size_t)3);
    fwrite(kind, 1, 4, file);
    fwrite(data, 1, size, file);
    for (size_t at = size; at % 4; at++)
        fputc(padding, file);
}

static int write_glb(const char *path, const char *json, size_t json_size, const char *bin, size_t bin_size)
{
    FILE *file = fopen(path, "wb");
    if (!file)
        return -1;
    put32(file, 0x46546c67);
    put32(file, 2);
    put32(file, 28 + ((json_size + 3) & ~(size_t)3) + ((bin_size + 3) & ~(size_t)3));
    put_chunk(file, "JSON", json, json_size, ' ');
    put_chunk(file, "BIN", bin, bin_size, 0);
    int failed = ferror(file);
    return fclose(file) == 0 && !failed ? 0 : -1;
}

int glb_write(struct glb *glb, const char *animation, const char *path)
{
    FILE *const files[GLB_LISTS] = {glb->bin, glb->views, glb->accessors, glb->channels, glb->samplers, glb->json};
    for (int i = 0; i < GLB_LISTS - 1; i++)
        if (fclose(files[i]) != 0)
            end("no memory");
    fprintf(glb->json,
            "\"animations\":[{\"name\":\"%s\",\"channels\":[%s],\"samplers\":[%s]}],\"buffers\":[{\"byteLength\":%zu}],"
            "\"bufferViews\":[%s],\"accessors\":[%s]}",
            animation, glb->texts[4], glb->texts[5], glb->sizes[1], glb->texts[2], glb->texts[3]);
    if (fclose(glb->json) != 0)
        end("no memory");
    int result = write_glb(path, glb->texts[0], glb->sizes[0], glb->texts[1], glb->sizes[1]);
    for (int i = 0; i < GLB_LISTS; i++)
        free(glb->texts[i]);
    return result;
}
