/* SPDX-License-Identifier: Apache-2.0 */
#include "octants.h"

#include <math.h>

enum { SLOTS = 8 };

/* gains[child][slot] */
static void compute_gains(const float offsets[3][8], unsigned count, float ret_gains[SLOTS][SLOTS])
{
    for (unsigned child = 0; child < count; child++) {
        float x = offsets[0][child], y = offsets[1][child], z = offsets[2][child];
        for (unsigned slot = 0; slot < SLOTS; slot++)
            ret_gains[child][slot] = (slot & 1 ? x : -x) + (slot & 2 ? y : -y) + (slot & 4 ? z : -z);
    }
}

/* Children by falling distance; equal ones in their order. */
static void sort_children(const float offsets[3][8], unsigned count, uint8_t ret_order[SLOTS])
{
    float distances[SLOTS];
    for (unsigned child = 0; child < count; child++) {
        float distance = fabsf(offsets[0][child]) + fabsf(offsets[1][child]) + fabsf(offsets[2][child]);
        unsigned at = child;
        for (; at > 0 && distances[at - 1] < distance; at--) {
            distances[at] = distances[at - 1];
            ret_order[at] = ret_order[at - 1];
        }
        distances[at] = distance;
        ret_order[at] = (uint8_t)child;
    }
}

static unsigned best_free_slot(const float gains[SLOTS], unsigned taken)
{
    unsigned best = (unsigned)__builtin_ctz(~taken);
    float most = -INFINITY;
    for (unsigned slot = 0; slot < SLOTS; slot++) {
        float gain = taken >> slot & 1 ? -INFINITY : gains[slot];
        best = gain > most ? slot : best;
        most = gain > most ? gain : most;
    }
    return best;
}

/* One pass over all pairs; exchanges two children where both together gain. */
static int exchange(float gains[SLOTS][SLOTS], unsigned count, uint8_t slots[SLOTS])
{
    int exchanged = 0;
    for (unsigned a = 0; a + 1 < count; a++)
        for (unsigned b = a + 1; b < count; b++) {
            unsigned sa = slots[a], sb = slots[b];
            if (gains[a][sb] + gains[b][sa] > gains[a][sa] + gains[b][sb]) {
                slots[a] = (uint8_t)sb;
                slots[b] = (uint8_t)sa;
                exchanged = 1;
            }
        }
    return exchanged;
}

void octants_assign(const float offsets[3][8], unsigned count, uint8_t ret_slots[8])
{
    float gains[SLOTS][SLOTS];
    uint8_t order[SLOTS];
    compute_gains(offsets, count, gains);
    sort_children(offsets, count, order);
    unsigned taken = 0;
    for (unsigned i = 0; i < count; i++) {
        unsigned slot = best_free_slot(gains[order[i]], taken);
        taken |= 1u << slot;
        ret_slots[order[i]] = (uint8_t)slot;
    }
    /* The first pass finds most of what there is; rounding could make exchanges go in circles, so passes are counted. */
    for (int pass = 0; pass < 2 && exchange(gains, count, ret_slots); pass++)
        ;
}
