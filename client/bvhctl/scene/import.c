/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/scene/import.h"

#include <assimp/cimport.h>
#include <assimp/config.h>
#include <assimp/postprocess.h>
#include <assimp/scene.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>

#include "client/bvhctl/base/files.h"
#include "client/bvhctl/scene/gltf.h"
#include "client/bvhctl/scene/import_files.h"
#include "client/bvhctl/scene/import_limits.h"
#include "client/bvhctl/scene/import_nodes.h"
#include "client/bvhctl/scene/import_round.h"
#include "client/bvhctl/scene/weld.h"

/* The text is the same for every allocation, because all of them are for the scene as a whole. */
static enum bvhd_status no_memory(const char *path, struct bvhd_error *error)
{
    return bvhd_error_no_memory(error, path, "no memory for the scene, or more than --memory allows");
}

static char *copy_name(struct memory *memory, const struct aiString *name)
{
    return files_copy_text(memory, name->length < sizeof name->data ? name->data : "");
}

char *import_name(const char *path, struct memory *memory)
{
    const char *slash = strrchr(path, '/'), *base = slash ? slash + 1 : path, *dot = strrchr(base, '.');
    size_t length = dot && dot > base ? (size_t)(dot - base) : strlen(base);
    char *name = memory_alloc(memory, length + 1);
    if (name) {
        memcpy(name, base, length);
        name[length] = '\0';
    }
    return name;
}

/* Sums up the triangles that the faces of a mesh have: corners - 2 for each. */
static uint64_t count_triangles(const struct aiMesh *source)
{
    uint64_t triangles = 0;
    for (unsigned i = 0; i < source->mNumFaces; i++)
        triangles += source->mFaces[i].mNumIndices > 2 ? source->mFaces[i].mNumIndices - 2 : 0;
    return triangles;
}

/* `wanted` is the number of triangles before the polygons were cut. */
static void count_faces(const struct aiMesh *source, const struct import_wish *wish, uint64_t wanted,
                        struct import_mesh *mesh)
{
    struct import_counts *counts = &mesh->counts;
    for (unsigned i = 0; i < source->mNumFaces; i++) {
        unsigned corners = source->mFaces[i].mNumIndices;
        counts->empty_faces += corners == 0;
        counts->points += corners == 1 && !(wish->point_radius > 0);
        counts->lines += corners == 2 && !(wish->line_radius > 0);
    }
    counts->skins += source->mNumBones > 0;
    counts->morphs += source->mNumAnimMeshes;
    counts->lost += wanted > mesh->primitive_count ? wanted - mesh->primitive_count : 0;
}

/* Copies the faces that have as many corners as the primitives of the mesh. */
static bool copy_faces(const struct aiMesh *source, struct import_mesh *mesh)
{
    uint32_t corners = import_shape_kinds[mesh->shape].corners, *out = mesh->indices;
    for (unsigned i = 0; i < source->mNumFaces; i++) {
        const struct aiFace *face = &source->mFaces[i];
        for (unsigned k = 0; k < corners && face->mNumIndices == corners; k++) {
            if (face->mIndices[k] >= mesh->vertex_count)
                return false;
            *out++ = face->mIndices[k];
        }
    }
    return true;
}

static void copy_positions(const struct aiMesh *source, struct import_mesh *mesh)
{
    for (unsigned i = 0; i < source->mNumVertices; i++) {
        mesh->positions[3 * (size_t)i] = (float)source->mVertices[i].x;
        mesh->positions[3 * (size_t)i + 1] = (float)source->mVertices[i].y;
        mesh->positions[3 * (size_t)i + 2] = (float)source->mVertices[i].z;
    }
}

/* Materials without a name and assimp's default material give no colour, because nobody chose it. */
static void copy_colour(const struct aiMaterial *material, struct import_mesh *mesh)
{
    struct aiColor4D colour;
    if (!*mesh->material || !strcmp(mesh->material, AI_DEFAULT_MATERIAL_NAME))
        return;
    if (aiGetMaterialColor(material, AI_MATKEY_BASE_COLOR, &colour) != aiReturn_SUCCESS &&
        aiGetMaterialColor(material, AI_MATKEY_COLOR_DIFFUSE, &colour) != aiReturn_SUCCESS)
        return;
    const float channels[3] = {(float)colour.r, (float)colour.g, (float)colour.b};
    mesh->has_colour = true;
    for (int i = 0; i < 3; i++)
        mesh->colour[i] = channels[i] >= 0 && channels[i] <= 1 ? channels[i] : channels[i] > 1 ? 1.0f : 0.0f;
}

