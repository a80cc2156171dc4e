/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/picture/camera.h"

#include "client/bvhctl/oracle/rays.h"

enum {
    AZIMUTHS = 16,
    ELEVATIONS = 4,
    INSIDE_GRID = 6, /* positions along each horizontal axis */
    INSIDE_HEIGHTS = 2,
    INSIDE_AZIMUTHS = 12,
    OUTSIDE_VIEWS = AZIMUTHS * ELEVATIONS,
    INSIDE_VIEWS = INSIDE_GRID * INSIDE_GRID * INSIDE_HEIGHTS * INSIDE_AZIMUTHS,
    VIEWS = OUTSIDE_VIEWS + INSIDE_VIEWS,
    PROBE_WIDTH = 40,
    PROBE_HEIGHT = 24,
    OPENNESS_STANDS = 256,
    OPENNESS_RAYS = 24,
    COSTLY = 500, /* triangle tests a ray from which on views are not compared */
};

static const double pi = 3.14159265358979323846;

struct vector camera_direction(const struct camera *camera, double x, double y)
{
    struct vector across = vector_scale(camera->right, (2 * x - 1) * camera->half_width);
    struct vector along = vector_mad(camera->forward, camera->up, (1 - 2 * y) * camera->half_height);
    return vector_unit(vector_add(across, along));
}

static struct vector spherical(const struct stage *stage, double azimuth, double elevation)
{
    double flat = cos(elevation);
    return stage_to_world(stage, vector_make(flat * cos(azimuth), flat * sin(azimuth), sin(elevation)));
}

static void aim(struct camera *camera, const struct stage *stage, struct vector forward, double half_angle,
                double aspect)
{
    camera->forward = forward;
    camera->right = vector_unit(vector_cross(forward, stage->up));
    camera->up = vector_cross(camera->right, forward);
    camera->half_height = tan(half_angle);
    camera->half_width = camera->half_height * aspect;
}

static double flatness(const struct stage *stage)
{
    struct vector extent = vector_sub(stage->high, stage->low);
    return extent.z / fmax(fmax(extent.x, extent.y), 1e-44);
}

/*
 * Returns whether a point should be in the picture. These are the points of the bulk; but of a landscape, which is much
 * wider than high, only those in the middle, because otherwise everything on it would be tiny.
 */
static bool in_focus(const struct stage *stage, struct vector point)
{
    struct vector extent = vector_sub(stage->high, stage->low),
                  middle = vector_scale(vector_add(stage->low, stage->high), 0.5);
    struct vector away = vector_sub(stage_to_local(stage, point), middle);
    double reach = flatness(stage) < 0.05 ? 0.26 : 0.501,
           rounding = 1e-6 * stage->size; /* the extent of a level plane is 0 */
    return fabs(away.x) <= reach * extent.x + rounding && fabs(away.y) <= reach * extent.y + rounding &&
           fabs(away.z) <= 0.501 * extent.z + rounding;
}

/*
 * The size of the bulk in the picture, by its samples, as seen from far away. The unit is half a side of the picture at
 * distance 1.
 */
struct fit {
    double left, right, bottom, top; /* of the outermost samples, relative to the centre of the view */
    double distance;
};

static struct fit fit_samples(const struct stage *stage, const struct camera *camera, struct vector target)
{
    static const double margin = 0.86;
    double wide = camera->half_width * margin, high = camera->half_height * margin;
    struct fit fit = {INFINITY, -INFINITY, INFINITY, -INFINITY, 0};
    for (uint32_t i = 0; i < stage->sample_count; i++) {
        if (!in_focus(stage, stage->samples[i]))
            continue;
        struct vector q = vector_sub(stage->samples[i], target);
        double x = vector_dot(q, camera->right), y = vector_dot(q, camera->up), z = vector_dot(q, camera->forward);
        fit.distance = fmax(fit.distance, fmax(fabs(x) / wide, fabs(y) / high) - z);
        fit.left = fmin(fit.left, x);
        fit.right = fmax(fit.right, x);
        fit.bottom = fmin(fit.bottom, y);
        fit.top = fmax(fit.top, y);
    }
    return fit;
}

