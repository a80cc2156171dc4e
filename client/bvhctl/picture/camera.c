/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/picture/camera.h"

#include "client/bvhctl/oracle/rays.h"
#include "client/bvhctl/picture/camera_probe.h"
#include "client/bvhctl/picture/camera_view.h"

enum {
    OPENNESS_STANDS = 256,
    OPENNESS_RAYS = 24,
    OPENNESS_KEPT = 4, /* of the points that are seen from each stand */
    COSTLY = 1000, /* triangle tests a ray from which on views are not compared */
    DEFAULT_VIEW = VIEW_AZIMUTHS + 2, /* the one that is taken then: somewhat from the side, and from above */
};

static const double pi = 3.14159265358979323846;

struct vector camera_direction(const struct camera *camera, double x, double y)
{
    struct vector across = vector_scale(camera->right, (2 * x - 1) * camera->half_width);
    struct vector along = vector_mad(camera->forward, camera->up, (1 - 2 * y) * camera->half_height);
    return vector_unit(vector_add(across, along));
}

struct vector camera_sun(const struct stage *stage, const struct camera *camera)
{
    struct vector flat = vector_unit(vector_cross(stage->up, camera->right));
    struct vector level = vector_unit(vector_mad(vector_scale(flat, -0.45), camera->right, -0.9));
    return vector_unit(vector_mad(level, stage->up, camera->is_inside ? 1.7 : 0.95));
}

static struct vector turn_vector(const struct stage *stage, struct vector vector, double angle)
{
    struct vector along = vector_scale(stage->up, vector_dot(vector, stage->up)), level = vector_sub(vector, along);
    struct vector side = vector_cross(stage->up, level);
    return vector_add(along, vector_mad(vector_scale(level, cos(angle)), side, sin(angle)));
}

struct camera camera_turn(const struct stage *stage, const struct camera *camera, double angle)
{
    struct camera turned = *camera;
    turned.origin = vector_add(camera->pivot, turn_vector(stage, vector_sub(camera->origin, camera->pivot), angle));
    turned.forward = turn_vector(stage, camera->forward, angle);
    turned.right = turn_vector(stage, camera->right, angle);
    turned.up = turn_vector(stage, camera->up, angle);
    return turned;
}

struct contest {
    const struct stage *stage;
    struct camera_options options;
    int first; /* the number of the first view that is judged */
    double *scores;
};

/* Returns what a view gains from its side. The front counts much if its side is known. */
static double front_bonus(const struct contest *contest, int index)
{
    double away = fabs(view_azimuth(index)), ideal = pi / 6;
    double steepness = contest->options.knows_front ? 2 : 1;
    double facing = (1 + cos(fmin(steepness * fmax(away - ideal, 0), pi))) / 2 - 0.05 * (away < ideal);
    return facing * (contest->options.knows_front ? 1.5 : 0.2);
}

static double score_outside(const struct contest *contest, const struct camera *camera, const struct view_probe *probe,
                            int index)
{
    /* Flat scenes look better from above, compact ones from a nearly level view. */
    double flat = view_flatness(contest->stage), best = flat < 0.35 ? 2 : flat < 0.8 ? 1.2 : 0.8;
    double level = view_level(index) - best;
    double coverage = (double)probe->subject_hits / (PROBE_WIDTH * PROBE_HEIGHT);
    return 1.8 * sqrt(fmin(coverage, 0.55)) + 0.25 * probe_facing(probe) + 1.2 * fmin(probe_outlines(probe), 0.3) +
           1.5 * probe_visibility(contest->stage, camera) - 0.12 * level * level + front_bonus(contest, index);
}

static double score_inside(const struct contest *contest, const struct camera *camera, const struct view_probe *probe)
{
    double coverage = (double)probe->hits / (PROBE_WIDTH * PROBE_HEIGHT);
    if (probe->nearest < 0.03 * contest->stage->size || coverage < 0.8)
        return -1;
    double room = fmin(probe->nearest / (0.15 * contest->stage->size), 1); /* what is too near hides the rest */
    return coverage + 0.8 * room + 0.3 * probe_facing(probe) + 2 * probe_outlines(probe) + 0.3 * probe_depth(probe) +
           3 * fmin(probe_sunlit(contest->stage, camera, probe), 0.3);
}