/* What is copied from assimp. */
struct copy {
    const struct aiScene *scene;
    const struct import_wish *wish;
    const uint64_t *wanted; /* of each mesh, the number of triangles before the polygons were cut */
    struct import_meshes_of *meshes_of; /* of each mesh */
    const char *path;
    struct import *import;
    struct bvhd_error *error;
};

static uint32_t count_shape(const struct aiMesh *source, enum import_shape shape)
{
    uint32_t count = 0;
    for (unsigned i = 0; i < source->mNumFaces; i++)
        count += source->mFaces[i].mNumIndices == import_shape_kinds[shape].corners;
    return count;
}

/* Copies the primitives of one shape of a mesh. Names and colours are those of the mesh. */
static enum bvhd_status copy_mesh(const struct copy *copy, const struct aiMesh *source, struct import_mesh *mesh)
{
    struct aiString name = {0};
    struct memory *memory = copy->import->memory;
    const struct aiMaterial *material =
        source->mMaterialIndex < copy->scene->mNumMaterials ? copy->scene->mMaterials[source->mMaterialIndex] : NULL;
    if (material)
        aiGetMaterialString(material, AI_MATKEY_NAME, &name);
    mesh->primitive_count = count_shape(source, mesh->shape);
    mesh->vertex_count = source->mVertices ? source->mNumVertices : 0;
    mesh->name = copy_name(memory, &source->mName);
    mesh->material = copy_name(memory, &name);
    /* There is room for one element more, so that arrays of a mesh without triangles are not NULL. */
    mesh->positions = memory_array(memory, (uint64_t)mesh->vertex_count + 1, 3 * sizeof *mesh->positions);
    mesh->indices = memory_array(memory, (uint64_t)mesh->primitive_count + 1, 3 * sizeof *mesh->indices);
    if (!mesh->name || !mesh->material || !mesh->positions || !mesh->indices)
        return no_memory(copy->path, copy->error);
    if (material)
        copy_colour(material, mesh);
    if (!copy_faces(source, mesh))
        return bvhd_error_set(copy->error, BVHD_INVALID, copy->path, "mesh '%s' has an index beyond its vertices",
                              mesh->name);
    if (mesh->vertex_count)
        copy_positions(source, mesh);
    return BVHD_OK;
}

/* Copies the points or lines of a mesh, all of one radius: assimp knows no other. */
static enum bvhd_status copy_round(const struct copy *copy, const struct aiMesh *source, struct import_mesh *mesh)
{
    float radius = import_round_radius(copy->wish, mesh->shape);
    enum bvhd_status status = copy_mesh(copy, source, mesh);
    if (status)
        return status;
    mesh->radii = memory_array(copy->import->memory, (uint64_t)mesh->vertex_count + 1, sizeof *mesh->radii);
    for (uint32_t i = 0; i < mesh->vertex_count && mesh->radii; i++)
        mesh->radii[i] = radius;
    /* Assimp gives each line vertices of its own. */
    bool ok = mesh->radii && weld_mesh(mesh, copy->import->memory) && import_round_order(mesh, copy->import->memory);
    return ok ? BVHD_OK : no_memory(copy->path, copy->error);
}

/* Numbers the meshes: those of triangles as in the scene, then those of points and of lines that are not empty. */
static uint64_t number_meshes(const struct copy *copy)
{
    uint64_t count = copy->scene->mNumMeshes;
    for (unsigned i = 0; i < copy->scene->mNumMeshes; i++) {
        copy->meshes_of[i].shapes[IMPORT_TRIANGLES] = i;
        for (enum import_shape shape = IMPORT_POINTS; shape < IMPORT_SHAPES; shape++) {
            bool is_there = import_round_radius(copy->wish, shape) > 0 && count_shape(copy->scene->mMeshes[i], shape);
            copy->meshes_of[i].shapes[shape] = is_there && count < IMPORT_NO_MESH ? (uint32_t)count++ : IMPORT_NO_MESH;
        }
    }
    return count;
}

