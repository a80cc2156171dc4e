/* SPDX-License-Identifier: Apache-2.0 */
/* test_lavapipe_write.c - tests that structures of the lavapipe layout hold exactly what was requested. */
#include "tests/support/unit.h"

#include <math.h>

#include "builder/format/lavapipe.h"
#include "builder/format/lavapipe_write.h"
#include "builder/format/serialized.h"
#include "tests/support/builder/test_blob.h"
#include "builder/workers.h"

/* A structure that was written and opened. */
struct written {
    struct memory memory;
    unsigned char *blob;
    struct layout_sizes sizes;
    struct lavapipe_view view;
    uint8_t *seen; /* for each leaf: how many boxes refer to it */
    uint32_t *places; /* the boxes in depth-first order, the first child first */
    uint32_t place_count;
};

static void write_model(const struct test_model *model, enum lavapipe_variant variant, struct written *written)
{
    struct bvhd_error error;
    memset(written, 0, sizeof *written);
    memory_init(&written->memory, UINT64_MAX);
    test_blob_dirty_heap(model->canonical.primitive_count * UINT64_C(110));
    assert_int_equal(test_blob_write_native(model, variant, &written->memory, &parallel_serial, &written->blob,
                                            &written->sizes, &error),
                     BVHD_OK);
    assert_int_equal((uintptr_t)written->blob % 64, 0);
    struct bytes bytes = {written->blob, written->sizes.total};
    if (lavapipe_open(bytes, variant, &written->memory, &written->view, &error) != BVHD_OK)
        fail_msg("%s: %s", error.where, error.text);
    written->seen = calloc(model->canonical.primitive_count + 1, 1);
    written->places = calloc(written->view.leaf_offset / 56 + 1, sizeof *written->places);
    assert_true(written->seen && written->places);
}

static void written_finish(struct written *written)
{
    memory_free(&written->memory, written->blob);
    free(written->seen);
    free(written->places);
    assert_int_equal(written->memory.live, 0);
}

static enum lavapipe_kind kind_for(uint32_t type)
{
    return type == GEOMETRY_TRIANGLES ? LAVAPIPE_TRIANGLE : type == GEOMETRY_AABBS ? LAVAPIPE_AABB : LAVAPIPE_INSTANCE;
}

static float padded(float value, double sign, enum lavapipe_variant variant)
{
    double magnitude = fabs((double)value) > 1 ? fabs((double)value) : 1;
    return variant == LAVAPIPE_COMPACTED
               ? (float)((double)value + sign * (double)(float)(magnitude * (double)FLT_EPSILON))
               : value;
}

/* Checks that a child's box equals `box` in the one variant, and is larger by the margin in the other. */
static void assert_child_box(const struct lavapipe_box *node, int child, const struct box *box,
                             enum lavapipe_variant variant)
{
    for (int axis = 0; axis < 3; axis++) {
        assert_true(node->bounds[child].min[axis] == padded(box->min[axis], -1, variant));
        assert_true(node->bounds[child].max[axis] == padded(box->max[axis], 1, variant));
    }
}

static void assert_absent(const struct lavapipe_box *node, int child, enum lavapipe_variant variant)
{
    assert_int_equal(node->children[child], LAVAPIPE_NONE);
    for (int axis = 0; axis < 3; axis++)
        if (variant == LAVAPIPE_COMPACTED)
            assert_true(isnan(node->bounds[child].min[axis]) && isnan(node->bounds[child].max[axis]));
        else
            assert_true(node->bounds[child].min[axis] == INFINITY && node->bounds[child].max[axis] == -INFINITY);
}

/* Checks that each child's box is exactly the union of everything below it, which it returns. */
static struct box walk(const struct test_model *model, struct written *written, uint32_t offset)
{
    const struct lavapipe_view *view = &written->view;
    struct lavapipe_box node = lavapipe_box_at(view, offset);
    struct box bounds = box_empty();
    written->places[written->place_count++] = (offset - LAVAPIPE_HEADER) / 56;
    for (int child = 0; child < 2; child++) {
        uint32_t reference = node.children[child];
        struct box below;
        if (reference == LAVAPIPE_NONE) {
            assert_absent(&node, child, (enum lavapipe_variant)view->device.variant);
            continue;
        }
        if ((reference & 3) == LAVAPIPE_BOX) {
            below = walk(model, written, reference & ~3u);
        } else {
            uint32_t leaf = lavapipe_leaf_index(view, reference);
            written->seen[leaf]++;
            below = model->boxes[leaf];
        }
        assert_child_box(&node, child, &below, (enum lavapipe_variant)view->device.variant);
        box_grow(&bounds, &below);
    }
    return bounds;
}

