/* SPDX-License-Identifier: Apache-2.0 */
/*
 * record.h - what is kept about an updatable structure beside its bytes, so that the rules of updates can be checked
 * and the decay of its tree can be told without the geometry that it was built from.
 *
 * Vulkan compares an update with the last build or update of its source: flags, types, formats, counts, indices, and
 * which primitives are active (Vulkan specification, vkBuildAccelerationStructuresKHR, the rules about mode UPDATE). A
 * structure that was built without ALLOW_UPDATE has no record. A record is one block of bytes, which may be copied,
 * stored and read back: the header, one row for each geometry, and one bit for each primitive if some are inactive.
 */
#ifndef BVHD_RECORD_H
#define BVHD_RECORD_H

#include "builder/context.h"
#include "builder/format/canonical.h"
#include "proto/base/bytes.h"
#include "proto/base/status.h"

/*
 * Version 2 added rows of spheres and linear swept spheres, version 3 rows of motion triangles, which may stand beside
 * rows of triangles, and of motion instances. Version 4 has, behind the rows, one for the micromap of each. A record
 * has the oldest version that has its rows.
 */
enum { RECORD_MICROMAPS = 4, RECORD_NEWEST = RECORD_MICROMAPS };

/* The fields of the structure as a whole. */
struct record_header {
    char magic[4]; /* "BVHU" */
    uint32_t version;
    uint64_t size; /* bytes of the whole record */
    uint32_t type; /* STRUCTURE_TOP or STRUCTURE_BOTTOM */
    uint32_t flags; /* BUILD_ */
    uint32_t geometry_count;
    uint32_t primitive_count; /* over all geometries */
    uint32_t inactive_count; /* how many of them are inactive */
    uint32_t target; /* enum target */
    uint32_t layout_flags; /* PORTABLE_FAST_TRIANGLES */
    uint32_t quality; /* enum build_quality of the last build; QUALITY_UNSPECIFIED until the record is complete */
    struct device_format device; /* all zero for a target of no device */
    uint32_t refits; /* updates since the last build */
    double cost; /* of the tree when it was last built (refit.h); 0 until the record is complete, or for no tree */
    uint64_t reserved[2]; /* 0 */
};

/*
 * The fields of one geometry. All but the first three are 0 unless the geometry has vertices. Where there are two names
 * for a field, the first is that of triangles.
 */
struct record_geometry {
    uint32_t type; /* GEOMETRY_ */
    uint32_t flags; /* GEOMETRY_OPAQUE | GEOMETRY_NO_DUPLICATE_ANY_HIT */
    uint32_t primitive_count;
    uint32_t vertex_count; /* of the canonical copy */
    uint32_t indexed; /* 1: the canonical copy has indices */
    union {
        uint32_t has_transform; /* 1: transformData was not NULL */
        uint32_t swept_modes; /* linear swept spheres: FORM_SWEPT_ (canonical_form.h); 0 for spheres */
    };
    uint32_t vertex_format; /* VkFormat */
    union {
        uint32_t max_vertex;
        uint32_t radius_format; /* VkFormat; spheres and linear swept spheres */
    };
    uint32_t index_type; /* VkIndexType */
    uint32_t lowest_index; /* in the request */
    uint64_t index_sum; /* a checksum of the canonical copy's indices, which count from the lowest one */
};

/* What a geometry has: no micromap, special indices without one, or a micromap. */
enum record_attachment { RECORD_NO_MICROMAP, RECORD_SPECIAL_ONLY, RECORD_MICROMAP };

/* The micromap of one geometry. */
struct record_micromap {
    uint32_t attachment; /* enum record_attachment */
    uint32_t reserved; /* 0 */
    /*
     * A checksum of the copy's indices; with MICROMAP_DATA_UPDATE of their shapes (struct form_micromap), and with
     * MICROMAP_UPDATE 0, because updates may change them.
     */
    uint64_t index_sum;
    struct key key; /* of the micromap; 0 with either of the flags */
};

_Static_assert(sizeof(struct record_header) == 112 && sizeof(struct record_geometry) == 48, "format");
_Static_assert(sizeof(struct record_micromap) == 48, "format");

/* A view of a record. */
struct record {
    struct bytes bytes; /* the whole record */
    const struct record_header *header;
    const struct record_geometry *geometries; /* header->geometry_count rows */
    const struct record_micromap *micromaps; /* as many; NULL: no geometry has a micromap */
    /* bit i % 64 of word i / 64 is set if flat primitive i is active; NULL: all are active */
    const uint64_t *active;
    struct record_header *owned; /* the block if it belongs to the view, else NULL */
};

/*
 * Makes the record of a canonical copy that is about to be built, or to become an update. Cost, quality and refits are
 * those of no build yet: refit.h completes them. The bytes are the same for any number of threads. *ret_record owns its
 * memory (of context->memory) until record_finish. Returns BVHD_NO_MEMORY or BVHD_CANCELLED.
 */
enum bvhd_status record_make(const struct canonical *canonical, const struct build_options *options,
                             const struct build_context *context, struct record *ret_record, struct bvhd_error *error);

/*
 * Opens the bytes of a complete record from elsewhere, which are not trusted. They must be 8-byte aligned, must not
 * change, and must outlive the view, which owns nothing. Returns BVHD_CORRUPT with the field, e.g.
 * "record.geometries[3].type", or BVHD_INCOMPATIBLE for another version.
 */
enum bvhd_status record_open(struct bytes bytes, struct record *ret_record, struct bvhd_error *error);

/*
 * Returns the GEOMETRY_ that decides what structure it is of, as canonical_kind does: that of the first row that moves,
 * else that of the first row. A record without rows counts as one of triangles, or of instances.
 */
uint32_t record_type_of(const struct record *record);

/* Frees what record_make made, and zeroes the view. `record` may be NULL or already zeroed. */
void record_finish(struct record *record, struct memory *memory);

/* Returns whether flat primitive `primitive` is active: whether rays could hit it. */
static inline bool record_is_active(const struct record *record, uint32_t primitive)
{
    return !record->active || (record->active[primitive / 64] >> primitive % 64 & 1);
}

#endif