static enum bvhd_status copy_meshes(const struct copy *copy)
{
    struct import *import = copy->import;
    uint64_t count = number_meshes(copy);
    if (count == 0)
        return BVHD_OK;
    import->meshes = memory_array(import->memory, count, sizeof *import->meshes);
    if (!import->meshes)
        return no_memory(copy->path, copy->error);
    memset(import->meshes, 0, count * sizeof *import->meshes);
    import->mesh_count = (uint32_t)count;
    for (unsigned i = 0; i < copy->scene->mNumMeshes; i++) {
        const struct aiMesh *source = copy->scene->mMeshes[i];
        enum bvhd_status status = copy_mesh(copy, source, &import->meshes[i]);
        count_faces(source, copy->wish, copy->wanted[i], &import->meshes[i]);
        import_counts_add_mesh(&import->counts, &import->meshes[i].counts);
        for (enum import_shape shape = IMPORT_POINTS; shape < IMPORT_SHAPES && !status; shape++) {
            uint32_t mesh = copy->meshes_of[i].shapes[shape];
            if (mesh == IMPORT_NO_MESH)
                continue;
            import->meshes[mesh].shape = shape;
            status = copy_round(copy, source, &import->meshes[mesh]);
        }
        if (status)
            return status;
    }
    import_round_count(import);
    return BVHD_OK;
}

static enum bvhd_status no_triangles(const struct copy *copy)
{
    const struct import_counts *counts = &copy->import->counts;
    if (counts->points || counts->lines || counts->lost)
        return bvhd_error_set(copy->error, BVHD_INVALID, copy->path,
                              "no triangles in it, only %llu points, %llu lines and %llu triangles of broken "
                              "polygons%s",
                              (unsigned long long)counts->points, (unsigned long long)counts->lines,
                              (unsigned long long)counts->lost, import_round_hint(counts));
    return bvhd_error_set(copy->error, BVHD_INVALID, copy->path, "no triangles in it");
}

static enum bvhd_status copy_scene(const struct copy *copy)
{
    struct import *import = copy->import;
    enum bvhd_status status = copy_meshes(copy);
    if (status)
        return status;
    if (!import_round_any(import))
        return no_triangles(copy);
    import->counts.animations = copy->scene->mNumAnimations;
    status = import_nodes(copy->scene, copy->meshes_of, import);
    if (status == BVHD_UNSUPPORTED)
        return bvhd_error_set(copy->error, status, copy->path, "assimp made a node with a mesh that is not there");
    if (status)
        return no_memory(copy->path, copy->error);
    if (import->instance_count == 0)
        return bvhd_error_set(copy->error, BVHD_INVALID, copy->path, "no node has triangles");
    return BVHD_OK;
}

/* Says why assimp returned nothing. */
static enum bvhd_status refused(const char *path, struct bvhd_error *error)
{
    char text[BVHD_TEXT_SIZE];
    snprintf(text, sizeof text, "%s", aiGetErrorString());
    text[strcspn(text, "\r\n")] = '\0';
    if (!strcmp(text, "std::bad_alloc") && import_limits_memory())
        return bvhd_error_set(error, BVHD_UNSUPPORTED, path,
                              "assimp needs more than %.0f MB, which is the limit for a file of its size",
                              (double)import_limits_memory() / 1e6);
    if (!strcmp(text, "std::bad_alloc"))
        return bvhd_error_set(error, BVHD_UNSUPPORTED, path, "assimp needs more memory than there is");
    return bvhd_error_set(error, BVHD_UNSUPPORTED, path, "%s", *text ? text : "assimp does not read it");
}

/* Reads the file without cutting polygons, so that they can be counted. */
static const struct aiScene *read_polygons(const char *path, struct import_files *files)
{
    struct aiPropertyStore *properties = aiCreatePropertyStore();
    if (!properties)
        return NULL;
    /* Otherwise some importers make a mesh of the bones of files without meshes, which is not in the file. */
    aiSetImportPropertyInteger(properties, AI_CONFIG_IMPORT_NO_SKELETON_MESHES, 1);
    const struct aiScene *scene = aiImportFileExWithProperties(path, 0, &files->io, properties);
    aiReleasePropertyStore(properties);
    return scene;
}

