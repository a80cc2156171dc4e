/* SPDX-License-Identifier: Apache-2.0 */
/*
 * driver_golden.c - tests the lavapipe layout against the driver itself. The driver builds; our writer, given the
 * driver's topology and our own geometry, has to give the bytes that the driver serializes. Then the structure that our
 * builder makes of the same request is loaded into the driver, which has to serialize the same bytes.
 *
 * Empty structures are not compared, because the driver reports a serialized size of 0 for them. Skipped (77) where no
 * device loads this layout.
 */
#include "tests/support/unit.h"

#include "builder/build.h"
#include "tests/support/driver/driver_structure.h"
#include "builder/format/lavapipe.h"
#include "builder/format/lavapipe_topology.h"
#include "builder/format/lavapipe_write.h"
#include "builder/input/prepare.h"
#include "tests/support/random.h"
#include "builder/format/serialized.h"

enum { SKIPPED = 77, BOTTOMS = 3 };

static struct memory memory;
static struct gpu *gpu;
static struct device_format device;

#define MUST(call) must((call), &error)

static void must(enum bvhd_status status, const struct bvhd_error *error)
{
    if (status != BVHD_OK)
        fail_msg("%s: %s", error->where, error->text);
}

static void *allocate(size_t size)
{
    void *block = memory_alloc(&memory, size + 1);
    assert_non_null(block);
    return block;
}

/* ---- Comparing ---- */

static enum bvhd_status open_as_device(struct bytes blob, struct lavapipe_view *ret_view, struct bvhd_error *error)
{
    return device.variant ? lavapipe_open(blob, (enum lavapipe_variant)device.variant, &memory, ret_view, error)
                          : lavapipe_open_any(blob, &memory, ret_view, error);
}

/* Replaces rows by addresses in the handles, as a loader does. */
static void set_handles(unsigned char *blob, uint64_t size, const uint64_t *addresses)
{
    struct bvhd_error error;
    struct lavapipe_view view;
    MUST(open_as_device((struct bytes){blob, size}, &view, &error));
    for (uint64_t i = 0; i < view.handle_count; i++) {
        unsigned char *handle = blob + SERIALIZED_HANDLES + 8 * i;
        uint64_t address = addresses[bytes_get64(handle) - 1];
        bytes_put64(handle, address);
        bytes_put64(blob + (view.body - blob) + view.leaf_offset + i * sizeof(struct lavapipe_instance), address);
    }
}

static void assert_equal(const char *name, struct bytes driver, struct bytes ours)
{
    uint64_t size = driver.size < ours.size ? driver.size : ours.size;
    for (uint64_t i = 0; i < size; i++)
        if (driver.data[i] != ours.data[i])
            fail_msg("%s: byte %llu of %llu is %02x, the driver's %02x", name, (unsigned long long)i,
                     (unsigned long long)size, ours.data[i], driver.data[i]);
    assert_int_equal(driver.size, ours.size);
}

/* Writes our canonical copy with the driver's tree. */
static void write_again(const struct canonical *canonical, const struct lavapipe_view *view,
                        const struct parallel *parallel, struct bytes *ret_blob)
{
    struct bvhd_error error;
    struct lavapipe_topology topology;
    struct layout_sizes sizes;
    unsigned char *blob;
    MUST(lavapipe_topology_read(view, canonical, &memory, &topology, &error));
    const struct layout_input input = {
        .canonical = canonical, .ir = &topology.ir, .device = &view->device, .memory = &memory, .parallel = parallel};
    MUST(lavapipe_write_at(&input, topology.places, &blob, &sizes, &error));
    lavapipe_topology_finish(&topology);
    *ret_blob = (struct bytes){blob, sizes.total};
}

static struct bytes build_ours(const struct canonical *canonical, const uint64_t *addresses)
{
    struct bvhd_error error;
    struct build_options options = {.quality = QUALITY_BALANCED, .target = TARGET_LAVAPIPE, .device = device};
    struct build_context context = {.memory = &memory, .parallel = &parallel_serial};
    struct build_stats stats;
    unsigned char *blob;
    MUST(build(canonical, &options, &context, &blob, &stats, &error));
    set_handles(blob, stats.sizes.total, addresses);
    return (struct bytes){blob, stats.sizes.total};
}

