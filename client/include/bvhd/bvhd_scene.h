/* SPDX-License-Identifier: Apache-2.0 */
/*
 * bvhd_scene.h - reads containers: files in which `bvhctl build SCENE -o scene.bvhd` puts all structures of one or more
 * scenes together with their manifest. A game ships one file, maps it, and uses the structures in place, without a
 * daemon.
 *
 *     struct bvhd_scene *scene;
 *     if (bvhd_scene_open("city.bvhd", 0, &scene, &error) == BVHD_OK) {
 *         const struct bvhd_scene_structure *top = bvhd_scene_get_structure(scene, bvhd_scene_top(scene, 0));
 *         for (uint32_t r = 0; r < top->bottom_count; r++)
 *             blobs[r] = the data and size of bvhd_scene_get_structure(scene, top->bottoms[r]);
 *         blobs[top->bottom_count] = top->data, top->size;           what bvhd_vulkan_scene_create takes
 *         bvhd_scene_close(scene);
 *     }
 *
 * Trust: opening a container checks every size, place and text in it, so that no file makes the functions of this
 * header read beyond its end, and compares checksums, which find damage. Whoever makes a hostile file makes its
 * checksums, too: structures from untrusted sources are checked by bvhd_vulkan_check before a device gets them.
 *
 * Threads: any number of threads may use one scene at once; bvhd_scene_close must be the last call on it. Errors are
 * reported as in bvhd.h, with places such as "container.structures[3].offset". Strings are UTF-8.
 */
#ifndef BVHD_BVHD_SCENE_H
#define BVHD_BVHD_SCENE_H

#include <bvhd/bvhd.h>

#ifdef __cplusplus
extern "C" {
#endif

/* An open container. */
struct bvhd_scene;

/* Flags of the functions that open a container. */
enum {
    /*
     * The bytes of structures are not compared with their checksums when the container is opened, so that only the
     * pages of its directory are read, whatever its size. bvhd_scene_check compares those of one structure later.
     */
    BVHD_SCENE_LAZY = 0x1,
};

/*
 * Opens a container by mapping its file, which must stay as it is until the scene is closed: a program that replaces a
 * container writes another file and renames it, as bvhctl does. Fails with BVHD_NOT_FOUND, BVHD_IO (the system refuses,
 * or it is no regular file), BVHD_CORRUPT, BVHD_INCOMPATIBLE (a newer version of the format, or a target that this
 * library does not know), BVHD_INVALID (an argument) and BVHD_NO_MEMORY. End with bvhd_scene_close.
 */
BVHD_API enum bvhd_status bvhd_scene_open(const char *path, uint32_t flags, struct bvhd_scene **ret_scene,
                                          struct bvhd_error *ret_error);

/*
 * Opens a container in memory. `data` is aligned to 64 bytes; it is not copied and must stay unchanged until the scene
 * is closed. The errors are those of bvhd_scene_open, without those of files.
 */
BVHD_API enum bvhd_status bvhd_scene_open_bytes(const void *data, uint64_t size, uint32_t flags,
                                                struct bvhd_scene **ret_scene, struct bvhd_error *ret_error);

/* Closes the container; all pointers into it end here. NULL is allowed and does nothing. */
BVHD_API void bvhd_scene_close(struct bvhd_scene *scene);

/* One structure of a container. It lives as long as the scene. Later versions may add members at the end. */
struct bvhd_scene_structure {
    /* The serialized acceleration structure, aligned to 64 bytes. Structures with equal keys may share their bytes. */
    const void *data;
    uint64_t size;
    struct bvhd_key key;
    enum bvhd_target target;
    VkAccelerationStructureTypeKHR type; /* VK_ACCELERATION_STRUCTURE_TYPE_TOP_LEVEL_KHR or BOTTOM_LEVEL_KHR */
    const char
        *file; /* its name as a file, such as "city.tlas.as": different for each structure, and in the manifest */
    const char *name; /* of the mesh or node that it was built from; of a top level: of the scene; may be "" */
    const char *scene; /* the scene that it belongs to */
    float bounds[6]; /* minimum, maximum, for bvhd_reference */
    float slabs[20]; /* for bvhd_reference */
    /*
     * Of a top level: bottoms[r] is the number of the structure that row r of its references names. Rows are explained
     * in bvhd_vulkan.h.
     */
    const uint32_t *bottoms;
    uint32_t bottom_count;
    int moves; /* 1: it has motion triangles, or is a top level with the flag MOTION; for bvhd_reference */
};

/* Returns the number of structures. */
BVHD_API uint32_t bvhd_scene_structure_count(const struct bvhd_scene *scene);

/* Returns structure `index`, counted from 0, or NULL if there is none. A bottom level has a lower number than the top
 * levels that name it. */
BVHD_API const struct bvhd_scene_structure *bvhd_scene_get_structure(const struct bvhd_scene *scene, uint32_t index);

/* Returns the number of the structure with this `file`, or UINT32_MAX if there is none. */
BVHD_API uint32_t bvhd_scene_find(const struct bvhd_scene *scene, const char *file);

/*
 * Returns the number of top levels, and the number of the structure that is top level `index`, counted from 0;
 * UINT32_MAX if there is none. A container has one top level for each scene that it was built from.
 */
BVHD_API uint32_t bvhd_scene_top_count(const struct bvhd_scene *scene);
BVHD_API uint32_t bvhd_scene_top(const struct bvhd_scene *scene, uint32_t index);

/* Returns the number of the structure that is the top level of this scene, or UINT32_MAX if there is none. */
BVHD_API uint32_t bvhd_scene_find_top(const struct bvhd_scene *scene, const char *name);

/*
 * Returns the manifest, which is JSON, and the number of its bytes without the zero byte that follows. docs/manifest.md
 * describes its members. ret_size may be NULL.
 */
BVHD_API const char *bvhd_scene_manifest(const struct bvhd_scene *scene, uint64_t *ret_size);

/*
 * Compares the bytes of structure `index` with their checksum. Fails with BVHD_CORRUPT, and with BVHD_INVALID if there
 * is no such structure.
 */
BVHD_API enum bvhd_status bvhd_scene_check(const struct bvhd_scene *scene, uint32_t index,
                                           struct bvhd_error *ret_error);

#ifdef __cplusplus
}
#endif

#endif
