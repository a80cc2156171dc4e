/* SPDX-License-Identifier: Apache-2.0 */
#include "proto/wire/frame.h"

#include <assert.h>
#include <unistd.h>

/* Offsets of the header's fields. PROTOCOL.md has the same table. */
enum {
    AT_MAGIC = 0,
    AT_TYPE = 4,
    AT_DESCRIPTORS = 6,
    AT_RESERVED8 = 7,
    AT_CONTROL_SIZE = 8,
    AT_INLINE_SIZE = 12,
    AT_REQUEST = 16,
    AT_RESERVED64 = 24,
};

enum {
    READ_AHEAD = 16 * 1024, /* space while no frame is under way: it holds many small frames */
};

static const unsigned char magic[4] = {'B', 'V', 'H', 'D'};

void frame_header_write(const struct frame_header *header, unsigned char ret_bytes[FRAME_HEADER_SIZE])
{
    memcpy(ret_bytes + AT_MAGIC, magic, sizeof magic);
    memcpy(ret_bytes + AT_TYPE, &header->type, sizeof header->type);
    ret_bytes[AT_DESCRIPTORS] = header->descriptors;
    ret_bytes[AT_RESERVED8] = 0;
    bytes_put32(ret_bytes + AT_CONTROL_SIZE, header->control_size);
    bytes_put32(ret_bytes + AT_INLINE_SIZE, header->inline_size);
    bytes_put64(ret_bytes + AT_REQUEST, header->request);
    bytes_put64(ret_bytes + AT_RESERVED64, 0);
}

static struct frame_header header_at(const unsigned char *bytes)
{
    return (struct frame_header){
        .type = bytes_get16(bytes + AT_TYPE),
        .descriptors = bytes[AT_DESCRIPTORS],
        .control_size = bytes_get32(bytes + AT_CONTROL_SIZE),
        .inline_size = bytes_get32(bytes + AT_INLINE_SIZE),
        .request = bytes_get64(bytes + AT_REQUEST),
    };
}

/* The sizes have been checked against the limits, so the sum cannot overflow. */
static uint64_t size_of(const struct frame_header *header)
{
    return (uint64_t)FRAME_HEADER_SIZE + header->control_size + header->inline_size;
}

void frame_parser_init(struct frame_parser *parser, struct memory *memory, uint32_t max_control, uint32_t max_inline)
{
    assert(max_control <= FRAME_MAX_CONTROL && max_inline <= FRAME_MAX_INLINE);
    *parser = (struct frame_parser){.memory = memory, .max_control = max_control, .max_inline = max_inline};
}

void frame_parser_read_ahead(struct frame_parser *parser, uint64_t size)
{
    parser->ahead = size;
}

static void close_all(const int *descriptors, uint32_t count)
{
    for (uint32_t i = 0; i < count; i++)
        close(descriptors[i]);
}

void frame_parser_finish(struct frame_parser *parser)
{
    if (!parser)
        return;
    close_all(parser->descriptors, parser->descriptor_count);
    memory_free(parser->memory, parser->buffer);
    *parser = (struct frame_parser){.memory = parser->memory, .broken = BVHD_INTERNAL};
}

static enum bvhd_status fail_broken(const struct frame_parser *parser, struct bvhd_error *error)
{
    return bvhd_error_set(error, parser->broken, "frame", "an earlier frame was wrong");
}

/* Records that nothing after a wrong frame can be trusted. */
static enum bvhd_status break_parser(struct frame_parser *parser, enum bvhd_status status)
{
    parser->broken = status;
    return status;
}

static enum bvhd_status check_header(const struct frame_parser *parser, const unsigned char *bytes,
                                     struct bvhd_error *error)
{
    struct frame_header header = header_at(bytes);
    if (bytes[AT_RESERVED8] != 0 || bytes_get64(bytes + AT_RESERVED64) != 0)
        return bvhd_error_set(error, BVHD_CORRUPT, "frame.reserved", "not 0");
    if (header.descriptors > FRAME_MAX_DESCRIPTORS)
        return bvhd_error_set(error, BVHD_TOO_LARGE, "frame.descriptors", "%u, over %u", header.descriptors,
                              FRAME_MAX_DESCRIPTORS);
    if (header.control_size > parser->max_control)
        return bvhd_error_set(error, BVHD_TOO_LARGE, "frame.controlSize", "%u bytes, over %u", header.control_size,
                              parser->max_control);
    if (header.inline_size > parser->max_inline)
        return bvhd_error_set(error, BVHD_TOO_LARGE, "frame.inlineSize", "%u bytes, over %u", header.inline_size,
                              parser->max_inline);
    return BVHD_OK;
}

