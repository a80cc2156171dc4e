/* SPDX-License-Identifier: Apache-2.0 */
/* test_summary.c - tests that summaries are read as they were written, and that broken ones are refused. */
#include "tests/support/unit.h"

#include "builder/update/batch.h"
#include "builder/summary.h"
#include "tests/support/builder/random_input.h"

/* Where the three fields lie that are checked. */
enum { AT_TARGET = SUMMARY_SIZE - 12, AT_QUALITY = SUMMARY_SIZE - 8, AT_METHOD = SUMMARY_SIZE - 4 };

static void check_equal(const struct summary *a, const struct summary *b)
{
    assert_int_equal(a->target, b->target);
    assert_int_equal(a->peak_bytes, b->peak_bytes);
    assert_true(a->build_ms == b->build_ms);
    assert_int_equal(a->primitives, b->primitives);
    assert_int_equal(a->triangles, b->triangles);
    assert_int_equal(a->instances, b->instances);
    assert_int_equal(a->inactive, b->inactive);
    assert_int_equal(a->degenerate, b->degenerate);
    assert_int_equal(a->skipped, b->skipped);
    assert_int_equal(a->refs, b->refs);
    assert_int_equal(a->depth, b->depth);
    assert_int_equal(a->quality, b->quality);
    assert_true(a->sah == b->sah);
    assert_string_equal(a->method, b->method);
    assert_memory_equal(&a->bounds, &b->bounds, sizeof a->bounds);
    assert_memory_equal(&a->slabs, &b->slabs, sizeof a->slabs);
}

static void pass_through(const struct summary *summary)
{
    struct summary again;
    unsigned char bytes[SUMMARY_SIZE];
    summary_write(summary, bytes);
    assert_int_equal(summary_read((struct bytes){bytes, sizeof bytes}, &again, NULL), BVHD_OK);
    check_equal(summary, &again);
}

/* Random builds of every quality, among them empty ones, give every method. */
static void what_builds_say_is_kept(void **state)
{
    (void)state;
    bool seen[4] = {false};
    struct random random = {1};
    const struct limits limits = limits_default();
    for (int i = 0; i < 80; i++) {
        struct random_input input;
        struct memory memory;
        struct batch_item item;
        memory_init(&memory, UINT64_MAX);
        const struct build_context context = {.memory = &memory, .parallel = &parallel_serial};
        random_input_bottom(&input, &random, i % 8 == 0 ? 0 : 300);
        input.input.options.quality = (enum build_quality)(QUALITY_FAST + i % 3);
        assert_int_equal(batch_build(&input.input, 1, &limits, &context, &item, NULL), BVHD_OK);
        assert_int_equal(item.status, BVHD_OK);
        assert_int_equal(item.summary.target, input.input.options.target);
        assert_true(item.summary.build_ms == item.build_ms);
        pass_through(&item.summary);
        seen[*item.summary.method == 'n'   ? 0
             : *item.summary.method == 'p' ? 1
             : *item.summary.method == 'b' ? 2
                                           : 3] = true;
        batch_finish(&item, 1, &memory);
        random_input_finish(&input);
    }
    for (int i = 0; i < 4; i++)
        assert_true(seen[i]);
}

static void write_plain(unsigned char ret_bytes[SUMMARY_SIZE])
{
    summary_write(&(struct summary){.target = TARGET_LAVAPIPE, .method = "ploc", .quality = QUALITY_FAST, .sah = 1.5},
                  ret_bytes);
}

static void other_sizes_are_refused(void **state)
{
    (void)state;
    unsigned char bytes[SUMMARY_SIZE + 1] = {0};
    struct summary summary;
    struct bvhd_error error;
    write_plain(bytes);
    for (uint64_t size = 0; size <= SUMMARY_SIZE + 1; size++) {
        enum bvhd_status status = summary_read((struct bytes){bytes, size}, &summary, &error);
        assert_int_equal(status, size == SUMMARY_SIZE ? BVHD_OK : BVHD_CORRUPT);
        if (status != BVHD_OK)
            assert_string_equal(error.where, "summary");
    }
}

static void values_that_do_not_exist_are_refused(void **state)
{
    (void)state;
    static const struct {
        int at;
        uint32_t value;
        const char *where;
    } cases[] = {
        {AT_TARGET, 0, "summary.target"},
        {AT_TARGET, 3, "summary.target"},
        {AT_TARGET, UINT32_MAX, "summary.target"},
        {AT_QUALITY, QUALITY_UNSPECIFIED, "summary.quality"},
        {AT_QUALITY, QUALITY_AUTO, "summary.quality"},
        {AT_QUALITY, UINT32_MAX, "summary.quality"},
        {AT_METHOD, 7, "summary.method"},
        {AT_METHOD, UINT32_MAX, "summary.method"},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        unsigned char bytes[SUMMARY_SIZE];
        struct summary summary;
        struct bvhd_error error;
        write_plain(bytes);
        bytes_put32(bytes + cases[i].at, cases[i].value);
        assert_int_equal(summary_read((struct bytes){bytes, sizeof bytes}, &summary, &error), BVHD_CORRUPT);
        assert_string_equal(error.where, cases[i].where);
    }
}

int main(void)
{
    static const struct CMUnitTest tests[] = {
        cmocka_unit_test(what_builds_say_is_kept),
        cmocka_unit_test(other_sizes_are_refused),
        cmocka_unit_test(values_that_do_not_exist_are_refused),
    };
    return cmocka_run_group_tests_name("summary", tests, NULL, NULL);
}
