/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_refit.c - tests that an update keeps the tree and fits its boxes: it is no build, does not depend on threads,
 * tells its decay, and leaves nothing behind when it fails. tests/integration/random_inputs traces rays through
 * updates.
 */
#include "tests/support/unit.h"

#include "tests/support/builder/refit_world.h"

/* An update with the same geometry gives the same bytes: the boxes are those that the build made. */
static void equal_geometry_gives_equal_bytes(void **state)
{
    (void)state;
    for (enum kind kind = INDEXED; kind < KINDS; kind++) {
        struct world *world = world_of(kind);
        struct built source = build_world(world), updated = update_world(world, &source);
        assert_int_equal(updated.size, source.size);
        for (uint64_t i = 0; i < source.size; i++)
            if (updated.blob[i] != source.blob[i])
                fail_msg("kind %d: byte %llu is %d instead of %d", (int)kind, (unsigned long long)i, updated.blob[i],
                         source.blob[i]);
        assert_true(updated.result.decay == 1);
        assert_int_equal(updated.result.refits, 1);
        assert_memory_equal(&updated.stats.bounds, &source.stats.bounds, sizeof source.stats.bounds);
        assert_memory_equal(&updated.stats.slabs, &source.stats.slabs, sizeof source.stats.slabs);
        assert_int_equal(updated.stats.triangles, source.stats.triangles);
        assert_int_equal(updated.stats.instances, source.stats.instances);
        assert_int_equal(updated.stats.inactive, source.stats.inactive);
        assert_int_equal(updated.stats.refs, source.stats.refs);
        assert_string_equal(updated.stats.method, "refit");
        assert_int_equal(updated.stats.quality, QUALITY_BALANCED);
        built_finish(&updated);
        built_finish(&source);
        world_finish(world);
    }
}

static struct portable_view open_portable(const struct built *built)
{
    struct portable_view view;
    struct bvhd_error error;
    if (portable_open((struct bytes){built->blob, built->size}, &memory, &view, &error) != BVHD_OK)
        fail_msg("%s: %s", error.where, error.text);
    return view;
}

static struct lavapipe_view open_native(const struct built *built)
{
    struct lavapipe_view view;
    struct bvhd_error error;
    if (lavapipe_open_any((struct bytes){built->blob, built->size}, &memory, &view, &error) != BVHD_OK)
        fail_msg("%s: %s", error.where, error.text);
    return view;
}

/* The fields of nodes that say what is where. A rebuild for other geometry has others. */
static void same_topology(const struct built *source, const struct built *updated)
{
    const struct portable_view a = open_portable(source), b = open_portable(updated);
    assert_int_equal(a.header->node_count, b.header->node_count);
    for (uint32_t i = 0; i < a.header->node_count; i++) {
        const struct portable_node *first = portable_node_at(&a, i), *second = portable_node_at(&b, i);
        assert_int_equal(first->first_child, second->first_child);
        assert_int_equal(first->first_record, second->first_record);
        assert_int_equal(first->inner_mask, second->inner_mask);
        assert_memory_equal(first->meta, second->meta, 8);
    }
    if (a.header->content == PORTABLE_INDEXED_TRIANGLES || a.header->content == PORTABLE_MOVING_TRIANGLES)
        assert_memory_equal(a.records, b.records, 16 * (size_t)a.header->record_count);
    if (a.header->content == PORTABLE_SPHERES || a.header->content == PORTABLE_SWEPT_SPHERES)
        assert_memory_equal(a.records, b.records, sizeof(struct portable_round) * a.header->record_count);
}

static void same_references(const struct built *source, const struct built *updated)
{
    const struct lavapipe_view a = open_native(source), b = open_native(updated);
    assert_int_equal(a.body_size, b.body_size);
    assert_int_equal(a.levels, b.levels);
    for (uint32_t at = LAVAPIPE_HEADER; at < a.leaf_offset; at += sizeof(struct lavapipe_box)) {
        const struct lavapipe_box first = lavapipe_box_at(&a, at), second = lavapipe_box_at(&b, at);
        assert_memory_equal(first.children, second.children, sizeof first.children);
    }
}

