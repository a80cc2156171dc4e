/* SPDX-License-Identifier: Apache-2.0 */
/*
 * sample_scene.h - small structures of every kind for targets that read structures: a bottom level of triangles, one of
 * boxes, and a top level over both, each portable and native.
 */
#ifndef BVHD_FUZZ_SAMPLE_SCENE_H
#define BVHD_FUZZ_SAMPLE_SCENE_H

#include "tests/fuzz/fuzz.h"
#include "tests/support/builder/test_scene.h"

/* Points to the three structures of a scene, the bottom levels first. */
struct sample_structures {
    const struct batch_item *items[3];
};

/* Builds the scene, which the caller ends with test_scene_finish. */
static inline void sample_scene_init(struct test_scene *ret_scene)
{
    enum { TRIANGLES = 12, BOXES = 6 };
    static float corners[TRIANGLES][3][3], boxes[BOXES][6];
    static const struct test_instance instances[] = {
        {.transform = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}, .mask = 0xff, .bottom = 0},
        {.transform = {0, 1, 0, 0.5f, -1, 0, 0, 0, 0, 0, 2, 0}, .mask = 0x81, .flags = 2, .bottom = 1}};
    struct random random = {5};
    for (int i = 0; i < TRIANGLES * 9; i++)
        corners[i / 9][i / 3 % 3][i % 3] = (float)random_between(&random, -1, 1);
    for (int i = 0; i < BOXES * 3; i++) {
        boxes[i / 3][i % 3] = (float)random_between(&random, -1, 1);
        boxes[i / 3][3 + i % 3] = boxes[i / 3][i % 3] + 0.3f;
    }
    const struct geometry triangles = test_scene_triangles((const float(*)[3][3])corners, TRIANGLES, 0),
                          aabbs = test_scene_aabbs((const float(*)[6])boxes, BOXES, 0);
    test_scene_init_native(ret_scene, LAVAPIPE_PLAIN);
    test_scene_add(ret_scene, &triangles, 1, 0);
    test_scene_add(ret_scene, &aabbs, 1, 0);
    test_scene_add_top(ret_scene, instances, 2);
}

static inline struct sample_structures sample_scene_structures(const struct test_scene *scene, bool native)
{
    const struct batch_item *from = native ? scene->native_items : scene->items;
    return (struct sample_structures){{&from[0], &from[1], &from[TEST_SCENE_BOTTOMS]}};
}

#endif