/* Loads our structure into the driver and compares what the driver serializes byte by byte. */
static void assert_round_trip(const char *name, const struct canonical *canonical, const uint64_t *addresses)
{
    struct bvhd_error error;
    struct driver_structure loaded;
    struct bytes ours = build_ours(canonical, addresses), back;
    unsigned char *data;
    MUST(driver_structure_load(gpu, ours.data, ours.size, &loaded, &error));
    MUST(driver_structure_serialize(gpu, &loaded, &memory, &data, &back.size, &error));
    back.data = data;
    assert_equal(name, back, ours);
    driver_structure_destroy(gpu, &loaded);
    memory_free(&memory, data);
    memory_free(&memory, (void *)(uintptr_t)ours.data);
}

/* Collects for each leaf the box that its parent node stores. */
static void collect_boxes(struct bytes blob, struct box *ret_boxes)
{
    struct bvhd_error error;
    struct lavapipe_view view;
    MUST(open_as_device(blob, &view, &error));
    for (uint32_t at = LAVAPIPE_HEADER; at < view.leaf_offset; at += sizeof(struct lavapipe_box)) {
        struct lavapipe_box box = lavapipe_box_at(&view, at);
        for (int c = 0; c < 2; c++)
            if (box.children[c] != LAVAPIPE_NONE && (box.children[c] & 3) == LAVAPIPE_INSTANCE) {
                struct box *to = &ret_boxes[lavapipe_leaf_index(&view, box.children[c])];
                memcpy(to->min, box.bounds[c].min, sizeof to->min);
                memcpy(to->max, box.bounds[c].max, sizeof to->max);
            }
    }
}

/*
 * Checks that our boxes of instances contain the driver's. The driver computes them in float; ours are rounded outward
 * from double, so that what hits the driver's box hits ours.
 */
static void assert_instance_boxes_contain(const struct canonical *canonical, struct bytes driver,
                                          const uint64_t *addresses)
{
    struct bytes ours = build_ours(canonical, addresses);
    struct box *theirs = allocate(canonical->primitive_count * sizeof *theirs),
               *own = allocate(canonical->primitive_count * sizeof *own);
    struct lavapipe_view view;
    struct bvhd_error error;
    uint32_t larger = 0;
    MUST(open_as_device(driver, &view, &error));
    collect_boxes(driver, theirs);
    collect_boxes(ours, own);
    for (uint32_t i = 0; i < view.leaf_count; i++) {
        assert_true(box_contains(&own[i], &theirs[i]));
        larger += !box_contains(&theirs[i], &own[i]);
    }
    print_message("boxes of %u instances: %u are larger than the driver's, the others equal\n", view.leaf_count,
                  larger);
    memory_free(&memory, own);
    memory_free(&memory, theirs);
    memory_free(&memory, (void *)(uintptr_t)ours.data);
}

static void check(const char *name, const struct canonical *canonical, const uint64_t *addresses)
{
    struct bvhd_error error;
    struct driver_structure structure;
    struct lavapipe_view view;
    struct bytes driver, ours;
    unsigned char *data;
    MUST(driver_structure_build(gpu, canonical, addresses, &memory, &structure, &error));
    MUST(driver_structure_serialize(gpu, &structure, &memory, &data, &driver.size, &error));
    driver.data = data;
    if (driver.size > 0) {
        MUST(open_as_device(driver, &view, &error));
        device = view.device;
        write_again(canonical, &view, &parallel_serial, &ours);
        if (canonical->type == STRUCTURE_TOP)
            set_handles((unsigned char *)(uintptr_t)ours.data, ours.size, addresses);
        assert_equal(name, driver, ours);
        print_message("%s: %llu bytes are equal\n", name, (unsigned long long)driver.size);
        if (canonical->type == STRUCTURE_TOP)
            assert_instance_boxes_contain(canonical, driver, addresses);
        memory_free(&memory, (void *)(uintptr_t)ours.data);
    } else {
        assert_true(canonical->primitive_count == 0);
    }
    memory_free(&memory, data);
    driver_structure_destroy(gpu, &structure);
    assert_round_trip(name, canonical, addresses);
}

