/* SPDX-License-Identifier: Apache-2.0 */
/*
 * shader_still.h - a scene as it is at one time, for judges that know nothing of motion: motion triangles become
 * triangles, and motion instances become instances. It cannot be traversed, but its records can be read. For test
 * programs only.
 */
#ifndef BVHD_SHADER_STILL_H
#define BVHD_SHADER_STILL_H

#include "builder/traverse/traverse.h"

/* A scene at one time. What does not move is that of the scene it is made from, which must outlive it. */
struct shader_still {
    struct scene scene;
    bool has_moving_top;
    struct portable_view *views; /* one for each bottom level, and the last for the top level */
    struct portable_header *headers;
    const struct portable_view **bottoms;
    void **blocks; /* vertices or records that the views lead to */
};

/* An instance that is nowhere at that time gets the mask 0. */
void shader_still_make(const struct scene *scene, float time, struct shader_still *ret_still);
void shader_still_finish(struct shader_still *still);

/*
 * Returns whether the matrix of an instance, by its position in the request, is nearly singular: the inverse in floats
 * that shaders begin with is then no inverse at all. At some times this happens to motion instances.
 */
bool shader_still_is_flat(const struct shader_still *still, uint32_t instance);

/* Returns whether anything in a scene moves. */
bool shader_still_moves(const struct scene *scene);

#endif
