/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/support/scene/gltf.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static void end(const char *why)
{
    fprintf(stderr, "glTF scene: %s\n", why);
    exit(1);
}

void gltf_finish(struct gltf *gltf)
{
    if (!gltf)
        return;
    for (int i = 0; i < gltf->mesh_count; i++)
        for (int part = 0; part < gltf->meshes[i].part_count; part++)
            mesh_finish(&gltf->meshes[i].parts[part]);
    free(gltf->nodes);
    memset(gltf, 0, sizeof *gltf);
}

int gltf_add_material(struct gltf *gltf, const char *name, double red, double green, double blue)
{
    if (gltf->material_count == GLTF_MAX_MATERIALS)
        end("too many materials");
    gltf->materials[gltf->material_count] = (struct gltf_material){name, {(float)red, (float)green, (float)blue}};
    return gltf->material_count++;
}

int gltf_add_mesh(struct gltf *gltf, const char *name)
{
    if (gltf->mesh_count == GLTF_MAX_MESHES)
        end("too many meshes");
    gltf->meshes[gltf->mesh_count].name = name;
    return gltf->mesh_count++;
}

int gltf_add_node(struct gltf *gltf, const struct gltf_node *node)
{
    if (gltf->node_count == gltf->node_capacity) {
        gltf->node_capacity = gltf->node_capacity ? gltf->node_capacity * 2 : 64;
        gltf->nodes = realloc(gltf->nodes, (size_t)gltf->node_capacity * sizeof *gltf->nodes);
        if (!gltf->nodes)
            end("no memory");
    }
    gltf->nodes[gltf->node_count] = *node;
    return gltf->node_count++;
}

struct mesh *gltf_add_part(struct gltf *gltf, int mesh, int material)
{
    struct gltf_mesh *owner = &gltf->meshes[mesh];
    if (owner->part_count == GLTF_MAX_PARTS)
        end("too many parts in a mesh");
    owner->materials[owner->part_count] = material;
    return &owner->parts[owner->part_count++];
}

uint64_t gltf_triangles(const struct gltf *gltf)
{
    uint64_t total = 0;
    for (int i = 0; i < gltf->node_count; i++) {
        if (gltf->nodes[i].mesh == GLTF_NONE)
            continue;
        const struct gltf_mesh *mesh = &gltf->meshes[gltf->nodes[i].mesh];
        for (int part = 0; part < mesh->part_count; part++)
            total += mesh->parts[part].triangle_count;
    }
    return total;
}

static void write_materials(const struct gltf *gltf, FILE *file)
{
    fprintf(file, "\"materials\":[");
    for (int i = 0; i < gltf->material_count; i++) {
        const float *colour = gltf->materials[i].colour;
        fprintf(file,
                "%s\n{\"name\":\"%s\",\"pbrMetallicRoughness\":{\"baseColorFactor\":[%.9g,%.9g,%.9g,1],"
                "\"metallicFactor\":0}}",
                i ? "," : "", gltf->materials[i].name, colour[0], colour[1], colour[2]);
    }
    fprintf(file, "],\n");
}

/* Accessors are numbered in the order of parts: positions, then indices. */
static void write_meshes(const struct gltf *gltf, FILE *file)
{
    int accessor = 0;
    fprintf(file, "\"meshes\":[");
    for (int i = 0; i < gltf->mesh_count; i++) {
        const struct gltf_mesh *mesh = &gltf->meshes[i];
        fprintf(file, "%s\n{\"name\":\"%s\",\"primitives\":[", i ? "," : "", mesh->name);
        for (int part = 0; part < mesh->part_count; part++, accessor += 2)
            fprintf(file, "%s{\"attributes\":{\"POSITION\":%d},\"indices\":%d,\"material\":%d}", part ? "," : "",
                    accessor, accessor + 1, mesh->materials[part]);
        fprintf(file, "]}");
    }
    fprintf(file, "],\n");
}

static void write_bounds(const struct mesh *mesh, FILE *file)
{
    float low[3], high[3];
    memcpy(low, mesh->vertices[0], sizeof low);
    memcpy(high, mesh->vertices[0], sizeof high);
    for (uint32_t i = 1; i < mesh->vertex_count; i++)
        for (int axis = 0; axis < 3; axis++) {
            float x = mesh->vertices[i][axis];
            low[axis] = x < low[axis] ? x : low[axis];
            high[axis] = x > high[axis] ? x : high[axis];
        }
    fprintf(file, "\"min\":[%.9g,%.9g,%.9g],\"max\":[%.9g,%.9g,%.9g]", low[0], low[1], low[2], high[0], high[1],
            high[2]);
}

static void write_part_accessors(const struct mesh *mesh, int view, FILE *file)
{
    fprintf(file, "%s\n{\"bufferView\":%d,\"componentType\":5126,\"count\":%u,\"type\":\"VEC3\",", view ? "," : "",
            view, mesh->vertex_count);
    write_bounds(mesh, file);
    fprintf(file, "},\n{\"bufferView\":%d,\"componentType\":5125,\"count\":%u,\"type\":\"SCALAR\"}", view + 1,
            mesh->triangle_count * 3);
}

