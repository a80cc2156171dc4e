/* SPDX-License-Identifier: Apache-2.0 */
/*
 * target_reader.h - the table of readers: everything that bvhctl does differently for structures of different targets.
 *
 * It is the counterpart of the table of layouts (builder/format/layout.h), which writes them. A new target needs a file
 * target_reader_NAME.c, a row in target_reader.c, a member in the union of structure.h, and its name among those of
 * --target (base/options.c).
 *
 * The callers are structure.h, structures.h, survey.h and unpack.h; other code uses those. All functions may be called
 * by any thread.
 */
#ifndef BVHCTL_TARGET_READER_H
#define BVHCTL_TARGET_READER_H

#include "client/bvhctl/scene/structure.h"

struct survey;

struct target_reader {
    enum target target;
    bool is_native; /* a driver loads its structures; those of other targets are traced by compute shaders */
    /*
     * The 16 bytes by which the header of every blob of this target begins. NULL for a native target, whose blobs begin
     * with the UUID of the driver that they are for.
     */
    const uint8_t *driver_uuid;
    /*
     * true: a top level has one serialized handle for each row of the request's references, in their order. false: it
     * has one for each instance, and several may name the same row.
     */
    bool has_handle_per_row;

    /*
     * Opens a hostile blob: fills in the structure, of which `blob`, `memory` and `target` are set. BVHD_CORRUPT,
     * BVHD_INCOMPATIBLE, BVHD_UNSUPPORTED, BVHD_NO_MEMORY. The caller closes the structure after a failure too.
     */
    enum bvhd_status (*open)(struct structure *structure, struct bvhd_error *error);
    /* These five do the work of the functions of structure.h and survey.h that have the same names. */
    void (*bounds)(const struct structure *structure, float ret_bounds[6]);
    void (*triangle)(const struct structure *structure, uint32_t row, float time, float ret_corners[3][3],
                     uint32_t *ret_primitive);
    struct structure_round (*round)(const struct structure *structure, uint32_t row); /* NULL: it has none */
    struct structure_instance (*instance)(const struct structure *structure, uint32_t row);
    const char *(*content_name)(const struct structure *structure);
    /* Adds the figures of a structure to *survey, which is zero. BVHD_NO_MEMORY. */
    enum bvhd_status (*survey)(const struct structure *structure, struct memory *memory, struct survey *survey);

    /*
     * The inverse of an instance's matrix, as the driver computes it; both are row-major 3x4. NULL: rays are
     * transformed with more precision than `float`, so that nobody has to allow for an error.
     */
    void (*invert)(const float object_to_world[12], float ret_world_to_object[12]);
};

enum { TARGET_READER_COUNT = 2 };

extern const struct target_reader target_reader_portable, target_reader_lavapipe;
extern const struct target_reader *const target_readers[TARGET_READER_COUNT];

/* Returns NULL for an unknown target. */
const struct target_reader *target_reader_find(enum target target);

#endif
