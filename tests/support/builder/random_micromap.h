/* SPDX-License-Identifier: Apache-2.0 */
/*
 * random_micromap.h - random opacity micromaps, triangles that name them, and what they mean: for each triangle the
 * state at a point, from the request and not from the bytes that were built.
 *
 * For test programs only: without memory, or if a build fails, they print a message and end. random_micromap_make opens
 * the door for micromaps (validate_micromaps).
 */
#ifndef BVHD_TEST_RANDOM_MICROMAP_H
#define BVHD_TEST_RANDOM_MICROMAP_H

#include "builder/format/micro_triangle.h"
#include "proto/base/geometry.h"
#include "tests/support/random.h"

/* A micromap as a request, and the portable structure that is built from it. It must not be copied. */
struct random_micromap {
    struct micromap_triangle *triangles; /* with gaps between them of `stride` bytes */
    uint64_t stride;
    uint32_t count;
    unsigned char *states;
    uint64_t states_size;
    struct micromap_usage usages[2 * (MICRO_LEVEL_MAX + 1) + 2]; /* some say 0, and some are said in two parts */
    uint32_t usage_count;
    struct geometry geometry; /* GEOMETRY_MICROMAP of all these */
    struct bytes blob; /* portable, 64-byte aligned */
    struct key key;
};

/* Returns triangle `index` of the request. */
struct micromap_triangle random_micromap_triangle(const struct random_micromap *micromap, uint32_t index);

/*
 * Makes a micromap of `count` triangles of levels up to `max_level`, of both formats and any states; some are of one
 * state, some have the same states as others, and some states overlap. Then builds it with these BUILD_ flags.
 */
void random_micromap_make(struct random *random, uint32_t count, unsigned max_level, uint32_t flags,
                          struct random_micromap *ret_micromap);
void random_micromap_finish(struct random_micromap *micromap);

/* Returns a reference to the micromap under that handle, for the table of a bottom level's request. */
struct reference random_micromap_reference(const struct random_micromap *micromap, uint64_t handle);

/* How triangles of a geometry name those of a micromap. It must not be copied. */
struct random_attachment {
    const struct random_micromap *micromap; /* NULL: none */
    unsigned char *indices;
    uint32_t *names; /* for each triangle: a special index (MICROMAP_FULLY_), or the number of a micromap's triangle */
    uint32_t count;
    struct micromap_usage usages[2 * (MICRO_LEVEL_MAX + 1)];
};

/*
 * Gives a geometry of triangles, whose range is set, a micromap with random indices of any type. `micromap` is known
 * under `handle`; NULL: all indices are special.
 */
void random_micromap_attach(struct random *random, const struct random_micromap *micromap, uint64_t handle,
                            struct geometry *geometry, struct random_attachment *ret_attachment);
void random_attachment_finish(struct random_attachment *attachment);

/* Returns the state at the point with weights u and v of a triangle of the geometry. */
enum micro_state random_attachment_state(const struct random_attachment *attachment, uint32_t triangle, float u,
                                         float v);

#endif
