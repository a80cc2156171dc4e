/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_frame.c - tests the frame parser with bytes and real descriptors in portions of any size. test_frame_socket.c
 * sends them through the kernel.
 */
#include "tests/support/unit.h"

#include <sys/stat.h>

#include "tests/support/proto/frames.h"
#include "tests/support/random.h"

static struct memory memory = {.limit = UINT64_MAX, .fail_after = -1};

/* There is one stream at a time, static because it is too large for the stack. */
static struct frames_stream *empty_stream(void)
{
    static struct frames_stream stream;
    stream.size = stream.count = 0;
    return &stream;
}

static void start(struct frame_parser *parser)
{
    frame_parser_init(parser, &memory, FRAME_MAX_CONTROL, FRAME_MAX_INLINE);
}

static void stop(struct frame_parser *parser)
{
    frame_parser_finish(parser);
    frame_parser_finish(parser);
    assert_int_equal(memory.live, 0);
}

static enum bvhd_status feed(struct frame_parser *parser, const void *bytes, size_t size, const int *descriptors,
                             uint32_t count)
{
    return frames_feed(parser, bytes, size, descriptors, count, NULL);
}

/* Returns the next frame, which must be there. */
static struct frame next(struct frame_parser *parser)
{
    struct frame frame;
    struct bvhd_error error;
    bool found;
    if (frame_parser_next(parser, &frame, &found, &error) != BVHD_OK)
        fail_msg("%s: %s", error.where, error.text);
    assert_true(found);
    return frame;
}

static void expect_none(struct frame_parser *parser)
{
    struct frame frame;
    bool found = true;
    assert_int_equal(frame_parser_next(parser, &frame, &found, NULL), BVHD_OK);
    assert_false(found);
}

/* Checks that the parser has failed for good: it reports the place once, and takes nothing afterwards. */
static void expect_broken(struct frame_parser *parser, enum bvhd_status want, const char *where)
{
    struct frame frame = {.header.type = 4711};
    struct bvhd_error error;
    bool found = true;
    assert_int_equal(frame_parser_next(parser, &frame, &found, &error), want);
    assert_string_equal(error.where, where);
    assert_int_equal(frame.header.type, 4711);
    assert_true(found);
    assert_int_equal(frame_parser_next(parser, &frame, &found, &error), want);
    assert_string_equal(error.where, "frame");
    unsigned char *at;
    uint64_t size;
    assert_int_equal(frame_parser_space(parser, &at, &size, &error), want);
    int before = open_descriptors(), descriptor = frames_descriptor(NULL);
    assert_int_equal(frame_parser_feed(parser, 0, &descriptor, 1, NULL), want);
    assert_int_equal(open_descriptors(), before);
}

static void the_header_is_a_table(void **state)
{
    (void)state;
    static const unsigned char want[FRAME_HEADER_SIZE] = {'B',  'V',  'H',  'D',  0x45, 0x01, 3, 0, 0x78, 0x56, 0x34,
                                                          0x12, 0xef, 0xcd, 0xab, 0x90, 8,    7, 6, 5,    4,    3,
                                                          2,    1,    0,    0,    0,    0,    0, 0, 0,    0};
    struct frame_header header = {.type = 0x145,
                                  .descriptors = 3,
                                  .control_size = 0x12345678,
                                  .inline_size = 0x90abcdef,
                                  .request = 0x0102030405060708};
    unsigned char bytes[FRAME_HEADER_SIZE];
    memset(bytes, 0xee, sizeof bytes);
    frame_header_write(&header, bytes);
    assert_memory_equal(bytes, want, sizeof want);
}

static void a_frame_comes_out_as_it_went_in(void **state)
{
    (void)state;
    struct frames_stream *stream = empty_stream();
    frames_add(stream,
               &(struct frame_header){.type = 3, .control_size = 700, .inline_size = 900, .request = UINT64_MAX});
    struct frame_parser parser;
    start(&parser);
    expect_none(&parser);
    assert_int_equal(feed(&parser, stream->bytes, stream->size, NULL, 0), BVHD_OK);
    struct frame frame = next(&parser);
    frames_check(stream, 0, &frame);
    assert_int_equal(frame.descriptors[0], -1);
    expect_none(&parser);
    stop(&parser);
}