static void check_tree(const struct test_model *model, struct written *written)
{
    uint32_t active = 0, all = model->canonical.primitive_count;
    struct box bounds = walk(model, written, LAVAPIPE_HEADER), zeros = {{0, 0, 0}, {0, 0, 0}};
    for (uint32_t i = 0; i < all; i++) {
        assert_int_equal(written->seen[i], !box_is_empty(&model->boxes[i]));
        active += written->seen[i];
    }
    assert_memory_equal(active ? &bounds : &zeros, written->view.bounds, sizeof bounds);
    assert_int_equal(written->place_count, active < 2 ? 1 : active - 1);
    for (uint32_t i = 0; i < written->place_count; i++)
        assert_int_equal(written->places[i], i); /* there are no gaps, and first children follow their parents */
}

/* The sizes are the driver's own, with room for an update in which all primitives are active. */
static void check_sizes(const struct test_model *model, const struct written *written)
{
    uint32_t n = model->canonical.primitive_count, kind = kind_for(model->canonical.geometries[0].type);
    uint32_t leaf_size = kind == LAVAPIPE_TRIANGLE ? 48
                         : kind == LAVAPIPE_AABB   ? 32
                                                   : 120,
             leaves = 40 + 56 * (n > 1 ? n - 1 : 1);
    uint32_t body = leaves + leaf_size * n, handles = kind == LAVAPIPE_INSTANCE ? n : 0,
             variant = written->view.device.variant;
    if (variant == LAVAPIPE_COMPACTED)
        body = 40 + (body - 40 + 55) / 56 * 56;
    const uint32_t total = 56 + 8 * handles + body;
    const uint32_t plain[4] = {total, handles, leaves, 0}, compacted[4] = {body, total, handles, leaves};
    assert_int_equal(written->sizes.total, total);
    assert_int_equal(written->sizes.header + written->sizes.nodes + written->sizes.records, total);
    assert_int_equal(bytes_get64(written->blob + 32), total);
    assert_int_equal(bytes_get64(written->blob + 40), body);
    assert_int_equal(bytes_get64(written->blob + 48), handles);
    assert_memory_equal(written->blob, "driver\0\0\0\0\0\0\0\0\0", 16);
    assert_memory_equal(written->blob + 16, "compatibility\0\0", 16);
    assert_memory_equal(written->view.body + 24, variant == LAVAPIPE_COMPACTED ? compacted : plain, 16);
    assert_true(written->view.levels >= 1 && written->view.levels <= LAVAPIPE_MAX_LEVELS);
}

static void check_leaf(const struct test_model *model, const struct written *written, uint32_t id)
{
    const struct canonical *canonical = &model->canonical;
    uint32_t g = canonical_geometry_of(canonical, id), index = id - canonical->geometries[g].first_primitive;
    uint32_t flags = g % 2 ? g : g | LAVAPIPE_GEOMETRY_OPAQUE;
    if (canonical->geometries[g].type == GEOMETRY_TRIANGLES) {
        struct lavapipe_triangle leaf = lavapipe_triangle_at(&written->view, id);
        float corners[3][3];
        canonical_triangle(&canonical->geometries[g], index, corners);
        assert_memory_equal(leaf.corners, corners, sizeof corners);
        assert_int_equal(leaf.primitive, index);
        assert_int_equal(leaf.geometry_and_flags, flags);
        assert_int_equal(leaf.padding, 0);
    } else if (canonical->geometries[g].type == GEOMETRY_AABBS) {
        struct lavapipe_aabb leaf = lavapipe_aabb_at(&written->view, id);
        assert_memory_equal(leaf.min, canonical->geometries[g].boxes + 6 * (size_t)index, 24);
        assert_int_equal(leaf.primitive, index);
        assert_int_equal(leaf.geometry_and_flags, flags);
    } else {
        struct lavapipe_instance leaf = lavapipe_instance_at(&written->view, id);
        struct canonical_instance instance = canonical_instance(&canonical->geometries[0], index);
        float inverse[12];
        lavapipe_invert(instance.transform, inverse);
        assert_memory_equal(leaf.object_to_world, instance.transform, sizeof instance.transform);
        assert_memory_equal(leaf.world_to_object, inverse, sizeof inverse);
        assert_int_equal(leaf.instance, index);
        assert_int_equal(leaf.custom_and_mask, instance.custom_index | instance.mask << 24);
        assert_int_equal(leaf.address, instance.reference);
        assert_int_equal(bytes_get64(written->view.handles + 8 * (size_t)id), instance.reference);
    }
}

