/* SPDX-License-Identifier: Apache-2.0 */
/*
 * A line and the convex hull of two spheres, with bounds that hold for all moves of the inputs.
 *
 * A search in double (oracle_hull.h) proposes, and two kinds of witnesses prove. One sphere between the ends that the
 * line surely meets proves that it meets the hull, and bounds the entry from above. A plane that has both spheres on
 * one side proves that the line misses the hull, or bounds the entry from below. A witness is one fixed number z or
 * one fixed normal, and is tested for all moves at once; that the search is inexact costs tightness alone. Both bounds
 * are stationary at the best witness, so that they are as tight as the moves allow, to first order.
 */
#include "client/bvhctl/oracle/oracle_round_internal.h"

#include "client/bvhctl/oracle/oracle_hull.h"

/* More than the sums below, of at most some twenty roundings, lose relative to the sum of their terms' magnitudes. */
#define SUM_ROUNDING (32 * DBL_EPSILON)

/* Where moves turn a direction by more than this angle, nothing is certain. Below, its length is surely not 0. */
#define MOST_TURN 0.1

/* ---- vectors ---- */

static struct radial dot(const struct radial a[3], const struct radial b[3])
{
    struct radial sum = radial_mul(a[0], b[0]);
    sum = radial_add(sum, radial_mul(a[1], b[1]));
    return radial_add(sum, radial_mul(a[2], b[2]));
}

static void cross(const struct radial a[3], const struct radial b[3], struct radial ret[3])
{
    for (int x = 0; x < 3; x++) {
        int y = (x + 1) % 3, z = (x + 2) % 3;
        ret[x] = radial_sub(radial_mul(a[y], b[z]), radial_mul(a[z], b[y]));
    }
}