static void judge_view(void *context, size_t task)
{
    const struct contest *contest = context;
    int index = (int)task + contest->first;
    struct camera camera = view_make(contest->stage, &contest->options, index);
    struct view_probe probe;
    probe_take(contest->stage, &camera, &probe);
    if (probe.hits == 0)
        contest->scores[index] = -1;
    else if (camera.is_inside)
        contest->scores[index] = score_inside(contest, &camera, &probe);
    else
        contest->scores[index] = score_outside(contest, &camera, &probe, index);
}

/* Judges a range of views, and returns the best one. */
static int judge(struct contest *contest, const struct parallel *parallel, int first, int count)
{
    contest->first = first;
    parallel_for(parallel, (size_t)count, judge_view, contest);
    int best = first;
    for (int i = first; i < first + count; i++)
        best = contest->scores[i] > contest->scores[best] ? i : best;
    return best;
}

/* ---- whether there is an inside ---- */

/* The view from random positions in the bulk that have room around them. */
struct openness {
    uint32_t stands, walls; /* such positions, and those that are between walls */
    double distance; /* the sum, over the latter, of the mean distances of what is seen */
    uint32_t points; /* of what is seen from between walls: */
    struct vector seen[OPENNESS_STANDS * OPENNESS_KEPT];
};

/*
 * Looks around from one position. It is between walls if it sees surfaces, from their front, in most directions.
 * Between objects outdoors half of all directions lead to the sky, and a solid body shows the backs of its surfaces to
 * its inside.
 */
static void look_around(const struct stage *stage, struct vector stand, struct openness *openness)
{
    uint32_t hits = 0, backs = 0;
    struct vector seen[OPENNESS_RAYS];
    double nearest = INFINITY, distance = 0;
    for (int k = 0; k < OPENNESS_RAYS; k++) {
        double height = 2 * (k + 0.5) / OPENNESS_RAYS - 1, azimuth = 2 * pi * 0.618034 * k;
        struct stage_hit hit;
        if (!stage_look(stage, stand, view_towards(stage, azimuth, asin(height)), stage_time(stage, 0.5), &hit))
            continue;
        seen[hits++] = hit.position;
        backs += hit.is_back;
        distance += hit.distance;
        nearest = fmin(nearest, hit.distance);
    }
    if (nearest < 0.04 * stage->size)
        return;
    openness->stands++;
    if (hits < OPENNESS_RAYS * 7 / 10 || 2 * backs > hits)
        return;
    openness->walls++;
    openness->distance += distance / hits;
    for (int i = 0; i < OPENNESS_KEPT; i++)
        openness->seen[openness->points++] = seen[(size_t)i * hits / OPENNESS_KEPT];
}

/*
 * Returns whether the stage has an inside: most positions in the bulk that have room around them are between walls,
 * there are many of them, and the walls are far away. In a body with many holes they are few and near.
 */
static bool has_inside(const struct stage *stage, struct openness *openness)
{
    uint64_t state = 0xca3e7a;
    struct vector extent = vector_sub(stage->high, stage->low);
    for (int i = 0; i < OPENNESS_STANDS; i++) {
        struct vector fractions = vector_make(rays_uniform(&state), rays_uniform(&state), rays_uniform(&state) * 0.7);
        look_around(stage, stage_to_world(stage, vector_add(stage->low, vector_mul(extent, fractions))), openness);
    }
    static const double least_room = 0.05; /* the part of positions that have room, times the distance of walls there */
    double room = openness->distance / (OPENNESS_STANDS * fmin(extent.x, fmin(extent.y, extent.z)));
    return openness->stands >= OPENNESS_STANDS / 16 && openness->walls * 2 > openness->stands && room > least_room;
}

/* Returns whether a view from outside shows most of the inside, as that of a room whose front is left out does. */
static bool shows_inside(const struct stage *stage, const struct camera *camera, const struct openness *openness)
{
    uint32_t seen = 0;
    for (uint32_t i = 0; i < openness->points; i++) {
        bool is_back = true;
        seen += probe_sees(stage, camera, openness->seen[i], stage_time(stage, 0.5), &is_back) && !is_back;
    }
    return 5 * seen > 2 * openness->points;
}