/* The stream is cut at every byte; an incomplete frame is never returned. */
static void every_truncation_waits(void **state)
{
    (void)state;
    struct frames_stream *stream = empty_stream();
    frames_add(stream, &(struct frame_header){.type = 70, .control_size = 11, .inline_size = 7, .request = 5});
    for (size_t cut = 0; cut < stream->size; cut++) {
        struct frame_parser parser;
        start(&parser);
        assert_int_equal(feed(&parser, stream->bytes, cut, NULL, 0), BVHD_OK);
        expect_none(&parser);
        assert_int_equal(feed(&parser, stream->bytes + cut, stream->size - cut, NULL, 0), BVHD_OK);
        struct frame frame = next(&parser);
        frames_check(stream, 0, &frame);
        stop(&parser);
    }
}

/* Adds frames of sizes around the sizes of the buffer. */
static void add_many(struct frames_stream *stream)
{
    static const uint32_t sizes[] = {0, 1, 31, 4000, 16 * 1024 - 33, 16 * 1024 - 32, 16 * 1024, 64 * 1024};
    for (uint32_t i = 0; i < 8; i++)
        for (uint32_t k = 0; k < 8; k++)
            frames_add(stream, &(struct frame_header){.type = (uint16_t)(1 + i),
                                                      .control_size = sizes[i],
                                                      .inline_size = sizes[k],
                                                      .request = 8 * i + k + 1});
    frames_add(stream,
               &(struct frame_header){.type = 1, .control_size = FRAME_MAX_CONTROL, .inline_size = FRAME_MAX_INLINE});
    frames_add(stream, &(struct frame_header){.type = 2});
}

/* Feeds all frames of the stream in portions of `portion` bytes, or of random sizes up to that. */
static void pass(const struct frames_stream *stream, size_t portion, struct random *random)
{
    struct frame_parser parser;
    uint32_t frames = 0;
    start(&parser);
    for (size_t at = 0; at < stream->size;) {
        size_t left = stream->size - at, size = random ? 1 + random_next(random) % portion : portion;
        size = size < left ? size : left;
        assert_int_equal(feed(&parser, stream->bytes + at, size, NULL, 0), BVHD_OK);
        at += size;
        struct frame frame;
        bool found;
        while (assert_int_equal(frame_parser_next(&parser, &frame, &found, NULL), BVHD_OK), found)
            frames_check(stream, frames++, &frame);
    }
    assert_int_equal(frames, stream->count);
    expect_none(&parser);
    stop(&parser);
}

static void portions_do_not_matter(void **state)
{
    (void)state;
    static struct frames_stream stream, small;
    add_many(&stream);
    for (uint32_t i = 0; i < 100; i++)
        frames_add(&small,
                   &(struct frame_header){.type = 7, .control_size = i % 5, .inline_size = i % 3, .request = i});
    pass(&small, 1, NULL);
    pass(&small, small.size, NULL);
    pass(&stream, 65536, NULL);
    pass(&stream, stream.size, NULL);
    struct random random = {4};
    for (int round = 0; round < 20; round++) {
        pass(&small, 100, &random);
        pass(&stream, 40000, &random);
    }
}

/* Changes one byte of a valid header and expects a refusal. */
static void refuse(size_t at, unsigned char value, enum bvhd_status status, const char *where)
{
    struct frames_stream *stream = empty_stream();
    frames_add(stream, &(struct frame_header){.type = 3});
    stream->bytes[at] = value;
    struct frame_parser parser;
    start(&parser);
    assert_int_equal(feed(&parser, stream->bytes, stream->size, NULL, 0), BVHD_OK);
    expect_broken(&parser, status, where);
    assert_true(memory.live < 64 * 1024);
    stop(&parser);
}

