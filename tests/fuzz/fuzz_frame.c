/* SPDX-License-Identifier: Apache-2.0 */
/*
 * fuzz_frame.c - fuzzes the parser of frames: with all bytes at once, in portions, and in portions with descriptors.
 * Portions must not change the result, and no descriptor may be lost.
 *
 * The input is a byte that seeds portions and descriptors, followed by the bytes from the socket.
 */
#include "tests/fuzz/fuzz.h"

#include <fcntl.h>
#include <unistd.h>

#include "proto/wire/frame.h"
#include "tests/support/random.h"

enum { MOST_DESCRIPTORS = 256, MAX_CONTROL = 2000, MAX_INLINE = 3000 };

struct run {
    struct memory memory;
    struct frame_parser parser;
    struct random random;
    bool portions, descriptors;
    int given[MOST_DESCRIPTORS];
    uint32_t given_count;
    uint64_t digest; /* of all frames */
    uint32_t frames;
    enum bvhd_status status;
};

static void digest_bytes(struct run *run, const void *bytes, uint64_t size)
{
    const unsigned char *at = bytes;
    for (uint64_t i = 0; i < size; i++)
        run->digest = (run->digest ^ at[i]) * UINT64_C(0x100000001b3);
}

static void take_frame(struct run *run, const struct frame *frame)
{
    FUZZ_CHECK(frame->header.descriptors <= FRAME_MAX_DESCRIPTORS);
    FUZZ_CHECK(frame->control.size == frame->header.control_size && frame->control.size <= MAX_CONTROL);
    FUZZ_CHECK(frame->inline_bytes.size == frame->header.inline_size && frame->inline_bytes.size <= MAX_INLINE);
    digest_bytes(run, &frame->header.type, sizeof frame->header.type);
    digest_bytes(run, &frame->header.request, sizeof frame->header.request);
    digest_bytes(run, frame->control.data, frame->control.size);
    digest_bytes(run, frame->inline_bytes.data, frame->inline_bytes.size);
    for (uint32_t i = 0; i < frame->header.descriptors; i++)
        FUZZ_CHECK(close(frame->descriptors[i]) == 0);
    run->frames++;
}

static void take_frames(struct run *run)
{
    bool found = true;
    while (run->status == BVHD_OK && found) {
        struct frame frame;
        struct bvhd_error error;
        run->status = frame_parser_next(&run->parser, &frame, &found, &error);
        if (run->status == BVHD_OK && found)
            take_frame(run, &frame);
        else if (run->status != BVHD_OK)
            FUZZ_CHECK(error.status == run->status && error.where[0]);
    }
}

static uint32_t open_descriptors(struct run *run, int *ret_descriptors)
{
    uint64_t dice = random_next(&run->random);
    uint32_t count = run->descriptors && dice % 3 == 0 ? (uint32_t)(dice >> 8) % 6 : 0;
    for (uint32_t i = 0; i < count; i++) {
        if (run->given_count == MOST_DESCRIPTORS)
            return i;
        ret_descriptors[i] = run->given[run->given_count++] = fcntl(STDERR_FILENO, F_DUPFD_CLOEXEC, 100);
        FUZZ_CHECK(ret_descriptors[i] >= 0);
    }
    return count;
}

static uint64_t feed_some(struct run *run, const uint8_t *data, size_t size)
{
    unsigned char *at;
    uint64_t room, dice = random_next(&run->random);
    uint64_t wanted = frame_parser_wanted(&run->parser);
    run->status = frame_parser_space(&run->parser, &at, &room, NULL);
    if (run->status != BVHD_OK)
        return 0;
    FUZZ_CHECK(room > 0 && run->parser.capacity == wanted);
    uint64_t some = run->portions ? 1 + (dice >> 8) % (dice % 4 ? 40 : 2000) : size;
    some = some < size ? some : size;
    some = some < room ? some : room;
    memcpy(at, data, some);
    int descriptors[6];
    uint32_t count = open_descriptors(run, descriptors);
    run->status = frame_parser_feed(&run->parser, some, descriptors, count, NULL);
    return some;
}

/*
 * Checks that every descriptor is closed. A number can be reused for a later descriptor, so this is checked at the end,
 * when none may be open.
 */
static void finish(struct run *run)
{
    frame_parser_finish(&run->parser);
    FUZZ_CHECK(run->memory.live == 0);
    FUZZ_CHECK(run->memory.peak <= 32 * 1024);
    for (uint32_t i = 0; i < run->given_count; i++)
        FUZZ_CHECK(fcntl(run->given[i], F_GETFD) < 0);
}

static void go(struct run *run, const uint8_t *data, size_t size)
{
    memory_init(&run->memory, UINT64_MAX);
    frame_parser_init(&run->parser, &run->memory, MAX_CONTROL, MAX_INLINE);
    while (size > 0 && run->status == BVHD_OK) {
        uint64_t some = feed_some(run, data, size);
        data += some;
        size -= some;
        take_frames(run);
    }
    finish(run);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    if (size == 0)
        return 0;
    static struct run whole, portions, descriptors;
    whole = (struct run){.random = {data[0]}};
    portions = (struct run){.random = {data[0]}, .portions = true};
    descriptors = (struct run){.random = {data[0]}, .portions = true, .descriptors = true};
    go(&whole, data + 1, size - 1);
    go(&portions, data + 1, size - 1);
    go(&descriptors, data + 1, size - 1);
    FUZZ_CHECK(whole.status == portions.status && whole.frames == portions.frames && whole.digest == portions.digest);
    return 0;
}

/* Sample 0 is empty; samples 1 .. 7 have that many frames of growing sizes, the later ones with descriptors. */
size_t fuzz_sample(uint32_t index, uint8_t *ret_bytes)
{
    if (index >= 8)
        return 0;
    size_t size = 0;
    ret_bytes[size++] = (uint8_t)(17 * index);
    for (uint32_t i = 0; i < index; i++) {
        struct frame_header header = {.type = (uint16_t)(i < 4 ? 1 + i : 60 + i),
                                      .descriptors = (uint8_t)(index > 4 ? i % 3 : 0),
                                      .control_size = 50 * i * (index % 3),
                                      .inline_size = 70 * i * (index % 2),
                                      .request = i};
        frame_header_write(&header, ret_bytes + size);
        size += FRAME_HEADER_SIZE;
        memset(ret_bytes + size, (int)i, header.control_size + header.inline_size);
        size += header.control_size + header.inline_size;
    }
    return size;
}