static enum bvhd_status read_by_assimp(const char *path, const struct import_wish *wish, struct import_files *files,
                                       struct import *import, struct bvhd_error *error)
{
    const struct aiScene *scene = read_polygons(path, files);
    if (!scene || !scene->mRootNode) {
        enum bvhd_status status = refused(path, error);
        aiReleaseImport(scene);
        return status;
    }
    uint64_t count = (uint64_t)scene->mNumMeshes + 1, *wanted = memory_array(import->memory, count, sizeof *wanted);
    struct import_meshes_of *meshes_of = memory_array(import->memory, count, sizeof *meshes_of);
    for (unsigned i = 0; i < scene->mNumMeshes && wanted; i++)
        wanted[i] = count_triangles(scene->mMeshes[i]);
    enum bvhd_status status = BVHD_OK;
    if (!wanted || !meshes_of)
        status = no_memory(path, error);
    else if (!(scene = aiApplyPostProcessing(scene, aiProcess_Triangulate)))
        status = refused(path, error);
    if (!status)
        status = copy_scene(&(struct copy){scene, wish, wanted, meshes_of, path, import, error});
    memory_free(import->memory, meshes_of);
    memory_free(import->memory, wanted);
    aiReleaseImport(scene);
    return status;
}

static enum bvhd_status read_scene(const char *path, const struct import_wish *wish, struct import_files *files,
                                   struct import *import, struct bvhd_error *error)
{
    struct stat file;
    const char *foreign = NULL;
    enum bvhd_status status = BVHD_OK;
    if (stat(path, &file) < 0)
        return bvhd_error_set(error, BVHD_NOT_FOUND, path, "no such file");
    bool is_gltf = gltf_is_file(path);
    if (is_gltf)
        status = gltf_read(path, wish, files, import, &foreign, error);
    if (is_gltf && !foreign)
        import->reader = IMPORT_BY_GLTF;
    if (status || (is_gltf && !foreign))
        return status;
    if (wish->scene)
        return bvhd_error_set(error, BVHD_NOT_FOUND, path,
                              "it has no scene '%.60s': only glTF 2.0 has scenes to choose", wish->scene);
    if (wish->moment)
        return bvhd_error_set(error, BVHD_NOT_FOUND, path, "it has no moments: only animations of glTF 2.0 are read");
    status = read_by_assimp(path, wish, files, import, error);
    if (status && foreign && error)
        return bvhd_error_set(error, status, path, "%s: %.90s", foreign, error->text);
    return status;
}

/* Reads a file by `read`, and completes the import. */
static enum bvhd_status read_by(const char *path, const struct import_wish *wish, struct memory *memory,
                                enum bvhd_status (*read)(const char *, const struct import_wish *,
                                                         struct import_files *, struct import *, struct bvhd_error *),
                                struct import *ret_import, struct bvhd_error *error)
{
    struct import import = {.memory = memory,
                            .name = import_name(path, memory),
                            .wants_looks = wish->wants_looks,
                            .point_radius = wish->point_radius,
                            .line_radius = wish->line_radius};
    if (!import.name)
        return no_memory(path, error);
    struct import_files files;
    import_files_init(&files, memory);
    enum bvhd_status status = read(path, wish, &files, &import, error);
    if (!status && files.failed)
        status = no_memory(path, error);
    import.files = files.paths;
    import.file_count = files.count;
    if (status)
        import_finish(&import);
    else
        *ret_import = import;
    return status;
}

enum bvhd_status import_read_as(const char *path, const struct import_wish *wish, struct memory *memory,
                                struct import *ret_import, struct bvhd_error *error)
{
    return read_by(path, wish, memory, read_scene, ret_import, error);
}

enum bvhd_status import_read(const char *path, const char *scene, struct memory *memory, struct import *ret_import,
                             struct bvhd_error *error)
{
    return import_read_as(path, &(struct import_wish){.scene = scene}, memory, ret_import, error);
}

enum bvhd_status import_read_with_looks(const char *path, const char *scene, struct memory *memory,
                                        struct import *ret_import, struct bvhd_error *error)
{
    return import_read_as(path, &(struct import_wish){.scene = scene, .wants_looks = true}, memory, ret_import, error);
}

enum bvhd_status import_read_by_assimp(const char *path, const struct import_wish *wish, struct memory *memory,
                                       struct import *ret_import, struct bvhd_error *error)
{
    return read_by(path, wish, memory, read_by_assimp, ret_import, error);
}