static void wrong_headers_are_refused(void **state)
{
    (void)state;
    for (size_t at = 0; at < 4; at++)
        for (int bit = 0; bit < 8; bit++)
            refuse(at, (unsigned char)("BVHD"[at] ^ 1 << bit), BVHD_CORRUPT, "frame.magic");
    refuse(7, 1, BVHD_CORRUPT, "frame.reserved");
    for (size_t at = 24; at < 32; at++)
        refuse(at, 0x80, BVHD_CORRUPT, "frame.reserved");
    refuse(6, FRAME_MAX_DESCRIPTORS + 1, BVHD_TOO_LARGE, "frame.descriptors");
    refuse(6, 255, BVHD_TOO_LARGE, "frame.descriptors");
    refuse(10, 0x11, BVHD_TOO_LARGE, "frame.controlSize");
    refuse(11, 0xff, BVHD_TOO_LARGE, "frame.controlSize");
    refuse(14, 2, BVHD_TOO_LARGE, "frame.inlineSize");
    refuse(15, 0xff, BVHD_TOO_LARGE, "frame.inlineSize");
}

/*
 * A stranger's bytes are refused before a whole header has arrived; a size over a limit is refused before its bytes
 * arrive.
 */
static void wrong_bytes_are_refused_early(void **state)
{
    (void)state;
    for (size_t good = 0; good < 4; good++) {
        struct frame_parser parser;
        start(&parser);
        assert_int_equal(feed(&parser, "BVHD", good, NULL, 0), BVHD_OK);
        expect_none(&parser);
        assert_int_equal(feed(&parser, "x", 1, NULL, 0), BVHD_OK);
        unsigned char *at;
        uint64_t size;
        struct bvhd_error error;
        assert_int_equal(frame_parser_space(&parser, &at, &size, &error), BVHD_CORRUPT);
        assert_string_equal(error.where, "frame.magic");
        stop(&parser);
    }
}

static void limits_are_the_receivers(void **state)
{
    (void)state;
    for (int over = 0; over < 3; over++) {
        struct frames_stream *stream = empty_stream();
        frames_add(stream,
                   &(struct frame_header){.type = 3, .control_size = 50 + (over == 1), .inline_size = 9 + (over == 2)});
        struct frame_parser parser;
        frame_parser_init(&parser, &memory, 50, 9);
        assert_int_equal(feed(&parser, stream->bytes, stream->size, NULL, 0), BVHD_OK);
        if (over)
            expect_broken(&parser, BVHD_TOO_LARGE, over == 1 ? "frame.controlSize" : "frame.inlineSize");
        else
            next(&parser);
        stop(&parser);
    }
}

/* The buffer for a large frame is as large as its header says, which can be asked before, and is freed after it. */
static void buffers_grow_and_shrink(void **state)
{
    (void)state;
    struct frames_stream *stream = empty_stream();
    frames_add(stream, &(struct frame_header){.type = 3, .control_size = FRAME_MAX_CONTROL, .inline_size = 100});
    struct frame_parser parser;
    unsigned char *at;
    uint64_t size;
    start(&parser);
    assert_int_equal(memory.live, 0);
    assert_int_equal(frame_parser_wanted(&parser), 16 * 1024);
    assert_int_equal(feed(&parser, stream->bytes, FRAME_HEADER_SIZE - 1, NULL, 0), BVHD_OK);
    assert_int_equal(frame_parser_space(&parser, &at, &size, NULL), BVHD_OK);
    assert_int_equal(memory.live, 16 * 1024);
    assert_int_equal(feed(&parser, stream->bytes + FRAME_HEADER_SIZE - 1, 1, NULL, 0), BVHD_OK);
    assert_int_equal(memory.live, 16 * 1024);
    assert_int_equal(frame_parser_wanted(&parser), stream->size);
    assert_int_equal(frame_parser_space(&parser, &at, &size, NULL), BVHD_OK);
    assert_int_equal(size, FRAME_MAX_CONTROL + 100);
    assert_int_equal(memory.live, stream->size);
    assert_int_equal(feed(&parser, stream->bytes + FRAME_HEADER_SIZE, stream->size - FRAME_HEADER_SIZE, NULL, 0),
                     BVHD_OK);
    next(&parser);
    assert_int_equal(memory.live, stream->size);
    expect_none(&parser);
    assert_int_equal(memory.live, 0);
    assert_int_equal(frame_parser_space(&parser, &at, &size, NULL), BVHD_OK);
    assert_int_equal(memory.live, 16 * 1024);
    assert_int_equal(feed(&parser, (const unsigned char *)"BVHx", 4, NULL, 0), BVHD_OK);
    assert_int_equal(frame_parser_wanted(&parser), 16 * 1024);
    expect_broken(&parser, BVHD_CORRUPT, "frame.magic");
    assert_int_equal(frame_parser_wanted(&parser), 16 * 1024);
    stop(&parser);
}

