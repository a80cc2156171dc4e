/* SPDX-License-Identifier: Apache-2.0 */
/* test_fetch.c - tests that only the given bytes are read, and are read right, for random descriptions. */
/*
 * The memory ends where a page without access starts. Descriptions are valid or invalid; the expected contents of
 * accepted copies are read independently from the same fields.
 */
#include "tests/support/unit.h"

#include <math.h>
#include <sys/mman.h>
#include <unistd.h>

#include "builder/input/prepare.h"
#include "tests/support/random.h"
#include "builder/input/vertex_format.h"
#include "proto/base/kind.h"
#include "proto/base/vertex_element.h"

enum { DATA_PAGES = 4 };

static struct memory memory = {.limit = UINT64_MAX, .fail_after = -1};
static const struct build_context context = {.memory = &memory, .parallel = &parallel_serial};
static unsigned char *pages;
static size_t data_size;

static int set_up(void **state)
{
    (void)state;
    size_t page = (size_t)sysconf(_SC_PAGESIZE);
    data_size = DATA_PAGES * page;
    pages = mmap(NULL, data_size + 2 * page, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    if (pages == MAP_FAILED || mprotect(pages, page, PROT_NONE) || mprotect(pages + page + data_size, page, PROT_NONE))
        return -1;
    pages += page;
    return 0;
}

static uint64_t below(struct random *random, uint64_t limit)
{
    return random_next(random) % limit;
}

/* Returns a range of the pages that starts or ends at their border, sometimes NULL. */
static struct bytes some_bytes(struct random *random)
{
    uint64_t size = below(random, below(random, 2) ? 200 : data_size);
    switch (below(random, 30)) {
    case 0:
        return (struct bytes){NULL, 0};
    case 1:
        return (struct bytes){pages, size};
    default:
        return (struct bytes){pages + data_size - size, size};
    }
}

/* Returns mostly small and aligned numbers, sometimes any number. */
static uint32_t some_number(struct random *random, uint32_t alignment, uint32_t most)
{
    static const uint32_t edges[] = {0, 1, 3, 0x7fffffff, 0x80000000, UINT32_MAX - 15, UINT32_MAX};
    if (below(random, 40) == 0)
        return edges[below(random, sizeof edges / sizeof edges[0])];
    return (uint32_t)below(random, most) * alignment;
}

/* What the pages hold. */
enum contents {
    FLOATS_AND_INDICES,
    GROWING_FLOATS, /* with few exceptions, so that boxes have min <= max wherever they start */
    NATURALS_AND_CHAINS, /* floats that are hardly ever negative; indices that often are one more than the last one */
};

static void fill(struct random *random, enum contents contents)
{
    const bool growing = contents == GROWING_FLOATS;
    uint32_t mask = (uint32_t)below(random, 4) ? 15 : UINT32_MAX, last = 0;
    for (size_t i = 0; i + 4 <= data_size; i += 4) {
        float value = growing ? (float)i : (float)random_between(random, contents == FLOATS_AND_INDICES ? -10 : 0, 10);
        uint32_t index = (uint32_t)random_next(random) & mask;
        if (contents == NATURALS_AND_CHAINS && below(random, 40))
            index = (last + 1) & mask;
        last = index;
        if (below(random, 50) == 0)
            value = below(random, 4) ? NAN : (float)random_between(random, -100, 20000);
        memcpy(pages + i, growing || i < data_size / 2 ? (const void *)&value : (const void *)&index, 4);
    }
}

static struct geometry some_triangles(struct random *random)
{
    static const uint32_t types[] = {INDEX_NONE, INDEX_UINT16, INDEX_UINT32, INDEX_UINT32};
    uint32_t count;
    const struct vertex_format *format = vertex_formats(&count);
    format += below(random, 2) ? 15 : below(random, count);
    uint32_t type = types[below(random, 4)], index_size = type == INDEX_UINT16   ? 2
                                                          : type == INDEX_UINT32 ? 4
                                                                                 : format->alignment;
    return (struct geometry){
        .type = GEOMETRY_TRIANGLES,
        .triangles = {.vertex_format = format->format,
                      .max_vertex = below(random, 3) ? UINT32_MAX : some_number(random, 1, 200),
                      .vertex_stride = some_number(random, format->alignment, 8),
                      .index_type = type,
                      .vertices = some_bytes(random),
                      .indices = some_bytes(random),
                      .transform = below(random, 4) ? (struct bytes){NULL, 0} : some_bytes(random)},
        .range = {.primitive_count = some_number(random, 1, 40),
                  .primitive_offset = some_number(random, index_size, 20),
                  .first_vertex = some_number(random, 1, 10),
                  .transform_offset = some_number(random, 16, 4)},
    };
}

static struct geometry some_boxes(struct random *random)
{
    return (struct geometry){
        .type = GEOMETRY_AABBS,
        .aabbs = {some_number(random, 8, 6), some_bytes(random)},
        .range = {.primitive_count = some_number(random, 1, 4), .primitive_offset = some_number(random, 8, 20)},
    };
}

static const uint32_t radius_formats[] = {RADIUS_FLOAT16, RADIUS_FLOAT32};

/* Returns more bytes than most primitives need, up to the end of the pages, or some bytes. */
static struct bytes enough_bytes(struct random *random)
{
    const uint64_t size = data_size / 4 + below(random, data_size / 4);
    return below(random, 5) ? (struct bytes){pages + data_size - size, size} : some_bytes(random);
}

static struct geometry_spheres some_arrays(struct random *random)
{
    static const uint32_t types[] = {INDEX_NONE, INDEX_UINT16, INDEX_UINT32, INDEX_UINT32};
    uint32_t count;
    const struct vertex_format *format = vertex_formats(&count);
    format += below(random, 2) ? 15 : below(random, count);
    const uint32_t type = types[below(random, 4)];
    return (struct geometry_spheres){
        .vertex_format = format->format,
        .radius_format = radius_formats[below(random, 2)],
        .index_type = type,
        .vertex_stride = some_number(random, format->alignment, 8),
        .radius_stride = some_number(random, 2, 8),
        .index_stride = below(random, 2) ? (type == INDEX_UINT16 ? 2 : 4) : some_number(random, 1, 9),
        .vertices = enough_bytes(random),
        .radii = enough_bytes(random),
        .indices = type == INDEX_NONE && below(random, 20) ? (struct bytes){NULL, 0} : enough_bytes(random),
    };
}

static struct geometry_range some_range(struct random *random)
{
    return (struct geometry_range){.primitive_count = some_number(random, 1, 40),
                                   .primitive_offset = some_number(random, 4, 10),
                                   .first_vertex = some_number(random, 1, 10)};
}

static struct geometry some_spheres(struct random *random)
{
    return (struct geometry){.type = GEOMETRY_SPHERES, .spheres = some_arrays(random), .range = some_range(random)};
}

static struct geometry some_swept_spheres(struct random *random)
{
    const struct geometry_spheres ends = some_arrays(random);
    const bool successive = below(random, 2) && (ends.index_type != INDEX_NONE || below(random, 10) == 0);
    return (struct geometry){
        .type = GEOMETRY_SWEPT_SPHERES,
        .swept_spheres = {ends, successive ? SWEPT_SUCCESSIVE : SWEPT_LIST, (uint32_t)below(random, 2)},
        .range = some_range(random),
    };
}

static uint32_t index_at(const struct geometry *geometry, uint64_t k)
{
    if (geometry->triangles.index_type == INDEX_NONE)
        return (uint32_t)k;
    const unsigned char *at = geometry->triangles.indices.data + geometry->range.primitive_offset;
    return geometry->triangles.index_type == INDEX_UINT16 ? bytes_get16(at + 2 * k) : bytes_get32(at + 4 * k);
}

/* Reads corner k as the specification says, one at a time. */
static void corner_of(const struct geometry *geometry, uint64_t k, float ret_corner[3])
{
    const struct geometry_triangles *triangles = &geometry->triangles;
    uint64_t vertex = (uint64_t)geometry->range.first_vertex + index_at(geometry, k);
    uint64_t offset = triangles->index_type == INDEX_NONE ? geometry->range.primitive_offset : 0;
    float p[3], m[12];
    vertex_format_find(triangles->vertex_format)
        ->decode(triangles->vertices.data + offset + triangles->vertex_stride * vertex, 0, 1, p);
    memcpy(ret_corner, p, sizeof p);
    if (!triangles->transform.data)
        return;
    memcpy(m, triangles->transform.data + geometry->range.transform_offset, sizeof m);
    for (int row = 0; row < 3; row++)
        ret_corner[row] = (float)((double)m[4 * row] * p[0] + (double)m[4 * row + 1] * p[1] +
                                  (double)m[4 * row + 2] * p[2] + m[4 * row + 3]);
}

static void compare_triangles(const struct geometry *geometry, const struct canonical_geometry *got)
{
    for (uint32_t i = 0; i < got->primitive_count; i++) {
        float corners[3][3], want[3];
        for (unsigned k = 0; k < 3 && got->indices; k++)
            assert_true(got->indices[3 * i + k] < got->vertex_count);
        canonical_triangle(got, i, corners);
        for (unsigned k = 0; k < 3; k++) {
            corner_of(geometry, (uint64_t)3 * i + k, want);
            for (int axis = 0; axis < 3; axis++)
                assert_true(corners[k][axis] == want[axis] || (isnan(corners[k][axis]) && isnan(want[axis])));
        }
    }
}

static void compare_boxes(const struct geometry *geometry, const struct canonical_geometry *got)
{
    for (uint32_t i = 0; i < got->primitive_count; i++) {
        float want[6];
        const float *box = got->boxes + (size_t)6 * i;
        memcpy(want, geometry->aabbs.boxes.data + geometry->range.primitive_offset + i * geometry->aabbs.stride,
               sizeof want);
        bool inactive = false;
        for (int k = 0; k < 6; k++)
            inactive |= isnan(want[k]);
        assert_int_equal(isnan(box[0]), inactive);
        assert_memory_equal(box + 1, want + 1, 20);
        if (!inactive)
            assert_true(box[0] == want[0]);
    }
}

static uint32_t named_at(const struct geometry *geometry, const struct geometry_spheres *arrays, uint64_t k)
{
    const unsigned char *at = arrays->indices.data + geometry->range.primitive_offset + arrays->index_stride * k;
    return arrays->index_type == INDEX_UINT16 ? bytes_get16(at) : bytes_get32(at);
}

/* Reads a vertex as the specification says, and compares it. */
static void compare_vertex(const struct geometry *geometry, const struct geometry_spheres *arrays, uint64_t vertex,
                           const float got[4])
{
    const uint64_t offset = arrays->index_type == INDEX_NONE ? geometry->range.primitive_offset : 0;
    const uint64_t number = geometry->range.first_vertex + vertex;
    float want[4];
    vertex_format_find(arrays->vertex_format)
        ->decode(arrays->vertices.data + offset + arrays->vertex_stride * number, 0, 1, want);
    radius_format_find(arrays->radius_format)
        ->decode(arrays->radii.data + offset + arrays->radius_stride * number, 0, 1, want + 3);
    for (int k = 0; k < 4; k++)
        assert_true(got[k] == want[k] || (isnan(got[k]) && isnan(want[k])));
    assert_false(got[3] < 0);
}

static void compare_spheres(const struct geometry *geometry, const struct canonical_geometry *got)
{
    const struct geometry_spheres *spheres = &geometry->spheres;
    assert_true(got->vertex_count <= kind_find(GEOMETRY_SPHERES)->vertices(geometry));
    for (uint32_t i = 0; i < got->primitive_count; i++) {
        const uint32_t vertex = got->indices ? got->indices[i] : i;
        assert_true(vertex < got->vertex_count);
        compare_vertex(geometry, spheres, spheres->index_type == INDEX_NONE ? i : named_at(geometry, spheres, i),
                       got->positions + (size_t)4 * vertex);
    }
}

static void compare_swept_spheres(const struct geometry *geometry, const struct canonical_geometry *got)
{
    const struct geometry_swept_spheres *swept = &geometry->swept_spheres;
    const bool indexed = swept->ends.index_type != INDEX_NONE, successive = swept->indexing_mode == SWEPT_SUCCESSIVE;
    assert_true(got->vertex_count <= kind_find(GEOMETRY_SWEPT_SPHERES)->vertices(geometry));
    for (uint32_t i = 0; i < got->primitive_count; i++) {
        const uint32_t end = got->indices[i] & CANONICAL_END_MASK;
        uint64_t ends[2] = {2 * (uint64_t)i, 2 * (uint64_t)i + 1};
        assert_true(end + 1 < got->vertex_count);
        bool continues = false;
        if (indexed && successive) {
            ends[0] = named_at(geometry, &swept->ends, i);
            ends[1] = ends[0] + 1;
            continues = i > 0 && ends[0] == (uint64_t)named_at(geometry, &swept->ends, i - 1) + 1;
        } else if (indexed) {
            ends[0] = named_at(geometry, &swept->ends, ends[0]);
            ends[1] = named_at(geometry, &swept->ends, ends[1]);
        }
        compare_vertex(geometry, &swept->ends, ends[0], got->positions + (size_t)4 * end);
        compare_vertex(geometry, &swept->ends, ends[1], got->positions + (size_t)4 * end + 4);
        const bool chained = swept->end_caps_mode == SWEPT_CAPS_CHAINED;
        assert_int_equal((got->indices[i] & CANONICAL_CAP_FIRST) != 0, chained && !continues);
        assert_int_equal((got->indices[i] & CANONICAL_CAP_SECOND) != 0, chained);
    }
}

/* Returns how many inputs were accepted and had primitives. */
static unsigned try_many(struct random *random, unsigned rounds, enum contents contents,
                         struct geometry (*make)(struct random *),
                         void (*compare)(const struct geometry *, const struct canonical_geometry *))
{
    struct limits limits = limits_default();
    limits.max_canonical_bytes = 1 << 24;
    unsigned accepted = 0;
    for (unsigned round = 0; round < rounds; round++) {
        struct geometry geometries[3];
        struct build_input input = {.type = STRUCTURE_BOTTOM,
                                    .flags = round % 2 ? BUILD_ALLOW_UPDATE : 0,
                                    .geometry_count = (uint32_t)below(random, 4),
                                    .geometries = geometries,
                                    .options.target = TARGET_PORTABLE};
        struct canonical canonical;
        struct bvhd_error error;
        if (round % 100 == 0)
            fill(random, contents);
        for (uint32_t i = 0; i < 3; i++)
            geometries[i] = make(random);
        enum bvhd_status status = prepare(&input, 0, &limits, &context, &canonical, &error);
        if (status != BVHD_OK) {
            assert_true(status == BVHD_INVALID || status == BVHD_TOO_LARGE);
            assert_true(error.status == status && error.where[0] != 0);
            assert_int_equal(memory.live, 0);
            continue;
        }
        for (uint32_t i = 0; i < input.geometry_count; i++)
            compare(&geometries[i], &canonical.geometries[i]);
        accepted += canonical.primitive_count > 0;
        struct canonical reopened;
        assert_int_equal(prepare_open((struct bytes){canonical.bytes, canonical.size}, &memory, &reopened, &error),
                         BVHD_OK);
        prepare_finish(&reopened, &memory);
        prepare_finish(&canonical, &memory);
    }
    return accepted;
}

static void triangles_are_read_inside(void **state)
{
    (void)state;
    struct random random = {23};
    assert_true(try_many(&random, 40000, FLOATS_AND_INDICES, some_triangles, compare_triangles) > 2000);
}

static void boxes_are_read_inside(void **state)
{
    (void)state;
    struct random random = {24};
    assert_true(try_many(&random, 20000, GROWING_FLOATS, some_boxes, compare_boxes) > 500);
}

static void spheres_are_read_inside(void **state)
{
    (void)state;
    struct random random = {25};
    assert_true(try_many(&random, 40000, NATURALS_AND_CHAINS, some_spheres, compare_spheres) > 2000);
}

static void swept_spheres_are_read_inside(void **state)
{
    (void)state;
    struct random random = {26};
    assert_true(try_many(&random, 60000, NATURALS_AND_CHAINS, some_swept_spheres, compare_swept_spheres) > 2000);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(triangles_are_read_inside),
        cmocka_unit_test(boxes_are_read_inside),
        cmocka_unit_test(spheres_are_read_inside),
        cmocka_unit_test(swept_spheres_are_read_inside),
    };
    return cmocka_run_group_tests(tests, set_up, NULL);
}
