/* SPDX-License-Identifier: Apache-2.0 */
/*
 * frames.h - streams of frames with known contents, descriptors to send with them, and the number of open descriptors.
 * For unit tests of the wire.
 */
#ifndef BVHD_TEST_FRAMES_H
#define BVHD_TEST_FRAMES_H

#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include "proto/wire/frame.h"
#include "tests/support/open_descriptors.h"
#include "tests/support/unit.h"

enum { FRAMES_MAX = 128, FRAMES_BYTES = 4 << 20 };

struct frames_stream {
    unsigned char bytes[FRAMES_BYTES];
    size_t size;
    struct frame_header headers[FRAMES_MAX];
    uint32_t count;
};

/* Returns byte `at` of the contents of frame number `frame`. */
static inline unsigned char frames_pattern(uint32_t frame, uint64_t at)
{
    return (unsigned char)(frame * 37 + at * 11 + (at >> 8));
}

static inline void frames_add(struct frames_stream *stream, const struct frame_header *header)
{
    size_t size = (size_t)header->control_size + header->inline_size;
    assert_true(stream->count < FRAMES_MAX && stream->size + FRAME_HEADER_SIZE + size <= FRAMES_BYTES);
    frame_header_write(header, stream->bytes + stream->size);
    stream->size += FRAME_HEADER_SIZE;
    for (size_t i = 0; i < size; i++)
        stream->bytes[stream->size + i] = frames_pattern(stream->count, i);
    stream->size += size;
    stream->headers[stream->count++] = *header;
}

static inline void frames_check_bytes(struct bytes bytes, uint32_t frame, uint64_t first)
{
    for (uint64_t i = 0; i < bytes.size; i++)
        if (bytes.data[i] != frames_pattern(frame, first + i))
            fail_msg("frame %u: byte %llu is another", frame, (unsigned long long)(first + i));
}

/* Checks that `frame` is number `index` of the stream. */
static inline void frames_check(const struct frames_stream *stream, uint32_t index, const struct frame *frame)
{
    const struct frame_header *want = &stream->headers[index];
    assert_int_equal(frame->header.type, want->type);
    assert_int_equal(frame->header.descriptors, want->descriptors);
    assert_int_equal(frame->header.request, want->request);
    assert_int_equal(frame->control.size, want->control_size);
    assert_int_equal(frame->inline_bytes.size, want->inline_size);
    frames_check_bytes(frame->control, index, 0);
    frames_check_bytes(frame->inline_bytes, index, frame->control.size);
}

/* Feeds bytes as a reader does, in as many steps as the parser takes. The descriptors come with the last bytes. */
static inline enum bvhd_status frames_feed(struct frame_parser *parser, const unsigned char *bytes, size_t size,
                                           const int *descriptors, uint32_t count, struct bvhd_error *error)
{
    for (;;) {
        unsigned char *at;
        uint64_t room;
        enum bvhd_status status = frame_parser_space(parser, &at, &room, error);
        if (status != BVHD_OK)
            return status;
        assert_true(room > 0);
        uint64_t some = size < room ? size : room;
        memcpy(at, bytes, some);
        if (some == size)
            return frame_parser_feed(parser, some, descriptors, count, error);
        status = frame_parser_feed(parser, some, NULL, 0, error);
        if (status != BVHD_OK)
            return status;
        bytes += some;
        size -= some;
    }
}

/* Returns a descriptor of a new file. */
static inline int frames_descriptor(ino_t *ret_inode)
{
    int descriptor = memfd_create("frames", MFD_CLOEXEC);
    struct stat about;
    assert_true(descriptor >= 0 && fstat(descriptor, &about) == 0);
    if (ret_inode)
        *ret_inode = about.st_ino;
    return descriptor;
}

#endif
