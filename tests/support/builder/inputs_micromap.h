/* SPDX-License-Identifier: Apache-2.0 */
/*
 * inputs_micromap.h - small valid requests with opacity micromaps, as inputs.h has them of other kinds. They are
 * refused unless validate_micromaps (validate_shape.h) is set.
 */
#ifndef BVHD_TEST_INPUTS_MICROMAP_H
#define BVHD_TEST_INPUTS_MICROMAP_H

#include "tests/support/builder/inputs.h"

enum { INPUTS_MICROMAP_HANDLE = 88 };

/*
 * Makes a micromap of two triangles: one of level 1 with a micro-triangle in each of the four states, and one of level
 * 2 in two states.
 */
static inline void inputs_micromap(struct test_input *test)
{
    inputs_start(test, STRUCTURE_MICROMAP, 1);
    test->usages[0] = (struct micromap_usage){.count = 1, .level = 1, .format = 2};
    test->usages[1] = (struct micromap_usage){.count = 1, .level = 2, .format = 1};
    test->micromap_triangles[0] = (struct micromap_triangle){.offset = 5, .level = 1, .format = 2};
    test->micromap_triangles[1] = (struct micromap_triangle){.offset = 8, .level = 2, .format = 1};
    test->states[5] = 0xe4;
    test->states[8] = 0x5a;
    test->states[9] = 0x0f;
    test->geometries[0] = (struct geometry){
        .type = GEOMETRY_MICROMAP,
        .micromap = {.usages = {(const unsigned char *)test->usages, sizeof test->usages},
                     .states = {test->states, sizeof test->states},
                     .triangles = {(const unsigned char *)test->micromap_triangles, sizeof test->micromap_triangles},
                     .stride = sizeof(struct micromap_triangle)},
        .range = {.primitive_count = 2},
    };
}

/* Makes a micromap of two triangles from 4 x 4 texels, of which the left half is opaque. */
static inline void inputs_baked_micromap(struct test_input *test)
{
    static const float coordinates[4][2] = {{0, 0}, {1, 0}, {0, 1}, {1, 1}};
    static const uint16_t indices[6] = {0, 1, 2, 2, 1, 3};
    inputs_start(test, STRUCTURE_MICROMAP, 1);
    for (int i = 0; i < 16; i++)
        test->states[i] = i % 4 < 2 ? 0xff : 0x00;
    memcpy(test->coordinates, coordinates, sizeof coordinates);
    memcpy(test->indices, indices, sizeof indices);
    test->geometries[0] = (struct geometry){
        .type = GEOMETRY_BAKED_MICROMAP,
        .bake = {.alpha = {test->states, sizeof test->states},
                 .width = 4,
                 .height = 4,
                 .row_stride = 4,
                 .wrap_u = BAKE_CLAMP_TO_EDGE,
                 .wrap_v = BAKE_MIRRORED_REPEAT,
                 .is_nearest = 1,
                 .mode = BAKE_MASK,
                 .cutoff = 0.5f,
                 .format = 2,
                 .level = 3,
                 .coordinates = {(const unsigned char *)test->coordinates, sizeof test->coordinates},
                 .coordinate_stride = sizeof test->coordinates[0],
                 .vertex_count = 4,
                 .index_type = INDEX_UINT16,
                 .indices = {(const unsigned char *)test->indices, sizeof indices}},
        .range = {.primitive_count = 2},
    };
}

/*
 * Attaches the micromap of inputs_micromap, as the reference INPUTS_MICROMAP_HANDLE whose key is all 0x88, to the first
 * geometry of inputs_triangles or of inputs_motion_triangles: to its first triangle that of level 2, while the second
 * one is opaque.
 */
static inline void inputs_attach(struct test_input *test)
{
    test->usages[0] = (struct micromap_usage){.count = 1, .level = 2, .format = 1};
    test->micromap_indices[0] = 0;
    test->micromap_indices[1] = (uint16_t)MICROMAP_FULLY_OPAQUE;
    test->geometries[0].triangles.micromap = (struct triangle_micromap){
        .is_given = 1,
        .index_type = INDEX_UINT16,
        .indices = {(const unsigned char *)test->micromap_indices, sizeof test->micromap_indices},
        .stride = sizeof test->micromap_indices[0],
        .base_triangle = 1,
        .has_usages = 1,
        .usages = {(const unsigned char *)test->usages, sizeof test->usages[0]},
        .micromap = INPUTS_MICROMAP_HANDLE,
    };
    test->references[0] =
        (struct reference){.kind = REFERENCE_MICROMAP, .handle = INPUTS_MICROMAP_HANDLE, .has_key = true};
    memset(&test->references[0].key, 0x88, sizeof test->references[0].key);
    test->references[0].bounds = box_empty();
    test->input.references = test->references;
    test->input.reference_count = 1;
}

static inline void inputs_triangles_with_micromap(struct test_input *test)
{
    inputs_triangles(test);
    inputs_attach(test);
}

static inline void inputs_motion_triangles_with_micromap(struct test_input *test)
{
    inputs_motion_triangles(test);
    inputs_attach(test);
}

#endif