/* The first frame that does not fit makes the buffer large, and it stays. One that is larger still is freed. */
static void a_receiver_may_read_ahead(void **state)
{
    enum { AHEAD = 100000 };
    static const uint32_t sizes[] = {100, 20000, 100, 150000, 100};
    static const uint64_t wanted[] = {16 * 1024, AHEAD, AHEAD, 150032, 16 * 1024};
    static const uint64_t kept[] = {16 * 1024, AHEAD, AHEAD, 0, 16 * 1024};
    struct frame_parser parser;
    (void)state;
    start(&parser);
    frame_parser_read_ahead(&parser, AHEAD);
    for (size_t i = 0; i < sizeof sizes / sizeof sizes[0]; i++) {
        unsigned char *at;
        uint64_t size;
        struct frames_stream *stream = empty_stream();
        frames_add(stream, &(struct frame_header){.type = 3, .control_size = sizes[i], .request = i + 1});
        assert_int_equal(feed(&parser, stream->bytes, FRAME_HEADER_SIZE, NULL, 0), BVHD_OK);
        assert_int_equal(frame_parser_wanted(&parser), wanted[i]);
        assert_int_equal(frame_parser_space(&parser, &at, &size, NULL), BVHD_OK);
        assert_int_equal(memory.live, wanted[i]);
        assert_true(size >= sizes[i]);
        assert_int_equal(feed(&parser, stream->bytes + FRAME_HEADER_SIZE, stream->size - FRAME_HEADER_SIZE, NULL, 0),
                         BVHD_OK);
        struct frame frame = next(&parser);
        frames_check(stream, 0, &frame);
        expect_none(&parser);
        assert_int_equal(memory.live, kept[i]);
    }
    stop(&parser);
}

/* Without memory everything stays as it was, and parsing goes on once there is memory. */
static void failing_allocations_change_nothing(void **state)
{
    (void)state;
    struct frames_stream *stream = empty_stream();
    frames_add(stream, &(struct frame_header){.type = 3, .control_size = 100000, .inline_size = 100});
    int failures = 0;
    for (bool failed = true; failed; failures++) {
        struct frame_parser parser;
        failed = false;
        start(&parser);
        atomic_store(&memory.fail_after, failures);
        for (size_t at = 0; at < stream->size;) {
            size_t size = stream->size - at < 10000 ? stream->size - at : 10000;
            enum bvhd_status status = feed(&parser, stream->bytes + at, size, NULL, 0);
            assert_true(status == BVHD_OK || (status == BVHD_NO_MEMORY && !failed));
            failed = failed || status == BVHD_NO_MEMORY;
            at += status == BVHD_OK ? size : 0;
        }
        struct frame frame = next(&parser);
        frames_check(stream, 0, &frame);
        stop(&parser);
    }
    assert_true(failures > 2);
    atomic_store(&memory.fail_after, -1);
}

/* Three frames that declare 0, 2 and 1 descriptors. */
struct story {
    struct frames_stream *stream;
    size_t starts[4];
    int descriptors[3];
    ino_t inodes[3];
    struct frame_parser parser;
    int open; /* number of descriptors before */
};

static void open_story(struct story *story)
{
    static const uint8_t declared[3] = {0, 2, 1};
    *story = (struct story){.stream = empty_stream(), .open = open_descriptors()};
    for (int i = 0; i < 3; i++) {
        story->starts[i] = story->stream->size;
        frames_add(story->stream,
                   &(struct frame_header){.type = 3, .descriptors = declared[i], .control_size = 20, .request = 1});
        story->descriptors[i] = frames_descriptor(&story->inodes[i]);
    }
    story->starts[3] = story->stream->size;
    start(&story->parser);
}

static enum bvhd_status tell(struct story *story, size_t from, size_t to, int first, uint32_t count)
{
    return feed(&story->parser, story->stream->bytes + from, to - from, story->descriptors + first, count);
}

