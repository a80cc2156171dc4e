/* SPDX-License-Identifier: Apache-2.0 */
/* import_compare.h - compares what two readers made of one file, so that a mistake of a reader shows. */
#ifndef BVHCTL_IMPORT_COMPARE_H
#define BVHCTL_IMPORT_COMPARE_H

#include "client/bvhctl/scene/import.h"

/* The scene in world space, over all instances that are not skipped. */
struct import_extent {
    uint64_t triangles;
    /* of the boxes of its bottom levels, as far as corners are finite; low > high: there are none */
    double low[3], high[3];
};

enum import_agreement {
    /* there is only one reader for this file, or the other one does not read the same of it, or there is no memory */
    IMPORT_NOT_COMPARED,
    IMPORT_AGREES,
    IMPORT_DIFFERS,
    IMPORT_REFUSED, /* by the other reader */
};

struct import_comparison {
    enum import_agreement agreement;
    struct import_extent first, second; /* `second` is that of assimp */
    char text[BVHD_TEXT_SIZE]; /* for IMPORT_REFUSED: assimp's reason */
};

/*
 * Imports the file again with assimp, if it was read by another reader, and compares numbers of triangles and bounds.
 * Neither the order of triangles nor their corners are compared.
 */
struct import_comparison import_compare(const char *path, const struct import *import, struct memory *memory);

#endif
