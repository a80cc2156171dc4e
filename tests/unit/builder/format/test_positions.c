/* SPDX-License-Identifier: Apache-2.0 */
/* test_positions.c - tests that corners read by the numbers of primitives are those of the request, in every layout. */
#include "tests/support/unit.h"

#include <math.h>

#include "builder/update/batch.h"
#include "builder/format/positions.h"
#include "builder/format/serialized.h"
#include "tests/support/builder/inputs.h"
#include "tests/support/builder/random_input.h"
#include "tests/support/builder/random_update.h"

enum { CASES = 120, MOST_PRIMITIVES = 300, MOST_UPDATES = 2 };

static struct memory memory;
static const struct build_context context = {.memory = &memory, .parallel = &parallel_serial};

/* A structure whose positions are read, and the request that they must equal. */
struct bed {
    struct random_input request;
    struct batch_item item;
    struct positions *positions;
    enum lavapipe_variant variant; /* 0: portable */
    uint32_t read, refused;
};

static void open_bed(struct bed *bed)
{
    const struct bytes blob = {bed->item.blob, bed->item.size};
    struct bvhd_error error;
    struct portable_view view;
    struct lavapipe_view native;
    enum bvhd_status status = bed->variant ? lavapipe_open(blob, bed->variant, &memory, &native, &error)
                                           : portable_open(blob, &memory, &view, &error);
    if (status == BVHD_OK)
        status = bed->variant ? positions_of_lavapipe(blob, &native, &memory, &bed->positions, &error)
                              : positions_of_portable(blob, &view, &memory, &bed->positions, &error);
    if (status != BVHD_OK)
        fail_msg("%s: %s", error.where, error.text);
}

/* Makes a structure of triangles that may have been updated. Returns false if a move was no update. */
static bool make_bed(struct bed *bed, uint32_t seed)
{
    struct random random = {seed * UINT64_C(0x9e3779b97f4a7c15)};
    const struct limits limits = limits_default();
    struct bvhd_error error;
    uint64_t updates = 0;
    *bed = (struct bed){.variant = (enum lavapipe_variant)(seed % 2 ? seed / 2 % 3 : 0)};
    random_input_triangles(&bed->request, &random, MOST_PRIMITIVES);
    struct build_input *input = &bed->request.input;
    input->flags |= BUILD_ALLOW_DATA_ACCESS;
    if (bed->variant) {
        input->options.target = TARGET_LAVAPIPE;
        input->options.layout_flags = 0;
        input->options.device = (struct device_format){.variant = bed->variant};
    }
    assert_int_equal(batch_build(input, 1, &limits, &context, &bed->item, &error), BVHD_OK);
    assert_int_equal(bed->item.status, BVHD_OK);
    const struct random_update update = {input, random_input_move, &bed->request, MOST_UPDATES, &context};
    bool moves = input->flags & BUILD_ALLOW_UPDATE;
    if (moves && random_update_run(&update, &random, &bed->item, &updates, &error) != BVHD_OK)
        return false;
    open_bed(bed);
    return true;
}

static void end_bed(struct bed *bed)
{
    positions_unref(bed->positions);
    batch_finish(&bed->item, 1, &memory);
    random_input_finish(&bed->request);
    assert_int_equal(memory.live, 0);
}

/* Returns the area of a triangle relative to its edges; NaN for an infinite one. */
static double area_of(float corners[3][3])
{
    double u[3], v[3], area = 0, edges = 0;
    for (int axis = 0; axis < 3; axis++) {
        u[axis] = (double)corners[1][axis] - corners[0][axis];
        v[axis] = (double)corners[2][axis] - corners[0][axis];
        edges += fabs(u[axis]) + fabs(v[axis]);
    }
    for (int axis = 0; axis < 3; axis++)
        area += fabs(u[axis] * v[(axis + 1) % 3] - u[(axis + 1) % 3] * v[axis]);
    return edges > 0 ? area / (edges * edges) : area;
}

static bool is_nan(float corners[3][3])
{
    for (int k = 0; k < 9; k++)
        if (isnan(corners[k / 3][k % 3]))
            return true;
    return false;
}

static bool is_same(const struct bed *bed, float is, float wanted, bool moved)
{
    if (moved)
        return is == wanted || nextafterf(is, wanted) == wanted;
    if (bed->variant == LAVAPIPE_PLAIN)
        wanted += 0.0f; /* this driver has no -0 */
    return memcmp(&is, &wanted, sizeof is) == 0;
}

