/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_container.h - a small container with two scenes, for tests of what reads containers. Its structures have headers
 * and are otherwise empty. For test programs only.
 */
#ifndef BVHD_TEST_CONTAINER_H
#define BVHD_TEST_CONTAINER_H

#include "builder/format/container.h"

/*
 * Rows 0 to 2 are bottom levels of the scene "one", of which row 1 has the bytes of row 0; row 3 is its top level over
 * rows 2 and 0. Rows 4 and 5 are a bottom level and a top level of the scene "two". Row i has size
 * TEST_CONTAINER_SIZE + 8 * i, except for the shared one.
 */
enum { TEST_CONTAINER_ROWS = 6, TEST_CONTAINER_SIZE = 56 };

#define TEST_CONTAINER_MANIFEST "{\"schema\": 1}\n"

/* Makes the container in a block from malloc that is aligned to 64 bytes. */
struct bytes test_container_make(void);

/* A sink for container_writer_init, which appends to a block from `memory` that begins with room for the header. */
struct test_sink {
    struct memory *memory;
    unsigned char *data;
    uint64_t size; /* 0: the first call makes room for the header */
    int64_t fail_after; /* calls after which it fails; < 0: never */
};
bool test_sink_take(void *context, struct bytes data);

/* Writes the container; `sink` is at its start. Returns the status of the first call that fails. */
enum bvhd_status test_container_write(struct memory *memory, struct test_sink *sink, struct bvhd_error *error);

#endif