static void finish_meshes(struct import *import)
{
    for (uint32_t i = 0; i < import->mesh_count; i++) {
        memory_free(import->memory, import->meshes[i].name);
        memory_free(import->memory, import->meshes[i].material);
        memory_free(import->memory, import->meshes[i].positions);
        memory_free(import->memory, import->meshes[i].end_positions);
        memory_free(import->memory, import->meshes[i].indices);
        memory_free(import->memory, import->meshes[i].radii);
        memory_free(import->memory, import->meshes[i].caps);
        import_look_finish(&import->meshes[i].look, import->memory);
    }
    memory_free(import->memory, import->meshes);
}

void import_finish(struct import *import)
{
    if (!import || !import->memory)
        return;
    if (import->block) {
        memory_free(import->memory, import->block);
        *import = (struct import){0};
        return;
    }
    finish_meshes(import);
    for (uint32_t i = 0; i < import->image_count; i++)
        memory_free(import->memory, import->images[i].rgba);
    memory_free(import->memory, import->images);
    for (uint32_t i = 0; i < import->bottom_count; i++) {
        memory_free(import->memory, import->bottoms[i].name);
        memory_free(import->memory, import->bottoms[i].meshes);
    }
    for (uint32_t i = 0; i < import->file_count; i++)
        memory_free(import->memory, import->files[i]);
    memory_free(import->memory, import->bottoms);
    memory_free(import->memory, import->files);
    memory_free(import->memory, import->instances);
    memory_free(import->memory, import->motions);
    memory_free(import->memory, import->node_names.texts);
    memory_free(import->memory, import->source_name);
    memory_free(import->memory, import->name);
    *import = (struct import){0};
}

uint32_t import_turning_count(const struct import *import)
{
    uint32_t count = 0;
    for (uint32_t i = 0; i < import->motion_count; i++)
        count += import->motions[i].kind == ORACLE_SRT;
    return count;
}

static struct oracle_mesh *add_oracle_meshes(const struct import *import, uint32_t bottom_index,
                                             const struct oracle_mesh *place, struct oracle_mesh *next)
{
    const struct import_bottom *bottom = &import->bottoms[bottom_index];
    for (uint32_t i = 0; i < bottom->mesh_count; i++) {
        const struct import_mesh *mesh = &import->meshes[bottom->meshes[i]];
        *next = *place;
        next->shape = import_shape_kinds[mesh->shape].oracle;
        next->positions = mesh->positions;
        next->end_positions = mesh->end_positions;
        next->indices = mesh->indices;
        next->radii = mesh->radii;
        next->caps = mesh->caps;
        next->primitive_count = mesh->primitive_count;
        next->geometry = i;
        next++;
    }
    return next;
}

/* Returns where an instance is, as a mesh without primitives. */
static struct oracle_mesh place_of(const struct import *import, uint32_t index)
{
    const struct import_instance *instance = &import->instances[index];
    const struct import_motion *motion = instance->motion ? &import->motions[instance->motion - 1] : NULL;
    return (struct oracle_mesh){.transform = motion ? motion->start : instance->transform,
                                .motion = motion ? motion->kind : ORACLE_STILL,
                                .end_transform = motion ? motion->end : NULL,
                                .instance = index};
}

static uint64_t count_instanced_meshes(const struct import *import)
{
    uint64_t count = 0;
    for (uint32_t i = 0; i < import->instance_count; i++)
        count += import->instances[i].skipped ? 0 : import->bottoms[import->instances[i].bottom].mesh_count;
    return count;
}

enum bvhd_status import_oracle_meshes(const struct import *import, bool has_top, struct oracle_mesh **ret_meshes,
                                      uint32_t *ret_count, struct bvhd_error *error)
{
    uint64_t count = has_top ? count_instanced_meshes(import) : import->bottoms[0].mesh_count;
    struct oracle_mesh *meshes = count < UINT32_MAX ? memory_array(import->memory, count, sizeof *meshes) : NULL;
    if (!meshes && count)
        return no_memory(import->name, error);
    struct oracle_mesh *next = meshes;
    if (!has_top)
        add_oracle_meshes(import, 0, &(struct oracle_mesh){.instance = RAY_NO_INSTANCE}, next);
    for (uint32_t i = 0; has_top && i < import->instance_count; i++) {
        const struct oracle_mesh place = place_of(import, i);
        if (!import->instances[i].skipped)
            next = add_oracle_meshes(import, import->instances[i].bottom, &place, next);
    }
    *ret_meshes = meshes;
    *ret_count = (uint32_t)count;
    return BVHD_OK;
}