static void structures_are_as_defined(void **state)
{
    (void)state;
    static const struct test_shape inactive = {
        .type = GEOMETRY_TRIANGLES, .geometries = 2, .primitives = 20, .size = 1, .detail = 0.05, .inactive = 1};
    for (int i = 0; i < 2 * TEST_BLOB_SHAPES + 2; i++) {
        struct test_model model;
        struct written written;
        test_model_make(i / 2 < TEST_BLOB_SHAPES ? &test_blob_shapes[i / 2] : &inactive, 3 + (uint64_t)i, &model);
        write_model(&model, i % 2 ? LAVAPIPE_COMPACTED : LAVAPIPE_PLAIN, &written);
        check_tree(&model, &written);
        check_sizes(&model, &written);
        for (uint32_t id = 0; id < model.canonical.primitive_count; id++)
            check_leaf(&model, &written, id);
        written_finish(&written);
        test_model_finish(&model);
    }
}

static void an_empty_structure_is_96_bytes(void **state)
{
    (void)state;
    static const struct test_shape nothing = {
        .type = GEOMETRY_TRIANGLES, .geometries = 1, .primitives = 0, .size = 1, .detail = 1};
    static const unsigned char zeros[24];
    for (int variant = 1; variant <= LAVAPIPE_VARIANTS; variant++) {
        struct test_model model;
        struct written written;
        test_model_make(&nothing, 1, &model);
        write_model(&model, (enum lavapipe_variant)variant, &written);
        assert_int_equal(written.view.body_size, 96);
        assert_int_equal(written.view.leaf_offset, 96);
        assert_int_equal(written.view.levels, 1);
        struct lavapipe_box root = lavapipe_box_at(&written.view, LAVAPIPE_HEADER);
        assert_absent(&root, 0, (enum lavapipe_variant)variant);
        assert_absent(&root, 1, (enum lavapipe_variant)variant);
        assert_memory_equal(written.view.body, zeros, 24);
        written_finish(&written);
        test_model_finish(&model);
    }
}

/* The gaps between boxes and leaves, and behind the leaves, are zero, as the driver's memory is before it builds. */
static void what_is_not_used_is_zero(void **state)
{
    (void)state;
    static const struct test_shape few = {
        .type = GEOMETRY_AABBS, .geometries = 2, .primitives = 30, .size = 1, .detail = 0.1, .inactive = 3};
    for (int variant = 1; variant <= LAVAPIPE_VARIANTS; variant++) {
        struct test_model model;
        struct written written;
        test_model_make(&few, 1, &model);
        write_model(&model, (enum lavapipe_variant)variant, &written);
        const struct lavapipe_view *view = &written.view;
        assert_int_equal(view->leaf_offset, 40 + 56 * 59);
        for (uint32_t i = 40 + 56 * 39; i < view->leaf_offset; i++)
            assert_int_equal(view->body[i], 0);
        uint64_t end = view->leaf_offset + 32 * 60;
        assert_int_equal(view->body_size - end, variant == LAVAPIPE_COMPACTED ? 40 : 0);
        for (uint64_t i = end; i < view->body_size; i++)
            assert_int_equal(view->body[i], 0);
        written_finish(&written);
        test_model_finish(&model);
    }
}

static const float with_zeros[3][3] = {{-0.0f, 1, -0.0f}, {-1, -0.0f, 0.0f}, {-2, -3, -0.0f}};

static bool is_negative_zero(float value)
{
    return value == 0 && signbit(value);
}