static struct camera outside_view(const struct stage *stage, double aspect, int index)
{
    static const double elevations[ELEVATIONS] = {0.17, 0.31, 0.49, 0.7};
    struct camera camera = {0};
    double azimuth = 2 * pi * (index % AZIMUTHS + 0.5) / AZIMUTHS;
    aim(&camera, stage, vector_scale(spherical(stage, azimuth, elevations[index / AZIMUTHS]), -1), 0.3, aspect);
    struct vector target = stage_to_world(stage, vector_scale(vector_add(stage->low, stage->high), 0.5));
    for (int i = 0; i < 2; i++) {
        struct fit fit = fit_samples(stage, &camera, target);
        target = vector_mad(target, camera.right, (fit.left + fit.right) / 2);
        target = vector_mad(target, camera.up, (fit.bottom + fit.top) / 2);
    }
    camera.origin = vector_mad(target, camera.forward, -fit_samples(stage, &camera, target).distance);
    return camera;
}

static struct camera inside_view(const struct stage *stage, double aspect, int index)
{
    static const double heights[INSIDE_HEIGHTS] = {0.14, 0.4};
    int azimuth = index % INSIDE_AZIMUTHS, stand = index / INSIDE_AZIMUTHS, column = stand % INSIDE_GRID,
        row = stand / INSIDE_GRID % INSIDE_GRID;
    double height = heights[stand / (INSIDE_GRID * INSIDE_GRID)];
    struct vector extent = vector_sub(stage->high, stage->low);
    struct vector local =
        vector_make(stage->low.x + extent.x * (column + 0.5) / INSIDE_GRID,
                    stage->low.y + extent.y * (row + 0.5) / INSIDE_GRID, stage->low.z + extent.z * height);
    struct camera camera = {.is_inside = true, .origin = stage_to_world(stage, local)};
    aim(&camera, stage, spherical(stage, 2 * pi * azimuth / INSIDE_AZIMUTHS, 0.04), 0.52, aspect);
    return camera;
}

static struct camera make_view(const struct stage *stage, double aspect, int index)
{
    return index < OUTSIDE_VIEWS ? outside_view(stage, aspect, index)
                                 : inside_view(stage, aspect, index - OUTSIDE_VIEWS);
}

/* The hits of a few rays through a view. The distance of a miss is INFINITY. */
struct view_probe {
    double distance[PROBE_HEIGHT][PROBE_WIDTH];
    struct vector normal[PROBE_HEIGHT][PROBE_WIDTH];
    uint32_t hits;
    double nearest;
};

static void take_probe(const struct stage *stage, const struct camera *camera, struct view_probe *probe)
{
    probe->hits = 0;
    probe->nearest = INFINITY;
    for (int y = 0; y < PROBE_HEIGHT; y++)
        for (int x = 0; x < PROBE_WIDTH; x++) {
            struct stage_hit hit = {.distance = INFINITY};
            struct vector direction = camera_direction(camera, (x + 0.5) / PROBE_WIDTH, (y + 0.5) / PROBE_HEIGHT);
            probe->hits += stage_look(stage, camera->origin, direction, &hit);
            probe->distance[y][x] = hit.distance;
            probe->normal[y][x] = hit.normal;
            probe->nearest = fmin(probe->nearest, hit.distance);
        }
}

/* Returns the entropy, in bits, of the directions in which the visible surfaces face: 0 for one flat wall. */
static double facing_entropy(const struct view_probe *probe)
{
    uint32_t counts[27] = {0};
    for (int y = 0; y < PROBE_HEIGHT; y++)
        for (int x = 0; x < PROBE_WIDTH; x++) {
            struct vector n = probe->normal[y][x];
            if (isfinite(probe->distance[y][x]))
                counts[(int)lround(n.x) + 3 * (int)lround(n.y) + 9 * (int)lround(n.z) + 13]++;
        }
    double entropy = 0;
    for (int i = 0; i < 27; i++)
        if (counts[i])
            entropy -= (double)counts[i] / probe->hits * log2((double)counts[i] / probe->hits);
    return entropy;
}

