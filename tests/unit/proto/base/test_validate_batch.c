/* SPDX-License-Identifier: Apache-2.0 */
/* test_validate_batch.c - tests the rules between the entries of one call, also against a comparison of all pairs. */
#include "tests/support/unit.h"

#include "tests/support/random.h"
#include "builder/input/validate.h"

static struct memory memory = {.limit = UINT64_MAX, .fail_after = -1};

static void expect(const struct bvhd_error *error, enum bvhd_vuid vuid, const char *where)
{
    assert_int_equal(error->status, vuid ? BVHD_INVALID : BVHD_OK);
    assert_int_equal(error->vuid, vuid);
    assert_string_equal(error->where, where);
}

static void entries_fail_alone(void **state)
{
    (void)state;
    const struct reference references[2] = {{.handle = 9}, {.handle = 4}};
    struct build_input inputs[7] = {
        {.destination = 1},
        {.destination = 2, .mode = MODE_UPDATE, .source = 4},
        {.destination = 3, .mode = MODE_UPDATE, .source = 3},
        {.destination = 4},
        {.destination = 1},
        {.references = references, .reference_count = 2},
        {.destination = 0, .source = 4},
    };
    struct bvhd_error errors[7];
    assert_int_equal(validate_batch(inputs, 7, &memory, errors), BVHD_OK);
    expect(&errors[0], BVHD_VUID_03698, "infos[0].dstAccelerationStructure");
    expect(&errors[1], BVHD_VUID_03403, "infos[1].srcAccelerationStructure");
    expect(&errors[2], BVHD_VUID_NONE, ""); /* an update in place is allowed */
    expect(&errors[3], BVHD_VUID_NONE, "");
    expect(&errors[4], BVHD_VUID_03698, "infos[4].dstAccelerationStructure");
    expect(&errors[5], BVHD_VUID_03407, "infos[5].references[1]");
    expect(&errors[6], BVHD_VUID_NONE, ""); /* a build ignores its source */
    assert_int_equal(memory.live, 0);

    inputs[5].destination = 4; /* entry 5's destination is now also entry 3's */
    assert_int_equal(validate_batch(inputs, 7, &memory, errors), BVHD_OK);
    expect(&errors[3], BVHD_VUID_03698, "infos[3].dstAccelerationStructure");
    expect(&errors[5], BVHD_VUID_03698, "infos[5].dstAccelerationStructure");
    assert_int_equal(validate_batch(NULL, 0, &memory, NULL), BVHD_OK);
}

/* Random entries give the same errors as a comparison of all pairs. */
static void pairs_are_found(void **state)
{
    (void)state;
    enum { MOST = 40 };
    struct random random = {2};
    for (int round = 0; round < 400; round++) {
        struct build_input inputs[MOST] = {0};
        struct reference references[MOST] = {0};
        struct bvhd_error errors[MOST];
        uint32_t count = 1 + (uint32_t)(random_next(&random) % MOST);
        for (uint32_t i = 0; i < count; i++) {
            references[i].handle = random_next(&random) % 100;
            inputs[i] = (struct build_input){.destination = random_next(&random) % 100,
                                             .source = random_next(&random) % 100,
                                             .mode = (uint32_t)(random_next(&random) % 2),
                                             .references = &references[i],
                                             .reference_count = (uint32_t)(random_next(&random) % 2)};
        }
        assert_int_equal(validate_batch(inputs, count, &memory, errors), BVHD_OK);
        for (uint32_t i = 0; i < count; i++) {
            bool destination = false, source = false, named = false;
            for (uint32_t j = 0; j < count; j++) {
                uint64_t other = j == i ? 0 : inputs[j].destination;
                destination |= other && other == inputs[i].destination;
                source |= other && inputs[i].mode == MODE_UPDATE && other == inputs[i].source;
                named |= other && inputs[i].reference_count && other == references[i].handle;
            }
            assert_int_equal(errors[i].vuid, destination ? BVHD_VUID_03698
                                             : source    ? BVHD_VUID_03403
                                             : named     ? BVHD_VUID_03407
                                                         : BVHD_VUID_NONE);
        }
    }
}

static void without_memory_it_says_so(void **state)
{
    (void)state;
    struct build_input input = {.destination = 1};
    struct bvhd_error error;
    atomic_store(&memory.fail_after, 0);
    assert_int_equal(validate_batch(&input, 1, &memory, &error), BVHD_NO_MEMORY);
    assert_int_equal(validate_batch(&input, 1, &memory, &error), BVHD_OK);
    assert_int_equal(memory.live, 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(entries_fail_alone),
        cmocka_unit_test(pairs_are_found),
        cmocka_unit_test(without_memory_it_says_so),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
