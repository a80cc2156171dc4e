/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/picture/scene_source.h"

#include <stdio.h>
#include <string.h>
#include <sys/stat.h>

static bool is_file(const char *path)
{
    struct stat file;
    return stat(path, &file) == 0 && S_ISREG(file.st_mode);
}

char *scene_source_find(const char *directory, const char *scene, struct memory *memory)
{
    static const char *const endings[] = {"gltf", "glb"};
    static const char *const folders[] = {"/", "/../", ""};
    size_t size = strlen(directory) + strlen(scene) + sizeof "/../.gltf";
    char *path = memory_alloc(memory, size);
    for (int i = 0; i < 6 && path; i++) {
        const char *folder = folders[i / 2];
        snprintf(path, size, "%s%s%s.%s", *folder ? directory : "", folder, scene, endings[i % 2]);
        if (is_file(path))
            return path;
    }
    memory_free(memory, path);
    return NULL;
}
