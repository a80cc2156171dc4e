/* SPDX-License-Identifier: Apache-2.0 */
/* scene_file.c - containers for programs: the functions of bvhd_scene.h. */
#include <errno.h>
#include <fcntl.h>
#include <stdbool.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <bvhd/bvhd_scene.h>

#include "builder/format/container.h"
#include "client/library.h"
#include "client/reference.h"
#include "proto/base/place.h"
#include "proto/base/status.h"

struct bvhd_scene {
    struct container container;
    void *mapping; /* NULL: the bytes are the caller's */
    struct bvhd_scene_structure *structures;
    uint32_t *tops;
    uint32_t top_count;
};

_Static_assert((int)VK_ACCELERATION_STRUCTURE_TYPE_TOP_LEVEL_KHR == STRUCTURE_TOP &&
                   (int)VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR == STRUCTURE_BOTTOM,
               "types have Vulkan's numbers");

static enum bvhd_status refuse(struct bvhd_error *error, const char *where, const char *text)
{
    return bvhd_error_set(error, BVHD_INVALID, where, "%s", text);
}

static struct bvhd_scene_structure describe(const struct container_structure *stored)
{
    struct bvhd_scene_structure structure = {
        .data = stored->blob.data,
        .size = stored->blob.size,
        .target = (enum bvhd_target)stored->target,
        .type = (VkAccelerationStructureTypeKHR)stored->type,
        .file = stored->file,
        .name = stored->name,
        .scene = stored->scene,
        .bottoms = stored->references,
        .bottom_count = stored->reference_count,
        .moves = reference_moves(stored->blob),
    };
    memcpy(&structure.key, &stored->key, sizeof structure.key);
    memcpy(structure.bounds, stored->bounds, sizeof structure.bounds);
    memcpy(structure.slabs, stored->slabs, sizeof structure.slabs);
    return structure;
}

/* Lists the structures of the container that is open, and the top levels among them. */
static enum bvhd_status list_structures(struct bvhd_scene *scene, struct bvhd_error *error)
{
    uint64_t count = scene->container.count;
    scene->structures = memory_array(&library_memory, count + 1, sizeof *scene->structures);
    scene->tops = memory_array(&library_memory, count + 1, sizeof *scene->tops);
    if (!scene->structures || !scene->tops)
        return bvhd_error_no_memory(error, "container", "no memory for the list of its structures");
    for (uint32_t i = 0; i < count; i++) {
        struct container_structure stored = container_structure(&scene->container, i);
        scene->structures[i] = describe(&stored);
        if (stored.type == STRUCTURE_TOP)
            scene->tops[scene->top_count++] = i;
    }
    return BVHD_OK;
}

static enum bvhd_status fill(struct bvhd_scene *scene, struct bytes file, uint32_t flags, struct bvhd_error *error)
{
    enum bvhd_status status = container_open(file, &scene->container, error);
    for (uint32_t i = 0; status == BVHD_OK && !(flags & BVHD_SCENE_LAZY) && i < scene->container.count; i++)
        status = container_check(&scene->container, i, error);
    return status == BVHD_OK ? list_structures(scene, error) : status;
}

/* Opens a container, and takes the mapping over, which is NULL if there is none, even if it fails. */
static enum bvhd_status open_bytes(struct bytes file, void *mapping, uint32_t flags, struct bvhd_scene **ret_scene,
                                   struct bvhd_error *error)
{
    struct bvhd_scene *scene = memory_alloc(&library_memory, sizeof *scene);
    if (!scene) {
        if (mapping)
            munmap(mapping, file.size);
        return bvhd_error_no_memory(error, "container", "no memory for it");
    }
    *scene = (struct bvhd_scene){.mapping = mapping, .container.file = file};
    enum bvhd_status status = fill(scene, file, flags, error);
    if (status == BVHD_OK)
        *ret_scene = scene;
    else
        bvhd_scene_close(scene);
    return status;
}

enum bvhd_status bvhd_scene_open_bytes(const void *data, uint64_t size, uint32_t flags, struct bvhd_scene **ret_scene,
                                       struct bvhd_error *ret_error)
{
    if (!ret_scene)
        return refuse(ret_error, "ret_scene", "ret_scene is NULL");
    if (!data)
        return refuse(ret_error, "data", "data is NULL");
    if ((uintptr_t)data % CONTAINER_ALIGN != 0)
        return refuse(ret_error, "data", "its address is no multiple of 64 bytes");
    if (flags & ~(uint32_t)BVHD_SCENE_LAZY)
        return refuse(ret_error, "flags", "not a combination of BVHD_SCENE_ flags");
    return open_bytes((struct bytes){data, size}, NULL, flags, ret_scene, ret_error);
}