static void prepare_input(const struct build_input *input, struct canonical *ret_canonical)
{
    struct bvhd_error error;
    struct limits limits = limits_default();
    struct build_context context = {.memory = &memory, .parallel = &parallel_serial};
    MUST(prepare(input, 0, &limits, &context, ret_canonical, &error));
}

static void check_input(const char *name, const struct build_input *input, const uint64_t *addresses)
{
    struct canonical canonical;
    prepare_input(input, &canonical);
    check(name, &canonical, addresses);
    prepare_finish(&canonical, &memory);
}

/* ---- Requests ---- */

/* Random triangles. Every ninth coordinate is a zero, and every second of these is negative. */
static float *random_floats(uint64_t seed, uint32_t count)
{
    struct random random = {seed};
    float *floats = allocate(count * sizeof *floats);
    for (uint32_t i = 0; i < count; i++)
        floats[i] = i % 9 == 4 ? (i % 2 ? -0.0f : 0.0f) : (float)random_between(&random, -100, 100);
    return floats;
}

static struct geometry triangles_of(const float *vertices, uint32_t first, uint32_t count, uint32_t flags)
{
    return (struct geometry){
        .type = GEOMETRY_TRIANGLES,
        .flags = flags,
        .triangles = {.vertex_format = VK_FORMAT_R32G32B32_SFLOAT,
                      .max_vertex = count ? 3 * count - 1 : 0,
                      .vertex_stride = 12,
                      .index_type = INDEX_NONE,
                      .vertices = {(const unsigned char *)(vertices + 9 * (size_t)first), 36 * (size_t)count + 12}},
        .range = {.primitive_count = count}};
}

static struct build_input bottom_of(const struct geometry *geometries, uint32_t count)
{
    return (struct build_input){.type = STRUCTURE_BOTTOM,
                                .geometry_count = count,
                                .geometries = geometries,
                                .options = {.target = TARGET_LAVAPIPE, .device = {.variant = LAVAPIPE_PLAIN}}};
}

static void triangles_are_equal(void **state)
{
    (void)state;
    static const uint32_t counts[] = {1, 2, 3, 4, 5, 2000, 50000, 0};
    for (size_t i = 0; i < sizeof counts / sizeof counts[0]; i++) {
        char name[40];
        float *vertices = random_floats(counts[i], 9 * counts[i] + 3);
        struct geometry geometry = triangles_of(vertices, 0, counts[i], GEOMETRY_OPAQUE);
        struct build_input input = bottom_of(&geometry, 1);
        snprintf(name, sizeof name, "%u triangles", counts[i]);
        check_input(name, &input, NULL);
        memory_free(&memory, vertices);
    }
}

static void geometries_are_equal(void **state)
{
    (void)state;
    static const uint32_t counts[] = {7, 0, 1, 300, 12},
                          flags[] = {0, 1, GEOMETRY_OPAQUE, GEOMETRY_NO_DUPLICATE_ANY_HIT, 3};
    struct geometry geometries[5];
    float *vertices = random_floats(11, 9 * 320 + 3);
    for (uint32_t i = 0, first = 0; i < 5; first += counts[i++])
        geometries[i] = triangles_of(vertices, first, counts[i], flags[i]);
    struct build_input input = bottom_of(geometries, 5);
    check_input("five geometries", &input, NULL);
    input.geometry_count = 0;
    check_input("no geometry", &input, NULL);
    memory_free(&memory, vertices);
}