static double dot3(const double a[3], const double b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static double length3(const double a[3])
{
    return sqrt(dot3(a, a));
}

/* Returns the interval between two numbers that are not negative. */
static struct radial between(double low, double high)
{
    return radial_rounded(0.5 * (low + high), 0.5 * (high - low), high);
}

static double lower(struct radial a)
{
    return a.centre - a.radius;
}

static double upper(struct radial a)
{
    return a.centre + a.radius;
}

/* Returns the interval of a vector's length. */
static struct radial length_of(const struct radial a[3])
{
    const double centre[3] = {a[0].centre, a[1].centre, a[2].centre},
                 radius[3] = {a[0].radius, a[1].radius, a[2].radius};
    double length = length3(centre), moved = length3(radius);
    return between(fmax(length - moved, 0) * (1 - SUM_ROUNDING), (length + moved) * (1 + SUM_ROUNDING));
}

/* ---- making a body ---- */

bool oracle_round_make(const struct oracle_moment *moment, uint32_t first, uint32_t second, unsigned caps,
                       struct oracle_round *ret_round)
{
    const uint32_t vertices[2] = {first, second};
    const struct oracle_mesh *mesh = moment->mesh;
    struct oracle_round round = {.moment = moment};
    for (int end = 0; end < 2; end++) {
        const float *centre = mesh->positions + (uint64_t)3 * vertices[end];
        float radius = mesh->radii[vertices[end]];
        if (!isfinite(centre[0]) || !isfinite(centre[1]) || !isfinite(centre[2]) || !isfinite(radius))
            return false;
        for (int axis = 0; axis < 3; axis++)
            round.centres[end][axis] = radial_input(centre[axis]);
        round.radii[end] = radial_input(radius);
        round.caps[end] = (caps & (end ? ORACLE_CAP_SECOND : ORACLE_CAP_FIRST)) != 0;
    }
    if (round.radii[0].centre == 0 && round.radii[1].centre == 0)
        return false;
    *ret_round = round;
    return true;
}

void oracle_round_sphere(const union oracle_subject *subject, double ret_centre[3], double *ret_radius)
{
    const struct oracle_round *round = &subject->round;
    const struct radial *matrix = round->moment->has_matrix ? round->moment->matrix : NULL;
    double stretch = 1, away[3], radius = fmax(upper(round->radii[0]), upper(round->radii[1]));
    struct radial world[2][3];
    for (int end = 0; end < 2; end++)
        for (int row = 0; row < 3; row++) {
            const struct radial *m = matrix ? matrix + 4 * row : NULL;
            world[end][row] = m ? m[3] : round->centres[end][row];
            for (int column = 0; m && column < 3; column++)
                world[end][row] = radial_add(world[end][row], radial_mul(m[column], round->centres[end][column]));
        }
    for (int k = 0; matrix && k < 9; k++) {
        const struct radial *entry = &matrix[4 * (k / 3) + k % 3];
        double most = fabs(entry->centre) + entry->radius;
        stretch = (k ? stretch : 0) + most * most;
    }
    for (int axis = 0; axis < 3; axis++) {
        ret_centre[axis] = 0.5 * world[0][axis].centre + 0.5 * world[1][axis].centre;
        away[axis] = 0.5 * fabs(world[1][axis].centre - world[0][axis].centre) +
                     fmax(world[0][axis].radius, world[1][axis].radius);
    }
    *ret_radius = (length3(away) + sqrt(stretch) * radius) * (1 + SUM_ROUNDING);
}

/* ---- a line and a body ---- */

/*
 * Moves of the ray shift the t of all primitives alike, as far as they are along it. Where the mesh has a transform,
 * the two parts of a move are not kept apart, and all of it counts as the primitive's own.
 */
struct line {
    struct radial origin[3], direction[3]; /* with all moves */
    double origin_own[3], direction_own[3], origin_shared[3], direction_shared[3];
};

struct view {
    const struct oracle_round *round;
    struct line line;
    struct radial to[2][3]; /* from the line's origin to the centres */
    double to_own[2][3]; /* the part of their radii that is no shared move */
    struct radial across[2][3]; /* to x direction: their lengths are the centres' distances times `length` */
    struct radial length; /* of the direction */
    double square, turn; /* the direction's centre: its squared length; how far it moves, relative to its length */
    struct radial axis[3], taper; /* from the first centre to the second; the first radius less the second */
};

static void place(const struct oracle_ray *ray, const struct oracle_round *round, struct line *ret_line)
{
    const struct oracle_moment *moment = round->moment;
    struct radial from[3];
    for (int axis = 0; axis < 3; axis++) {
        if (!moment->has_matrix) {
            ret_line->origin[axis] = ray->from[axis];
            ret_line->direction[axis] = ray->along[axis];
            ret_line->origin_shared[axis] = ray->from[axis].radius;
            ret_line->direction_shared[axis] = ray->along[axis].radius;
            ret_line->origin_own[axis] = ret_line->direction_own[axis] = 0;
            continue;
        }
        from[axis] = radial_sub(ray->from[axis], moment->matrix[4 * axis + 3]);
    }
    for (int axis = 0; moment->has_matrix && axis < 3; axis++) {
        ret_line->origin[axis] = dot(moment->inverse[axis], from);
        ret_line->direction[axis] = dot(moment->inverse[axis], ray->along);
        ret_line->origin_own[axis] = ret_line->origin[axis].radius;
        ret_line->direction_own[axis] = ret_line->direction[axis].radius;
        ret_line->origin_shared[axis] = ret_line->direction_shared[axis] = 0;
    }
}

/* Moves do not separate equal ends, because equal numbers come from equal ones. */
static void find_axis(const struct oracle_round *round, struct view *view)
{
    bool are_equal = true;
    for (int axis = 0; axis < 3; axis++)
        are_equal = are_equal && round->centres[0][axis].centre == round->centres[1][axis].centre;
    for (int axis = 0; axis < 3; axis++)
        view->axis[axis] = are_equal ? radial_exact(0) : radial_sub(round->centres[1][axis], round->centres[0][axis]);
    view->taper = round->radii[0].centre == round->radii[1].centre ? radial_exact(0)
                                                                   : radial_sub(round->radii[0], round->radii[1]);
}

static struct view view_of(const struct oracle_ray *ray, const struct oracle_round *round)
{
    struct view view = {.round = round};
    place(ray, round, &view.line);
    find_axis(round, &view);
    for (int end = 0; end < 2; end++) {
        for (int axis = 0; axis < 3; axis++) {
            struct radial centre = round->centres[end][axis];
            view.to[end][axis] = radial_sub(centre, view.line.origin[axis]);
            view.to_own[end][axis] = centre.radius + view.line.origin_own[axis];
        }
        cross(view.to[end], view.line.direction, view.across[end]);
    }
    double turned = 0;
    for (int axis = 0; axis < 3; axis++) {
        struct radial along = view.line.direction[axis];
        view.square += along.centre * along.centre;
        turned += along.radius * along.radius;
    }
    view.length = length_of(view.line.direction);
    view.turn = sqrt(turned / view.square) * (1 + SUM_ROUNDING);
    return view;
}

static struct radial mix(struct radial a, struct radial b, double z)
{
    return radial_rounded((1 - z) * a.centre + z * b.centre, (1 - z) * a.radius + z * b.radius,
                          fabs(a.centre) + fabs(b.centre));
}

/* The line's distance from the sphere's centre at z. */
static struct radial distance_at(const struct view *view, double z)
{
    struct radial across[3];
    for (int axis = 0; axis < 3; axis++)
        across[axis] = mix(view->across[0][axis], view->across[1][axis], z);
    struct radial product = length_of(across);
    return between(fmax(lower(product), 0) / upper(view->length), upper(product) / lower(view->length));
}

/* Half of what the line has inside a sphere. */
static struct radial chord_of(struct radial radius, struct radial distance)
{
    double low = (lower(radius) - upper(distance)) * (lower(radius) + upper(distance));
    double high = (upper(radius) - fmax(lower(distance), 0)) * (upper(radius) + fmax(lower(distance), 0));
    return between(sqrt(fmax(low, 0)), sqrt(fmax(high, 0)));
}

static enum oracle_presence presence_of_sphere(struct radial radius, struct radial distance)
{
    if (upper(distance) < lower(radius))
        return ORACLE_SURE;
    return lower(distance) > upper(radius) ? ORACLE_ABSENT : ORACLE_POSSIBLE;
}

/* ---- whether the line meets the hull ---- */

/* The centres of all intervals, with both radii larger by `grown`. */
static struct oracle_hull hull_of(const struct view *view, double grown)
{
    struct oracle_hull hull;
    double length = sqrt(view->square);
    for (int end = 0; end < 2; end++) {
        double along = 0;
        for (int axis = 0; axis < 3; axis++) {
            hull.across[end][axis] = view->across[end][axis].centre / length;
            along += view->to[end][axis].centre * view->line.direction[axis].centre;
        }
        hull.along[end] = along / length;
        hull.radius[end] = view->round->radii[end].centre + grown;
    }
    return hull;
}

/*
 * Returns whether both spheres are surely on one side of a plane, and the line on the other: across the line, the
 * component of both centres along one fixed unit vector is larger than their radii.
 */
static bool surely_misses(const struct view *view, const struct oracle_hull *hull, double z)
{
    double normal[3], size;
    for (int axis = 0; axis < 3; axis++)
        normal[axis] = (1 - z) * hull->across[0][axis] + z * hull->across[1][axis];
    size = length3(normal);
    for (int end = 0; end < 2; end++) {
        double apart = 0, magnitude = 0;
        for (int axis = 0; axis < 3; axis++) {
            const double share = normal[axis] / size;
            const struct radial across = view->across[end][axis];
            apart += share * across.centre - fabs(share) * across.radius;
            magnitude += fabs(share) * (fabs(across.centre) + across.radius);
        }
        if (!(apart - SUM_ROUNDING * magnitude > upper(view->length) * upper(view->round->radii[end])))
            return false;
    }
    return true;
}

static enum oracle_presence presence_of_hull(const struct view *view)
{
    const struct oracle_hull hull = hull_of(view, 0);
    /* For most lines that miss, the plane across the way to the middle is proof enough. */
    if (surely_misses(view, &hull, 0.5))
        return ORACLE_ABSENT;
    double z = oracle_hull_nearest(&hull);
    if (surely_misses(view, &hull, z))
        return ORACLE_ABSENT;
    struct radial radius = mix(view->round->radii[0], view->round->radii[1], z);
    return presence_of_sphere(radius, distance_at(view, z)) == ORACLE_SURE ? ORACLE_SURE : ORACLE_POSSIBLE;
}

/* ---- whether it enters through a face that is there ---- */

/*
 * Returns whether the line enters the hull through the part of its surface that belongs to the sphere at one end. X is
 * where it enters that sphere. At the first end the part is where (X - P0) . D <= r0 (r0 - r1) for the axis D, and at
 * the second end where (X - P1) . D >= r1 (r0 - r1). These are the tangent circles, without a division by the length
 * of D. They also hold where one sphere swallows the other.
 */
static enum oracle_presence presence_of_cap(const struct view *view, int end)
{
    struct radial radius = view->round->radii[end], distance = distance_at(view, end), foot[3];
    enum oracle_presence met = presence_of_sphere(radius, distance);
    if (met == ORACLE_ABSENT)
        return ORACLE_ABSENT;
    /* from the centre to the foot of its perpendicular on the line */
    cross(view->across[end], view->line.direction, foot);
    struct radial square = radial_mul(view->length, view->length);
    struct radial ahead =
        radial_div(radial_mul(chord_of(radius, distance), dot(view->line.direction, view->axis)), view->length);
    struct radial beyond =
        radial_sub(radial_sub(radial_div(dot(foot, view->axis), square), ahead), radial_mul(radius, view->taper));
    if (end == 1)
        beyond.centre = -beyond.centre;
    if (radial_is_positive(beyond))
        return ORACLE_ABSENT;
    return radial_is_negative(beyond) ? met : ORACLE_POSSIBLE;
}

/* Returns whether one of the spheres surely contains the other, so that the hull has no side. */
static bool has_no_side(const struct view *view)
{
    return upper(length_of(view->axis)) <= fabs(view->taper.centre) - view->taper.radius;
}

/* Returns whether the larger one of two spheres has a cap, which is the first one if they are equal. */
static enum oracle_presence presence_of_larger(const struct view *view)
{
    const bool *caps = view->round->caps;
    if (caps[0] == caps[1])
        return caps[0] ? ORACLE_SURE : ORACLE_ABSENT;
    if (lower(view->taper) < 0 && upper(view->taper) >= 0)
        return ORACLE_POSSIBLE;
    return caps[lower(view->taper) >= 0 ? 0 : 1] ? ORACLE_SURE : ORACLE_ABSENT;
}

/*
 * Returns whether the surface is there where the line enters the hull. If it may enter through several parts, it
 * enters through one of them, so that it is sure if all of them are there.
 */
static enum oracle_presence presence_of_surface(const struct view *view)
{
    bool may_be_there = false, may_be_gone = false, is_cap = false;
    if (has_no_side(view))
        return presence_of_larger(view);
    for (int end = 0; end < 2; end++) {
        enum oracle_presence cap = presence_of_cap(view, end);
        is_cap = is_cap || cap == ORACLE_SURE;
        may_be_there = may_be_there || (cap != ORACLE_ABSENT && view->round->caps[end]);
        may_be_gone = may_be_gone || (cap != ORACLE_ABSENT && !view->round->caps[end]);
    }
    may_be_there = may_be_there || !is_cap;
    if (!may_be_there)
        return ORACLE_ABSENT;
    return may_be_gone ? ORACLE_POSSIBLE : ORACLE_SURE;
}

/* ---- where it enters ---- */

/* Returns how much moves along the line can change a t of this magnitude for all primitives alike. */
static double shared_shift(const struct view *view, double t)
{
    double sum = 0;
    for (int axis = 0; axis < 3; axis++)
        sum += fabs(view->line.direction[axis].centre) *
               (view->line.origin_shared[axis] + fabs(t) * view->line.direction_shared[axis]);
    return sum / view->square * RADIAL_WIDEN;
}

/*
 * Returns a lower bound for the t at which the line enters the hull, by a plane with the inner normal n of length 1; or
 * -INFINITY if the line may run along the plane.
 *
 * The hull is on one side of the planes that touch the spheres, so that t is at least the smaller of the two
 * (n . (P - o) - r) / m, where m = n . d. If P, r, o and d move by dP, dr, do and dd, each of them changes by
 * (n . dP - dr - n . (do + t dd)) / (m + n . dd). With c = d / |d|^2 the last part is c . (do + t dd), which is the
 * shared shift, and p . (do + t dd) with p = n / m - c, which is the primitive's own.
 */
static double plane_bound(const struct view *view, const double n[3])
{
    const struct line *line = &view->line;
    double m = 0, m_moves = 0, least = INFINITY;
    for (int axis = 0; axis < 3; axis++) {
        m += n[axis] * line->direction[axis].centre;
        m_moves += fabs(n[axis]) * (line->direction[axis].radius + SUM_ROUNDING * fabs(line->direction[axis].centre));
    }
    if (!(m > 2 * m_moves))
        return -INFINITY;
    double widen = 1 / (1 - m_moves / m);
    for (int end = 0; end < 2; end++) {
        struct radial radius = view->round->radii[end];
        double height = -radius.centre, magnitude = fabs(radius.centre), own = radius.radius, turned = 0;
        for (int axis = 0; axis < 3; axis++) {
            height += n[axis] * view->to[end][axis].centre;
            magnitude += fabs(n[axis] * view->to[end][axis].centre);
        }
        double t = height / m;
        for (int axis = 0; axis < 3; axis++) {
            double p = n[axis] / m - line->direction[axis].centre / view->square;
            own += fabs(n[axis]) * (view->to_own[end][axis] + fabs(t) * line->direction_own[axis]);
            turned += fabs(p) * (line->origin_shared[axis] + fabs(t) * line->direction_shared[axis]);
        }
        own = (own / m + turned) * widen + shared_shift(view, t) * (widen - 1);
        least = fmin(least, t - own * RADIAL_WIDEN - SUM_ROUNDING * (magnitude / m + fabs(t)));
    }
    return least;
}

/*
 * Returns an upper bound for the t at which the line enters the hull, by the sphere at z. If the line may miss that
 * sphere, it is a bound for where it passes the centre.
 *
 * With F = o + t_c d - P for the t_c where the line passes the centre, and |d| t = |d| t_c - h, moves dP, do and dd
 * change t_c by (-(do + t_c dd) . d' + dP . d' - F . dd) / |d'|^2, where d' = d + dd. Of that, c . (do + t dd) is the
 * shared shift. d' / |d'|^2 differs from c by at most `turn` / (1 - `turn`) / |d|; and -h / |d'| is at most
 * -h / |d| (1 - c . dd - turn^2 / 2).
 */
static double sphere_bound(const struct view *view, double z)
{
    const struct line *line = &view->line;
    struct radial radius = mix(view->round->radii[0], view->round->radii[1], z), distance = distance_at(view, z);
    double length = sqrt(view->square), along = 0, magnitude = 0, own = 0, moves = 0, turned = 0, slow = 0;
    double chord = fmax(lower(chord_of(radius, distance)), 0) / length;
    if (presence_of_sphere(radius, distance) != ORACLE_SURE)
        chord = 0;
    for (int axis = 0; axis < 3; axis++) {
        double to = (1 - z) * view->to[0][axis].centre + z * view->to[1][axis].centre;
        double d = line->direction[axis].centre;
        double centre_own = (1 - z) * view->to_own[0][axis] + z * view->to_own[1][axis];
        along += to * d;
        magnitude += (fabs(view->to[0][axis].centre) + fabs(view->to[1][axis].centre)) * fabs(d);
        own += fabs(d) * centre_own;
        slow += fabs(d) * line->direction_own[axis];
        moves += centre_own + line->origin_shared[axis];
        turned += line->direction[axis].radius;
    }
    double passes = along / view->square, t = passes - chord, turn = view->turn / (1 - view->turn);
    own = (own + slow * fabs(t)) / view->square;
    own += (moves + fabs(passes) * turned) * turn / length;
    own += upper(distance) * view->turn / (1 - view->turn) / (1 - view->turn) / length + chord * turn * turn;
    return t + own * RADIAL_WIDEN + SUM_ROUNDING * (magnitude / view->square + fabs(t) + chord);
}

/* The inner normal where the line enters the sphere at z. */
static void normal_at(const struct view *view, const struct oracle_hull *hull, double z, double ret_normal[3])
{
    double across[3], direction[3], length = sqrt(view->square), chord = 0;
    for (int axis = 0; axis < 3; axis++) {
        across[axis] = (1 - z) * hull->across[0][axis] + z * hull->across[1][axis];
        direction[axis] = view->line.direction[axis].centre / length;
    }
    chord = (1 - z) * hull->along[0] + z * hull->along[1] - oracle_hull_entry(hull, z);
    for (int x = 0; x < 3; x++) {
        int y = (x + 1) % 3, w = (x + 2) % 3;
        ret_normal[x] = direction[y] * across[w] - direction[w] * across[y] + chord * direction[x];
    }
}

/*
 * Improves z by the point where the line enters the sphere there: the generating sphere of a point X of the side is at
 * z = ((X - P0) . D - (r0 - r1) r0) / (D . D - (r0 - r1)^2). `normal` is not yet of length 1.
 */
static double improve(const struct view *view, const struct oracle_hull *hull, double z, const double normal[3])
{
    double axis[3], taper = view->taper.centre, along = 0;
    for (int k = 0; k < 3; k++) {
        axis[k] = view->axis[k].centre;
        along += (z * axis[k] - normal[k]) * axis[k];
    }
    double better = (along - taper * hull->radius[0]) / (dot3(axis, axis) - taper * taper);
    return better >= 0 && better <= 1 ? better : z;
}

/* The bounds of the t at which the line enters the hull. */
struct entry {
    double t, low, high;
};

/* Uses what the search finds for radii that are larger by `grown`. */
static void tighten(const struct view *view, double grown, struct entry *entry)
{
    const struct oracle_hull hull = hull_of(view, grown);
    double z = oracle_hull_first(&hull), normal[3];
    for (int step = 0; step < 2 && oracle_hull_gap(&hull, z) <= 0; step++) {
        normal_at(view, &hull, z, normal);
        double better = improve(view, &hull, z, normal), size = length3(normal);
        for (int axis = 0; axis < 3; axis++)
            normal[axis] /= size;
        entry->low = fmax(entry->low, plane_bound(view, normal));
        if (presence_of_sphere(mix(view->round->radii[0], view->round->radii[1], z), distance_at(view, z)) ==
            ORACLE_SURE)
            entry->high = fmin(entry->high, sphere_bound(view, z));
        entry->t = grown == 0 || isnan(entry->t) ? oracle_hull_entry(&hull, z) / sqrt(view->square) : entry->t;
        z = better;
    }
}

/* Returns about how far moves shift the line and the spheres against each other. */
static double looseness(const struct view *view)
{
    double most = 0;
    for (int end = 0; end < 2; end++)
        most = fmax(most, distance_at(view, end).radius + view->round->radii[end].radius);
    return most;
}

static struct oracle_crossing enter(const struct view *view)
{
    struct entry entry = {NAN, -INFINITY, INFINITY};
    double along[3], loose = looseness(view), length = sqrt(view->square);
    const double grown[3] = {loose, 0, -loose};
    for (int k = 0; k < 3; k++)
        tighten(view, grown[k], &entry);
    for (int axis = 0; axis < 3; axis++)
        along[axis] = view->line.direction[axis].centre / length;
    entry.low = fmax(entry.low, plane_bound(view, along));
    /* It is not later than where it passes the farther centre. */
    entry.high = fmin(entry.high, fmax(sphere_bound(view, 0), sphere_bound(view, 1)));
    if (!(entry.low > -INFINITY && entry.high < INFINITY && entry.low <= entry.high))
        return (struct oracle_crossing){0, -INFINITY, INFINITY, 0};
    double t = isnan(entry.t) ? 0.5 * entry.low + 0.5 * entry.high : fmin(fmax(entry.t, entry.low), entry.high);
    return oracle_crossing_make(t, entry.low, entry.high, shared_shift(view, fmax(fabs(entry.low), fabs(entry.high))));
}

enum oracle_presence oracle_round_meet(const struct oracle_ray *ray, const union oracle_subject *subject,
                                       struct oracle_crossing *ret_crossing, struct oracle_outline *ret_outline)
{
    enum oracle_presence presence = ORACLE_POSSIBLE;
    struct oracle_crossing crossing = {0, -INFINITY, INFINITY, 0};
    const struct view view = view_of(ray, &subject->round);
    if (!subject->round.moment->vague && view.turn < MOST_TURN) {
        presence = presence_of_hull(&view);
        if (presence != ORACLE_ABSENT)
            presence = oracle_worse(presence, presence_of_surface(&view));
        if (presence == ORACLE_ABSENT)
            return ORACLE_ABSENT;
        crossing = enter(&view);
    }
    presence = oracle_worse(presence, oracle_crossing_between(&crossing, ray));
    if (presence == ORACLE_POSSIBLE)
        *ret_outline = (struct oracle_outline){.open = false};
    if (presence != ORACLE_ABSENT)
        *ret_crossing = crossing;
    return presence;
}