static void updates_are_refits(void **state)
{
    (void)state;
    for (enum kind kind = INDEXED; kind < KINDS; kind++) {
        struct world *world = world_of(kind);
        struct built source = build_world(world);
        place(world, 6);
        struct built updated = update_world(world, &source), rebuilt = build_world(world);
        if (is_native(kind))
            same_references(&source, &updated);
        else
            same_topology(&source, &updated);
        assert_true(updated.size != rebuilt.size || memcmp(updated.blob, rebuilt.blob, updated.size) != 0);
        assert_memory_equal(&updated.stats.bounds, &rebuilt.stats.bounds, sizeof rebuilt.stats.bounds);
        assert_true(updated.result.decay > 1.05); /* rows turn as a whole, so that strands decay the least */
        built_finish(&rebuilt);
        built_finish(&updated);
        built_finish(&source);
        world_finish(world);
    }
}

/* The decay of a chain is that against the build, and going back undoes it. */
static void chains_count_and_compare_with_the_build(void **state)
{
    (void)state;
    for (enum kind kind = INDEXED; kind < KINDS; kind++) {
        struct world *world = world_of(kind);
        struct built source = build_world(world), last = source;
        for (uint32_t step = 1; step <= 3; step++) {
            place(world, step == 3 ? 0 : 3 * step);
            struct built next = update_world(world, &last);
            assert_int_equal(next.result.refits, step);
            assert_int_equal(next.record.header->refits, step);
            assert_true(next.record.header->cost == source.record.header->cost);
            assert_true((next.result.decay == 1) == (step == 3));
            if (step > 1)
                built_finish(&last);
            last = next;
        }
        assert_int_equal(last.size, source.size);
        assert_memory_equal(last.blob, source.blob, source.size);
        built_finish(&last);
        built_finish(&source);
        world_finish(world);
    }
}

static void threads_do_not_matter(void **state)
{
    struct workers *workers;
    (void)state;
    assert_int_equal(workers_create(5, &workers, NULL), BVHD_OK);
    const struct build_context threads = {.memory = &memory, .parallel = workers_parallel(workers)};
    for (enum kind kind = INDEXED; kind < KINDS; kind++) {
        struct world *world = world_of(kind);
        struct built source = build_world(world), other;
        place(world, 2);
        struct built updated = update_world(world, &source);
        assert_int_equal(try_update(world, &source, &threads, &other, NULL), BVHD_OK);
        assert_int_equal(other.size, updated.size);
        assert_memory_equal(other.blob, updated.blob, updated.size);
        assert_true(other.result.decay == updated.result.decay);
        assert_memory_equal(other.record.bytes.data, updated.record.bytes.data, updated.record.bytes.size);
        built_finish(&other);
        built_finish(&updated);
        built_finish(&source);
        world_finish(world);
    }
    workers_destroy(workers);
}

static void failures_leave_nothing(void **state)
{
    (void)state;
    for (enum kind kind = INDEXED; kind < KINDS; kind++) {
        struct world *world = world_of(kind);
        struct built source = build_world(world), updated;
        struct bvhd_error error;
        const uint64_t live = memory.live;
        struct memory tight;
        enum bvhd_status status = BVHD_NO_MEMORY;
        for (int64_t after = 0; status != BVHD_OK; after++) {
            memory_init_within(&tight, &memory, UINT64_MAX);
            tight.fail_after = after;
            const struct build_context context = {.memory = &tight, .parallel = &parallel_serial};
            status = try_update(world, &source, &context, &updated, &error);
            assert_true(status == BVHD_OK || (status == BVHD_NO_MEMORY && tight.live == 0));
            assert_true(after < 20);
        }
        record_finish(&updated.record, &tight);
        memory_free(&tight, updated.blob);
        atomic_bool cancel = true;
        const struct build_context context = {.memory = &memory, .parallel = &parallel_serial, .cancel = &cancel};
        assert_int_equal(try_update(world, &source, &context, &updated, &error), BVHD_CANCELLED);
        assert_int_equal(memory.live, live);
        built_finish(&source);
        world_finish(world);
    }
}

