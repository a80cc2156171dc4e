/* SPDX-License-Identifier: Apache-2.0 */
/* test_portable_micromap.c - tests that micromaps are read as they were written, and that damaged ones are refused. */
#include "tests/support/unit.h"

#include "builder/format/portable_micromap.h"
#include "builder/format/serialized.h"
#include "proto/base/geometry.h"

enum { TRIANGLES = 3, STATES = 21, INDICES = 5 };

static const struct micromap_triangle triangles[TRIANGLES] = {{0, 2, MICRO_4_STATE}, {4, 3, MICRO_4_STATE}, {20, 0, 1}};
static const uint32_t indices[INDICES] = {2, MICROMAP_FULLY_OPAQUE, 0, 1, MICROMAP_FULLY_UNKNOWN_OPAQUE};

static struct memory memory = {.limit = UINT64_MAX, .fail_after = -1};

/* A written micromap, which tests change. */
struct subject {
    unsigned char *blob;
    struct layout_sizes sizes;
    struct portable_micromap_header *header;
    struct micromap_triangle *triangles;
    uint32_t *indices;
};

static struct subject make(void)
{
    static unsigned char states[STATES];
    for (uint32_t i = 0; i < STATES; i++)
        states[i] = (unsigned char)(37 * i + 11);
    struct layout_micromap input = {.flags = BUILD_ALLOW_COMPACTION,
                                    .triangles = triangles,
                                    .triangle_count = TRIANGLES,
                                    .states = states,
                                    .states_size = STATES,
                                    .indices = indices,
                                    .index_count = INDICES,
                                    .baked = {1, 2, 3, 4},
                                    .memory = &memory};
    struct subject s;
    struct bvhd_error error;
    assert_int_equal(portable_micromap_write(&input, &s.blob, &s.sizes, &error), BVHD_OK);
    unsigned char *body = s.blob + PORTABLE_MICROMAP_BODY;
    s.header = (struct portable_micromap_header *)(void *)body;
    s.triangles = (struct micromap_triangle *)(void *)(body + s.header->triangle_offset);
    s.indices = (uint32_t *)(void *)(body + s.header->index_offset);
    return s;
}

static void finish(struct subject *s)
{
    memory_free(&memory, s->blob);
    assert_int_equal(memory.live, 0);
}

static void expect(const struct subject *s, uint64_t size, enum bvhd_status status, const char *where)
{
    struct bvhd_error error = {.status = BVHD_OK};
    struct portable_micromap_view view;
    assert_int_equal(portable_micromap_open((struct bytes){s->blob, size}, &view, &error), status);
    assert_string_equal(error.where, where);
}

static void what_is_written_is_read(void **state)
{
    (void)state;
    struct subject s = make();
    struct portable_micromap_view view;
    struct bvhd_error error;
    const struct layout_sizes *sizes = &s.sizes;
    assert_int_equal(sizes->total, sizes->header + sizes->records + sizes->vertices + sizes->geometries);
    assert_int_equal(sizes->total, 64 + portable_micromap_bound(TRIANGLES, STATES, INDICES));
    assert_int_equal(portable_micromap_open((struct bytes){s.blob, sizes->total}, &view, &error), BVHD_OK);
    assert_int_equal(view.header->build_flags, BUILD_ALLOW_COMPACTION);
    assert_int_equal(view.header->triangle_count, TRIANGLES);
    assert_memory_equal(view.triangles, triangles, sizeof triangles);
    assert_memory_equal(view.indices, indices, sizeof indices);
    assert_int_equal(view.header->baked[3], 4);
    for (uint32_t t = 0; t < TRIANGLES; t++)
        for (uint32_t i = 0; i < micro_triangle_count(triangles[t].level); i++) {
            uint32_t corners[3][2];
            const bool upright = micro_triangle_corners(i, triangles[t].level, corners);
            const float parts = (float)(1 << triangles[t].level), third = upright ? 1.0f / 3 : 2.0f / 3;
            uint32_t u = corners[0][0], v = corners[0][1];
            for (int k = 1; k < 3; k++) {
                u = corners[k][0] < u ? corners[k][0] : u;
                v = corners[k][1] < v ? corners[k][1] : v;
            }
            const uint32_t bit = i * triangles[t].format;
            const unsigned char byte = (unsigned char)(37 * (triangles[t].offset + bit / 8) + 11);
            assert_int_equal(portable_micromap_state(&view, t, ((float)u + third) / parts, ((float)v + third) / parts),
                             byte >> bit % 8 & (triangles[t].format == MICRO_4_STATE ? 3 : 1));
        }
    finish(&s);
}