/*
 * Reads the header of the current frame once it is complete. The magic is checked as soon as its first bytes are there,
 * so that a stranger does not wait for more.
 */
static enum bvhd_status look_at_header(const struct frame_parser *parser, struct frame_header *ret_header,
                                       bool *ret_found, struct bvhd_error *error)
{
    uint64_t have = parser->end - parser->begin;
    *ret_found = false;
    if (have == 0)
        return BVHD_OK;
    const unsigned char *bytes = parser->buffer + parser->begin;
    if (memcmp(bytes, magic, have < sizeof magic ? have : sizeof magic) != 0)
        return bvhd_error_set(error, BVHD_CORRUPT, "frame.magic", "not a frame of bvhd's");
    if (have < FRAME_HEADER_SIZE)
        return BVHD_OK;
    enum bvhd_status status = check_header(parser, bytes, error);
    if (status != BVHD_OK)
        return status;
    *ret_header = header_at(bytes);
    *ret_found = true;
    return BVHD_OK;
}

/* Returns the buffer size that the current frame needs, at least one byte more than have arrived. */
static uint64_t wanted_capacity(const struct frame_parser *parser, const struct frame_header *header)
{
    uint64_t have = parser->end - parser->begin, wanted = header ? size_of(header) : FRAME_HEADER_SIZE;
    return wanted > have ? wanted : have + READ_AHEAD;
}

/*
 * Returns the capacity of a buffer that has room for `wanted` bytes: there is none below READ_AHEAD, and none between
 * that and what the owner reads ahead.
 */
static uint64_t grown_capacity(const struct frame_parser *parser, uint64_t wanted)
{
    if (parser->capacity >= wanted)
        return parser->capacity;
    uint64_t least = wanted > READ_AHEAD && parser->ahead > 0 ? parser->ahead : READ_AHEAD;
    return wanted > least ? wanted : least;
}

uint64_t frame_parser_wanted(const struct frame_parser *parser)
{
    struct frame_header header = {0};
    bool found;
    if (parser->broken != BVHD_OK || look_at_header(parser, &header, &found, NULL) != BVHD_OK)
        return parser->capacity;
    return grown_capacity(parser, wanted_capacity(parser, found ? &header : NULL));
}

static void move_to_front(struct frame_parser *parser)
{
    if (parser->begin > 0)
        memmove(parser->buffer, parser->buffer + parser->begin, parser->end - parser->begin);
    parser->end -= parser->begin;
    parser->begin = 0;
}

static enum bvhd_status grow(struct frame_parser *parser, uint64_t wanted, struct bvhd_error *error)
{
    uint64_t capacity = grown_capacity(parser, wanted);
    unsigned char *buffer = memory_resize(parser->memory, parser->buffer, capacity);
    if (!buffer)
        return bvhd_error_no_memory(error, "frame", "%llu bytes", (unsigned long long)capacity);
    parser->buffer = buffer;
    parser->capacity = capacity;
    return BVHD_OK;
}

static void shrink_when_empty(struct frame_parser *parser)
{
    uint64_t kept = parser->ahead > FRAME_KEEP ? parser->ahead : FRAME_KEEP;
    if (parser->begin != parser->end || parser->capacity <= kept)
        return;
    memory_free(parser->memory, parser->buffer);
    parser->buffer = NULL;
    parser->capacity = parser->begin = parser->end = 0;
}

/* Reads the header of the next frame, if all of it is there. A parser that fails once always fails. */
static enum bvhd_status next_header(struct frame_parser *parser, struct frame_header *ret_header, bool *ret_found,
                                    struct bvhd_error *error)
{
    *ret_found = false;
    if (parser->broken != BVHD_OK)
        return fail_broken(parser, error);
    enum bvhd_status status = look_at_header(parser, ret_header, ret_found, error);
    return status == BVHD_OK ? BVHD_OK : break_parser(parser, status);
}

enum bvhd_status frame_parser_space(struct frame_parser *parser, unsigned char **ret_at, uint64_t *ret_size,
                                    struct bvhd_error *error)
{
    struct frame_header header;
    bool found;
    enum bvhd_status status = next_header(parser, &header, &found, error);
    if (status != BVHD_OK)
        return status;
    uint64_t wanted = wanted_capacity(parser, found ? &header : NULL);
    if (parser->capacity - parser->begin < wanted || parser->begin == parser->end)
        move_to_front(parser);
    if (parser->capacity < wanted) {
        status = grow(parser, wanted, error);
        if (status != BVHD_OK)
            return status;
    }
    *ret_at = parser->buffer + parser->end;
    *ret_size = parser->capacity - parser->end;
    return BVHD_OK;
}

