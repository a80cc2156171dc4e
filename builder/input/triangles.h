/* SPDX-License-Identifier: Apache-2.0 */
/* triangles.h - what triangles and motion triangles share: everything but the vertices at t = 1 (input_kind.h). */
#ifndef BVHD_TRIANGLES_H
#define BVHD_TRIANGLES_H

#include "builder/input/fetch_internal.h"
#include "builder/input/input_kind.h"

enum bvhd_status triangles_check_memory(const struct validate_subject *subject);

void triangles_describe(const struct geometry *geometry, bool is_update, struct form_geometry *row);
bool triangles_update_is_sound(const struct form_geometry *row);

void triangles_fetch_indices(struct fetch *fetch, uint32_t geometry, uint32_t first, uint32_t count);
enum bvhd_status triangles_finish(struct fetch *fetch, uint32_t geometry, struct bvhd_error *error);
void triangles_rebase(struct fetch *fetch, uint32_t geometry, uint32_t first, uint32_t count);

/*
 * Reads `count` of the vertices in use, from number `first` of them on, out of an array that is laid out as the
 * geometry says, and transforms them.
 */
void triangles_read_vertices(const struct fetch *fetch, uint32_t geometry, const struct bytes *array, uint32_t first,
                             uint32_t count, float *ret_positions);

enum bvhd_status triangles_check_foreign(const struct canonical *canonical, uint32_t geometry,
                                         struct bvhd_error *error);

#endif