static void expect_descriptor(int descriptor, ino_t inode)
{
    struct stat about;
    assert_int_equal(fstat(descriptor, &about), 0);
    assert_int_equal(about.st_ino, inode);
    close(descriptor);
}

/* Expects all three frames, each with its own descriptors, and no descriptor left over. */
static void close_story(struct story *story)
{
    next(&story->parser);
    struct frame second = next(&story->parser), third = next(&story->parser);
    expect_descriptor(second.descriptors[0], story->inodes[0]);
    expect_descriptor(second.descriptors[1], story->inodes[1]);
    expect_descriptor(third.descriptors[0], story->inodes[2]);
    assert_int_equal(second.descriptors[2], -1);
    expect_none(&story->parser);
    stop(&story->parser);
    assert_int_equal(open_descriptors(), story->open);
}

/* Expects a failure after `good` frames; all descriptors are closed. */
static void break_story(struct story *story, uint32_t good)
{
    for (uint32_t i = 0; i < good; i++) {
        struct frame frame = next(&story->parser);
        for (uint32_t k = 0; k < frame.header.descriptors; k++)
            close(frame.descriptors[k]);
    }
    expect_broken(&story->parser, BVHD_CORRUPT, "frame.descriptors");
    stop(&story->parser);
}

static void descriptors_arrive_with_any_byte(void **state)
{
    (void)state;
    struct story story;
    size_t last;
    open_story(&story);
    last = story.starts[3];
    for (size_t cut = story.starts[1] + 1; cut <= story.starts[2]; cut++) {
        if (cut > story.starts[1] + 1)
            open_story(&story);
        assert_int_equal(tell(&story, 0, cut, 0, 2), BVHD_OK);
        assert_int_equal(tell(&story, cut, last, 2, 1), BVHD_OK);
        close_story(&story);
    }
    /* Descriptors come in one read, in two reads that end before their last bytes, and one by one within a frame. */
    open_story(&story);
    assert_int_equal(tell(&story, 0, last, 0, 3), BVHD_OK);
    close_story(&story);
    open_story(&story);
    assert_int_equal(tell(&story, 0, story.starts[2] + 1, 0, 3), BVHD_OK);
    assert_int_equal(tell(&story, story.starts[2] + 1, last, 0, 0), BVHD_OK);
    close_story(&story);
    open_story(&story);
    assert_int_equal(tell(&story, 0, story.starts[1] + 5, 0, 1), BVHD_OK);
    assert_int_equal(tell(&story, story.starts[1] + 5, story.starts[2], 1, 1), BVHD_OK);
    assert_int_equal(tell(&story, story.starts[2], last, 2, 1), BVHD_OK);
    close_story(&story);
}

static void a_frame_is_complete_without_its_descriptors(void **state)
{
    (void)state;
    struct story story;
    open_story(&story);
    assert_int_equal(tell(&story, 0, story.starts[2], 0, 1), BVHD_OK);
    break_story(&story, 1);
    close(story.descriptors[1]);
    close(story.descriptors[2]);
    assert_int_equal(open_descriptors(), story.open);
    open_story(&story);
    assert_int_equal(tell(&story, 0, story.starts[3], 0, 2), BVHD_OK);
    break_story(&story, 2);
    close(story.descriptors[2]);
    assert_int_equal(open_descriptors(), story.open);
}

static void descriptors_that_no_frame_declares_are_found(void **state)
{
    (void)state;
    struct story story;
    open_story(&story); /* they come with a frame that declares none */
    assert_int_equal(tell(&story, 0, story.starts[1], 0, 1), BVHD_OK);
    break_story(&story, 0);
    close(story.descriptors[1]);
    close(story.descriptors[2]);
    assert_int_equal(open_descriptors(), story.open);
    open_story(&story); /* they come in the middle of that frame, and are detected before its end */
    assert_int_equal(tell(&story, 0, 40, 0, 3), BVHD_OK);
    break_story(&story, 0);
    assert_int_equal(open_descriptors(), story.open);
    open_story(&story); /* one more comes than is declared */
    assert_int_equal(tell(&story, 0, story.starts[2], 0, 3), BVHD_OK);
    break_story(&story, 1);
    assert_int_equal(open_descriptors(), story.open);
}