/* Returns whether a view from inside shows more than the walls of an empty box or ball. */
static bool is_worth_showing(const struct stage *stage, const struct camera *camera)
{
    struct view_probe probe;
    probe_take(stage, camera, &probe);
    return probe_outlines(&probe) > 0.04;
}

/* ---- the choice ---- */

/*
 * Finds the best view from outside. What would be too thin to be seen from where all of it fits into the picture, such
 * as a long wire, is seen from nearer.
 */
static struct camera search_outside(struct contest *contest, const struct parallel *parallel, uint64_t *ret_rays)
{
    enum { FEWEST_HITS = 8, CLOSER = 3, MOST_TIMES = 12 };
    struct camera camera = view_make(contest->stage, &contest->options, DEFAULT_VIEW);
    struct view_probe probe = {.hits = 0};
    for (int i = 0; i < MOST_TIMES && probe.subject_hits < FEWEST_HITS; i++) {
        int best = judge(contest, parallel, 0, VIEWS_OUTSIDE);
        struct camera found = view_make(contest->stage, &contest->options, best);
        uint32_t hits = probe.subject_hits;
        probe_take(contest->stage, &found, &probe);
        if (i == 0 || probe.subject_hits > hits)
            camera = found;
        contest->options.closeness = CLOSER * fmax(contest->options.closeness, 1);
        *ret_rays += VIEWS_OUTSIDE * (PROBE_WIDTH * PROBE_HEIGHT + PROBE_TARGETS);
    }
    return camera;
}

static enum bvhd_status search(const struct stage *stage, const struct camera_options *options,
                               const struct parallel *parallel, struct memory *memory, struct camera *ret_camera,
                               uint64_t *ret_rays, struct bvhd_error *error)
{
    struct contest contest = {.stage = stage, .options = *options};
    contest.scores = memory_array(memory, VIEWS, sizeof *contest.scores);
    struct openness *openness = memory_alloc(memory, sizeof *openness);
    enum bvhd_status status = BVHD_OK;
    if (contest.scores && openness) {
        *openness = (struct openness){0};
        *ret_camera = search_outside(&contest, parallel, ret_rays);
        *ret_rays += OPENNESS_STANDS * OPENNESS_RAYS;
        if (!options->has_target && has_inside(stage, openness) && !shows_inside(stage, ret_camera, openness)) {
            struct camera inside = view_make(stage, options, judge(&contest, parallel, VIEWS_OUTSIDE, VIEWS_INSIDE));
            *ret_rays += (uint64_t)VIEWS_INSIDE * PROBE_WIDTH * PROBE_HEIGHT;
            if (is_worth_showing(stage, &inside))
                *ret_camera = inside;
        }
    } else {
        status = bvhd_error_no_memory(error, "trace", "no memory to choose a view");
    }
    memory_free(memory, openness);
    memory_free(memory, contest.scores);
    return status;
}

/* Places the camera where the options say. */
static enum bvhd_status place(const struct stage *stage, const struct camera_options *options,
                              struct camera *ret_camera, struct bvhd_error *error)
{
    struct vector middle = stage_to_world(stage, vector_scale(vector_add(stage->low, stage->high), 0.5));
    struct vector target = options->has_target ? options->target : middle,
                  forward = vector_unit(vector_sub(target, options->eye));
    if (vector_length(forward) < 0.5 && options->has_target)
        return bvhd_error_set(error, BVHD_INVALID, "trace", "--eye and --look-at are the same point");
    if (vector_length(forward) < 0.5)
        forward = vector_scale(stage->front, -1);
    *ret_camera = (struct camera){.origin = options->eye, .pivot = target};
    view_aim(ret_camera, stage, forward, options);
    return BVHD_OK;
}

enum bvhd_status camera_choose(const struct stage *stage, const struct camera_options *options,
                               const struct parallel *parallel, struct memory *memory, struct camera *ret_camera,
                               uint64_t *ret_rays, struct bvhd_error *error)
{
    *ret_rays = 0;
    if (options->has_eye)
        return place(stage, options, ret_camera, error);
    if (stage_cost(stage) <= COSTLY)
        return search(stage, options, parallel, memory, ret_camera, ret_rays, error);
    *ret_camera = view_make(stage, options, DEFAULT_VIEW);
    return BVHD_OK;
}