enum bvhd_status frame_parser_feed(struct frame_parser *parser, uint64_t size, const int *descriptors, uint32_t count,
                                   struct bvhd_error *error)
{
    if (parser->broken != BVHD_OK) {
        close_all(descriptors, count);
        return fail_broken(parser, error);
    }
    assert(size <= parser->capacity - parser->end);
    parser->end += size;
    parser->fed += size;
    if (count > FRAME_QUEUE - parser->descriptor_count) {
        close_all(descriptors, count);
        bvhd_error_set(error, BVHD_TOO_LARGE, "frame.descriptors", "over %u wait for their frames", FRAME_QUEUE);
        return break_parser(parser, BVHD_TOO_LARGE);
    }
    for (uint32_t i = 0; i < count; i++) {
        parser->descriptors[parser->descriptor_count] = descriptors[i];
        parser->arrived[parser->descriptor_count++] = parser->fed;
    }
    return BVHD_OK;
}

/*
 * Checks the descriptors that have come while a frame is under way. They all belong to it, so there are not more than
 * it declares, or than any frame has while its header is not complete.
 */
static enum bvhd_status check_waiting(const struct frame_parser *parser, const struct frame_header *header,
                                      struct bvhd_error *error)
{
    uint32_t most = header ? header->descriptors : FRAME_MAX_DESCRIPTORS;
    if (parser->descriptor_count > most)
        return bvhd_error_set(error, BVHD_CORRUPT, "frame.descriptors", "%u allowed, more came", most);
    return BVHD_OK;
}

/*
 * Checks that a complete frame, which ends at position `end` of the stream, has exactly the descriptors that came with
 * it.
 */
static enum bvhd_status check_descriptors(const struct frame_parser *parser, const struct frame_header *header,
                                          uint64_t end, struct bvhd_error *error)
{
    uint32_t declared = header->descriptors;
    if (parser->descriptor_count < declared)
        return bvhd_error_set(error, BVHD_CORRUPT, "frame.descriptors", "%u declared, %u came", declared,
                              parser->descriptor_count);
    if (parser->descriptor_count > declared && parser->arrived[declared] <= end)
        return bvhd_error_set(error, BVHD_CORRUPT, "frame.descriptors", "%u declared, more came", declared);
    return BVHD_OK;
}

static void claim_descriptors(struct frame_parser *parser, struct frame *frame)
{
    uint32_t claimed = frame->header.descriptors, left = parser->descriptor_count - claimed;
    memcpy(frame->descriptors, parser->descriptors, claimed * sizeof *frame->descriptors);
    memmove(parser->descriptors, parser->descriptors + claimed, left * sizeof *parser->descriptors);
    memmove(parser->arrived, parser->arrived + claimed, left * sizeof *parser->arrived);
    parser->descriptor_count = left;
}

/* Takes the complete frame out of the buffer. */
static void take_frame(struct frame_parser *parser, const struct frame_header *header, struct frame *ret_frame)
{
    const unsigned char *bytes = parser->buffer + parser->begin + FRAME_HEADER_SIZE;
    *ret_frame = (struct frame){
        .header = *header,
        .control = {bytes, header->control_size},
        .inline_bytes = {bytes + header->control_size, header->inline_size},
        .descriptors = {-1, -1, -1, -1},
    };
    claim_descriptors(parser, ret_frame);
    parser->begin += size_of(header);
}

enum bvhd_status frame_parser_next(struct frame_parser *parser, struct frame *ret_frame, bool *ret_found,
                                   struct bvhd_error *error)
{
    struct frame_header header;
    bool found;
    enum bvhd_status status = next_header(parser, &header, &found, error);
    if (status != BVHD_OK)
        return status;
    if (!found || parser->end - parser->begin < size_of(&header)) {
        status = check_waiting(parser, found ? &header : NULL, error);
        if (status != BVHD_OK)
            return break_parser(parser, status);
        shrink_when_empty(parser);
        *ret_found = false;
        return BVHD_OK;
    }
    uint64_t end = parser->fed - (parser->end - parser->begin) + size_of(&header);
    status = check_descriptors(parser, &header, end, error);
    if (status != BVHD_OK)
        return break_parser(parser, status);
    take_frame(parser, &header, ret_frame);
    *ret_found = true;
    return BVHD_OK;
}
