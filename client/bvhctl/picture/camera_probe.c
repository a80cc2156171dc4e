/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/picture/camera_probe.h"

#include "client/bvhctl/oracle/rays.h"

static bool is_in_bulk(const struct stage *stage, struct vector point)
{
    struct vector at = stage_to_local(stage, point);
    double rounding = 1e-4 * stage->size;
    return at.x >= stage->low.x - rounding && at.x <= stage->high.x + rounding && at.y >= stage->low.y - rounding &&
           at.y <= stage->high.y + rounding && at.z >= stage->low.z - rounding && at.z <= stage->high.z + rounding;
}

/* Returns the time of a probe's ray. Those of neighbours are far apart, and every part of a view has all times. */
static float probe_time(const struct stage *stage, int x, int y)
{
    return stage_time(stage, fmod(0.6180339887498949 * (y * PROBE_WIDTH + x), 1));
}

void probe_take(const struct stage *stage, const struct camera *camera, struct view_probe *ret_probe)
{
    ret_probe->hits = ret_probe->subject_hits = 0;
    ret_probe->nearest = INFINITY;
    for (int y = 0; y < PROBE_HEIGHT; y++)
        for (int x = 0; x < PROBE_WIDTH; x++) {
            struct stage_hit hit = {.distance = INFINITY};
            struct vector direction = camera_direction(camera, (x + 0.5) / PROBE_WIDTH, (y + 0.5) / PROBE_HEIGHT);
            bool is_hit = stage_look(stage, camera->origin, direction, probe_time(stage, x, y), &hit);
            ret_probe->hits += is_hit;
            ret_probe->subject_hits += is_hit && is_in_bulk(stage, hit.position);
            ret_probe->distance[y][x] = hit.distance;
            ret_probe->normal[y][x] = hit.normal;
            ret_probe->nearest = fmin(ret_probe->nearest, hit.distance);
        }
}

static double entropy(const uint32_t *counts, int kinds, uint32_t total)
{
    double sum = 0;
    for (int i = 0; i < kinds; i++)
        if (counts[i])
            sum -= (double)counts[i] / total * log2((double)counts[i] / total);
    return sum;
}

double probe_facing(const struct view_probe *probe)
{
    uint32_t counts[27] = {0};
    for (int y = 0; y < PROBE_HEIGHT; y++)
        for (int x = 0; x < PROBE_WIDTH; x++) {
            struct vector n = probe->normal[y][x];
            if (isfinite(probe->distance[y][x]))
                counts[(int)lround(n.x) + 3 * (int)lround(n.y) + 9 * (int)lround(n.z) + 13]++;
        }
    return entropy(counts, 27, probe->hits);
}

double probe_outlines(const struct view_probe *probe)
{
    uint32_t jumps = 0;
    for (int y = 1; y < PROBE_HEIGHT; y++)
        for (int x = 1; x < PROBE_WIDTH; x++) {
            double here = probe->distance[y][x], left = probe->distance[y][x - 1], above = probe->distance[y - 1][x];
            jumps += isfinite(here) && (fabs(here - left) > 0.06 * here || fabs(here - above) > 0.06 * here);
        }
    return (double)jumps / (PROBE_WIDTH * PROBE_HEIGHT);
}

/* Distances are counted in steps of a factor 1.5. */
double probe_depth(const struct view_probe *probe)
{
    uint32_t counts[32] = {0};
    for (int y = 0; y < PROBE_HEIGHT; y++)
        for (int x = 0; x < PROBE_WIDTH; x++)
            if (isfinite(probe->distance[y][x]) && probe->nearest > 0)
                counts[(int)fmin(31, log(probe->distance[y][x] / probe->nearest) / log(1.5))]++;
    return entropy(counts, 32, probe->hits);
}

double probe_sunlit(const struct stage *stage, const struct camera *camera, const struct view_probe *probe)
{
    struct vector sun = camera_sun(stage, camera);
    uint32_t lit = 0;
    for (int y = 0; y < PROBE_HEIGHT; y++)
        for (int x = 0; x < PROBE_WIDTH; x++) {
            if (!isfinite(probe->distance[y][x]) || vector_dot(probe->normal[y][x], sun) <= 0)
                continue;
            struct vector direction = camera_direction(camera, (x + 0.5) / PROBE_WIDTH, (y + 0.5) / PROBE_HEIGHT);
            struct vector place = vector_mad(camera->origin, direction, probe->distance[y][x] * 0.9999);
            lit += isinf(stage_clearance(stage, place, sun, probe_time(stage, x, y)));
        }
    return (double)lit / (PROBE_WIDTH * PROBE_HEIGHT);
}

bool probe_sees(const struct stage *stage, const struct camera *camera, struct vector point, float time,
                bool *ret_is_back)
{
    struct vector away = vector_sub(point, camera->origin);
    double ahead = vector_dot(away, camera->forward), distance = vector_length(away);
    if (ahead <= 0 || fabs(vector_dot(away, camera->right)) > ahead * camera->half_width ||
        fabs(vector_dot(away, camera->up)) > ahead * camera->half_height)
        return false;
    struct stage_hit hit;
    if (!stage_look(stage, camera->origin, vector_scale(away, 1 / distance), time, &hit) ||
        hit.distance < 0.995 * distance)
        return false;
    *ret_is_back = hit.is_back;
    return true;
}

double probe_visibility(const struct stage *stage, const struct camera *camera)
{
    static const double back = 0.3; /* what the back of a surface is worth, in that of its front */
    uint64_t state = 0x5ee;
    uint32_t tried = 0;
    double seen = 0;
    for (int i = 0; i < 4 * PROBE_TARGETS && tried < PROBE_TARGETS; i++) {
        const struct stage_sample *sample = &stage->samples[rays_random(&state) % stage->sample_count];
        bool is_back = false;
        if (!sample->is_subject)
            continue;
        tried++;
        if (probe_sees(stage, camera, sample->at, sample->time, &is_back))
            seen += is_back ? back : 1;
    }
    return tried ? seen / tried : 0;
}