/* The earlier driver computes 0 + 1 * x, the later one stores x. */
static void negative_zeros_are_the_drivers(void **state)
{
    (void)state;
    for (int variant = 1; variant <= LAVAPIPE_VARIANTS; variant++) {
        struct box box = {{-2, -3, -0.0f}, {-0.0f, 1, 0}};
        struct canonical_geometry geometry = {
            .type = GEOMETRY_TRIANGLES, .primitive_count = 1, .vertex_count = 3, .positions = with_zeros[0]};
        struct test_model model = {.canonical = {.type = STRUCTURE_BOTTOM,
                                                 .geometry_count = 1,
                                                 .primitive_count = 1,
                                                 .vertex_count = 3,
                                                 .geometries = &geometry},
                                   .boxes = &box};
        struct written written;
        write_model(&model, (enum lavapipe_variant)variant, &written);
        struct lavapipe_triangle leaf = lavapipe_triangle_at(&written.view, 0);
        bool plain = variant == LAVAPIPE_PLAIN;
        for (int k = 0; k < 9; k++)
            assert_int_equal(is_negative_zero(leaf.corners[k / 3][k % 3]),
                             !plain && is_negative_zero(with_zeros[k / 3][k % 3]));
        assert_int_equal(is_negative_zero(written.view.bounds[2]), !plain);
        struct lavapipe_box root = lavapipe_box_at(&written.view, LAVAPIPE_HEADER);
        for (int axis = 0; plain && axis < 3; axis++)
            assert_false(is_negative_zero(root.bounds[0].min[axis]) || is_negative_zero(root.bounds[0].max[axis]));
        written_finish(&written);
    }
}

/* The zeros of AABBs are copied with their signs. */
static void negative_zeros_of_boxes_stay(void **state)
{
    (void)state;
    static const float boxes[6] = {-1, -0.0f, -2, -0.0f, 0.0f, 3};
    struct box box;
    memcpy(&box, boxes, sizeof box);
    struct canonical_geometry geometry = {.type = GEOMETRY_AABBS, .primitive_count = 1, .boxes = boxes};
    struct test_model model = {
        .canonical = {.type = STRUCTURE_BOTTOM, .geometry_count = 1, .primitive_count = 1, .geometries = &geometry},
        .boxes = &box};
    struct written written;
    write_model(&model, LAVAPIPE_PLAIN, &written);
    struct lavapipe_aabb leaf = lavapipe_aabb_at(&written.view, 0);
    assert_memory_equal(leaf.min, boxes, sizeof boxes);
    assert_memory_equal(lavapipe_box_at(&written.view, LAVAPIPE_HEADER).bounds, boxes, sizeof boxes);
    assert_memory_equal(written.view.bounds, boxes, sizeof boxes);
    written_finish(&written);
}

/*
 * The leaves behind a null instance move up and keep their instance numbers. Its handle is missing, and the space of
 * its leaf stays at the end.
 */
static void null_instances_have_no_leaf(void **state)
{
    (void)state;
    static const struct test_shape shape = {
        .type = GEOMETRY_INSTANCES, .geometries = 1, .primitives = 10, .size = 1, .detail = 0.1, .inactive = 3};
    struct test_model model;
    struct written written;
    test_model_make(&shape, 1, &model);
    for (size_t i = 0; i < 10; i += 3)
        memset((unsigned char *)(uintptr_t)model.canonical.geometries[0].instances + 64 * i + 56, 0, 8);
    write_model(&model, LAVAPIPE_PLAIN, &written);
    assert_int_equal(written.view.handle_count, 6);
    assert_int_equal(written.view.leaf_count, 6);
    assert_int_equal(written.view.body_size, 40 + 56 * 9 + 120 * 10);
    static const uint32_t kept[6] = {1, 2, 4, 5, 7, 8};
    for (uint32_t i = 0; i < 6; i++) {
        struct lavapipe_instance leaf = lavapipe_instance_at(&written.view, i);
        assert_int_equal(leaf.instance, kept[i]);
        assert_int_equal(bytes_get64(written.view.handles + 8 * (size_t)i), leaf.address);
    }
    written_finish(&written);
    test_model_finish(&model);
}