/* An unfinished frame holds no more descriptors than it declares, or than any frame may have while that is unknown. */
static void a_frame_that_trickles_holds_few_descriptors(void **state)
{
    (void)state;
    for (uint32_t known = 0; known < 2; known++) {
        struct frames_stream *stream = empty_stream();
        frames_add(stream, &(struct frame_header){.type = 3, .descriptors = 2, .control_size = 100, .request = 1});
        int open = open_descriptors(), descriptors[FRAME_MAX_DESCRIPTORS + 1];
        uint64_t at = known ? FRAME_HEADER_SIZE : 1;
        uint32_t most = known ? 2 : FRAME_MAX_DESCRIPTORS;
        for (uint32_t i = 0; i <= most; i++)
            descriptors[i] = frames_descriptor(NULL);
        struct frame_parser parser;
        start(&parser);
        assert_int_equal(feed(&parser, stream->bytes, at, descriptors, most), BVHD_OK);
        expect_none(&parser);
        struct frame frame;
        bool found;
        assert_int_equal(feed(&parser, stream->bytes + at, 1, descriptors + most, 1), BVHD_OK);
        assert_int_equal(frame_parser_next(&parser, &frame, &found, NULL), BVHD_CORRUPT);
        stop(&parser);
        assert_int_equal(open_descriptors(), open);
    }
}

static void unclaimed_descriptors_are_closed(void **state)
{
    (void)state;
    struct story story;
    open_story(&story);
    assert_int_equal(tell(&story, 0, story.starts[1] + 30, 0, 3), BVHD_OK);
    next(&story.parser);
    expect_none(&story.parser);
    stop(&story.parser);
    assert_int_equal(open_descriptors(), story.open);
    frame_parser_finish(NULL);
}

/*
 * The queue holds eight frames with four descriptors each in one read; with one descriptor more, all descriptors of the
 * read are closed.
 */
static void the_queue_has_an_end(void **state)
{
    (void)state;
    for (uint32_t over = 0; over < 2; over++) {
        int open = open_descriptors(), descriptors[FRAME_QUEUE + 1];
        struct frames_stream *stream = empty_stream();
        for (int i = 0; i < 8; i++)
            frames_add(stream, &(struct frame_header){.type = 3, .descriptors = 4, .request = 1});
        for (uint32_t i = 0; i < FRAME_QUEUE + over; i++)
            descriptors[i] = frames_descriptor(NULL);
        struct frame_parser parser;
        start(&parser);
        assert_int_equal(feed(&parser, stream->bytes, stream->size, descriptors, FRAME_QUEUE + over),
                         over ? BVHD_TOO_LARGE : BVHD_OK);
        for (int i = 0; i < 8 && !over; i++) {
            struct frame frame = next(&parser);
            for (int k = 0; k < 4; k++) {
                assert_int_equal(frame.descriptors[k], descriptors[4 * i + k]);
                close(frame.descriptors[k]);
            }
        }
        stop(&parser);
        assert_int_equal(open_descriptors(), open);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_header_is_a_table),
        cmocka_unit_test(a_frame_comes_out_as_it_went_in),
        cmocka_unit_test(every_truncation_waits),
        cmocka_unit_test(portions_do_not_matter),
        cmocka_unit_test(wrong_headers_are_refused),
        cmocka_unit_test(wrong_bytes_are_refused_early),
        cmocka_unit_test(limits_are_the_receivers),
        cmocka_unit_test(buffers_grow_and_shrink),
        cmocka_unit_test(a_receiver_may_read_ahead),
        cmocka_unit_test(failing_allocations_change_nothing),
        cmocka_unit_test(descriptors_arrive_with_any_byte),
        cmocka_unit_test(a_frame_is_complete_without_its_descriptors),
        cmocka_unit_test(descriptors_that_no_frame_declares_are_found),
        cmocka_unit_test(a_frame_that_trickles_holds_few_descriptors),
        cmocka_unit_test(unclaimed_descriptors_are_closed),
        cmocka_unit_test(the_queue_has_an_end),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
