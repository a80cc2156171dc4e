/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/picture/stage_samples.h"

#include "client/bvhctl/oracle/rays.h"
#include "client/bvhctl/picture/round_surface.h"

enum {
    TOUR_STRIDE = 8, /* triangles that are visited for each one that a sample is taken from */
    FEW_TRIANGLES = 4096, /* of fewer triangles, each one gives a sample */
    FEWEST_SAMPLES = 256, /* that are needed to find an extent; of fewer triangles, each one gives several */
};

static struct vector random_point(const struct vector corners[3], uint64_t *state)
{
    double u = rays_uniform(state), v = rays_uniform(state);
    if (u + v > 1) {
        u = 1 - u;
        v = 1 - v;
    }
    return vector_mad(vector_mad(vector_scale(corners[0], 1 - u - v), corners[1], u), corners[2], v);
}

/* A pass over the triangles of all instances, of which it visits some, in order. */
struct tour {
    struct stage *stage;
    uint64_t state; /* of random numbers */
    /* samples by area: the area so far, its distance between samples (0: it is only added up), and that of the next */
    double area, area_step, area_next;
    uint64_t seen, stride, repeats; /* samples by number: `repeats` from one of each `stride` triangles that are seen */
    /*
     * states of random numbers, for the triangles that are visited, for those that are picked, and for the times of
     * samples. Regular steps could find the same triangles in every instance, because instances repeat
     */
    uint64_t place, pick, moment;
    uint64_t picked; /* which of the next `stride` triangles gives samples */
};

/* A primitive of an instance. */
struct place {
    const struct structure *bottom;
    const struct structure_instance *instance; /* NULL: there is no top level */
    uint32_t row;
};

/* Gives the triangle of a primitive as it is at a time. */
static void find_corners(const struct place *place, float time, struct vector ret_corners[3])
{
    float exact[3][3], matrix[12];
    uint32_t primitive;
    if (structure_round_count(place->bottom)) {
        struct structure_round round = structure_round(place->bottom, place->row);
        round_surface_stand_in(&round, ret_corners);
    } else {
        structure_triangle(place->bottom, place->row, time, exact, &primitive);
        for (int i = 0; i < 3; i++)
            ret_corners[i] = vector_from_floats(exact[i]);
    }
    if (!place->instance)
        return;
    structure_instance_matrix(place->instance, time, matrix);
    for (int i = 0; i < 3; i++)
        ret_corners[i] = vector_transform(matrix, ret_corners[i]);
}

/* Adds a point of a primitive at a random time. */
static void add_sample(struct tour *tour, const struct place *place)
{
    struct stage *stage = tour->stage;
    struct stage_sample sample = {.time = stage_time(stage, stage->is_blurred ? rays_uniform(&tour->moment) : 0)};
    find_corners(place, sample.time, sample.corners);
    sample.at = random_point(sample.corners, &tour->state);
    if (stage->sample_count == STAGE_SAMPLES || !isfinite(sample.at.x) || !isfinite(sample.at.y) ||
        !isfinite(sample.at.z))
        return;
    for (int i = 0; i < 3; i++)
        sample.reach = fmax(sample.reach, vector_length(vector_sub(sample.corners[i], sample.corners[(i + 1) % 3])));
    stage->samples[stage->sample_count++] = sample;
}

static void visit_primitive(struct tour *tour, const struct place *place)
{
    struct vector corners[3];
    find_corners(place, stage_time(tour->stage, 0.5), corners);
    if (tour->seen % tour->stride == 0)
        tour->picked = rays_random(&tour->pick) % tour->stride;
    bool is_chosen = tour->seen++ % tour->stride == tour->picked && tour->area_step == 0;
    for (uint64_t i = 0; i < tour->repeats && is_chosen; i++)
        add_sample(tour, place);
    struct vector normal = vector_cross(vector_sub(corners[1], corners[0]), vector_sub(corners[2], corners[0]));
    double area = vector_length(normal);
    tour->area += isfinite(area) ? area : 0;
    for (; tour->area_step > 0 && tour->area_next < tour->area && isfinite(area); tour->area_next += tour->area_step)
        add_sample(tour, place);
}

static void take_tour(struct tour *tour)
{
    const struct stage *stage = tour->stage;
    const struct structure_file *files = stage->structures->files;
    uint32_t source_count = stage->structures->has_top ? stage->instance_count : 1;
    double step = fmax(1, (double)stage->primitive_count / (STAGE_EVEN_SAMPLES * TOUR_STRIDE));
    double next = 0, at = rays_uniform(&tour->place) * step, base = 0;
    for (uint32_t i = 0; i < source_count; i++) {
        const struct structure_instance *instance = stage->structures->has_top ? &stage->instances[i] : NULL;
        const struct structure *bottom = &files[instance ? instance->bottom : 0].structure;
        double count = (double)structure_triangle_count(bottom) + structure_round_count(bottom);
        for (; at < base + count; at = next + rays_uniform(&tour->place) * step) {
            const struct place place = {bottom, instance, (uint32_t)(at - base)};
            visit_primitive(tour, &place);
            next += step;
        }
        base += count;
    }
}

/* Takes samples by number, which show where most triangles are, and then by area, which show what is most visible. */
void stage_samples_take(struct stage *stage)
{
    uint64_t count = stage->primitive_count;
    struct tour by_number = {
        .stage = stage, .state = 0x5eed, .stride = count < FEW_TRIANGLES ? 1 : TOUR_STRIDE, .repeats = 1};
    if (count > 0 && count < FEWEST_SAMPLES)
        by_number.repeats = (FEWEST_SAMPLES + count - 1) / count;
    take_tour(&by_number);
    stage->even_count = stage->sample_count;
    struct tour by_area = {.stage = stage, .state = 0xa4ea, .stride = 1};
    by_area.area_step = by_number.area / (STAGE_SAMPLES - STAGE_EVEN_SAMPLES);
    if (by_area.area_step > 0)
        take_tour(&by_area);
}
