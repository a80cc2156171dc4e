/* SPDX-License-Identifier: Apache-2.0 */
/*
 * container.h - the structures of one or more scenes in one file, beside the text of their manifest. FORMATS.md
 * describes every byte.
 *
 * A file that is mapped, or read to memory that is aligned to 64 bytes, is used in place: each structure in it is
 * aligned to 64 bytes. Structures come first and the directory, which describes them, at the end, so that a writer
 * needs no memory for structures.
 */
#ifndef BVHD_CONTAINER_H
#define BVHD_CONTAINER_H

#include "proto/base/bytes.h"
#include "proto/base/geometry.h"
#include "proto/base/key.h"
#include "proto/base/memory.h"
#include "proto/base/status.h"

enum { CONTAINER_HEADER = 64, CONTAINER_ROW = 192, CONTAINER_ALIGN = 64, CONTAINER_SLABS = 20 };

/* One structure in a container. Texts are UTF-8. */
struct container_structure {
    struct key key;
    struct bytes blob;
    uint32_t type; /* STRUCTURE_TOP or STRUCTURE_BOTTOM */
    enum target target;
    float bounds[6];
    float slabs[CONTAINER_SLABS]; /* ten minima, ten maxima; all 0 if they are not known */
    const char *file; /* its name as a file, which no other structure has */
    const char *name, *scene;
    /* of a top level: the structures that its references name, as rows of the table, by rows of the top level */
    const uint32_t *references;
    uint32_t reference_count;
};

/* An opened container. It points to the file's bytes, and needs no clean-up. */
struct container {
    struct bytes file;
    uint32_t count; /* structures */
    uint32_t version;
    const unsigned char *table;
    const uint32_t *references;
    const char *texts;
    struct bytes manifest; /* JSON in UTF-8; a zero byte follows */
};

/* Returns whether the bytes begin as a container does. */
bool container_is(struct bytes file);

/*
 * Opens a hostile file, whose first byte is aligned to 64 bytes: checks the sizes and places of everything, the
 * directory with its checksum, and the header of each structure. BVHD_CORRUPT or BVHD_INCOMPATIBLE with the place. The
 * structures themselves are checked by container_check and by the readers of their layouts.
 */
enum bvhd_status container_open(struct bytes file, struct container *ret_container, struct bvhd_error *error);

/* Returns structure `row`, 0 to count - 1, as it is stored. */
struct container_structure container_structure(const struct container *container, uint32_t row);

/*
 * Compares the bytes of a structure with its checksum. BVHD_CORRUPT. It finds damage; whoever makes a hostile file can
 * make its checksums, too.
 */
enum bvhd_status container_check(const struct container *container, uint32_t row, struct bvhd_error *error);

/* Writes a container from its first structure on. All its fields belong to container_write.c. */
struct container_writer {
    struct memory *memory;
    bool (*sink)(void *context, struct bytes data);
    void *context;
    uint64_t size; /* of the file so far */
    struct container_list {
        unsigned char *data;
        uint64_t size, capacity;
    } table, references, texts;
    uint32_t *slots; /* a hash table of the rows whose bytes are stored, by key: row + 1, or 0 */
    uint64_t slot_count; /* a power of two, or 0 */
    uint32_t count;
    uint32_t last_scene; /* the text of the last row's scene */
};

/*
 * Begins a container. `sink` gets the bytes of the file from offset CONTAINER_HEADER on, one piece after the other, and
 * returns false when it cannot take them. End with container_writer_finish.
 */
void container_writer_init(struct container_writer *writer, struct memory *memory,
                           bool (*sink)(void *context, struct bytes data), void *context);

/*
 * Adds a structure; bottom levels come before the top levels that refer to them. The bytes of a structure whose key is
 * that of an earlier one are not stored again. BVHD_NO_MEMORY, BVHD_TOO_LARGE, or BVHD_IO when the sink has failed.
 */
enum bvhd_status container_writer_add(struct container_writer *writer, const struct container_structure *structure,
                                      struct bvhd_error *error);

/*
 * Writes the directory, with the text of the manifest, and returns the header, which the caller puts at the start of
 * the file. The errors are those of container_writer_add.
 */
enum bvhd_status container_writer_end(struct container_writer *writer, struct bytes manifest,
                                      unsigned char ret_header[CONTAINER_HEADER], struct bvhd_error *error);

/* NULL-safe, idempotent. */
void container_writer_finish(struct container_writer *writer);

#endif