static void check_triangle(struct bed *bed, uint32_t g, uint32_t primitive)
{
    const struct random_meaning *meaning = &bed->request.meanings[g];
    float(*wanted)[3] = meaning->corners[primitive], corners[3][3];
    struct bvhd_error error;
    const bool is_inactive = is_nan(wanted), keeps_all = bed->variant || bed->request.input.flags & BUILD_ALLOW_UPDATE;
    enum bvhd_status status = positions_get(bed->positions, bed->item.blob, g, primitive, NULL, corners, &error);
    if (status == BVHD_OK) {
        bed->read++;
        assert_false(is_inactive);
        for (int k = 0; k < 9; k++)
            if (!is_same(bed, corners[k / 3][k % 3], wanted[k / 3][k % 3], meaning->moved))
                fail_msg("%u.%u: %a is not %a", g, primitive, (double)corners[k / 3][k % 3],
                         (double)wanted[k / 3][k % 3]);
        return;
    }
    bed->refused++;
    assert_int_equal(status, BVHD_INVALID);
    assert_string_equal(error.where, "primitive");
    if (!is_inactive && (keeps_all || area_of(wanted) > 1e-5))
        fail_msg("%u.%u is not there: %s", g, primitive, error.text);
}

static void corners_are_those_of_the_request(void **state)
{
    (void)state;
    uint32_t read = 0, refused = 0, cases = 0;
    for (uint32_t seed = 1; seed <= CASES; seed++) {
        struct bed bed;
        struct bvhd_error error;
        float corners[3][3];
        const bool is_made = make_bed(&bed, seed);
        const uint32_t count = bed.request.input.geometry_count;
        for (uint32_t g = 0; is_made && g < count; g++) {
            for (uint32_t i = 0; i < bed.request.meanings[g].count; i++)
                check_triangle(&bed, g, i);
            assert_int_equal(
                positions_get(bed.positions, bed.item.blob, g, bed.request.meanings[g].count, NULL, corners, &error),
                BVHD_INVALID);
        }
        if (is_made) {
            assert_int_equal(positions_get(bed.positions, bed.item.blob, count, 0, NULL, corners, &error),
                             BVHD_INVALID);
            assert_int_equal(positions_get(bed.positions, bed.item.blob, UINT32_MAX, UINT32_MAX, NULL, corners, &error),
                             BVHD_INVALID);
        }
        cases += is_made;
        read += bed.read;
        refused += bed.refused;
        end_bed(&bed);
    }
    assert_true(cases > CASES / 2 && read > 1000 && refused > 0);
}

/* Makes long thin triangles, which quality high cuts, in a native structure whose leaves padding follows. */
static void make_thin(struct bed *bed, float (*vertices)[3], uint32_t count)
{
    struct random random = {count};
    const struct limits limits = limits_default();
    struct bvhd_error error;
    for (uint32_t i = 0; i < count; i++)
        for (int axis = 0; axis < 3; axis++) {
            vertices[3 * i][axis] = (float)random_between(&random, 0, 10);
            vertices[3 * i + 1][axis] = vertices[3 * i][axis] + (float)random_between(&random, 0, 0.02);
            vertices[3 * i + 2][axis] = vertices[3 * i][axis] + (float)random_between(&random, -6, 6);
        }
    const struct geometry geometry = {
        .type = GEOMETRY_TRIANGLES,
        .triangles = {.vertex_format = 106,
                      .max_vertex = 3 * count - 1,
                      .vertex_stride = sizeof vertices[0],
                      .index_type = INDEX_NONE,
                      .vertices = {(const unsigned char *)vertices, 3 * count * sizeof vertices[0]}},
        .range.primitive_count = count,
    };
    const struct build_input input = {
        .type = STRUCTURE_BOTTOM,
        .flags = BUILD_ALLOW_DATA_ACCESS,
        .geometry_count = 1,
        .geometries = &geometry,
        .options = {.quality = QUALITY_HIGH, .target = TARGET_LAVAPIPE, .device.variant = LAVAPIPE_COMPACTED},
    };
    *bed = (struct bed){.variant = LAVAPIPE_COMPACTED};
    assert_int_equal(batch_build(&input, 1, &limits, &context, &bed->item, &error), BVHD_OK);
    assert_int_equal(bed->item.status, BVHD_OK);
    open_bed(bed);
}

/* With six triangles more than a multiple of seven, the padding behind the leaves is as large as a leaf. */
static void padding_is_no_triangle(void **state)
{
    (void)state;
    uint32_t cut = 0;
    for (uint32_t count = 13; count < 256; count += 7) {
        static float vertices[3 * 256][3];
        struct bed bed;
        make_thin(&bed, vertices, count);
        cut += bed.item.summary.refs > bed.item.summary.primitives;
        for (uint32_t i = 0; i < count; i++) {
            float corners[3][3];
            struct bvhd_error error;
            assert_int_equal(positions_get(bed.positions, bed.item.blob, 0, i, NULL, corners, &error), BVHD_OK);
            assert_memory_equal(corners, vertices[3 * i], sizeof corners);
        }
        positions_unref(bed.positions);
        batch_finish(&bed.item, 1, &memory);
    }
    assert_true(cut > 0);
    assert_int_equal(memory.live, 0);
}

