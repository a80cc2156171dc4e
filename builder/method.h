/* SPDX-License-Identifier: Apache-2.0 */
/*
 * method.h - chooses how the pieces of a build are made: by the request's builder, the quality that is built, and what
 * the structure consists of.
 */
#ifndef BVHD_METHOD_H
#define BVHD_METHOD_H

#include "builder/format/canonical.h"
#include "builder/top/pieces.h"

/*
 * Returns the builders that can be used, as bits 1 << BUILDER_. The first call loads Embree, which takes some
 * milliseconds, or far longer when its file has to be read from a disk.
 */
uint32_t method_builders(void);

/* `quality`: FAST, BALANCED or HIGH. */
enum pieces_method method_choose(const struct canonical *canonical, enum build_builder builder,
                                 enum build_quality quality);

/* True for methods whose top is divided by spatial_split, and that may split triangles. */
bool method_is_spatial(enum pieces_method method);

/* True for methods by which Embree builds the pieces. */
bool method_is_embree(enum pieces_method method);

/* True for methods that take runs of primitives as one ref (primitive.h). */
bool method_takes_runs(enum pieces_method method);

/* Returns how many refs a piece of a build of `count` refs should have. */
uint32_t method_piece_size(enum pieces_method method, uint32_t count);

/* Returns the name for statistics, a static string. `splits`: triangles may be split. */
const char *method_name(enum pieces_method method, bool splits);

#endif