static void order_corners(float *box)
{
    for (int axis = 0; axis < 3; axis++)
        if (box[axis] > box[axis + 3]) {
            float swap = box[axis];
            box[axis] = box[axis + 3];
            box[axis + 3] = swap;
        }
}

static void aabbs_are_equal(void **state)
{
    (void)state;
    static const uint32_t counts[] = {1, 2, 3, 1000};
    for (size_t i = 0; i < sizeof counts / sizeof counts[0]; i++) {
        char name[40];
        struct geometry geometries[2];
        float *boxes = random_floats(counts[i], 12 * counts[i]);
        for (uint32_t k = 0; k < 2 * counts[i]; k++)
            order_corners(boxes + 6 * (size_t)k);
        for (uint32_t g = 0; g < 2; g++)
            geometries[g] = (struct geometry){
                .type = GEOMETRY_AABBS,
                .flags = g ? GEOMETRY_OPAQUE : 0,
                .aabbs = {24, {(const unsigned char *)(boxes + 6 * (size_t)g * counts[i]), 24 * (uint64_t)counts[i]}},
                .range = {.primitive_count = counts[i]}};
        struct build_input input = bottom_of(geometries, counts[i] > 1 ? 2 : 1);
        snprintf(name, sizeof name, "%u boxes", counts[i]);
        check_input(name, &input, NULL);
        memory_free(&memory, boxes);
    }
}

/* ---- Top levels ---- */

struct world {
    struct driver_structure bottoms[BOTTOMS];
    struct reference references[BOTTOMS];
    uint64_t addresses[BOTTOMS];
};

/*
 * Three bottom levels of triangles. None is empty, because an empty one has no serialized bytes, and the driver's has
 * bounds of zeros.
 */
static void make_world(struct world *world)
{
    struct bvhd_error error;
    float *floats = random_floats(5, 9 * 100 + 3);
    for (int i = 0; i < BOTTOMS; i++) {
        struct geometry geometry = triangles_of(floats, 0, 30 * (uint32_t)(i + 1), GEOMETRY_OPAQUE);
        struct build_input input = bottom_of(&geometry, 1);
        struct canonical canonical;
        struct lavapipe_view view;
        unsigned char *data;
        uint64_t size;
        prepare_input(&input, &canonical);
        MUST(driver_structure_build(gpu, &canonical, NULL, &memory, &world->bottoms[i], &error));
        MUST(driver_structure_serialize(gpu, &world->bottoms[i], &memory, &data, &size, &error));
        MUST(open_as_device((struct bytes){data, size}, &view, &error));
        world->references[i] =
            (struct reference){.kind = REFERENCE_BLAS, .handle = world->addresses[i] = world->bottoms[i].address};
        memcpy(&world->references[i].bounds, view.bounds, sizeof view.bounds);
        memory_free(&memory, data);
        prepare_finish(&canonical, &memory);
    }
    memory_free(&memory, floats);
}

/*
 * The canonical copy sorts its references and drops those that no instance uses. This finds the addresses by row, by
 * comparing bounds.
 */
static void map_addresses(const struct world *world, const struct canonical *canonical, uint64_t *ret_addresses)
{
    for (uint32_t row = 0; row < canonical->reference_count; row++)
        for (int i = 0; i < BOTTOMS; i++)
            if (memcmp(&world->references[i].bounds, &canonical->references[row].bounds, sizeof(struct box)) == 0)
                ret_addresses[row] = world->addresses[i];
}

/*
 * A rotation by an eighth of a circle and a small translation, whose entries have equal magnitudes, so that pivots tie.
 */
static void make_ties(struct random *random, float ret_matrix[12])
{
    static const float turn[2][12] = {{1, 1, 0, 0, -1, 1, 0, 0, 0, 0, 1, 0}, {0, 1, 1, 0, 1, 0, 0, 0, 0, -1, 1, 0}};
    memcpy(ret_matrix, turn[random_next(random) % 2], sizeof turn[0]);
    for (int row = 0; row < 3; row++)
        ret_matrix[4 * row + 3] = (float)(random_next(random) % 3) - 1;
}

