/* SPDX-License-Identifier: Apache-2.0 */
/* assimp_scene.h - assimp's scene types. They want the C library's <limits.h>, in whose place ours of the same name is found. */
#ifndef BVHCTL_ASSIMP_SCENE_H
#define BVHCTL_ASSIMP_SCENE_H

#ifndef INT_MAX
#define INT_MAX __INT_MAX__
#endif

#include <assimp/scene.h>

#endif
