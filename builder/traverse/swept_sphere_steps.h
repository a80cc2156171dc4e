/* SPDX-License-Identifier: Apache-2.0 */
/*
 * swept_sphere_steps.h - the steps of the test of a linear swept sphere, in the arithmetic that round_real.h chose. It
 * is not an ordinary header: swept_sphere.c includes it twice. Letters are those of swept_sphere.h.
 *
 * Errors are bounded as in sphere_steps.h: x and v are wrong by at most 4 units of the roots of x_size and v_size, and
 * the error of a number that is called `n` is at most n_open. Products of two such numbers are wrong by what each error
 * makes of the other number, by the product of the errors, and by what rounding adds.
 */

/* The numbers of one test, with the bounds of their errors. */
struct REAL_NAME(cone) {
    REAL dd, c, g, k; /* d.d has an error of 4 units */
    REAL along; /* D.d */
    REAL slack; /* L^2 - q^2 */
    double c_open, g_open, k_open, along_open, slack_open;
};

static inline void REAL_NAME(prepare_cone)(const struct REAL_NAME(vector) * f, const struct REAL_NAME(vector) * way,
                                           const struct REAL_NAME(vector) * d, float first_radius, float second_radius,
                                           struct REAL_NAME(cone) * ret_cone)
{
    double x_size, v_size;
    const struct REAL_NAME(vector) x = REAL_NAME(cross)(f, d, &x_size), v = REAL_NAME(cross)(way, d, &v_size);
    const double u = REAL_UNIT;
    const REAL r = REAL_OF((double)first_radius), q = REAL_APART((double)first_radius, (double)second_radius);
    const REAL dd = REAL_NAME(dot)(d, d), xx = REAL_NAME(dot)(&x, &x), vv = REAL_NAME(dot)(&v, &v);
    const REAL qq = REAL_MUL(q, q), length = REAL_NAME(dot)(way, way), rr_dd = REAL_MUL(REAL_MUL(r, r), dd),
               qq_dd = REAL_MUL(qq, dd), rq_dd = REAL_MUL(REAL_MUL(r, q), dd), xv = REAL_NAME(dot)(&x, &v);
    *ret_cone = (struct REAL_NAME(cone)){
        .dd = dd,
        .c = REAL_SUB(xx, rr_dd),
        .g = REAL_SUB(REAL_OF(0.0), REAL_ADD(xv, rq_dd)),
        .k = REAL_SUB(vv, qq_dd),
        .along = REAL_NAME(dot)(way, d),
        .slack = REAL_SUB(length, qq),
        .slack_open = 8 * u * (REAL_ROUND(length) + REAL_ROUND(qq)),
        .along_open = 8 * u * REAL_NAME(dot_size)(way, d),
    };
    const double x_long = sqrt(REAL_ROUND(xx)), v_long = sqrt(REAL_ROUND(vv)), x_wide = sqrt(x_size),
                 v_wide = sqrt(v_size);
    ret_cone->c_open = u * (8 * x_long * x_wide + 16 * u * x_size + 8 * (REAL_ROUND(xx) + REAL_ROUND(rr_dd)));
    ret_cone->k_open = u * (8 * v_long * v_wide + 16 * u * v_size + 8 * (REAL_ROUND(vv) + REAL_ROUND(qq_dd)));
    ret_cone->g_open = u * (4 * (x_long * v_wide + v_long * x_wide) + 16 * u * x_wide * v_wide +
                            8 * (x_long * v_long + fabs(REAL_ROUND(rq_dd))));
}

/* Where a line enters the infinite cone. */
struct REAL_NAME(entry) {
    REAL way; /* from the point that is next to the first centre: w of swept_sphere.h */
    REAL y;
    double way_open, y_open;
};

/* Finds where the line enters the cone, if h and k allow it. */
static inline void REAL_NAME(enter_cone)(const struct REAL_NAME(cone) * cone, REAL h, double h_open,
                                         struct REAL_NAME(entry) * ret_entry)
{
    const double u = REAL_UNIT, dd = REAL_ROUND(cone->dd), along = fabs(REAL_ROUND(cone->along)),
                 g = fabs(REAL_ROUND(cone->g)), c = fabs(REAL_ROUND(cone->c));
    const REAL e = REAL_MUL(cone->dd, cone->slack), side = REAL_MUL(cone->along, cone->g),
               root = REAL_SQRT(REAL_MUL(e, h));
    const double e_open = dd * cone->slack_open + 8 * u * REAL_ROUND(e);
    const double product = REAL_ROUND(e) * fabs(REAL_ROUND(h)),
                 product_open = REAL_ROUND(e) * h_open + e_open * (fabs(REAL_ROUND(h)) + h_open) + 2 * u * product;
    const double root_open = product_open / fmax(REAL_ROUND(root), sqrt(product_open)) + 4 * u * REAL_ROUND(root);
    const double side_open =
        along * cone->g_open + g * cone->along_open + cone->g_open * cone->along_open + 2 * u * along * g;
    const bool is_front = REAL_ROUND(side) > 0;
    double above_open, below_open;
    REAL above, below;
    if (is_front) {
        above = REAL_SUB(REAL_MUL(e, cone->c), REAL_MUL(cone->g, cone->g));
        above_open = REAL_ROUND(e) * cone->c_open + e_open * (c + cone->c_open) + 2 * g * cone->g_open +
                     cone->g_open * cone->g_open + 4 * u * (REAL_ROUND(e) * c + g * g);
        below = REAL_MUL(cone->dd, REAL_ADD(side, root));
        below_open = dd * (side_open + root_open) + 8 * u * REAL_ROUND(below);
    } else {
        above = REAL_SUB(side, root);
        above_open = side_open + root_open + 2 * u * fabs(REAL_ROUND(above));
        below = REAL_MUL(cone->dd, cone->k);
        below_open = dd * cone->k_open + 8 * u * fabs(REAL_ROUND(below));
    }
    ret_entry->way = REAL_DIV(above, below);
    const double way = fabs(REAL_ROUND(ret_entry->way)), surely_below = fabs(REAL_ROUND(below)) - below_open;
    const double way_open = (above_open + way * below_open) / fmax(surely_below, 0) + 8 * u * way;
    ret_entry->y = REAL_ADD(REAL_DIV(cone->g, cone->dd), REAL_MUL(ret_entry->way, cone->along));
    ret_entry->y_open = (cone->g_open + 16 * u * g) / dd + way_open * (along + cone->along_open) +
                        way * cone->along_open + 4 * u * way * along;
    ret_entry->way_open = way_open;
}

