/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/support/builder/test_container.h"

#include <stdio.h>
#include <stdlib.h>

#include "builder/format/serialized.h"

bool test_sink_take(void *context, struct bytes data)
{
    struct test_sink *sink = context;
    if (sink->fail_after >= 0 && sink->fail_after-- == 0)
        return false;
    uint64_t begin = sink->size ? sink->size : CONTAINER_HEADER;
    unsigned char *grown = memory_resize(sink->memory, sink->data, begin + data.size);
    if (!grown)
        return false;
    sink->data = grown;
    memcpy(grown + begin, data.data, data.size);
    sink->size = begin + data.size;
    return true;
}

static const struct {
    uint32_t type;
    const char *scene;
    uint32_t references[2], reference_count;
} rows[TEST_CONTAINER_ROWS] = {{STRUCTURE_BOTTOM, "one", {0}, 0}, {STRUCTURE_BOTTOM, "one", {0}, 0},
                               {STRUCTURE_BOTTOM, "one", {0}, 0}, {STRUCTURE_TOP, "one", {2, 0}, 2},
                               {STRUCTURE_BOTTOM, "two", {0}, 0}, {STRUCTURE_TOP, "two", {4}, 1}};

static enum bvhd_status add_row(struct container_writer *writer, uint32_t row, struct bvhd_error *error)
{
    char file[32], name[32];
    unsigned char blob[TEST_CONTAINER_SIZE + 8 * TEST_CONTAINER_ROWS] = {0};
    uint32_t stored = row == 1 ? 0 : row;
    uint64_t size = TEST_CONTAINER_SIZE + 8 * stored;
    struct serialized_header header = {.serialized_size = size};
    serialized_write(blob, &header);
    memset(blob + TEST_CONTAINER_SIZE, 0xa0 + (int)row, size - TEST_CONTAINER_SIZE);
    snprintf(file, sizeof file, "%s.%u.as", rows[row].scene, row);
    snprintf(name, sizeof name, "n\xc3\xa4me %u", row);
    struct container_structure structure = {.blob = {blob, size},
                                            .type = rows[row].type,
                                            .target = TARGET_PORTABLE,
                                            .bounds = {-1, -2, -3, 1, 2, 3.5f + (float)row},
                                            .slabs = {-4, [19] = 4},
                                            .file = file,
                                            .name = row == 4 ? "" : name,
                                            .scene = rows[row].scene,
                                            .references = rows[row].references,
                                            .reference_count = rows[row].reference_count};
    memset(&structure.key, (int)(0x10 + stored), sizeof structure.key);
    return container_writer_add(writer, &structure, error);
}

enum bvhd_status test_container_write(struct memory *memory, struct test_sink *sink, struct bvhd_error *error)
{
    struct container_writer writer;
    unsigned char header[CONTAINER_HEADER];
    const struct bytes manifest = {(const unsigned char *)TEST_CONTAINER_MANIFEST, strlen(TEST_CONTAINER_MANIFEST)};
    enum bvhd_status status = BVHD_OK;
    container_writer_init(&writer, memory, test_sink_take, sink);
    for (uint32_t i = 0; i < TEST_CONTAINER_ROWS && status == BVHD_OK; i++)
        status = add_row(&writer, i, error);
    if (status == BVHD_OK)
        status = container_writer_end(&writer, manifest, header, error);
    if (status == BVHD_OK)
        memcpy(sink->data, header, sizeof header);
    container_writer_finish(&writer);
    return status;
}

struct bytes test_container_make(void)
{
    struct memory memory;
    struct test_sink sink = {.memory = &memory, .fail_after = -1};
    memory_init(&memory, UINT64_MAX);
    if (test_container_write(&memory, &sink, NULL) != BVHD_OK)
        abort();
    unsigned char *data = aligned_alloc(CONTAINER_ALIGN, bytes_align(sink.size, CONTAINER_ALIGN));
    if (!data)
        abort();
    memcpy(data, sink.data, sink.size);
    memory_free(&memory, sink.data);
    return (struct bytes){data, sink.size};
}
