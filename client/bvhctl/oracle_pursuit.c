/* SPDX-License-Identifier: Apache-2.0 */
#include "oracle_pursuit.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { DOUBTS = 64 }; /* kept for a ray; further ones count as not made up for */

void oracle_pursuit_init(struct oracle_pursuit *ret_pursuit, const struct ray *ray)
{
    *ret_pursuit = (struct oracle_pursuit){.best_high = INFINITY, .doubt_low = INFINITY};
    ret_pursuit->kind = oracle_ray_init(&ret_pursuit->ray, ray);
}

void oracle_pursuit_finish(struct oracle_pursuit *pursuit, struct memory *memory)
{
    memory_free(memory, pursuit->contenders);
    memory_free(memory, pursuit->doubts);
    pursuit->contenders = NULL;
    pursuit->doubts = NULL;
}

static void drop_beaten(struct oracle_pursuit *pursuit)
{
    uint32_t kept = 0;
    for (uint32_t i = 0; i < pursuit->count; i++)
        if (pursuit->contenders[i].crossing.low <= pursuit->best_high)
            pursuit->contenders[kept++] = pursuit->contenders[i];
    pursuit->count = kept;
    kept = 0;
    for (uint32_t i = 0; i < pursuit->doubt_count; i++)
        if (pursuit->doubts[i].contender.crossing.low <= pursuit->best_high)
            pursuit->doubts[kept++] = pursuit->doubts[i];
    pursuit->doubt_count = kept;
}

/* Identical triangles in a row make one contender, or many copies of a triangle would need memory for each pair. */
static bool extends(const struct oracle_contender *last, const struct oracle_contender *next)
{
    const struct oracle_crossing *a = &last->crossing, *b = &next->crossing;
    return last->id.instance == next->id.instance && last->id.geometry == next->id.geometry &&
           last->id.primitive + last->id.count == next->id.primitive && a->t == b->t && a->low == b->low && a->high == b->high &&
           a->shift == b->shift;
}

static bool make_room(struct oracle_pursuit *pursuit, struct memory *memory)
{
    if (pursuit->count < pursuit->capacity)
        return true;
    drop_beaten(pursuit);
    if (pursuit->count < pursuit->capacity / 2)
        return true;
    uint32_t capacity = pursuit->capacity ? 2 * pursuit->capacity : 8;
    void *grown = memory_resize(memory, pursuit->contenders, capacity * sizeof *pursuit->contenders);
    if (!grown)
        return false;
    pursuit->contenders = grown;
    pursuit->capacity = capacity;
    return true;
}

static bool add_contender(struct oracle_pursuit *pursuit, const struct oracle_contender *next, struct memory *memory)
{
    pursuit->best_high = fmin(pursuit->best_high, next->crossing.high);
    if (pursuit->count && extends(&pursuit->contenders[pursuit->count - 1], next)) {
        pursuit->contenders[pursuit->count - 1].id.count++;
        return true;
    }
    if (!make_room(pursuit, memory))
        return false;
    pursuit->contenders[pursuit->count++] = *next;
    return true;
}

static bool add_doubt(struct oracle_pursuit *pursuit, const struct oracle_contender *next, const struct oracle_triangle *triangle,
                      struct memory *memory)
{
    if (!pursuit->doubts)
        pursuit->doubts = memory_array(memory, DOUBTS, sizeof *pursuit->doubts);
    if (!pursuit->doubts)
        return false;
    if (pursuit->doubt_count == DOUBTS)
        drop_beaten(pursuit);
    if (pursuit->doubt_count == DOUBTS) {
        pursuit->doubt_low = fmin(pursuit->doubt_low, next->crossing.low);
        return true;
    }
    struct oracle_doubt *doubt = &pursuit->doubts[pursuit->doubt_count++];
    doubt->contender = *next;
    for (int end = 0; end < 2; end++)
        for (int axis = 0; axis < 3; axis++)
            doubt->edge[end][axis] = triangle->corners[(next->crossing.open_edge + 1 + end) % 3][axis].centre;
    return true;
}