/*
 * Random matrices: some are mirrored, some have very uneven scales, some have few different values. All flags, masks
 * and offsets occur.
 */
static void fill_record(struct random *random, const struct world *world, bool null, unsigned char *record)
{
    float matrix[12];
    for (int k = 0; k < 12; k++)
        matrix[k] = (float)random_between(random, -1, 1) * (k % 4 == 3 ? 1000 : 1);
    if (random_next(random) % 4 == 0)
        for (int k = 0; k < 12; k++)
            matrix[k] = k % 5 == 0 && k < 11 ? (k ? 2.0f : -1.0f) : k % 4 == 3 ? matrix[k] : 0.0f;
    if (random_next(random) % 4 == 0)
        make_ties(random, matrix);
    memcpy(record, matrix, sizeof matrix);
    bytes_put32(record + 48, (uint32_t)random_next(random));
    /* At most one of the two flags that force opacity is set. */
    uint32_t flags = (uint32_t)random_next(random) & 0xf, both = INSTANCE_FORCE_OPAQUE | INSTANCE_FORCE_NO_OPAQUE;
    flags &= (flags & both) == both ? ~both : ~UINT32_C(0);
    bytes_put32(record + 52, flags << 24 | (uint32_t)(random_next(random) & 0xffffff));
    bytes_put64(record + 56, null ? 0 : world->addresses[random_next(random) % BOTTOMS]);
}

static void check_top(const char *name, const struct world *world, uint32_t count, uint32_t null_step)
{
    struct random random = {count};
    unsigned char *records = allocate(64 * (size_t)count);
    for (uint32_t i = 0; i < count; i++)
        fill_record(&random, world, null_step && i % null_step == 0, records + 64 * (size_t)i);
    struct geometry geometry = {.type = GEOMETRY_INSTANCES,
                                .instances = {{records, 64 * (uint64_t)count}},
                                .range = {.primitive_count = count}};
    struct build_input input = bottom_of(&geometry, 1);
    input.type = STRUCTURE_TOP;
    input.references = world->references;
    input.reference_count = BOTTOMS;
    struct canonical canonical;
    uint64_t addresses[BOTTOMS] = {0};
    prepare_input(&input, &canonical);
    map_addresses(world, &canonical, addresses);
    check(name, &canonical, addresses);
    prepare_finish(&canonical, &memory);
    memory_free(&memory, records);
}

static void top_levels_are_equal(void **state)
{
    (void)state;
    struct world world;
    make_world(&world);
    check_top("1 instance", &world, 1, 0);
    check_top("2 instances", &world, 2, 0);
    check_top("1,000 instances", &world, 1000, 0);
    check_top("1,000 instances, some null", &world, 1001, 7);
    check_top("no instance", &world, 0, 0);
    for (int i = 0; i < BOTTOMS; i++)
        driver_structure_destroy(gpu, &world.bottoms[i]);
}

/* Opens the device whose structures this layout describes. Returns false when it does not exist. */
static bool open_device(void)
{
    struct bvhd_error error;
    memory_init(&memory, UINT64_MAX);
    if (gpu_open("llvmpipe", &memory, &gpu, &error) != BVHD_OK) {
        fprintf(stderr, "skipped: %s: %s\n", error.where, error.text);
        return false;
    }
    if (gpu->properties.has_acceleration_structure)
        return true;
    fprintf(stderr, "skipped: %s builds no acceleration structures\n", gpu->properties.name);
    gpu_close(gpu);
    return false;
}

int main(void)
{
    static const struct CMUnitTest tests[] = {
        cmocka_unit_test(triangles_are_equal),
        cmocka_unit_test(geometries_are_equal),
        cmocka_unit_test(aabbs_are_equal),
        cmocka_unit_test(top_levels_are_equal),
    };
    if (!open_device())
        return SKIPPED;
    int failed = cmocka_run_group_tests(tests, NULL, NULL) + (int)gpu_messages();
    gpu_close(gpu);
    return failed || memory.live != 0;
}
