/* SPDX-License-Identifier: Apache-2.0 */
/*
 * positions.h - finds the corners of triangles in serialized structures by their numbers in the request, for programs
 * that build with ALLOW_DATA_ACCESS and read positions without a ray.
 *
 * A portable structure stores triangles in the order of its tree, so that a table of 4 bytes a primitive finds them.
 * The leaves of a native one are in the order of the request, and are searched. A struct positions does not refer to
 * the bytes, which are given to each call, so that copies of a structure can share it.
 */
#ifndef BVHD_POSITIONS_H
#define BVHD_POSITIONS_H

#include "builder/format/lavapipe.h"
#include "builder/format/portable.h"

/* How the triangles of one structure are found. It may be read from any thread. */
struct positions;

/*
 * Makes a struct positions, which the caller ends with positions_unref, of a structure that has been opened, whatever
 * its primitives are. Returns BVHD_NO_MEMORY, at the place "data".
 */
enum bvhd_status positions_of_portable(struct bytes blob, const struct portable_view *view, struct memory *memory,
                                       struct positions **ret_positions, struct bvhd_error *error);
enum bvhd_status positions_of_lavapipe(struct bytes blob, const struct lavapipe_view *view, struct memory *memory,
                                       struct positions **ret_positions, struct bvhd_error *error);

/* Count one more user, and one fewer, of whom the last one frees it. NULL is allowed. For any thread. */
struct positions *positions_ref(struct positions *positions);
void positions_unref(struct positions *positions);

/*
 * Gives the corners of a triangle, exactly as they are stored; of motion triangles those at *time, which is within 0 ..
 * 1 (motion_number.h). `time` may be NULL. `blob` has the bytes that were prepared, or a copy which differs in its
 * flags alone. Returns BVHD_INVALID at the place "geometry" for a structure of other primitives, or of motion triangles
 * without a time, and for a geometry that is not there; at "primitive" for one beyond the geometry's, and for a
 * triangle that the structure does not hold.
 */
enum bvhd_status positions_get(const struct positions *positions, const unsigned char *blob, uint32_t geometry,
                               uint32_t primitive, const float *time, float ret_corners[3][3],
                               struct bvhd_error *error);

#endif
