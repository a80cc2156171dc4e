/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/oracle/oracle_pursuit.h"

#include <math.h>
#include <stdlib.h>

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
}

static void drop_beaten_doubts(struct oracle_pursuit *pursuit)
{
    struct oracle_doubts *doubts = pursuit->doubts;
    uint32_t kept = 0;
    for (uint32_t i = 0; i < doubts->count; i++)
        if (doubts->contenders[i].crossing.low <= pursuit->best_high) {
            doubts->contenders[kept] = doubts->contenders[i];
            doubts->triangles[kept++] = doubts->triangles[i];
        }
    doubts->count = kept;
}

/*
 * Returns whether `next` is the primitive after `last` and an identical one. Both become one contender then, so
 * that many copies of a primitive do not need memory for each pair of a ray and a copy.
 */
static bool extends(const struct oracle_contender *last, const struct oracle_contender *next)
{
    const struct oracle_crossing *a = &last->crossing, *b = &next->crossing;
    return last->id.instance == next->id.instance && last->id.geometry == next->id.geometry &&
           last->id.primitive + last->id.count == next->id.primitive && a->t == b->t && a->low == b->low &&
           a->high == b->high && a->shift == b->shift;
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

static bool add_doubt(struct oracle_pursuit *pursuit, const struct oracle_contender *next,
                      const struct oracle_outline *outline, struct memory *memory)
{
    struct oracle_doubts *doubts = pursuit->doubts;
    if (!doubts) {
        doubts = memory_alloc(memory, sizeof *doubts);
        if (!doubts)
            return false;
        doubts->count = 0;
        pursuit->doubts = doubts;
    }
    if (doubts->count == ORACLE_PATCH_MAX)
        drop_beaten_doubts(pursuit);
    if (doubts->count == ORACLE_PATCH_MAX) {
        pursuit->doubt_low = fmin(pursuit->doubt_low, next->crossing.low);
        return true;
    }
    doubts->triangles[doubts->count].instance = next->id.instance;
    doubts->triangles[doubts->count].outline = *outline;
    doubts->contenders[doubts->count++] = *next;
    return true;
}

bool oracle_pursuit_note(struct oracle_pursuit *pursuit, enum oracle_presence presence,
                         const struct oracle_contender *next, const struct oracle_outline *outline,
                         struct memory *memory)
{
    if (next->crossing.low > pursuit->best_high)
        return true;
    if (presence == ORACLE_SURE)
        return add_contender(pursuit, next, memory);
    if (outline->open)
        return add_doubt(pursuit, next, outline, memory);
    pursuit->doubt_low = fmin(pursuit->doubt_low, next->crossing.low);
    return true;
}

/*
 * Takes note of a patch that is surely hit. It is not known which of its triangles is hit, so that each becomes a
 * contender, with an interval that contains those of all.
 */
static bool add_patch(struct oracle_pursuit *pursuit, const uint32_t *patch, uint32_t which, struct memory *memory)
{
    const struct oracle_doubts *doubts = pursuit->doubts;
    double low = INFINITY, high = -INFINITY;
    for (uint32_t i = 0; i < doubts->count; i++)
        if (patch[i] == which) {
            low = fmin(low, doubts->contenders[i].crossing.low);
            high = fmax(high, doubts->contenders[i].crossing.high);
        }
    for (uint32_t i = 0; i < doubts->count; i++) {
        struct oracle_contender next = doubts->contenders[i];
        next.crossing.low = low;
        next.crossing.high = high;
        if (patch[i] == which && !add_contender(pursuit, &next, memory))
            return false;
    }
    return true;
}

static bool settle_doubts(struct oracle_pursuit *pursuit, struct memory *memory)
{
    if (!pursuit->doubts)
        return true;
    drop_beaten_doubts(pursuit);
    const struct oracle_doubts *doubts = pursuit->doubts;
    uint32_t patch[ORACLE_PATCH_MAX];
    oracle_patch_find(doubts->triangles, doubts->count, patch);
    for (uint32_t which = 0; which < doubts->count; which++) {
        if (patch[which] != which)
            continue;
        if (oracle_patch_covers(doubts->triangles, doubts->count, patch, which)) {
            if (!add_patch(pursuit, patch, which, memory))
                return false;
            continue;
        }
        for (uint32_t i = which; i < doubts->count; i++)
            if (patch[i] == which)
                pursuit->doubt_low = fmin(pursuit->doubt_low, doubts->contenders[i].crossing.low);
    }
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
    struct oracle_answer answer = {.outcome = pursuit->doubt_low <= pursuit->best_high && pursuit->doubt_low < INFINITY
                                                  ? ORACLE_UNCERTAIN
                                              : pursuit->count ? ORACLE_HIT
                                                               : ORACLE_MISS};
    if (pursuit->count) {
        qsort(pursuit->contenders, pursuit->count, sizeof *pursuit->contenders, compare_contenders);
        const struct oracle_crossing *first = &pursuit->contenders->crossing;
        answer.t = first->t;
        answer.t_low = first->low - first->shift;
        answer.t_high = answer.t_end = first->high + first->shift;
    }
    if (answer.outcome == ORACLE_HIT) {
        answer.tied = memory_array(memory, pursuit->count, sizeof *answer.tied);
        if (!answer.tied)
            return false;
        for (uint32_t i = 0; i < pursuit->count; i++) {
            const struct oracle_crossing *crossing = &pursuit->contenders[i].crossing;
            answer.tied[answer.tied_count] = pursuit->contenders[i].id;
            answer.tied[answer.tied_count++].t = crossing->t;
            answer.t_low = fmin(answer.t_low, crossing->low - crossing->shift);
            answer.t_end = fmax(answer.t_end, crossing->high + crossing->shift);
        }
    }
    *ret_answer = answer;
    return true;
}