/* Returns the answer for a line that comes out of the opening of the cone, or is within the cone everywhere. */
static inline enum swept_answer REAL_NAME(meet_cap_behind)(const struct REAL_NAME(cone) * cone)
{
    return REAL_ROUND(cone->along) > 0 ? SWEPT_FIRST : SWEPT_SECOND;
}

static enum swept_answer REAL_NAME(enter_swept)(const struct round_ray *ray, const float first[4],
                                                const float second[4], struct swept_sphere_hit *ret_hit)
{
    const double u = REAL_UNIT, from[3] = {first[0], first[1], first[2]};
    const struct REAL_NAME(vector) f = REAL_NAME(towards)(ray->origin, first), d = REAL_NAME(direction_of)(ray),
                                   way = REAL_NAME(towards)(from, second);
    struct REAL_NAME(cone) cone;
    REAL_NAME(prepare_cone)(&f, &way, &d, first[3], second[3], &cone);
    const double slack = REAL_ROUND(cone.slack);
    if (!(slack > cone.slack_open))
        return REAL_IS_LAST || slack < -cone.slack_open ? SWEPT_SWALLOWED : SWEPT_OPEN;

    const double k = REAL_ROUND(cone.k), g = fabs(REAL_ROUND(cone.g)), c = fabs(REAL_ROUND(cone.c));
    const bool is_parallel = !(fabs(k) > cone.k_open);
    if (!REAL_IS_LAST && is_parallel)
        return SWEPT_OPEN;
    if (k < 0 && !is_parallel && REAL_ROUND(cone.along) * ((double)first[3] - second[3]) > 0)
        return REAL_NAME(meet_cap_behind)(&cone);
    const REAL kc = REAL_MUL(cone.k, cone.c), gg = REAL_MUL(cone.g, cone.g), h = REAL_SUB(gg, kc);
    const double h_open = 2 * g * cone.g_open + cone.g_open * cone.g_open + fabs(k) * cone.c_open + c * cone.k_open +
                          cone.k_open * cone.c_open + 4 * u * (g * g + fabs(k) * c);
    if (REAL_ROUND(h) < -h_open)
        return SWEPT_MISSED;
    if (!REAL_IS_LAST && !(REAL_ROUND(h) > h_open))
        return SWEPT_OPEN;
    if (is_parallel && !(REAL_ROUND(cone.along) * REAL_ROUND(cone.g) > 0))
        return REAL_NAME(meet_cap_behind)(&cone);

    struct REAL_NAME(entry) entry;
    REAL_NAME(enter_cone)(&cone, h, h_open, &entry);
    const double y = REAL_ROUND(entry.y), beyond = REAL_ROUND(REAL_SUB(entry.y, cone.slack)),
                 beyond_open = entry.y_open + cone.slack_open + 2 * u * slack;
    if (y < -entry.y_open)
        return SWEPT_FIRST;
    if (beyond > beyond_open)
        return SWEPT_SECOND;
    if (!REAL_IS_LAST && !(y > entry.y_open && beyond < -beyond_open))
        return SWEPT_OPEN;

    const REAL fd = REAL_NAME(dot)(&f, &d), next = REAL_DIV(fd, cone.dd), t = REAL_ADD(next, entry.way);
    const double next_open =
        (8 * u * REAL_NAME(dot_size)(&f, &d) + 16 * u * fabs(REAL_ROUND(fd))) / REAL_ROUND(cone.dd);
    const double t_open = next_open + entry.way_open + 2 * u * fabs(REAL_ROUND(t));
    if (ray->tmin >= 0 && REAL_ROUND(t) < -t_open)
        return SWEPT_MISSED;
    if (!REAL_IS_LAST && !(t_open < round_distance_error * fabs(REAL_ROUND(t))))
        return SWEPT_OPEN;
    ret_hit->t = REAL_ROUND(t) * ray->scale;
    ret_hit->u = fmin(fmax(y / slack, 0), 1);
    return SWEPT_SIDE;
}
