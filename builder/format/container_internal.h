/* SPDX-License-Identifier: Apache-2.0 */
/* container_internal.h - where the fields of a container are: what its writer and its reader share. */
#ifndef BVHD_CONTAINER_INTERNAL_H
#define BVHD_CONTAINER_INTERNAL_H

#include "builder/format/container.h"
#include "proto/base/checksum.h"

enum { CONTAINER_VERSION = 1 };

static const char container_magic[8] = {'b', 'v', 'h', 'd', 's', 'c', 'e', 'n'};

/* Offsets in the header. */
enum {
    HEADER_VERSION = 8,
    HEADER_COUNT = 12,
    HEADER_SIZE = 16,
    HEADER_DIRECTORY = 24,
    HEADER_REFERENCES = 32,
    HEADER_TEXTS = 40,
    HEADER_MANIFEST = 48,
    HEADER_CHECKSUM = 56
};

/* Offsets in a row of the table. */
enum {
    ROW_KEY = 0,
    ROW_OFFSET = 32,
    ROW_SIZE = 40,
    ROW_CHECKSUM = 48,
    ROW_TYPE = 56,
    ROW_TARGET = 60,
    ROW_BOUNDS = 64,
    ROW_SLABS = 88,
    ROW_FILE = 168,
    ROW_NAME = 172,
    ROW_SCENE = 176,
    ROW_FIRST_REFERENCE = 180,
    ROW_REFERENCE_COUNT = 184,
    ROW_STORED = 188
};

/* The checksum of the directory covers the header in front of the checksum, too. */
static inline uint64_t container_header_seed(const unsigned char *header)
{
    return checksum((struct bytes){header, HEADER_CHECKSUM}, 0);
}

#endif
