/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/traverse/sphere.h"

/* The answer of the test in one precision. SPHERE_OPEN: this precision cannot decide. */
enum sphere_answer { SPHERE_MISSED, SPHERE_ENTERED, SPHERE_OPEN };

#include "builder/traverse/round_real.h"
#include "builder/traverse/sphere_steps.h"

#define ROUND_TWOFOLD
#include "builder/traverse/round_real.h"
#include "builder/traverse/sphere_steps.h"

bool sphere_intersect(const struct round_ray *ray, const float sphere[4], double *ret_t)
{
    double t = 0;
    if (!(sphere[3] > 0))
        return false;
    enum sphere_answer answer = enter_sphere_double(ray, sphere, &t);
    if (answer == SPHERE_OPEN)
        answer = enter_sphere_twofold(ray, sphere, &t);
    /* Infinite spheres end here, whatever became of their numbers. */
    if (answer != SPHERE_ENTERED || !isfinite(t))
        return false;
    *ret_t = t;
    return true;
}