static void flags_of_instances_are_the_drivers(void **state)
{
    (void)state;
    static const struct {
        uint32_t vulkan, driver;
    } flags[] = {{0, LAVAPIPE_NOT_FORCE_NO_OPAQUE},
                 {INSTANCE_CULL_DISABLE, LAVAPIPE_NOT_FORCE_NO_OPAQUE | LAVAPIPE_CULL_DISABLE},
                 {INSTANCE_FLIP_FACING, LAVAPIPE_NOT_FORCE_NO_OPAQUE | LAVAPIPE_FLIP_FACING},
                 {INSTANCE_FORCE_OPAQUE, LAVAPIPE_NOT_FORCE_NO_OPAQUE | LAVAPIPE_FORCE_OPAQUE},
                 {INSTANCE_FORCE_NO_OPAQUE, 0}};
    static const struct test_shape shape = {
        .type = GEOMETRY_INSTANCES, .geometries = 1, .primitives = 5, .size = 1, .detail = 0.1};
    struct test_model model;
    struct written written;
    test_model_make(&shape, 1, &model);
    for (size_t i = 0; i < 5; i++)
        bytes_put32((unsigned char *)(uintptr_t)model.canonical.geometries[0].instances + 64 * i + 52,
                    flags[i].vulkan << 24 | (0xabcd00 + (uint32_t)i));
    write_model(&model, LAVAPIPE_PLAIN, &written);
    for (uint32_t i = 0; i < 5; i++)
        assert_int_equal(lavapipe_instance_at(&written.view, i).sbt_and_flags, flags[i].driver | (0xabcd00 + i));
    written_finish(&written);
    test_model_finish(&model);
}

/*
 * In a tree with a primitive in two leaves, as spatial splits make them, the body grows by one box and the leaves do
 * not grow.
 */
static void parts_of_a_primitive_share_its_leaf(void **state)
{
    (void)state;
    float positions[6][3] = {{0, 0, 0}, {8, 0, 0}, {0, 1, 0}, {9, 0, 0}, {9, 2, 0}, {9, 0, 2}};
    struct canonical_geometry geometry = {
        .type = GEOMETRY_TRIANGLES, .primitive_count = 2, .vertex_count = 6, .positions = positions[0]};
    struct canonical canonical = {.type = STRUCTURE_BOTTOM,
                                  .geometry_count = 1,
                                  .primitive_count = 2,
                                  .vertex_count = 6,
                                  .geometries = &geometry};
    struct box boxes[5] = {{{0, 0, 0}, {9, 2, 2}},
                           {{0, 0, 0}, {4, 1, 0}},
                           {{4, 0, 0}, {9, 2, 2}},
                           {{4, 0, 0}, {8, 0.5f, 0}},
                           {{9, 0, 0}, {9, 2, 2}}};
    struct ir_node nodes[5] = {{1, 0}, {0, 1}, {3, 0}, {1, 1}, {2, 1}};
    uint32_t refs[3] = {0, 0, 1};
    struct ir ir = {.node_count = 5, .ref_count = 3, .key_count = 1, .nodes = nodes, .boxes = {boxes}, .refs = refs};
    const struct device_format device = {.variant = LAVAPIPE_PLAIN};
    struct memory memory;
    memory_init(&memory, UINT64_MAX);
    const struct layout_input input = {
        .canonical = &canonical, .ir = &ir, .device = &device, .memory = &memory, .parallel = &parallel_serial};
    unsigned char *blob;
    struct layout_sizes sizes;
    struct lavapipe_view view;
    assert_int_equal(layout_lavapipe.write(&input, &blob, &sizes, NULL), BVHD_OK);
    assert_int_equal(sizes.total, 56 + 40 + 2 * 56 + 2 * 48);
    assert_int_equal(lavapipe_open((struct bytes){blob, sizes.total}, LAVAPIPE_PLAIN, &memory, &view, NULL), BVHD_OK);
    struct lavapipe_box root = lavapipe_box_at(&view, 40), below = lavapipe_box_at(&view, 96);
    assert_int_equal(root.children[0], view.leaf_offset);
    assert_int_equal(root.children[1], 96 | LAVAPIPE_BOX);
    assert_int_equal(below.children[0], view.leaf_offset);
    assert_int_equal(below.children[1], view.leaf_offset + 48);
    assert_memory_equal(&root.bounds[0], &boxes[1], sizeof boxes[1]);
    assert_memory_equal(&below.bounds[0], &boxes[3], sizeof boxes[3]);
    memory_free(&memory, blob);
    assert_int_equal(memory.live, 0);
}

