/* SPDX-License-Identifier: Apache-2.0 */
/*
 * import_compare.h - compares an import by a reader of our own with assimp's import of the same file, so that a mistake
 * of a reader shows.
 */
#ifndef BVHCTL_IMPORT_COMPARE_H
#define BVHCTL_IMPORT_COMPARE_H

#include "client/bvhctl/scene/import.h"

/* What is compared: over all instances that are not skipped, in world space. */
struct import_figures {
    uint64_t triangles;
    double min[3], max[3]; /* of finite corners of triangles; min > max when there is none */
};

enum import_agreement {
    IMPORT_ONE_READER, /* assimp read the file, or cannot read it right, so that there is nothing to compare */
    IMPORT_AGREES, /* the same number of triangles, and bounds that differ by rounding only */
    IMPORT_DIFFERS,
    IMPORT_NOT_READ, /* assimp does not read the file */
};

struct import_comparison {
    enum import_agreement agreement;
    struct import_figures own, assimp;
    struct bvhd_error error; /* IMPORT_NOT_READ: why */
};

/* Returns the figures of an import. */
struct import_figures import_figures(const struct import *import);

/* Reads the file again with assimp if a reader of our own has read it. The second import is freed at once. */
struct import_comparison import_compare(const char *path, const struct import *import);

#endif
