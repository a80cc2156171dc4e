/* SPDX-License-Identifier: Apache-2.0 */
/*
 * validate_shape.h - checks Vulkan's rules about what is built: types, flags, formats and numbers of one entry. They
 * need neither the memory of the geometry nor a target, so that they hold for the query of sizes, too.
 *
 * Each function returns BVHD_INVALID with the rule and the place, BVHD_UNSUPPORTED for what Vulkan defines and bvhd
 * does not implement, or BVHD_TOO_LARGE for a limit that no rule of Vulkan names. They have no side effects, and may be
 * called from any thread.
 */
#ifndef BVHD_VALIDATE_SHAPE_H
#define BVHD_VALIDATE_SHAPE_H

#include "proto/base/geometry.h"
#include "proto/base/request_limits.h"
#include "proto/base/status.h"

/* The geometry that is being checked, and its place. */
struct validate_subject {
    const struct geometry *geometry;
    uint32_t info, index;
    struct bvhd_error *error;
    bool ignores_strides; /* for the query of sizes, which reads no memory */
};

/* The places of a member of the geometry, and of its range, as texts; for files that include place.h. */
#define VALIDATE_GEOMETRY_PLACE(subject, field)                                                                        \
    place("infos[%u].geometries[%u].%s", (subject)->info, (subject)->index, field).text
#define VALIDATE_RANGE_PLACE(subject, field) place("ranges[%u][%u].%s", (subject)->info, (subject)->index, field).text

/*
 * Whether opacity micromaps are built. They are refused until every part of the program knows them; tests of the parts
 * that do set it before they start threads.
 */
extern bool validate_micromaps;

/* Checks type and flags of entry `index`. */
enum bvhd_status validate_type(uint32_t type, uint32_t flags, uint32_t index, struct bvhd_error *error);

/* Checks the number of geometries of an entry of this type, which validate_type has accepted. */
enum bvhd_status validate_geometry_count(uint32_t type, uint32_t count, uint32_t index, const struct limits *limits,
                                         struct bvhd_error *error);

/*
 * Checks what the geometry is, as one of `input`, and how much of it there is. The input's geometries are checked in
 * their order, up to the first that fails. *total counts the primitives of all geometries so far; it begins with 0.
 * What only one kind of geometry has is left to kind->check_shape (kind.h).
 */
enum bvhd_status validate_geometry(const struct validate_subject *subject, const struct build_input *input,
                                   const struct limits *limits, uint64_t *total);

#endif