/*
 * Returns the fraction of neighbouring rays between which the distance jumps. Those are outlines, of which views with
 * detail and depth have many.
 */
static double outlines(const struct view_probe *probe)
{
    uint32_t jumps = 0;
    for (int y = 1; y < PROBE_HEIGHT; y++)
        for (int x = 1; x < PROBE_WIDTH; x++) {
            double here = probe->distance[y][x], left = probe->distance[y][x - 1], above = probe->distance[y - 1][x];
            jumps += isfinite(here) && (fabs(here - left) > 0.06 * here || fabs(here - above) > 0.06 * here);
        }
    return (double)jumps / (PROBE_WIDTH * PROBE_HEIGHT);
}

/*
 * Returns the entropy of the visible distances, in steps of a factor 1.5: it is high if near and far are both visible.
 */
static double depth_entropy(const struct view_probe *probe)
{
    uint32_t counts[32] = {0};
    for (int y = 0; y < PROBE_HEIGHT; y++)
        for (int x = 0; x < PROBE_WIDTH; x++)
            if (isfinite(probe->distance[y][x]) && probe->nearest > 0)
                counts[(int)fmin(31, log(probe->distance[y][x] / probe->nearest) / log(1.5))]++;
    double entropy = 0;
    for (int i = 0; i < 32; i++)
        if (counts[i])
            entropy -= (double)counts[i] / probe->hits * log2((double)counts[i] / probe->hits);
    return entropy;
}

static double score_outside(const struct view_probe *probe, double elevation_bonus)
{
    double coverage = (double)probe->hits / (PROBE_WIDTH * PROBE_HEIGHT);
    double outline = outlines(probe);
    return 1.5 * fmin(coverage, 0.55) + 0.25 * facing_entropy(probe) + 1.2 * fmin(outline, 0.3) + elevation_bonus;
}

struct vector camera_sun(const struct stage *stage, const struct camera *camera)
{
    struct vector flat = vector_unit(vector_mad(camera->forward, stage->up, -vector_dot(camera->forward, stage->up)));
    struct vector level = vector_unit(vector_mad(vector_scale(flat, -0.45), camera->right, -0.9));
    return vector_unit(vector_mad(level, stage->up, camera->is_inside ? 1.7 : 0.95));
}

/* Returns the fraction of the picture that the sun shines on. */
static double sunlit(const struct stage *stage, const struct camera *camera, const struct view_probe *probe)
{
    struct vector sun = camera_sun(stage, camera);
    uint32_t lit = 0;
    for (int y = 0; y < PROBE_HEIGHT; y++)
        for (int x = 0; x < PROBE_WIDTH; x++) {
            if (!isfinite(probe->distance[y][x]) || vector_dot(probe->normal[y][x], sun) <= 0)
                continue;
            struct vector direction = camera_direction(camera, (x + 0.5) / PROBE_WIDTH, (y + 0.5) / PROBE_HEIGHT);
            struct vector place = vector_mad(camera->origin, direction, probe->distance[y][x] * 0.9999);
            lit += isinf(stage_clearance(stage, place, sun));
        }
    return (double)lit / (PROBE_WIDTH * PROBE_HEIGHT);
}

static double score_inside(const struct stage *stage, const struct camera *camera, const struct view_probe *probe)
{
    double coverage = (double)probe->hits / (PROBE_WIDTH * PROBE_HEIGHT);
    if (probe->nearest < 0.03 * stage->size || coverage < 0.8)
        return -1;
    return coverage + 0.3 * facing_entropy(probe) + 2 * outlines(probe) + 0.3 * depth_entropy(probe) +
           3 * fmin(sunlit(stage, camera, probe), 0.3);
}