/* Changes one byte of the source. The result is a status, and what is made of it can be opened or is told apart. */
static void foreign_sources_are_safe(void **state)
{
    (void)state;
    for (enum kind kind = INDEXED; kind < KINDS; kind++) {
        struct random random = {4711};
        struct world *world = world_of(kind);
        struct built source = build_world(world), updated;
        uint32_t refused = 0;
        for (int round = 0; round < 60; round++) {
            const uint64_t at = round < 30 ? random_next(&random) % 400 : random_next(&random) % source.size;
            const unsigned char before = source.blob[at];
            struct bvhd_error error = {.where = "", .text = ""};
            source.blob[at] ^= (unsigned char)(1 + random_next(&random) % 255);
            enum bvhd_status status = try_update(world, &source, &serial, &updated, &error);
            source.blob[at] = before;
            if (status == BVHD_OK) {
                built_finish(&updated);
                continue;
            }
            refused++;
            assert_true(status == BVHD_CORRUPT || status == BVHD_INCOMPATIBLE);
            assert_true(error.where[0] && error.text[0]);
        }
        assert_true(refused > 5);
        for (uint64_t size = 0; size < source.size; size += 1 + size / 3) {
            struct built cut = source;
            struct bvhd_error error;
            cut.size = size;
            assert_int_equal(try_update(world, &cut, &serial, &updated, &error), BVHD_CORRUPT);
        }
        built_finish(&source);
        world_finish(world);
    }
}

/* Changes the boxes of a node to those with minimum and maximum exchanged along x, and flat along y. */
static void invert(uint8_t lo[3][8], uint8_t hi[3][8])
{
    for (int slot = 0; slot < 8; slot++) {
        const uint8_t before = lo[0][slot];
        lo[0][slot] = hi[0][slot];
        hi[0][slot] = before;
        hi[1][slot] = lo[1][slot];
    }
}

/* Inverts all boxes of a structure, at both ends of one that moves. */
static void invert_all(const struct built *built)
{
    const struct portable_view view = open_portable(built);
    for (uint32_t i = 0; i < view.header->node_count; i++) {
        struct portable_moving_node *node = (void *)(uintptr_t)portable_node_at(&view, i);
        invert(node->start.lo, node->start.hi);
        if (view.node_size == sizeof *node)
            invert(node->end_lo, node->end_hi);
    }
}

/* Boxes whose minimum is above their maximum give a tree a negative cost, which no build does. */
static void inverted_boxes_have_no_cost(void **state)
{
    static const enum kind kinds[] = {INDEXED, MOVING};
    (void)state;
    for (int i = 0; i < 2; i++) {
        struct world *world = world_of(kinds[i]);
        struct built source = build_world(world);
        struct bvhd_error error;
        invert_all(&source);
        assert_int_equal(
            refit_measure((struct bytes){source.blob, source.size}, &source.stats, &serial, &source.record, &error),
            BVHD_CORRUPT);
        assert_string_equal(error.where, "nodes");
        built_finish(&source);
        world_finish(world);
    }
}

static void forget_reference(struct world *world, int instance)
{
    unsigned char *moving = world->moving_instances[instance];
    memset(world->instances[instance] + 56, 0, 8);
    memset(moving + canonical_record_fields(GEOMETRY_MOVING_INSTANCES, moving) + 8, 0, 8);
}

/* Structures without any primitive that a ray can hit stay so. */
static void empty_structures_stay_empty(void **state)
{
    (void)state;
    for (enum kind kind = INDEXED; kind < KINDS; kind++) {
        struct world *world = world_of(kind);
        for (int i = 0; i < VERTICES; i++)
            world->vertices[i][0] = NAN;
        for (int i = 0; i < TRIANGLES; i++)
            world->corners[i][1][0] = NAN;
        for (int i = 0; i < BOXES; i++)
            world->boxes[i][0] = NAN;
        for (int i = 0; i < INSTANCES; i++)
            forget_reference(world, i);
        struct built source = build_world(world);
        world->vertices[0][1] = 7;
        struct built updated = update_world(world, &source);
        assert_true(updated.result.decay == 1);
        assert_int_equal(updated.stats.refs, 0);
        assert_int_equal(updated.size, source.size);
        if (is_native(kind))
            open_native(&updated);
        else
            open_portable(&updated);
        built_finish(&updated);
        built_finish(&source);
        world_finish(world);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(equal_geometry_gives_equal_bytes),
        cmocka_unit_test(updates_are_refits),
        cmocka_unit_test(chains_count_and_compare_with_the_build),
        cmocka_unit_test(threads_do_not_matter),
        cmocka_unit_test(failures_leave_nothing),
        cmocka_unit_test(foreign_sources_are_safe),
        cmocka_unit_test(inverted_boxes_have_no_cost),
        cmocka_unit_test(empty_structures_stay_empty),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
