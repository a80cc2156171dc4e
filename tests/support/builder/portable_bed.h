/* SPDX-License-Identifier: Apache-2.0 */
/*
 * portable_bed.h - portable structures for tests to spoil, which expect what the reader says of them. For test programs
 * only: an unexpected answer fails the running test.
 */
#ifndef BVHD_PORTABLE_BED_H
#define BVHD_PORTABLE_BED_H

#include "tests/support/unit.h"

#include "builder/format/portable.h"
#include "tests/support/builder/test_blob.h"

/* Reads all that a traversal would read of a structure, which lies in its block, or AddressSanitizer says so. */
typedef void (*portable_toucher)(const struct portable_view *view);

/* A blob for a test to change, and its parts, which lie in it. */
struct portable_subject {
    unsigned char *blob; /* free() it at the end */
    uint64_t size;
    struct portable_header *header;
    void *nodes, *records, *vertices;
    portable_toucher touch; /* called for what is opened */
};

/* Opens a structure that is right. */
static inline struct portable_view portable_bed_view(struct bytes blob)
{
    struct memory memory;
    struct portable_view view;
    struct bvhd_error error;
    memory_init(&memory, UINT64_MAX);
    if (portable_open(blob, &memory, &view, &error) != BVHD_OK)
        fail_msg("%s: %s", error.where, error.text);
    return view;
}

static inline struct portable_subject portable_subject_make(const struct test_shape *shape, portable_toucher touch)
{
    const struct bytes bytes = test_blob_make(shape, 11, 0);
    struct portable_subject s = {.size = bytes.size, .touch = touch};
    void *copy = NULL;
    assert_int_equal(posix_memalign(&copy, 64, bytes.size), 0);
    memcpy(copy, bytes.data, bytes.size);
    s.blob = copy;
    unsigned char *body = s.blob + portable_body_offset(bytes_get64(s.blob + 48));
    s.header = (struct portable_header *)(void *)body;
    s.nodes = body + s.header->node_offset;
    s.records = body + s.header->record_offset;
    s.vertices = body + s.header->vertex_offset;
    test_blob_free(bytes);
    return s;
}

/* Opens bytes, which may be anything. */
static inline enum bvhd_status portable_bed_open(struct bytes bytes, portable_toucher touch,
                                                 struct bvhd_error *ret_error)
{
    struct memory memory;
    struct portable_view view;
    memory_init(&memory, UINT64_MAX);
    *ret_error = (struct bvhd_error){.status = BVHD_OK};
    const enum bvhd_status status = portable_open(bytes, &memory, &view, ret_error);
    assert_int_equal(memory.live, 0);
    assert_int_equal(status, ret_error->status);
    if (status == BVHD_OK)
        touch(&view);
    return status;
}

static inline enum bvhd_status portable_subject_open(const struct portable_subject *s, struct bvhd_error *ret_error)
{
    return portable_bed_open((struct bytes){s->blob, s->size}, s->touch, ret_error);
}

static inline void portable_subject_expect(const struct portable_subject *s, enum bvhd_status status, const char *where)
{
    struct bvhd_error error;
    assert_int_equal(portable_subject_open(s, &error), status);
    assert_string_equal(error.where, where);
}

/* Replaces the value of a field, expects an answer, and restores the old value. */
#define PORTABLE_SPOIL(s, field, value, status, where)                                                                 \
    do {                                                                                                               \
        __typeof__(field) old_ = (field);                                                                              \
        (field) = (value);                                                                                             \
        portable_subject_expect((s), (status), (where));                                                               \
        (field) = old_;                                                                                                \
    } while (0)

/* Expects that no beginning of the structure is one. Of a large one, every seventh is cut. */
static inline void portable_subject_truncate(const struct portable_subject *s)
{
    const uint64_t step = s->size > 4096 ? 7 : 1;
    for (uint64_t size = 0; size < s->size; size += step) {
        struct bvhd_error error;
        void *cut = NULL;
        assert_int_equal(posix_memalign(&cut, 64, size ? size : 1), 0);
        memcpy(cut, s->blob, size);
        if (size >= 40)
            bytes_put64((unsigned char *)cut + 32, size); /* the header states the shorter size */
        assert_int_not_equal(portable_bed_open((struct bytes){cut, size}, s->touch, &error), BVHD_OK);
        free(cut);
    }
}

/* Turns bits one by one, of a large structure a ninth of all: what is opened is read inside the block. */
static inline void portable_subject_flip(const struct portable_subject *s)
{
    const unsigned step = s->size > 4096 ? 3 : 1;
    for (uint64_t at = 0; at < s->size; at += step)
        for (unsigned bit = 0; bit < 8; bit += step) {
            struct bvhd_error error;
            s->blob[at] ^= (unsigned char)(1u << bit);
            portable_subject_open(s, &error);
            s->blob[at] ^= (unsigned char)(1u << bit);
        }
    portable_subject_expect(s, BVHD_OK, "");
}

#endif
