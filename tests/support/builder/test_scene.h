/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_scene.h - small scenes that are built through the whole pipeline and opened for traversal, and brute force over
 * them.
 *
 * For test programs only: without memory, or if a build fails, they print a message and end.
 */
#ifndef BVHD_TEST_SCENE_H
#define BVHD_TEST_SCENE_H

#include "builder/update/batch.h"
#include "proto/base/geometry.h"
#include "builder/traverse/lavapipe_traverse.h"
#include "tests/support/random.h"
#include "builder/traverse/traverse.h"

enum { TEST_SCENE_BOTTOMS = 8 };

#define TEST_SCENE_INACTIVE UINT32_MAX /* the bottom level of an inactive instance */

struct test_instance {
    float transform[12];
    uint32_t custom_index, mask, sbt_offset, flags;
    uint32_t bottom;
};

struct test_scene {
    struct memory memory;
    struct batch_item items[TEST_SCENE_BOTTOMS + 1]; /* the last one is the top level */
    struct portable_view views[TEST_SCENE_BOTTOMS + 1];
    const struct portable_view *bottoms[TEST_SCENE_BOTTOMS];
    const struct test_instance *instances; /* NULL if there is no top level */
    uint32_t instance_count;
    struct scene scene;

    /* The same for a lavapipe device, if test_scene_init_native began the scene. */
    struct device_format device;
    struct batch_item native_items[TEST_SCENE_BOTTOMS + 1];
    struct lavapipe_view native_views[TEST_SCENE_BOTTOMS + 1];
    const struct lavapipe_view *native_bottoms[TEST_SCENE_BOTTOMS];
    struct lavapipe_scene native;

    enum build_quality quality; /* of everything that is added from now on */
    uint32_t flags; /* BUILD_, likewise */
    const struct reference *micromaps; /* that bottom levels may name, likewise */
    uint32_t micromap_count;
};

void test_scene_init(struct test_scene *scene);
/* Begins a scene in which everything is built twice: portable, and for a lavapipe device of this variant. */
void test_scene_init_native(struct test_scene *scene, enum lavapipe_variant variant);
void test_scene_finish(struct test_scene *scene);

/* Builds another bottom level; returns its number. */
uint32_t test_scene_add(struct test_scene *scene, const struct geometry *geometries, uint32_t count,
                        uint32_t layout_flags);

/*
 * Builds a top level over all bottom levels. Its instances must first use them in their order, and must outlive the
 * scene.
 */
void test_scene_add_top(struct test_scene *scene, const struct test_instance *instances, uint32_t count);

/* Builds a top level of `count` motion records, whose references are 0x1000 + the numbers of bottom levels. */
void test_scene_add_motion_top(struct test_scene *scene, const unsigned char *records, uint32_t count);

/* Make a geometry of `count` triangles without indices, or of `count` boxes; the floats must outlive the build. */
struct geometry test_scene_triangles(const float (*corners)[3][3], uint32_t count, uint32_t flags);
struct geometry test_scene_aabbs(const float (*boxes)[6], uint32_t count, uint32_t flags);

/* The answer of brute force. */
struct test_answer {
    bool is_hit;
    bool is_doubtful; /* a hit or a miss is too close to be certain */
    double t;
    uint32_t instance, geometry, primitive;
};

/*
 * Tests every triangle of every instance, by signed volumes in long double. It respects the mask and culling by facing,
 * and ignores all other flags; every triangle counts.
 */
struct test_answer test_scene_brute_force(const struct test_scene *scene, const struct ray *ray);

/* Returns whether two hits are equal in all fields, to the last bit. */
bool test_scene_same_hit(const struct ray_hit *a, const struct ray_hit *b);

/*
 * Makes a rotation times an uneven, shearing and sometimes mirroring scale, and a position in the cube [-place,
 * place)^3.
 */
void test_scene_transform(struct random *random, double scale, double place, float ret_transform[12]);

#endif
