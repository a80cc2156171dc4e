/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/support/scene/gltf.h"

#include <errno.h>
#include <math.h>
#include <png.h>
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
    for (int i = 0; i < gltf->image_count; i++)
        free(gltf->images[i].pixels);
    for (int i = 0; i < gltf->motion_count; i++)
        free(gltf->motions[i].keys);
    free(gltf->nodes);
    memset(gltf, 0, sizeof *gltf);
}

int gltf_add_material(struct gltf *gltf, const char *name, double red, double green, double blue)
{
    if (gltf->material_count == GLTF_MAX_MATERIALS)
        end("too many materials");
    gltf->materials[gltf->material_count] =
        (struct gltf_material){.name = name, .colour = {(float)red, (float)green, (float)blue}, .scale = 1};
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

void gltf_move(struct gltf *gltf, int node, const struct gltf_key *keys, int count)
{
    if (gltf->motion_count == GLTF_MAX_MOTIONS)
        end("too many nodes that move");
    struct gltf_key *copy = malloc((size_t)count * sizeof *copy);
    if (!copy)
        end("no memory");
    memcpy(copy, keys, (size_t)count * sizeof *copy);
    gltf->motions[gltf->motion_count++] = (struct gltf_motion){node, count, copy};
}

int gltf_add_image(struct gltf *gltf, unsigned width, unsigned height,
                   void (*paint)(double u, double v, unsigned char ret_rgba[4]))
{
    if (gltf->image_count == GLTF_MAX_IMAGES)
        end("too many images");
    unsigned char *pixels = malloc((size_t)width * height * 4);
    if (!pixels)
        end("no memory");
    for (unsigned i = 0; i < width * height; i++)
        paint((i % width + 0.5) / width, (i / width + 0.5) / height, pixels + 4 * (size_t)i);
    gltf->images[gltf->image_count] = (struct gltf_image){width, height, pixels};
    return gltf->image_count++;
}

static void write_images(const struct gltf *gltf, const char *stem, FILE *file)
{
    if (gltf->image_count == 0)
        return;
    fprintf(file, "\"textures\":[");
    for (int i = 0; i < gltf->image_count; i++)
        fprintf(file, "%s{\"source\":%d}", i ? "," : "", i);
    fprintf(file, "],\n\"images\":[");
    for (int i = 0; i < gltf->image_count; i++)
        fprintf(file, "%s{\"uri\":\"%s.%d.png\"}", i ? "," : "", stem, i);
    fprintf(file, "],\n");
}

static void write_materials(const struct gltf *gltf, FILE *file)
{
    fprintf(file, "\"materials\":[");
    for (int i = 0; i < gltf->material_count; i++) {
        const struct gltf_material *material = &gltf->materials[i];
        fprintf(file, "%s\n{\"name\":\"%s\",\"pbrMetallicRoughness\":{\"baseColorFactor\":[%.9g,%.9g,%.9g,1],",
                i ? "," : "", material->name, material->colour[0], material->colour[1], material->colour[2]);
        if (material->image)
            fprintf(file, "\"baseColorTexture\":{\"index\":%d},", material->image - 1);
        fprintf(file, "\"metallicFactor\":0}%s}", material->has_holes ? ",\"alphaMode\":\"MASK\"" : "");
    }
    fprintf(file, "],\n");
}

static const struct gltf_material *material_of(const struct gltf *gltf, const struct gltf_mesh *mesh, int part)
{
    return &gltf->materials[mesh->materials[part]];
}

/* The arrays of a part: its positions are always there. */
struct arrays {
    uint32_t index_count; /* 0: no indices */
    const void *indices;
    bool has_normals, has_coordinates;
};

static struct arrays arrays_of(const struct gltf_material *material, const struct mesh *mesh)
{
    bool has_faces = !mesh->radii;
    return (struct arrays){.index_count = mesh->line_count ? 2 * mesh->line_count : 3 * mesh->triangle_count,
                           .indices = mesh->line_count ? (const void *)mesh->lines : mesh->triangles,
                           .has_normals = has_faces && material->is_smooth,
                           .has_coordinates = has_faces && material->image};
}

/* Accessors are numbered in the order of parts: positions, and what there is of indices, normals, ..., radii. */
static int write_primitive(const struct gltf_material *material, const struct mesh *mesh, int accessor, FILE *file)
{
    struct arrays arrays = arrays_of(material, mesh);
    fprintf(file, "{\"attributes\":{\"POSITION\":%d", accessor++);
    int indices = arrays.index_count ? accessor++ : 0;
    if (arrays.has_normals)
        fprintf(file, ",\"NORMAL\":%d", accessor++);
    if (arrays.has_coordinates)
        fprintf(file, ",\"TEXCOORD_0\":%d", accessor++);
    if (mesh->radii)
        fprintf(file, ",\"_RADIUS\":%d", accessor++);
    fprintf(file, "}");
    if (indices)
        fprintf(file, ",\"indices\":%d", indices);
    if (mesh->radii)
        fprintf(file, ",\"mode\":%d", mesh->line_count ? 1 : 0);
    return accessor;
}

static void write_meshes(const struct gltf *gltf, FILE *file)
{
    int accessor = 0;
    fprintf(file, "\"meshes\":[");
    for (int i = 0; i < gltf->mesh_count; i++) {
        const struct gltf_mesh *mesh = &gltf->meshes[i];
        fprintf(file, "%s\n{\"name\":\"%s\",\"primitives\":[", i ? "," : "", mesh->name);
        for (int part = 0; part < mesh->part_count; part++) {
            fprintf(file, "%s", part ? "," : "");
            accessor = write_primitive(material_of(gltf, mesh, part), &mesh->parts[part], accessor, file);
            fprintf(file, ",\"material\":%d}", mesh->materials[part]);
        }
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

static int write_accessor(int view, int component, uint32_t count, const char *type, FILE *file)
{
    fprintf(file, ",\n{\"bufferView\":%d,\"componentType\":%d,\"count\":%u,\"type\":\"%s\"}", view, component, count,
            type);
    return view + 1;
}

static int write_part_accessors(const struct gltf_material *material, const struct mesh *mesh, int view, FILE *file)
{
    struct arrays arrays = arrays_of(material, mesh);
    fprintf(file, "%s\n{\"bufferView\":%d,\"componentType\":5126,\"count\":%u,\"type\":\"VEC3\",", view ? "," : "",
            view, mesh->vertex_count);
    write_bounds(mesh, file);
    fprintf(file, "}");
    view++;
    if (arrays.index_count)
        view = write_accessor(view, 5125, arrays.index_count, "SCALAR", file);
    if (arrays.has_normals)
        view = write_accessor(view, 5126, mesh->vertex_count, "VEC3", file);
    if (arrays.has_coordinates)
        view = write_accessor(view, 5126, mesh->vertex_count, "VEC2", file);
    return mesh->radii ? write_accessor(view, 5126, mesh->vertex_count, "SCALAR", file) : view;
}

/* The views and accessors of a motion: times, translations and rotations. */
static int write_motion_accessors(const struct gltf_motion *motion, int view, FILE *file)
{
    const uint32_t count = (uint32_t)motion->key_count;
    fprintf(
        file,
        ",\n{\"bufferView\":%d,\"componentType\":5126,\"count\":%u,\"type\":\"SCALAR\",\"min\":[%.9g],\"max\":[%.9g]}",
        view, count, (double)(float)motion->keys[0].time, (double)(float)motion->keys[count - 1].time);
    view = write_accessor(view + 1, 5126, count, "VEC3", file);
    return write_accessor(view, 5126, count, "VEC4", file);
}

/* A target of 0 means that the view is not of a mesh. */
static size_t write_view(size_t offset, size_t size, int target, FILE *file)
{
    fprintf(file, "%s\n{\"buffer\":0,\"byteOffset\":%zu,\"byteLength\":%zu", offset ? "," : "", offset, size);
    if (target)
        fprintf(file, ",\"target\":%d", target);
    fprintf(file, "}");
    return offset + size;
}

static size_t write_motion_views(const struct gltf_motion *motion, size_t offset, FILE *file)
{
    const size_t count = (size_t)motion->key_count;
    return write_view(write_view(write_view(offset, 4 * count, 0, file), 12 * count, 0, file), 16 * count, 0, file);
}

static size_t write_part_views(const struct gltf_material *material, const struct mesh *mesh, size_t offset, FILE *file)
{
    struct arrays arrays = arrays_of(material, mesh);
    offset = write_view(offset, (size_t)mesh->vertex_count * 12, 34962, file);
    if (arrays.index_count)
        offset = write_view(offset, (size_t)arrays.index_count * 4, 34963, file);
    if (arrays.has_normals)
        offset = write_view(offset, (size_t)mesh->vertex_count * 12, 34962, file);
    if (arrays.has_coordinates)
        offset = write_view(offset, (size_t)mesh->vertex_count * 8, 34962, file);
    return mesh->radii ? write_view(offset, (size_t)mesh->vertex_count * 4, 34962, file) : offset;
}

/* Returns the number of the first accessor of the motions. */
static int write_buffers(const struct gltf *gltf, const char *stem, FILE *file)
{
    int view = 0, first_motion;
    size_t offset = 0;
    fprintf(file, "\"accessors\":[");
    for (int i = 0; i < gltf->mesh_count; i++)
        for (int part = 0; part < gltf->meshes[i].part_count; part++)
            view = write_part_accessors(material_of(gltf, &gltf->meshes[i], part), &gltf->meshes[i].parts[part], view,
                                        file);
    first_motion = view;
    for (int i = 0; i < gltf->motion_count; i++)
        view = write_motion_accessors(&gltf->motions[i], view, file);
    fprintf(file, "],\n\"bufferViews\":[");
    for (int i = 0; i < gltf->mesh_count; i++)
        for (int part = 0; part < gltf->meshes[i].part_count; part++)
            offset =
                write_part_views(material_of(gltf, &gltf->meshes[i], part), &gltf->meshes[i].parts[part], offset, file);
    for (int i = 0; i < gltf->motion_count; i++)
        offset = write_motion_views(&gltf->motions[i], offset, file);
    fprintf(file, "],\n\"buffers\":[{\"uri\":\"%s.bin\",\"byteLength\":%zu}],\n", stem, offset);
    return first_motion;
}

static void write_animation(const struct gltf *gltf, int accessor, FILE *file)
{
    if (gltf->motion_count == 0)
        return;
    fprintf(file, "\"animations\":[{\"channels\":[");
    for (int i = 0; i < 2 * gltf->motion_count; i++)
        fprintf(file, "%s\n{\"sampler\":%d,\"target\":{\"node\":%d,\"path\":\"%s\"}}", i ? "," : "", i,
                gltf->motions[i / 2].node, i % 2 ? "rotation" : "translation");
    fprintf(file, "],\"samplers\":[");
    for (int i = 0; i < 2 * gltf->motion_count; i++)
        fprintf(file, "%s\n{\"input\":%d,\"output\":%d}", i ? "," : "", accessor + i / 2 * 3,
                accessor + i / 2 * 3 + 1 + i % 2);
    fprintf(file, "]}],\n");
}

static void write_children(const struct gltf *gltf, int parent, const char *label, FILE *file)
{
    int count = 0;
    for (int i = parent + 1; i < gltf->node_count; i++)
        if (gltf->nodes[i].parent == parent)
            fprintf(file, "%s%d", count++ ? "," : label, i);
    fprintf(file, "%s", count ? "]" : "");
}

static void write_numbers(const char *label, const double *numbers, int count, FILE *file)
{
    fprintf(file, ",\"%s\":[", label);
    for (int i = 0; i < count; i++)
        fprintf(file, "%s%.9g", i ? "," : "", numbers[i]);
    fprintf(file, "]");
}

/* glTF stores matrices by columns. A node that moves has none. */
static void write_place(const struct gltf *gltf, int index, FILE *file)
{
    double columns[16];
    for (int i = 0; i < gltf->motion_count; i++)
        if (gltf->motions[i].node == index) {
            write_numbers("translation", gltf->motions[i].keys[0].translation, 3, file);
            write_numbers("rotation", gltf->motions[i].keys[0].rotation, 4, file);
            return;
        }
    for (int i = 0; i < 16; i++)
        columns[i] = i % 4 == 3 ? i == 15 : gltf->nodes[index].matrix[i % 4 * 4 + i / 4];
    write_numbers("matrix", columns, 16, file);
}

static void write_node(const struct gltf *gltf, int index, FILE *file)
{
    const struct gltf_node *node = &gltf->nodes[index];
    fprintf(file, "%s\n{\"name\":\"%s", index ? "," : "", node->name);
    if (node->number >= 0)
        fprintf(file, "-%d", node->number);
    fprintf(file, "\"");
    if (node->mesh != GLTF_NONE)
        fprintf(file, ",\"mesh\":%d", node->mesh);
    write_place(gltf, index, file);
    write_children(gltf, index, ",\"children\":[", file);
    fprintf(file, "}");
}

static int write_json(const struct gltf *gltf, const char *stem, FILE *file)
{
    fprintf(file, "{\"asset\":{\"version\":\"2.0\"},\n");
    write_images(gltf, stem, file);
    write_materials(gltf, file);
    write_meshes(gltf, file);
    write_animation(gltf, write_buffers(gltf, stem, file), file);
    fprintf(file, "\"nodes\":[");
    for (int i = 0; i < gltf->node_count; i++)
        write_node(gltf, i, file);
    fprintf(file, "],\n\"scene\":0,\"scenes\":[{");
    write_children(gltf, GLTF_NONE, "\"nodes\":[", file);
    fprintf(file, "}]}\n");
    return ferror(file) ? -1 : 0;
}

/* Returns the normals of the vertices, each the mean of those of its triangles by area, xyz each. */
static float (*find_normals(const struct mesh *mesh))[3]
{
    float(*normals)[3] = calloc(mesh->vertex_count + 1, sizeof *normals);
    if (!normals)
        end("no memory");
    for (uint32_t i = 0; i < mesh->triangle_count; i++) {
        const uint32_t *corners = mesh->triangles[i];
        const float *a = mesh->vertices[corners[0]], *b = mesh->vertices[corners[1]], *c = mesh->vertices[corners[2]];
        for (int axis = 0; axis < 3; axis++) {
            int y = (axis + 1) % 3, z = (axis + 2) % 3;
            float area = (b[y] - a[y]) * (c[z] - a[z]) - (b[z] - a[z]) * (c[y] - a[y]);
            for (int k = 0; k < 3; k++)
                normals[corners[k]][axis] += area;
        }
    }
    for (uint32_t i = 0; i < mesh->vertex_count; i++) {
        float *n = normals[i], length = sqrtf(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
        for (int axis = 0; axis < 3; axis++)
            n[axis] = length > 0 ? n[axis] / length : axis == 1;
    }
    return normals;
}

static void map_vertex(const struct gltf_material *material, const float at[3], const float normal[3], float ret_uv[2])
{
    double length = sqrt((double)(at[0] * at[0] + at[1] * at[1] + at[2] * at[2]));
    if (material->mapping == GLTF_BY_SPHERE) { /* the seam is at the back */
        ret_uv[0] = (float)(0.5 + atan2(at[0], at[2]) / (2 * M_PI));
        ret_uv[1] = (float)(0.5 - asin(length > 0 ? at[1] / length : 0) / M_PI);
        return;
    }
    float x = fabsf(normal[0]), y = fabsf(normal[1]), z = fabsf(normal[2]);
    bool is_side = x > y && x > z, is_level = !is_side && y > z;
    ret_uv[0] = (float)(material->scale * (double)(is_side ? -at[2] * (normal[0] > 0 ? 1 : -1) : at[0]));
    ret_uv[1] = (float)(material->scale * (double)(is_level ? at[2] : -at[1]));
}

static void write_part_bytes(const struct gltf_material *material, const struct mesh *mesh, FILE *file)
{
    fwrite(mesh->vertices, sizeof *mesh->vertices, mesh->vertex_count, file);
    struct arrays arrays = arrays_of(material, mesh);
    if (arrays.index_count)
        fwrite(arrays.indices, sizeof(uint32_t), arrays.index_count, file);
    float(*normals)[3] = find_normals(mesh);
    if (arrays.has_normals)
        fwrite(normals, sizeof *normals, mesh->vertex_count, file);
    for (uint32_t i = 0; i < mesh->vertex_count && arrays.has_coordinates; i++) {
        float uv[2];
        map_vertex(material, mesh->vertices[i], normals[i], uv);
        fwrite(uv, sizeof uv, 1, file);
    }
    if (mesh->radii)
        fwrite(mesh->radii, sizeof *mesh->radii, mesh->vertex_count, file);
    free(normals);
}

static void write_motion_bytes(const struct gltf_motion *motion, FILE *file)
{
    for (int path = 0; path < 3; path++)
        for (int i = 0; i < motion->key_count; i++) {
            const struct gltf_key *key = &motion->keys[i];
            const double *numbers = path == 0 ? &key->time : path == 1 ? key->translation : key->rotation;
            const int counts[] = {1, 3, 4};
            for (int k = 0; k < counts[path]; k++)
                fwrite(&(float){(float)numbers[k]}, sizeof(float), 1, file);
        }
}

static int write_bin(const struct gltf *gltf, FILE *file)
{
    for (int i = 0; i < gltf->mesh_count; i++)
        for (int part = 0; part < gltf->meshes[i].part_count; part++)
            write_part_bytes(material_of(gltf, &gltf->meshes[i], part), &gltf->meshes[i].parts[part], file);
    for (int i = 0; i < gltf->motion_count; i++)
        write_motion_bytes(&gltf->motions[i], file);
    return ferror(file) ? -1 : 0;
}

static int write_png(const struct gltf_image *image, const char *path)
{
    png_image png = {
        .version = PNG_IMAGE_VERSION, .width = image->width, .height = image->height, .format = PNG_FORMAT_RGBA};
    int ok = png_image_write_to_file(&png, path, 0, image->pixels, 0, NULL);
    png_image_free(&png);
    return ok ? 0 : -1;
}

int gltf_write(const struct gltf *gltf, const char *path)
{
    size_t length = strlen(path);
    if (length < 6 || length >= 4000 || strcmp(path + length - 5, ".gltf") != 0) {
        errno = EINVAL;
        return -1;
    }
    char stem[4096], other[4200];
    snprintf(stem, sizeof stem, "%.*s", (int)length - 5, path);
    const char *slash = strrchr(stem, '/');
    snprintf(other, sizeof other, "%s.bin", stem);
    FILE *json = fopen(path, "w"), *bin = fopen(other, "wb");
    int result =
        json && bin && write_json(gltf, slash ? slash + 1 : stem, json) == 0 && write_bin(gltf, bin) == 0 ? 0 : -1;
    if (json && fclose(json) != 0)
        result = -1;
    if (bin && fclose(bin) != 0)
        result = -1;
    for (int i = 0; i < gltf->image_count && result == 0; i++) {
        snprintf(other, sizeof other, "%s.%d.png", stem, i);
        result = write_png(&gltf->images[i], other);
    }
    return result;
}