/* A small structure that claims half a billion triangles does not make its reader ask for gigabytes. */
static void memory_is_in_proportion(void **state)
{
    (void)state;
    enum { CLAIMED = 1 << 28 };
    struct bed bed = {.variant = 0};
    struct test_input test;
    const struct limits limits = limits_default();
    struct bvhd_error error;
    float corners[3][3];
    inputs_triangles(&test);
    test.input.flags = BUILD_ALLOW_DATA_ACCESS;
    test.input.options.quality = QUALITY_FAST;
    assert_int_equal(batch_build(&test.input, 1, &limits, &context, &bed.item, &error), BVHD_OK);
    unsigned char *body = bed.item.blob + bytes_align(SERIALIZED_HANDLES, PORTABLE_BODY_ALIGNMENT);
    struct portable_header *header = (struct portable_header *)(void *)body;
    struct portable_geometry *geometries = (struct portable_geometry *)(void *)(body + header->geometry_offset);
    header->primitive_count += CLAIMED;
    geometries[1].primitive_count += CLAIMED;
    open_bed(&bed);
    assert_true(memory.live < 2 * bed.item.size + 65536);
    assert_int_equal(positions_get(bed.positions, bed.item.blob, 1, 0, NULL, corners, &error), BVHD_OK);
    assert_int_equal(positions_get(bed.positions, bed.item.blob, 1, CLAIMED - 1, NULL, corners, &error), BVHD_INVALID);
    positions_unref(bed.positions);
    batch_finish(&bed.item, 1, &memory);
    assert_int_equal(memory.live, 0);
}

/* Other primitives than triangles have no corners, although some of them have vertices. */
static void other_primitives_are_refused(void **state)
{
    static void (*const make[])(struct test_input *) = {inputs_aabbs, inputs_spheres, inputs_swept_spheres};
    (void)state;
    for (size_t i = 0; i < sizeof make / sizeof *make; i++) {
        static struct test_input test;
        struct bed bed = {.variant = 0};
        const struct limits limits = limits_default();
        struct bvhd_error error;
        float corners[3][3];
        make[i](&test);
        test.input.flags = BUILD_ALLOW_DATA_ACCESS;
        assert_int_equal(batch_build(&test.input, 1, &limits, &context, &bed.item, &error), BVHD_OK);
        assert_int_equal(bed.item.status, BVHD_OK);
        open_bed(&bed);
        assert_int_equal(positions_get(bed.positions, bed.item.blob, 0, 0, NULL, corners, &error), BVHD_INVALID);
        assert_string_equal(error.where, "geometry");
        positions_unref(bed.positions);
        batch_finish(&bed.item, 1, &memory);
    }
    assert_int_equal(memory.live, 0);
}

/* Motion triangles have corners at each time, which are those of rays, and none without a time. */
static void what_moves_has_positions_of_a_time(void **state)
{
    (void)state;
    static const float times[] = {0, 0.125f, 0.3f, 0.5f, 0.9f, 1};
    struct test_input test;
    struct bed bed = {.variant = 0};
    const struct limits limits = limits_default();
    struct bvhd_error error;
    float corners[3][3];
    inputs_motion_triangles(&test);
    test.input.flags |= BUILD_ALLOW_DATA_ACCESS | BUILD_ALLOW_UPDATE; /* which keeps triangles without an area */
    assert_int_equal(batch_build(&test.input, 1, &limits, &context, &bed.item, &error), BVHD_OK);
    assert_int_equal(bed.item.status, BVHD_OK);
    open_bed(&bed);
    const struct geometry *geometry = &test.geometries[1]; /* without indices and transform */
    for (uint32_t i = 0; i < geometry->range.primitive_count; i++)
        for (size_t at = 0; at < sizeof times / sizeof *times; at++) {
            assert_int_equal(positions_get(bed.positions, bed.item.blob, 1, i, &times[at], corners, &error), BVHD_OK);
            for (uint32_t k = 0; k < 9; k++) {
                const size_t place = geometry->triangles.vertex_stride * (3 * i + k / 3) + sizeof(float) * (k % 3);
                float start, end;
                memcpy(&start, geometry->triangles.vertices.data + place, sizeof start);
                memcpy(&end, geometry->triangles.end_vertices.data + place, sizeof end);
                const float rest = 1 - times[at], before = start * rest, after = end * times[at];
                assert_true(corners[k / 3][k % 3] == before + after);
            }
        }
    assert_int_equal(positions_get(bed.positions, bed.item.blob, 1, 0, NULL, corners, &error), BVHD_INVALID);
    assert_string_equal(error.where, "geometry");
    assert_non_null(strstr(error.text, "move"));
    assert_int_equal(positions_get(bed.positions, bed.item.blob, 2, 0, times, corners, &error), BVHD_INVALID);
    positions_unref(bed.positions);
    batch_finish(&bed.item, 1, &memory);
    assert_int_equal(memory.live, 0);
}

int main(void)
{
    memory_init(&memory, UINT64_MAX);
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(corners_are_those_of_the_request),
        cmocka_unit_test(padding_is_no_triangle),
        cmocka_unit_test(memory_is_in_proportion),
        cmocka_unit_test(other_primitives_are_refused),
        cmocka_unit_test(what_moves_has_positions_of_a_time),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