static void an_empty_micromap_is_read(void **state)
{
    (void)state;
    const struct layout_micromap input = {.memory = &memory};
    struct subject s;
    struct bvhd_error error;
    assert_int_equal(portable_micromap_write(&input, &s.blob, &s.sizes, &error), BVHD_OK);
    assert_int_equal(s.sizes.total, 64 + 128);
    expect(&s, s.sizes.total, BVHD_OK, "");
    finish(&s);
    memory.fail_after = 0;
    assert_int_equal(portable_micromap_write(&input, &s.blob, &s.sizes, &error), BVHD_NO_MEMORY);
    memory.fail_after = -1;
    assert_int_equal(memory.live, 0);
}

/* Replaces a value, expects an error, and restores it. */
#define SPOIL(field, value, status, where)                                                                             \
    do {                                                                                                               \
        __typeof__(field) old_ = (field);                                                                              \
        (field) = (__typeof__(field))(value);                                                                          \
        expect(&s, s.sizes.total, status, where);                                                                      \
        (field) = old_;                                                                                                \
    } while (0)

static void damage_is_found(void **state)
{
    (void)state;
    struct subject s = make();
    struct portable_micromap_header *h = s.header;
    for (uint64_t size = 0; size < s.sizes.total; size++)
        expect(&s, size, BVHD_CORRUPT, size < 64 + 128 ? "body" : "body.bodySize");
    SPOIL(s.blob[2], 1, BVHD_INCOMPATIBLE, "header.driverUUID");
    SPOIL(s.blob[31], 2, BVHD_INCOMPATIBLE, "header.compatibilityUUID");
    SPOIL(s.blob[31], 4, BVHD_INCOMPATIBLE, "header.compatibilityUUID");
    SPOIL(s.blob[32], 1, BVHD_CORRUPT, "header.padding");
    SPOIL(s.blob[63], 1, BVHD_CORRUPT, "header.padding");
    SPOIL(h->magic, PORTABLE_MAGIC, BVHD_CORRUPT, "body.magic");
    SPOIL(h->version, 2, BVHD_INCOMPATIBLE, "body.version");
    SPOIL(h->reserved[2], 1, BVHD_CORRUPT, "body.reserved");
    SPOIL(h->reserved_end[0], UINT64_C(1) << 40, BVHD_CORRUPT, "body.reserved");
    SPOIL(h->body_size, h->body_size + 1, BVHD_CORRUPT, "body.bodySize");
    SPOIL(h->triangle_count, UINT32_MAX, BVHD_CORRUPT, "body.triangleCount");
    SPOIL(h->index_count, 1 << 29, BVHD_CORRUPT, "body.triangleCount");
    SPOIL(h->triangle_offset, 112, BVHD_CORRUPT, "body.triangleOffset");
    SPOIL(h->triangle_offset, 136, BVHD_CORRUPT, "body.triangleOffset");
    SPOIL(h->triangle_count, 1000, BVHD_CORRUPT, "body.triangleOffset");
    SPOIL(h->states_offset, h->states_offset - 16, BVHD_CORRUPT, "body.statesOffset");
    SPOIL(h->states_offset, UINT64_MAX - 15, BVHD_CORRUPT, "body.statesOffset");
    SPOIL(h->states_size, UINT64_MAX, BVHD_CORRUPT, "body.statesOffset");
    SPOIL(h->states_size, h->states_size + 16, BVHD_CORRUPT, "body.indexOffset");
    SPOIL(h->states_size, STATES - 1, BVHD_CORRUPT, "triangles[2]");
    SPOIL(h->index_offset, h->index_offset + 16, BVHD_CORRUPT, "body.indexOffset");
    SPOIL(h->index_count, INDICES + 1, BVHD_CORRUPT, "body.indexOffset");
    SPOIL(s.triangles[0].level, 13, BVHD_CORRUPT, "triangles[0]");
    SPOIL(s.triangles[0].level, 12, BVHD_CORRUPT, "triangles[0]");
    SPOIL(s.triangles[1].format, 0, BVHD_CORRUPT, "triangles[1]");
    SPOIL(s.triangles[1].format, 3, BVHD_CORRUPT, "triangles[1]");
    SPOIL(s.triangles[2].offset, STATES, BVHD_CORRUPT, "triangles[2]");
    SPOIL(s.triangles[1].offset, UINT32_MAX, BVHD_CORRUPT, "triangles[1]");
    SPOIL(s.indices[0], TRIANGLES, BVHD_CORRUPT, "indices[0]");
    SPOIL(s.indices[4], MICROMAP_FULLY_UNKNOWN_OPAQUE - 1, BVHD_CORRUPT, "indices[4]");
    expect(&s, s.sizes.total, BVHD_OK, "");
    finish(&s);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(what_is_written_is_read),
        cmocka_unit_test(an_empty_micromap_is_read),
        cmocka_unit_test(damage_is_found),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
