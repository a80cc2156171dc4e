/* SPDX-License-Identifier: Apache-2.0 */
/*
 * prepare_bed.h - prepares the requests of inputs.h and compares the canonical copies. For unit tests of prepare, which
 * include tests/support/unit.h first. Requests are entry 2 of their batch, so that places begin with "infos[2]".
 */
#ifndef BVHD_TEST_PREPARE_BED_H
#define BVHD_TEST_PREPARE_BED_H

#include "builder/input/prepare.h"
#include "tests/support/builder/inputs.h"

static struct memory bed_memory = {.limit = UINT64_MAX, .fail_after = -1};
static const struct build_context bed_context = {.memory = &bed_memory, .parallel = &parallel_serial};

static inline enum bvhd_status bed_try(const struct test_input *test, struct canonical *ret_canonical,
                                       struct bvhd_error *error)
{
    struct limits limits = limits_default();
    return prepare(&test->input, 2, &limits, &bed_context, ret_canonical, error);
}

static inline struct canonical bed_make(const struct test_input *test)
{
    struct canonical canonical;
    struct bvhd_error error;
    if (bed_try(test, &canonical, &error) != BVHD_OK)
        fail_msg("%s at %s: %s", bvhd_vuid_string(error.vuid), error.where, error.text);
    return canonical;
}

/* Checks that the request is refused with this rule and place, and that nothing is held. */
static inline void bed_refuse(const struct test_input *test, enum bvhd_status want, const char *vuid, const char *where)
{
    struct canonical canonical;
    struct bvhd_error error;
    assert_int_equal(bed_try(test, &canonical, &error), want);
    assert_string_equal(bvhd_vuid_string(error.vuid), vuid);
    assert_string_equal(error.where, where);
    assert_int_equal(bed_memory.live, 0);
}

/* Frees the last canonical copy, twice, and checks that nothing is held. */
static inline void bed_finish(struct canonical *canonical)
{
    prepare_finish(canonical, &bed_memory);
    prepare_finish(canonical, &bed_memory);
    assert_int_equal(bed_memory.live, 0);
}

/* Checks whether both inputs give the same bytes. */
static inline void bed_compare(const struct test_input *a, const struct test_input *b, bool equal)
{
    struct canonical first = bed_make(a), second = bed_make(b);
    bool same = first.size == second.size && memcmp(first.bytes, second.bytes, first.size) == 0;
    assert_int_equal(same, equal);
    prepare_finish(&first, &bed_memory);
    bed_finish(&second);
}

#endif