static double score_view(const struct stage *stage, const struct camera *camera, int index)
{
    struct view_probe probe;
    take_probe(stage, camera, &probe);
    if (probe.hits == 0)
        return -1;
    /* Flat scenes look better from above, compact ones from a nearly level view. */
    double flat = flatness(stage), best = flat < 0.35 ? 2 : flat < 0.8 ? 1.2 : 0.6;
    double level = index / AZIMUTHS - best;
    return camera->is_inside ? score_inside(stage, camera, &probe) : score_outside(&probe, -0.12 * level * level);
}

struct contest {
    const struct stage *stage;
    double aspect;
    bool inside;
    double *scores;
};

static void judge_view(void *context, size_t task)
{
    const struct contest *contest = context;
    int index = (int)task + (contest->inside ? OUTSIDE_VIEWS : 0);
    struct camera camera = make_view(contest->stage, contest->aspect, index);
    contest->scores[index] = score_view(contest->stage, &camera, index);
}

/*
 * Returns whether the camera can be inside the stage. That is so if most positions in the bulk that have room around
 * them see walls in most directions. Between objects outdoors, half of all directions lead to the sky. If no direction
 * from any position does, the bulk is a closed body, and it is dark inside.
 */
static bool is_enclosing(const struct stage *stage)
{
    uint64_t state = 0xca3e7a;
    uint32_t stands = 0, walls = 0, openings = 0; /* positions, those between walls, and rays that hit nothing */
    struct vector extent = vector_sub(stage->high, stage->low);
    for (int i = 0; i < OPENNESS_STANDS; i++) {
        struct vector fractions = vector_make(rays_uniform(&state), rays_uniform(&state), rays_uniform(&state) * 0.7);
        struct vector stand = stage_to_world(stage, vector_add(stage->low, vector_mul(extent, fractions)));
        uint32_t hits = 0;
        double nearest = INFINITY;
        for (int k = 0; k < OPENNESS_RAYS; k++) {
            double height = 2 * (k + 0.5) / OPENNESS_RAYS - 1, azimuth = 2 * pi * 0.618034 * k;
            double clearance = stage_clearance(stage, stand, spherical(stage, azimuth, asin(height)));
            hits += isfinite(clearance);
            nearest = fmin(nearest, clearance);
        }
        if (nearest < 0.04 * stage->size)
            continue;
        stands++;
        openings += OPENNESS_RAYS - hits;
        walls += hits >= OPENNESS_RAYS * 7 / 10;
    }
    return stands >= OPENNESS_STANDS / 16 && walls * 2 > stands && openings > 0;
}

enum bvhd_status camera_choose(const struct stage *stage, double aspect, const struct parallel *parallel,
                               struct memory *memory, struct camera *ret_camera, uint64_t *ret_rays,
                               struct bvhd_error *error)
{
    bool is_slow = stage_cost(stage) > COSTLY; /* the first view is taken then */
    struct contest contest = {.stage = stage, .aspect = aspect, .inside = !is_slow && is_enclosing(stage)};
    contest.scores = memory_array(memory, VIEWS, sizeof *contest.scores);
    if (!contest.scores)
        return bvhd_error_no_memory(error, "trace", "no memory to choose a view");
    for (int i = 0; i < VIEWS; i++)
        contest.scores[i] = -2;
    int count = contest.inside ? INSIDE_VIEWS : OUTSIDE_VIEWS, best = 0;
    if (!is_slow)
        parallel_for(parallel, (size_t)count, judge_view, &contest);
    for (int i = 1; i < VIEWS; i++)
        best = contest.scores[i] > contest.scores[best] ? i : best;
    *ret_camera = make_view(stage, aspect, best);
    *ret_rays = is_slow ? 0 : (uint64_t)count * PROBE_WIDTH * PROBE_HEIGHT + OPENNESS_STANDS * OPENNESS_RAYS;
    memory_free(memory, contest.scores);
    return BVHD_OK;
}