bool oracle_pursuit_meet(struct oracle_pursuit *pursuit, const struct oracle_triangle *triangle, const struct oracle_triangle_id *id,
                         struct memory *memory)
{
    struct oracle_contender next = {.id = *id};
    enum oracle_presence presence = oracle_triangle_meet(&pursuit->ray, triangle, &next.crossing);
    if (presence == ORACLE_ABSENT || next.crossing.low > pursuit->best_high)
        return true;
    if (presence == ORACLE_SURE)
        return add_contender(pursuit, &next, memory);
    if (next.crossing.open_edge >= 0)
        return add_doubt(pursuit, &next, triangle, memory);
    pursuit->doubt_low = fmin(pursuit->doubt_low, next.crossing.low);
    return true;
}

static bool ends_equal(const double a[3], const double b[3])
{
    return a[0] == b[0] && a[1] == b[1] && a[2] == b[2];
}

/* The ray hits a or b, whichever side of their common edge it passes. Only within one instance: there, equal corners are rounded alike. */
static bool make_up(const struct oracle_doubt *a, const struct oracle_doubt *b)
{
    if (a->contender.id.instance != b->contender.id.instance)
        return false;
    bool same_signs = a->contender.crossing.positive == b->contender.crossing.positive;
    if (ends_equal(a->edge[0], b->edge[1]) && ends_equal(a->edge[1], b->edge[0]))
        return same_signs;
    if (ends_equal(a->edge[0], b->edge[0]) && ends_equal(a->edge[1], b->edge[1]))
        return !same_signs;
    return false;
}

/* Doubts that make up for each other become contenders, over the range of both; the others stay doubts. */
static bool settle_doubts(struct oracle_pursuit *pursuit, struct memory *memory)
{
    for (uint32_t i = 0; i < pursuit->doubt_count; i++) {
        struct oracle_contender both = pursuit->doubts[i].contender;
        double high = INFINITY, low = both.crossing.low;
        for (uint32_t k = 0; k < pursuit->doubt_count; k++) {
            const struct oracle_crossing *other = &pursuit->doubts[k].contender.crossing;
            if (!make_up(&pursuit->doubts[i], &pursuit->doubts[k]) || other->high >= high)
                continue;
            high = other->high;
            low = other->low;
        }
        if (high == INFINITY) {
            pursuit->doubt_low = fmin(pursuit->doubt_low, both.crossing.low);
            continue;
        }
        both.crossing.low = fmin(both.crossing.low, low);
        both.crossing.high = fmax(both.crossing.high, high);
        if (!add_contender(pursuit, &both, memory))
            return false;
    }
    pursuit->doubt_count = 0;
    return true;
}

static int compare_numbers(uint32_t a, uint32_t b)
{
    return (a > b) - (a < b);
}

static int compare_contenders(const void *left, const void *right)
{
    const struct oracle_contender *a = left, *b = right;
    if (a->crossing.t != b->crossing.t)
        return a->crossing.t < b->crossing.t ? -1 : 1;
    int order = compare_numbers(a->id.instance, b->id.instance);
    order = order ? order : compare_numbers(a->id.geometry, b->id.geometry);
    return order ? order : compare_numbers(a->id.primitive, b->id.primitive);
}

bool oracle_pursuit_answer(struct oracle_pursuit *pursuit, struct memory *memory, struct oracle_answer *ret_answer)
{
    if (!settle_doubts(pursuit, memory))
        return false;
    drop_beaten(pursuit);
    struct oracle_answer answer = {.kind = pursuit->doubt_low <= pursuit->best_high && pursuit->doubt_low < INFINITY ? ORACLE_UNCERTAIN
                                           : pursuit->count                                                          ? ORACLE_HIT
                                                                                                                     : ORACLE_MISS};
    if (pursuit->count) {
        qsort(pursuit->contenders, pursuit->count, sizeof *pursuit->contenders, compare_contenders);
        const struct oracle_crossing *first = &pursuit->contenders->crossing;
        answer.t = first->t;
        answer.t_low = first->low - first->shift;
        answer.t_high = answer.t_end = first->high + first->shift;
    }
    if (answer.kind == ORACLE_HIT) {
        answer.tied = memory_array(memory, pursuit->count, sizeof *answer.tied);
        if (!answer.tied)
            return false;
        for (uint32_t i = 0; i < pursuit->count; i++) {
            const struct oracle_crossing *crossing = &pursuit->contenders[i].crossing;
            answer.tied[answer.tied_count++] = pursuit->contenders[i].id;
            answer.t_low = fmin(answer.t_low, crossing->low - crossing->shift);
            answer.t_end = fmax(answer.t_end, crossing->high + crossing->shift);
        }
    }
    *ret_answer = answer;
    return true;
}
