/* SPDX-License-Identifier: Apache-2.0 */
/* test_prepare_open.c - tests that bytes from elsewhere open only if prepare could have written them. */
/* Each block lies at the end of a page that is followed by one without access, so a read outside ends the test. */
#include "tests/support/unit.h"

#include <math.h>
#include <sys/mman.h>
#include <unistd.h>

#include "tests/support/builder/inputs.h"
#include "builder/input/prepare.h"
#include "tests/support/random.h"

enum {
    TRIANGLES,
    UPDATABLE,
    BOXES,
    TOP,
    OUTLINED,
    SPHERES,
    UPDATABLE_SPHERES,
    SWEPT,
    UPDATABLE_SWEPT,
    GATHERED,
    KINDS
};
enum { MOST = 4096 };

static struct memory memory = {.limit = UINT64_MAX, .fail_after = -1};
static const struct build_context context = {.memory = &memory, .parallel = &parallel_serial};
static unsigned char *pages;
static size_t page;

static void inputs_updatable(struct test_input *test)
{
    inputs_triangles(test);
    test->input.flags = BUILD_ALLOW_UPDATE;
    test->geometries[0].range.primitive_count = 1; /* so that the indices need padding */
}

/* Instances whose references have slabs. */
static void inputs_outlined(struct test_input *test)
{
    inputs_instances(test);
    for (int i = 0; i < SLABS_COUNT; i++)
        test->references[2].slabs.min[i] = -(test->references[2].slabs.max[i] = (float)(i + 1));
}

static void inputs_updatable_spheres(struct test_input *test)
{
    inputs_spheres(test);
    test->input.flags = BUILD_ALLOW_UPDATE;
}

static void inputs_updatable_swept(struct test_input *test)
{
    inputs_swept_spheres(test);
    test->input.flags = BUILD_ALLOW_UPDATE;
}

/* The pairs 0 1, 2 2 and 1 3 */
static void inputs_gathered(struct test_input *test)
{
    inputs_updatable_swept(test);
    test->geometries[0].swept_spheres.indexing_mode = SWEPT_LIST;
    test->geometries[0].range.primitive_count = 3;
}

static void (*const kinds[KINDS])(struct test_input *) = {
    [TRIANGLES] = inputs_triangles,
    [UPDATABLE] = inputs_updatable,
    [BOXES] = inputs_aabbs,
    [TOP] = inputs_instances,
    [OUTLINED] = inputs_outlined,
    [SPHERES] = inputs_spheres,
    [UPDATABLE_SPHERES] = inputs_updatable_spheres,
    [SWEPT] = inputs_swept_spheres,
    [UPDATABLE_SWEPT] = inputs_updatable_swept,
    [GATHERED] = inputs_gathered,
};

static size_t floats_of(const struct canonical_geometry *geometry)
{
    return geometry->type == GEOMETRY_TRIANGLES ? 3 : 4;
}

