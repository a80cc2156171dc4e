/* SPDX-License-Identifier: Apache-2.0 */
/* ply_header.h - reads the header of a PLY file: its format, elements and properties. Internal to ply.h. */
#ifndef BVHCTL_PLY_HEADER_H
#define BVHCTL_PLY_HEADER_H

#include <stdbool.h>
#include <stdint.h>

#include "client/bvhctl/scene/ply_source.h"
#include "proto/base/status.h"

enum {
    PLY_NAME_SIZE = 64, /* longer names are refused */
    PLY_ELEMENTS_MAX = 64,
    PLY_PROPERTIES_MAX = 1024, /* over all elements */
};

struct ply_property {
    char name[PLY_NAME_SIZE];
    bool is_list;
    enum ply_type count_type; /* of a list */
    enum ply_type type; /* of the value, or of each value of a list */
};

struct ply_element {
    char name[PLY_NAME_SIZE];
    uint64_t count; /* rows, which the file may lie about */
    const struct ply_property *properties;
    uint32_t property_count;
};

struct ply_header {
    struct ply_element elements[PLY_ELEMENTS_MAX];
    struct ply_property properties[PLY_PROPERTIES_MAX];
    uint32_t element_count, property_count;
    uint32_t unknown_lines; /* before the first element, with a word that is not known; they are ignored */
};

/*
 * Reads the header from the start of the file, and sets source->format. BVHD_INVALID with the line that is wrong, or
 * BVHD_UNSUPPORTED for a version, type or size that this reader does not know.
 */
enum bvhd_status ply_header_read(struct ply_source *source, const char *path, struct ply_header *ret_header,
                                 struct bvhd_error *error);

/* Returns the element with this name, or NULL. */
const struct ply_element *ply_header_find(const struct ply_header *header, const char *name);

/* Returns the number of the element's property with this name, or -1. */
int ply_element_find(const struct ply_element *element, const char *name);

/* Returns the fewest bytes that a row of the element takes in a file of this format. */
uint64_t ply_element_row_size(const struct ply_element *element, enum ply_format format);

/* Returns whether all rows have the same size: the file is binary and the element has no list. */
bool ply_element_is_fixed(const struct ply_element *element, enum ply_format format);

#endif
