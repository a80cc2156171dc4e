/* SPDX-License-Identifier: Apache-2.0 */
/*
 * shader_accuracy.h - how far ray queries of a shader may be from the exact result, by what the shaders document about
 * their own rounding. For test programs only.
 */
#ifndef BVHD_SHADER_ACCURACY_H
#define BVHD_SHADER_ACCURACY_H

#include "tests/support/builder/candidates.h"

/* Transforms the ray into an instance's space. Here and below `matrix`, object to world, may be NULL. */
struct long_ray shader_accuracy_ray(const struct ray *ray, const float *matrix);

/*
 * How much larger than its bounds a shader treats an AABB of a structure with these bounds. The ray is in the
 * structure's space.
 */
long double shader_accuracy_box(const struct long_ray *ray, const float box[6], const float bounds[6]);

/* Whether t is where the ray enters the AABB, or an AABB that is larger or smaller by that much. */
bool shader_accuracy_allows_entry(const struct ray *ray, const float *matrix, const float box[6], const float bounds[6],
                                  float t);

/* Whether t, u and v of a hit are those of the exact ray, or of a ray displaced by what shaders round. */
bool shader_accuracy_allows(const struct ray *ray, const float *matrix, float corners[3][3], const struct ray_hit *hit);

#endif