static void bytes_do_not_depend_on_threads(void **state)
{
    (void)state;
    static const unsigned threads[] = {1, 2, 8};
    static const struct test_shape large[] = {
        {.type = GEOMETRY_TRIANGLES, .geometries = 3, .primitives = 20000, .size = 10, .detail = 0.01, .inactive = 11},
        {.type = GEOMETRY_INSTANCES, .geometries = 1, .primitives = 20000, .size = 10, .detail = 0.01}};
    for (int i = 0; i < 2; i++) {
        struct test_model model;
        struct written serial;
        test_model_make(&large[i], 5, &model);
        write_model(&model, LAVAPIPE_PLAIN, &serial);
        for (int t = 0; t < 3; t++) {
            struct workers *workers;
            struct layout_sizes sizes;
            unsigned char *blob;
            assert_int_equal(workers_create(threads[t], &workers, NULL), BVHD_OK);
            assert_int_equal(test_blob_write_native(&model, LAVAPIPE_PLAIN, &serial.memory, workers_parallel(workers),
                                                    &blob, &sizes, NULL),
                             BVHD_OK);
            assert_int_equal(sizes.total, serial.sizes.total);
            assert_memory_equal(blob, serial.blob, sizes.total);
            memory_free(&serial.memory, blob);
            workers_destroy(workers);
        }
        written_finish(&serial);
        test_model_finish(&model);
    }
}

/* Counts that do not fit 24 bits, or sizes that do not fit 32 bits, are refused before anything is written. */
static void too_many_are_refused(void **state)
{
    (void)state;
    struct canonical_geometry geometry = {.type = GEOMETRY_TRIANGLES, .primitive_count = 1 << 24};
    struct canonical canonical = {
        .type = STRUCTURE_BOTTOM, .geometry_count = 1, .primitive_count = 1 << 24, .geometries = &geometry};
    struct ir ir = {.key_count = 1};
    const struct device_format device = {.variant = LAVAPIPE_PLAIN};
    struct memory memory;
    memory_init(&memory, 1000);
    const struct layout_input input = {
        .canonical = &canonical, .ir = &ir, .device = &device, .memory = &memory, .parallel = &parallel_serial};
    unsigned char *blob = NULL;
    struct layout_sizes sizes;
    struct bvhd_error error;
    assert_int_equal(layout_lavapipe.write(&input, &blob, &sizes, &error), BVHD_TOO_LARGE);
    assert_string_equal(error.where, "primitives");
    canonical.primitive_count = geometry.primitive_count = (1 << 24) - 1;
    assert_int_equal(layout_lavapipe.write(&input, &blob, &sizes, &error), BVHD_NO_MEMORY);
    canonical.geometry_count = 1 << 24;
    assert_int_equal(layout_lavapipe.write(&input, &blob, &sizes, &error), BVHD_TOO_LARGE);
    assert_string_equal(error.where, "geometries");
    canonical.geometry_count = 1;
    ir.node_count = 160000000; /* 80 million boxes */
    assert_int_equal(lavapipe_write_at(&input, NULL, &blob, &sizes, &error), BVHD_TOO_LARGE);
    assert_string_equal(error.where, "blob");
    assert_null(blob);
    assert_int_equal(memory.live, 0);
}

struct test_output {
    struct build_output output;
    unsigned char *bytes;
    int given, taken;
};

static unsigned char *give(struct build_output *self, uint64_t size)
{
    struct test_output *output = (struct test_output *)self;
    void *block = NULL;
    output->given++;
    assert_int_equal(posix_memalign(&block, 64, size), 0);
    return output->bytes = block;
}

static void take(struct build_output *self, unsigned char *bytes)
{
    struct test_output *output = (struct test_output *)self;
    assert_ptr_equal(bytes, output->bytes);
    output->taken++;
    free(bytes);
}

