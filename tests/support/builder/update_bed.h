/* SPDX-License-Identifier: Apache-2.0 */
/*
 * update_bed.h - records of the requests of inputs.h. For unit tests of updates, which include tests/support/unit.h
 * first. Requests are entry 2 of their batch, so that places begin with "infos[2]".
 */
#ifndef BVHD_TEST_UPDATE_BED_H
#define BVHD_TEST_UPDATE_BED_H

#include "builder/update/record.h"
#include "tests/support/builder/prepare_bed.h"

static inline struct record update_bed_record(const struct test_input *test)
{
    struct canonical canonical = bed_make(test);
    struct record record;
    struct bvhd_error error;
    if (record_make(&canonical, &test->input.options, &bed_context, &record, &error) != BVHD_OK)
        fail_msg("%s: %s", error.where, error.text);
    prepare_finish(&canonical, &bed_memory);
    return record;
}

#endif
