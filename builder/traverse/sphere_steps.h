/* SPDX-License-Identifier: Apache-2.0 */
/*
 * sphere_steps.h - the steps of the test of a sphere, in the arithmetic that round_real.h chose. It is not an ordinary
 * header: sphere.c includes it twice.
 *
 * Errors are bounded with a unit u per operation. Those of f are u, so that those of x are 4u of what its products add
 * up to, of which `size` is the square: its own, and the two of a difference of products. Those of d.d and f.f are at
 * most 5u, and of f.d 5u of the sum of its products' sizes.
 */
static enum sphere_answer REAL_NAME(enter_sphere)(const struct round_ray *ray, const float sphere[4], double *ret_t)
{
    const struct REAL_NAME(vector) f = REAL_NAME(towards)(ray->origin, sphere), d = REAL_NAME(direction_of)(ray);
    const double u = REAL_UNIT, r = sphere[3];
    double size;
    const struct REAL_NAME(vector) x = REAL_NAME(cross)(&f, &d, &size);
    const REAL squared_r = REAL_MUL(REAL_OF(r), REAL_OF(r)), dd = REAL_NAME(dot)(&d, &d), xx = REAL_NAME(dot)(&x, &x),
               reach = REAL_MUL(squared_r, dd), discriminant = REAL_SUB(reach, xx);
    const double missed = REAL_ROUND(xx),
                 open = u * (8 * sqrt(missed * size) + 16 * u * size + 8 * (missed + REAL_ROUND(reach)));
    if (REAL_ROUND(discriminant) < -open)
        return SPHERE_MISSED;
    if (!REAL_IS_LAST && !(REAL_ROUND(discriminant) > open))
        return SPHERE_OPEN;

    const REAL fd = REAL_NAME(dot)(&f, &d), ff = REAL_NAME(dot)(&f, &f), outside = REAL_SUB(ff, squared_r),
               root = REAL_SQRT(discriminant);
    const double ahead = REAL_ROUND(fd), ahead_open = 8 * u * REAL_NAME(dot_size)(&f, &d);
    const double outside_open = 8 * u * (REAL_ROUND(ff) + REAL_ROUND(squared_r));
    if (ray->tmin >= 0 && (ahead < -ahead_open || REAL_ROUND(outside) < -outside_open))
        return SPHERE_MISSED; /* it is behind the ray, or the ray begins inside */
    const bool is_ahead = ahead > 0;
    const REAL above = is_ahead ? outside : REAL_SUB(fd, root), below = is_ahead ? REAL_ADD(fd, root) : dd;
    const double root_open = ahead_open + open / REAL_ROUND(root);
    const double error = is_ahead ? outside_open / fabs(REAL_ROUND(outside)) + root_open / REAL_ROUND(below)
                                  : root_open / -REAL_ROUND(above);
    if (!REAL_IS_LAST && !(error + 16 * u < round_distance_error))
        return SPHERE_OPEN;
    const REAL t = REAL_DIV(above, below);
    *ret_t = REAL_ROUND(t) * ray->scale;
    return SPHERE_ENTERED;
}