/* A parallel that sets the build's cancel flag after a number of calls. */
struct cancelling {
    struct parallel parallel;
    int calls;
    atomic_bool *cancel;
};

static void run_and_cancel(const struct parallel *self, size_t count, parallel_task task, void *context)
{
    struct cancelling *cancelling = (struct cancelling *)(uintptr_t)self;
    parallel_serial.for_each(&parallel_serial, count, task, context);
    if (cancelling->calls-- == 0)
        atomic_store(cancelling->cancel, true);
}

static void a_cancelled_output_is_given_back(void **state)
{
    (void)state;
    struct test_model model;
    struct memory memory;
    struct ir ir;
    struct layout_sizes sizes;
    const struct device_format device = {.variant = LAVAPIPE_PLAIN};
    memory_init(&memory, UINT64_MAX);
    test_model_make(&test_blob_shapes[2], 1, &model);
    assert_int_equal(test_ir_make(model.boxes, model.canonical.primitive_count, 1, &memory, &ir), BVHD_OK);
    uint64_t live = memory.live;
    for (int calls = 0; calls < 3; calls++) {
        atomic_bool cancel = false;
        struct cancelling cancelling = {{1, run_and_cancel}, calls, &cancel};
        struct test_output output = {.output = {give, take}};
        const struct layout_input input = {.canonical = &model.canonical,
                                           .ir = &ir,
                                           .device = &device,
                                           .memory = &memory,
                                           .parallel = &cancelling.parallel,
                                           .cancel = &cancel,
                                           .output = &output.output};
        unsigned char *blob = NULL;
        enum bvhd_status status = layout_lavapipe.write(&input, &blob, &sizes, NULL);
        /* there are two calls: for boxes and for leaves */
        assert_int_equal(status, calls < 2 ? BVHD_CANCELLED : BVHD_OK);
        assert_int_equal(output.given, 1);
        assert_int_equal(output.taken, calls < 2);
        assert_int_equal(memory.live, live);
        if (status == BVHD_OK)
            free(blob);
        cancel = true;
        assert_int_equal(layout_lavapipe.write(&input, &blob, &sizes, NULL), BVHD_CANCELLED);
        assert_int_equal(output.given, output.taken + (calls == 2));
    }
    ir_finish(&ir);
    test_model_finish(&model);
}

static void failing_allocations_leave_nothing(void **state)
{
    (void)state;
    struct test_model model;
    struct memory memory;
    struct layout_sizes sizes;
    unsigned char *blob;
    test_model_make(&test_blob_shapes[TEST_BLOB_SHAPES - 1], 1, &model);
    /* Instance 0 becomes a null instance. */
    memset((unsigned char *)(uintptr_t)model.canonical.geometries[0].instances + 56, 0, 8);
    memory_init(&memory, UINT64_MAX);
    int failures = 0;
    for (;; failures++) {
        memory.fail_after = failures;
        enum bvhd_status status =
            test_blob_write_native(&model, LAVAPIPE_PLAIN, &memory, &parallel_serial, &blob, &sizes, NULL);
        if (status == BVHD_OK)
            break;
        assert_int_equal(status, BVHD_NO_MEMORY);
        assert_int_equal(memory.live, 0);
    }
    assert_true(failures >= 6); /* three arrays of the tree, the places of boxes and of instances, the blob */
    memory.fail_after = -1;
    memory_free(&memory, blob);
    assert_int_equal(memory.live, 0);
    test_model_finish(&model);
}

int main(void)
{
    static const struct CMUnitTest tests[] = {
        cmocka_unit_test(structures_are_as_defined),          cmocka_unit_test(an_empty_structure_is_96_bytes),
        cmocka_unit_test(what_is_not_used_is_zero),           cmocka_unit_test(negative_zeros_are_the_drivers),
        cmocka_unit_test(negative_zeros_of_boxes_stay),       cmocka_unit_test(null_instances_have_no_leaf),
        cmocka_unit_test(flags_of_instances_are_the_drivers), cmocka_unit_test(parts_of_a_primitive_share_its_leaf),
        cmocka_unit_test(bytes_do_not_depend_on_threads),     cmocka_unit_test(too_many_are_refused),
        cmocka_unit_test(a_cancelled_output_is_given_back),   cmocka_unit_test(failing_allocations_leave_nothing),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