static enum bvhd_status system_error(struct bvhd_error *error, const char *path, int number)
{
    enum bvhd_status status = number == ENOENT ? BVHD_NOT_FOUND : number == ENOMEM ? BVHD_NO_MEMORY : BVHD_IO;
    return bvhd_error_set(error, status, path, "%s", strerror(number));
}

/* Maps a regular file. An empty one is not mapped. */
static enum bvhd_status map_file(const char *path, int descriptor, struct bytes *ret_file, struct bvhd_error *error)
{
    static const unsigned char nothing[CONTAINER_ALIGN] __attribute__((aligned(CONTAINER_ALIGN)));
    struct stat status;
    if (fstat(descriptor, &status) < 0)
        return system_error(error, path, errno);
    if (!S_ISREG(status.st_mode))
        return bvhd_error_set(error, BVHD_IO, path, "not a regular file");
    *ret_file = (struct bytes){nothing, 0};
    if (status.st_size == 0)
        return BVHD_OK;
    void *data = mmap(NULL, (size_t)status.st_size, PROT_READ, MAP_PRIVATE, descriptor, 0);
    if (data == MAP_FAILED)
        return system_error(error, path, errno);
    *ret_file = (struct bytes){data, (uint64_t)status.st_size};
    return BVHD_OK;
}

enum bvhd_status bvhd_scene_open(const char *path, uint32_t flags, struct bvhd_scene **ret_scene,
                                 struct bvhd_error *ret_error)
{
    struct bytes file;
    if (!ret_scene)
        return refuse(ret_error, "ret_scene", "ret_scene is NULL");
    if (!path)
        return refuse(ret_error, "path", "path is NULL");
    if (flags & ~(uint32_t)BVHD_SCENE_LAZY)
        return refuse(ret_error, "flags", "not a combination of BVHD_SCENE_ flags");
    int descriptor = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOCTTY);
    if (descriptor < 0)
        return system_error(ret_error, path, errno);
    enum bvhd_status status = map_file(path, descriptor, &file, ret_error);
    close(descriptor);
    if (status != BVHD_OK)
        return status;
    return open_bytes(file, file.size ? (void *)(uintptr_t)file.data : NULL, flags, ret_scene, ret_error);
}

void bvhd_scene_close(struct bvhd_scene *scene)
{
    if (!scene)
        return;
    if (scene->mapping)
        munmap(scene->mapping, scene->container.file.size);
    memory_free(&library_memory, scene->structures);
    memory_free(&library_memory, scene->tops);
    memory_free(&library_memory, scene);
}

uint32_t bvhd_scene_structure_count(const struct bvhd_scene *scene)
{
    return scene ? scene->container.count : 0;
}

const struct bvhd_scene_structure *bvhd_scene_get_structure(const struct bvhd_scene *scene, uint32_t index)
{
    return index < bvhd_scene_structure_count(scene) ? &scene->structures[index] : NULL;
}

uint32_t bvhd_scene_find(const struct bvhd_scene *scene, const char *file)
{
    for (uint32_t i = 0; file && i < bvhd_scene_structure_count(scene); i++)
        if (strcmp(scene->structures[i].file, file) == 0)
            return i;
    return UINT32_MAX;
}

uint32_t bvhd_scene_top_count(const struct bvhd_scene *scene)
{
    return scene ? scene->top_count : 0;
}

uint32_t bvhd_scene_top(const struct bvhd_scene *scene, uint32_t index)
{
    return index < bvhd_scene_top_count(scene) ? scene->tops[index] : UINT32_MAX;
}

uint32_t bvhd_scene_find_top(const struct bvhd_scene *scene, const char *name)
{
    for (uint32_t i = 0; name && i < bvhd_scene_top_count(scene); i++)
        if (strcmp(scene->structures[scene->tops[i]].scene, name) == 0)
            return scene->tops[i];
    return UINT32_MAX;
}

const char *bvhd_scene_manifest(const struct bvhd_scene *scene, uint64_t *ret_size)
{
    if (ret_size)
        *ret_size = scene ? scene->container.manifest.size : 0;
    return scene ? (const char *)scene->container.manifest.data : NULL;
}

enum bvhd_status bvhd_scene_check(const struct bvhd_scene *scene, uint32_t index, struct bvhd_error *ret_error)
{
    if (!scene)
        return refuse(ret_error, "scene", "scene is NULL");
    if (index >= scene->container.count)
        return bvhd_error_set(ret_error, BVHD_INVALID, "index", "%u, but there are %u structures", index,
                              scene->container.count);
    return container_check(&scene->container, index, ret_error);
}
