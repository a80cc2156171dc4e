/* SPDX-License-Identifier: Apache-2.0 */
/*
 * fuzz_container.c - fuzzes the reader of containers: a container is refused with a place, or all that it hands out
 * lies inside of the file.
 *
 * The input is a byte, which is odd if the checksum of the directory is repaired, followed by the container.
 */
#include "tests/fuzz/fuzz.h"

#include <string.h>

#include "builder/format/container_internal.h"
#include "tests/support/builder/test_container.h"

/* Makes the checksum of the directory right, as far as its parts lie inside of the file. */
static void repair(uint8_t *file, uint64_t size)
{
    if (size < CONTAINER_HEADER)
        return;
    uint64_t sum = container_header_seed(file), at = bytes_get64(file + HEADER_DIRECTORY);
    const uint64_t sizes[] = {(uint64_t)bytes_get32(file + HEADER_COUNT) * CONTAINER_ROW,
                              4 * (bytes_get64(file + HEADER_REFERENCES) & UINT32_MAX),
                              bytes_get64(file + HEADER_TEXTS), bytes_get64(file + HEADER_MANIFEST), 1};
    for (size_t i = 0; i < sizeof sizes / sizeof sizes[0]; at += sizes[i++]) {
        if (at > size || sizes[i] > size - at)
            return;
        sum = checksum((struct bytes){file + at, sizes[i]}, sum);
    }
    bytes_put64(file + HEADER_CHECKSUM, sum);
}

static bool is_inside(struct bytes file, const void *data, uint64_t size)
{
    const unsigned char *at = data;
    return at >= file.data && size <= file.size && (uint64_t)(at - file.data) <= file.size - size;
}

static void check_structure(const struct container *container, uint32_t row)
{
    struct container_structure structure = container_structure(container, row);
    const char *texts[] = {structure.file, structure.name, structure.scene};
    FUZZ_CHECK(is_inside(container->file, structure.blob.data, structure.blob.size));
    FUZZ_CHECK((uintptr_t)structure.blob.data % CONTAINER_ALIGN == 0);
    for (int i = 0; i < 3; i++)
        FUZZ_CHECK(is_inside(container->file, texts[i], strlen(texts[i]) + 1));
    FUZZ_CHECK(is_inside(container->file, structure.references, 4 * (uint64_t)structure.reference_count));
    for (uint32_t i = 0; i < structure.reference_count; i++)
        FUZZ_CHECK(structure.references[i] < row);
    struct bvhd_error error = {0};
    enum bvhd_status status = container_check(container, row, &error);
    FUZZ_CHECK(status == BVHD_OK || (status == BVHD_CORRUPT && error.where[0]));
}

static void go(struct bytes file)
{
    struct container container;
    struct bvhd_error error = {0};
    enum bvhd_status status = container_open(file, &container, &error);
    if (status != BVHD_OK) {
        FUZZ_CHECK(status == BVHD_CORRUPT || status == BVHD_INCOMPATIBLE);
        FUZZ_CHECK(error.status == status && error.where[0] && error.text[0]);
        return;
    }
    FUZZ_CHECK(is_inside(file, container.manifest.data, container.manifest.size + 1));
    for (uint32_t i = 0; i < container.count; i++)
        check_structure(&container, i);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    void *block = NULL;
    if (size == 0)
        return 0;
    FUZZ_CHECK(posix_memalign(&block, CONTAINER_ALIGN, size) == 0);
    memcpy(block, data + 1, size - 1);
    if (data[0] & 1)
        repair(block, size - 1);
    go((struct bytes){block, size - 1});
    free(block);
    return 0;
}

/* Puts the bytes of a container behind the first byte of a sample, and says how large that is. */
static size_t put_sample(struct bytes file, bool repaired, uint8_t *ret_bytes)
{
    FUZZ_CHECK(file.size < FUZZ_ROOM);
    ret_bytes[0] = repaired;
    memcpy(ret_bytes + 1, file.data, file.size);
    return file.size + 1;
}

/* A container without structures. */
static size_t put_empty(uint8_t *ret_bytes)
{
    struct memory memory;
    struct container_writer writer;
    unsigned char header[CONTAINER_HEADER];
    memory_init(&memory, UINT64_MAX);
    struct test_sink sink = {.memory = &memory, .fail_after = -1};
    container_writer_init(&writer, &memory, test_sink_take, &sink);
    FUZZ_CHECK(container_writer_end(&writer, (struct bytes){NULL, 0}, header, NULL) == BVHD_OK);
    memcpy(sink.data, header, sizeof header);
    size_t size = put_sample((struct bytes){sink.data, sink.size}, true, ret_bytes);
    container_writer_finish(&writer);
    memory_free(&memory, sink.data);
    return size;
}

/* Samples are a container of two scenes, as it is and to be repaired, and an empty one. */
size_t fuzz_sample(uint32_t index, uint8_t *ret_bytes)
{
    if (index == 2)
        return put_empty(ret_bytes);
    if (index > 2)
        return 0;
    struct bytes made = test_container_make();
    size_t size = put_sample(made, index == 1, ret_bytes);
    free((void *)(uintptr_t)made.data);
    return size;
}