static int set_up(void **state)
{
    (void)state;
    page = (size_t)sysconf(_SC_PAGESIZE);
    pages = mmap(NULL, 2 * page, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    return pages != MAP_FAILED && mprotect(pages + page, page, PROT_NONE) == 0 ? 0 : -1;
}

static int tear_down(void **state)
{
    (void)state;
    return munmap(pages, 2 * page);
}

/* Writes a block by prepare, and returns its size. */
static uint64_t write_block(int kind, unsigned char *ret_block)
{
    struct test_input test;
    struct limits limits = limits_default();
    struct canonical canonical;
    kinds[kind](&test);
    assert_int_equal(prepare(&test.input, 0, &limits, &context, &canonical, NULL), BVHD_OK);
    uint64_t size = canonical.size;
    assert_true(size <= MOST);
    memcpy(ret_block, canonical.bytes, size);
    prepare_finish(&canonical, &memory);
    return size;
}

static enum bvhd_status open_block(const unsigned char *block, uint64_t size, struct canonical *ret_view,
                                   struct bvhd_error *error)
{
    unsigned char *place = pages + page - bytes_align(size, 16); /* at least 16-byte aligned */
    memcpy(place, block, size);
    return prepare_open((struct bytes){place, size}, &memory, ret_view, error);
}

/* Checks everything that a view promises to its readers. */
static void walk(const struct canonical *view)
{
    const unsigned char *end = view->bytes + view->size;
    uint64_t primitives = 0, vertices = 0;
    for (uint32_t g = 0; g < view->geometry_count; g++) {
        const struct canonical_geometry *geometry = &view->geometries[g];
        assert_int_equal(geometry->first_primitive, primitives);
        assert_int_equal(geometry->first_vertex, vertices);
        primitives += geometry->primitive_count;
        vertices += geometry->vertex_count;
        for (uint32_t i = 0; i < geometry->primitive_count; i++) {
            float corners[3][3];
            if (geometry->type == GEOMETRY_TRIANGLES)
                canonical_triangle(geometry, i, corners);
            else if (geometry->type == GEOMETRY_SPHERES)
                assert_true((geometry->indices ? geometry->indices[i] : i) < geometry->vertex_count);
            else if (geometry->type == GEOMETRY_SWEPT_SPHERES)
                assert_true((geometry->indices[i] & CANONICAL_END_MASK) + 1 < geometry->vertex_count);
            else if (geometry->type == GEOMETRY_AABBS)
                assert_true((const unsigned char *)(geometry->boxes + (size_t)6 * i + 6) <= end);
            else
                assert_true(canonical_instance(geometry, i).reference <= view->reference_count);
        }
        if (geometry->positions)
            assert_true((const unsigned char *)(geometry->positions + floats_of(geometry) * geometry->vertex_count) <=
                        end);
    }
    assert_int_equal(view->primitive_count, primitives);
    assert_int_equal(view->vertex_count, vertices);
}

/* Opens arbitrary bytes; what is accepted must be readable. */
static bool opens(const unsigned char *block, uint64_t size)
{
    struct canonical view;
    struct bvhd_error error;
    enum bvhd_status status = open_block(block, size, &view, &error);
    if (status == BVHD_OK) {
        walk(&view);
        prepare_finish(&view, &memory);
    } else {
        assert_int_equal(error.status, status);
        assert_true(error.text[0] != 0);
        assert_true(status != BVHD_NO_MEMORY && status != BVHD_INTERNAL);
    }
    assert_int_equal(memory.live, 0);
    return status == BVHD_OK;
}

static void what_was_written_opens(void **state)
{
    (void)state;
    for (int kind = 0; kind < KINDS; kind++) {
        unsigned char block[MOST];
        struct canonical view, made;
        struct test_input test;
        struct limits limits = limits_default();
        uint64_t size = write_block(kind, block);
        kinds[kind](&test);
        assert_int_equal(prepare(&test.input, 0, &limits, &context, &made, NULL), BVHD_OK);
        assert_int_equal(open_block(block, size, &view, NULL), BVHD_OK);
        assert_null(view.owned);
        assert_int_equal(view.type, made.type);
        assert_int_equal(view.flags, made.flags);
        assert_int_equal(view.geometry_count, made.geometry_count);
        assert_int_equal(view.reference_count, made.reference_count);
        for (uint32_t g = 0; g < view.geometry_count; g++) {
            const struct canonical_geometry *a = &view.geometries[g], *b = &made.geometries[g];
            assert_int_equal(a->type, b->type);
            assert_int_equal(a->flags, b->flags);
            assert_int_equal(a->primitive_count, b->primitive_count);
            assert_int_equal(a->vertex_count, b->vertex_count);
            assert_int_equal(a->indices != NULL, b->indices != NULL);
            assert_int_equal(a->boxes != NULL, b->boxes != NULL);
            assert_int_equal(a->instances != NULL, b->instances != NULL);
            if (a->positions)
                assert_memory_equal(a->positions, b->positions, 4 * floats_of(a) * a->vertex_count);
        }
        for (uint32_t i = 0; i < view.reference_count; i++)
            assert_memory_equal(&view.references[i], &made.references[i], sizeof view.references[i]);
        walk(&view);
        prepare_finish(&view, &memory);
        prepare_finish(&made, &memory);
    }
}

static void every_truncation_is_refused(void **state)
{
    (void)state;
    for (int kind = 0; kind < KINDS; kind++) {
        unsigned char block[MOST + 16] = {0};
        uint64_t size = write_block(kind, block);
        for (uint64_t shorter = 0; shorter < size; shorter++)
            assert_false(opens(block, shorter));
        assert_false(opens(block, size + 1));
        assert_false(opens(block, size + 16));
        memcpy(block + 32, &(uint64_t){size + 16}, 8); /* the header agrees with the excess bytes */
        assert_false(opens(block, size + 16));
    }
}

/* Every byte of the header and the rows is checked, except flags and the fields that updates compare. */
static void every_byte_of_the_tables_counts(void **state)
{
    (void)state;
    for (int kind = 0; kind < KINDS; kind++) {
        unsigned char block[MOST];
        uint64_t size = write_block(kind, block);
        uint64_t tables = 64 + 64 * (uint64_t)bytes_get32(block + 16);
        for (uint64_t at = 0; at < tables; at++) {
            bool flags = at == 12 || at == 13 || (at >= 64 && at % 64 == 4);
            bool updatable =
                kind == UPDATABLE || kind == UPDATABLE_SPHERES || kind == UPDATABLE_SWEPT || kind == GATHERED;
            bool update = updatable && at >= 64 && at % 64 >= 36 && at % 64 < (kind == UPDATABLE ? 56 : 64);
            for (unsigned value = 0; value < 256; value++) {
                unsigned char kept = block[at];
                block[at] = (unsigned char)value;
                bool opened = opens(block, size);
                if (opened != (value == kept) && !(opened && (flags || update)))
                    fail_msg("kind %d: byte %u of %u is %u", kind, (unsigned)at, (unsigned)size, value);
                block[at] = kept;
            }
        }
    }
}

static void reason(int kind, uint64_t at, uint32_t value, enum bvhd_status want, const char *where)
{
    unsigned char block[MOST];
    struct canonical view;
    struct bvhd_error error;
    uint64_t size = write_block(kind, block);
    bytes_put32(block + at, value);
    assert_int_equal(open_block(block, size, &view, &error), want);
    assert_string_equal(error.where, where);
    assert_int_equal(memory.live, 0);
}

static void places_are_named(void **state)
{
    (void)state;
    reason(TRIANGLES, 0, 1, BVHD_CORRUPT, "magic");
    reason(TRIANGLES, 4, 1, BVHD_INCOMPATIBLE, "version");
    reason(TRIANGLES, 4, 3, BVHD_CORRUPT, "version");
    reason(TRIANGLES, 4, 4, BVHD_CORRUPT, "version");
    reason(TRIANGLES, 4, 5, BVHD_INCOMPATIBLE, "version");
    reason(TRIANGLES, 8, 2, BVHD_CORRUPT, "type");
    reason(TRIANGLES, 12, 0x200, BVHD_CORRUPT, "flags");
    reason(TRIANGLES, 12, BUILD_MOTION, BVHD_CORRUPT, "version");
    reason(TRIANGLES, 12, 0xc, BVHD_CORRUPT, "flags");
    reason(TRIANGLES, 16, 1u << 24, BVHD_CORRUPT, "geometryCount");
    reason(TRIANGLES, 16, 50, BVHD_CORRUPT, "geometryCount");
    reason(TRIANGLES, 20, 1, BVHD_CORRUPT, "referenceOffset");
    reason(TRIANGLES, 24, 4, BVHD_CORRUPT, "primitiveCount");
    reason(TRIANGLES, 28, 4, BVHD_CORRUPT, "vertexCount");
    reason(TRIANGLES, 32, 4, BVHD_CORRUPT, "size");
    reason(TRIANGLES, 48, 4, BVHD_CORRUPT, "reserved");
    reason(TRIANGLES, 64, GEOMETRY_AABBS, BVHD_CORRUPT, "geometries[0].indexed");
    reason(TRIANGLES, 64 + 64, GEOMETRY_AABBS, BVHD_CORRUPT, "geometries[1].type");
    reason(TRIANGLES, 64 + 64 + 16, 5, BVHD_CORRUPT, "geometries[1].dataOffset");
    reason(TRIANGLES, 64 + 24, 5, BVHD_CORRUPT, "geometries[0].indexOffset");
    reason(TRIANGLES, 64 + 36, 1, BVHD_CORRUPT, "geometries[0].update");
    /* an index */
    reason(TRIANGLES, 192, 9, BVHD_CORRUPT, "geometries[0].vertexCount");
    reason(UPDATABLE, 192 + 12, 1, BVHD_CORRUPT, "geometries[0].padding");
    reason(BOXES, 128, 0x7f000000, BVHD_INVALID, "infos[0].geometries[0].aabbs[0].minX");
    reason(BOXES, 128 + 24 + 4, 0x7fc00000, BVHD_CORRUPT, "geometries[0].boxes");
    reason(TOP, 128 + 56, 2, BVHD_CORRUPT, "geometries[0].instances[0]");
    reason(TOP, 128 + 52, 0x40000000, BVHD_INVALID, "infos[0].geometries[0].instances[0].flags");
    reason(TOP, 128 + 128 + 56, 1, BVHD_CORRUPT, "referenceCount");
    reason(TOP, 128 + 256, 3, BVHD_CORRUPT, "references[0]");
    reason(TOP, 128 + 256 + 40, 0x7f800000, BVHD_CORRUPT, "references[0]");
    /* unknown, but not in the form that prepare writes */
    reason(TOP, 128 + 256 + 64, 0x80000000, BVHD_CORRUPT, "references[0]");
    /* above the maximum */
    reason(TOP, 128 + 256 + 64, 0x3f800000, BVHD_CORRUPT, "references[0]");
    reason(TOP, 128 + 256 + 144 + 104, 0xbf800000, BVHD_CORRUPT, "references[1]");
    reason(OUTLINED, 128 + 256 + 64, 0xff800000, BVHD_CORRUPT, "references[0]");
    reason(OUTLINED, 128 + 256 + 140, 0x7fc00000, BVHD_CORRUPT, "references[0]");
    reason(SPHERES, 4, 2, BVHD_CORRUPT, "version");
    reason(SPHERES, 64 + 36, 1, BVHD_CORRUPT, "geometries[0].update");
    reason(SPHERES, 64 + 56, 100, BVHD_CORRUPT, "geometries[0].update");
    reason(TRIANGLES, 64 + 56, 100, BVHD_CORRUPT, "version");
    reason(BOXES, 64 + 56, 100, BVHD_CORRUPT, "geometries[0].reserved");
    reason(UPDATABLE_SPHERES, 64 + 36, 3, BVHD_CORRUPT, "geometries[0].update");
    reason(UPDATABLE_SPHERES, 64 + 44, 1, BVHD_CORRUPT, "geometries[0].update");
    reason(UPDATABLE_SPHERES, 64 + 56, 106, BVHD_CORRUPT, "geometries[0].update");
    reason(UPDATABLE_SPHERES, 64 + 60, 1, BVHD_CORRUPT, "geometries[0].update");
    reason(UPDATABLE_SPHERES, 128 + 52, 1, BVHD_CORRUPT, "geometries[1].update");
    reason(UPDATABLE_SWEPT, 64 + 60, 4, BVHD_CORRUPT, "geometries[0].update");
    reason(UPDATABLE_SWEPT, 64 + 44, 1, BVHD_CORRUPT, "geometries[0].update");
    reason(UPDATABLE_SWEPT, 128 + 52, 1, BVHD_CORRUPT, "geometries[1].update");
    /* other modes of indices and caps than those recorded */
    reason(UPDATABLE_SWEPT, 64 + 60, 0, BVHD_CORRUPT, "geometries[0].indices");
    reason(UPDATABLE_SWEPT, 64 + 60, 1, BVHD_CORRUPT, "geometries[0].indices");
    reason(UPDATABLE_SWEPT, 64 + 60, 2, BVHD_CORRUPT, "geometries[0].indices");
    reason(GATHERED, 64 + 60, 0, BVHD_CORRUPT, "geometries[0].indices");
    /* no list without indices */
    reason(UPDATABLE_SWEPT, 192 + 32, 1, BVHD_CORRUPT, "geometries[1].indices");
    reason(UPDATABLE_SWEPT, 192 + 32 + 4, 0, BVHD_CORRUPT, "geometries[1].indices");
    /* SUCCESSIVE without indices */
    reason(UPDATABLE_SWEPT, 128 + 60, 1, BVHD_CORRUPT, "geometries[1].update");
    /* not indexed */
    reason(SWEPT, 64 + 32, 0, BVHD_CORRUPT, "geometries[0].vertexCount");
    /* the first index: another end, a cap less */
    reason(SPHERES, 192, 4, BVHD_CORRUPT, "geometries[0].vertexCount");
    reason(SPHERES, 192, 1, BVHD_CORRUPT, "geometries[0].indices");
    reason(SWEPT, 192, 0xc0000004, BVHD_CORRUPT, "geometries[0].vertexCount");
    reason(SWEPT, 192, 0xc0000001, BVHD_CORRUPT, "geometries[0].indices");
    reason(SWEPT, 192, 0x80000000, BVHD_CORRUPT, "geometries[0].indices");
    reason(GATHERED, 192, 0, BVHD_CORRUPT, "geometries[0].indices");
    /* the radius of the first vertex */
    reason(SPHERES, 192 + 32 + 12, 0xbf800000, BVHD_INVALID, "infos[0].geometries[0].spheres[0].radius");
    reason(SWEPT, 192 + 48 + 12, 0xbf800000, BVHD_INVALID, "infos[0].geometries[0].linearSweptSpheres[0].radii[0]");
    /* empty bounds, but not in the form that prepare writes */
    reason(OUTLINED, 128 + 256 + 40, 0x7f7fffff, BVHD_CORRUPT, "references[0]");
}

static void random_flips_are_survived(void **state)
{
    (void)state;
    struct random random = {17};
    for (int kind = 0; kind < KINDS; kind++) {
        unsigned char block[MOST], broken[MOST];
        uint64_t size = write_block(kind, block);
        for (int round = 0; round < 20000; round++) {
            memcpy(broken, block, size);
            for (uint64_t flips = 1 + random_next(&random) % 4; flips > 0; flips--)
                broken[random_next(&random) % size] ^= (unsigned char)(1u << random_next(&random) % 8);
            opens(broken, size);
        }
        for (int round = 0; round < 20000; round++) {
            memcpy(broken, block, size);
            uint64_t at = 4 * (random_next(&random) % (size / 4));
            static const uint32_t values[] = {0,          1,          UINT32_MAX, 0x7fffffff,
                                              0x80000000, 0x20000000, 0xaaaaaaab, 0x10000};
            bytes_put32(broken + at, values[random_next(&random) % 8]);
            bytes_put32(broken + 4 * (random_next(&random) % 48), values[random_next(&random) % 8]);
            opens(broken, size);
        }
    }
}

static void every_allocation_may_fail(void **state)
{
    (void)state;
    unsigned char block[MOST];
    struct canonical view;
    uint64_t size = write_block(TOP, block);
    for (int failures = 0; failures < 2; failures++) {
        atomic_store(&memory.fail_after, failures);
        assert_int_equal(open_block(block, size, &view, NULL), BVHD_NO_MEMORY);
        assert_int_equal(memory.live, 0);
    }
    atomic_store(&memory.fail_after, -1);
    prepare_finish(NULL, &memory);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(what_was_written_opens),          cmocka_unit_test(every_truncation_is_refused),
        cmocka_unit_test(every_byte_of_the_tables_counts), cmocka_unit_test(places_are_named),
        cmocka_unit_test(random_flips_are_survived),       cmocka_unit_test(every_allocation_may_fail),
    };
    return cmocka_run_group_tests(tests, set_up, tear_down);
}
