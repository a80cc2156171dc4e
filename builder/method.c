/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/method.h"

#include "builder/piece/embree.h"

uint32_t method_builders(void)
{
    struct embree_identity embree;
    const bool has_embree = embree_identify(&embree, NULL) == BVHD_OK;
    return 1U << BUILDER_OWN | (uint32_t)has_embree << BUILDER_EMBREE;
}

enum pieces_method method_choose(const struct canonical *canonical, enum build_builder builder,
                                 enum build_quality quality)
{
    if (builder == BUILDER_EMBREE)
        return quality == QUALITY_FAST   ? PIECES_EMBREE_LOW
               : quality == QUALITY_HIGH ? PIECES_EMBREE_HIGH
                                         : PIECES_EMBREE_MEDIUM;
    if (quality == QUALITY_BALANCED && canonical->type == STRUCTURE_TOP)
        /* Nodes over instances are expensive to traverse, so what HIGH does apart from splits is worth its time. */
        return PIECES_SPATIAL;
    return quality == QUALITY_HIGH ? PIECES_SPATIAL : quality == QUALITY_FAST ? PIECES_PLOC : PIECES_BINNED;
}

bool method_is_spatial(enum pieces_method method)
{
    return method == PIECES_SPATIAL || method == PIECES_EMBREE_HIGH;
}

bool method_is_embree(enum pieces_method method)
{
    return method == PIECES_EMBREE_LOW || method == PIECES_EMBREE_MEDIUM || method == PIECES_EMBREE_HIGH;
}

bool method_takes_runs(enum pieces_method method)
{
    return method == PIECES_PLOC || method == PIECES_BINNED;
}

uint32_t method_piece_size(enum pieces_method method, uint32_t count)
{
    /* Enough pieces to keep any number of threads busy, each small enough for the second-level cache. */
    enum { SMALLEST = 4096, LARGEST = 16384, PIECES = 32 };
    if (method == PIECES_EMBREE_HIGH)
        return EMBREE_SPLIT_PIECE_MOST;
    if (method == PIECES_EMBREE_LOW || method == PIECES_EMBREE_MEDIUM)
        return (EMBREE_PIECE_MOST - 1) / 2; /* scatter.h makes pieces of up to twice the size and one more */
    uint32_t size = count / PIECES;
    return size < SMALLEST ? SMALLEST : size > LARGEST ? LARGEST : size;
}

const char *method_name(enum pieces_method method, bool splits)
{
    static const char *const names[] = {
        [PIECES_PLOC] = "ploc",
        [PIECES_BINNED] = "binned",
        [PIECES_SPATIAL] = "spatial",
        [PIECES_EMBREE_LOW] = "embree-low",
        [PIECES_EMBREE_MEDIUM] = "embree-medium",
        [PIECES_EMBREE_HIGH] = "embree-high",
    };
    if (!splits && method == PIECES_EMBREE_HIGH)
        return names[PIECES_EMBREE_MEDIUM]; /* as Embree itself does */
    return method == PIECES_SPATIAL && !splits ? names[PIECES_BINNED] : names[method];
}