static size_t write_part_views(const struct mesh *mesh, size_t offset, FILE *file)
{
    size_t vertices = (size_t)mesh->vertex_count * 12, indices = (size_t)mesh->triangle_count * 12;
    fprintf(file, "%s\n{\"buffer\":0,\"byteOffset\":%zu,\"byteLength\":%zu,\"target\":34962},", offset ? "," : "",
            offset, vertices);
    fprintf(file, "\n{\"buffer\":0,\"byteOffset\":%zu,\"byteLength\":%zu,\"target\":34963}", offset + vertices,
            indices);
    return offset + vertices + indices;
}

static void write_buffers(const struct gltf *gltf, const char *name, FILE *file)
{
    int view = 0;
    size_t offset = 0;
    fprintf(file, "\"accessors\":[");
    for (int i = 0; i < gltf->mesh_count; i++)
        for (int part = 0; part < gltf->meshes[i].part_count; part++, view += 2)
            write_part_accessors(&gltf->meshes[i].parts[part], view, file);
    fprintf(file, "],\n\"bufferViews\":[");
    for (int i = 0; i < gltf->mesh_count; i++)
        for (int part = 0; part < gltf->meshes[i].part_count; part++)
            offset = write_part_views(&gltf->meshes[i].parts[part], offset, file);
    fprintf(file, "],\n\"buffers\":[{\"uri\":\"%s\",\"byteLength\":%zu}],\n", name, offset);
}

static void write_children(const struct gltf *gltf, int parent, const char *label, FILE *file)
{
    int count = 0;
    for (int i = parent + 1; i < gltf->node_count; i++)
        if (gltf->nodes[i].parent == parent)
            fprintf(file, "%s%d", count++ ? "," : label, i);
    fprintf(file, "%s", count ? "]" : "");
}

/* glTF stores matrices by columns. */
static void write_node(const struct gltf *gltf, int index, FILE *file)
{
    const struct gltf_node *node = &gltf->nodes[index];
    fprintf(file, "%s\n{\"name\":\"%s", index ? "," : "", node->name);
    if (node->number >= 0)
        fprintf(file, "-%d", node->number);
    fprintf(file, "\"");
    if (node->mesh != GLTF_NONE)
        fprintf(file, ",\"mesh\":%d", node->mesh);
    fprintf(file, ",\"matrix\":[");
    for (int column = 0; column < 4; column++)
        for (int row = 0; row < 4; row++)
            fprintf(file, "%s%.9g", column + row ? "," : "", row == 3 ? column == 3 : node->matrix[row * 4 + column]);
    fprintf(file, "]");
    write_children(gltf, index, ",\"children\":[", file);
    fprintf(file, "}");
}

static int write_json(const struct gltf *gltf, const char *bin_name, FILE *file)
{
    fprintf(file, "{\"asset\":{\"version\":\"2.0\"},\n");
    write_materials(gltf, file);
    write_meshes(gltf, file);
    write_buffers(gltf, bin_name, file);
    fprintf(file, "\"nodes\":[");
    for (int i = 0; i < gltf->node_count; i++)
        write_node(gltf, i, file);
    fprintf(file, "],\n\"scene\":0,\"scenes\":[{");
    write_children(gltf, GLTF_NONE, "\"nodes\":[", file);
    fprintf(file, "}]}\n");
    return ferror(file) ? -1 : 0;
}

static int write_bin(const struct gltf *gltf, FILE *file)
{
    for (int i = 0; i < gltf->mesh_count; i++)
        for (int part = 0; part < gltf->meshes[i].part_count; part++) {
            const struct mesh *mesh = &gltf->meshes[i].parts[part];
            fwrite(mesh->vertices, sizeof *mesh->vertices, mesh->vertex_count, file);
            fwrite(mesh->triangles, sizeof *mesh->triangles, mesh->triangle_count, file);
        }
    return ferror(file) ? -1 : 0;
}

int gltf_write(const struct gltf *gltf, const char *path)
{
    size_t length = strlen(path);
    if (length < 6 || length >= 4096 || strcmp(path + length - 5, ".gltf") != 0) {
        errno = EINVAL;
        return -1;
    }
    char bin_path[4096];
    snprintf(bin_path, sizeof bin_path, "%.*s.bin", (int)length - 5, path);
    const char *slash = strrchr(bin_path, '/');
    FILE *json = fopen(path, "w"), *bin = fopen(bin_path, "wb");
    int result =
        json && bin && write_json(gltf, slash ? slash + 1 : bin_path, json) == 0 && write_bin(gltf, bin) == 0 ? 0 : -1;
    if (json && fclose(json) != 0)
        result = -1;
    if (bin && fclose(bin) != 0)
        result = -1;
    return result;
}
