/* SPDX-License-Identifier: Apache-2.0 */
/* test_local_micromaps.c - tests that micromaps of this process are found by their keys, and held. */
#include "tests/support/unit.h"

#include <string.h>

#include "builder/format/portable_micromap.h"
#include "client/library.h"
#include "client/local_micromaps.h"
#include "client/result_blob.h"

enum { MICROMAP = 1, OTHER_MICROMAP, TRIANGLES, MISSING, SIZE = 192 };

static struct key key_of(unsigned char number)
{
    return (struct key){.bytes = {number, 9}};
}

/* Makes a blob as a local build does: of a micromap, as far as its first number shows, or of another structure. */
static struct bvhd_blob *make(unsigned char number)
{
    unsigned char *bytes = memory_alloc(&library_memory, SIZE);
    const struct key key = key_of(number);
    struct bvhd_blob *blob;
    assert_non_null(bytes);
    memset(bytes, number, SIZE);
    if (number != TRIANGLES)
        bytes_put32(bytes + PORTABLE_MICROMAP_BODY, PORTABLE_MICROMAP_MAGIC);
    assert_int_equal(result_blob_take(bytes, SIZE, &blob, NULL), BVHD_OK);
    assert_int_equal(result_blob_set_source(blob, &key, (struct bytes){NULL, 0}, NULL), BVHD_OK);
    return blob;
}

static struct reference name(enum reference_kind kind, unsigned char number)
{
    return (struct reference){.kind = kind, .handle = number, .has_key = true, .key = key_of(number)};
}

static void micromaps_are_held(void **state)
{
    (void)state;
    struct bvhd_blob *blobs[] = {make(MICROMAP), make(OTHER_MICROMAP)};
    struct reference references[] = {name(REFERENCE_MICROMAP, OTHER_MICROMAP), name(REFERENCE_BLAS, MICROMAP),
                                     name(REFERENCE_MICROMAP, MISSING), name(REFERENCE_MICROMAP, MICROMAP)};
    const struct build_input input = {.reference_count = 4, .references = references};
    struct local_micromaps *micromaps;
    assert_true(local_micromaps_find(&input, &micromaps));
    for (int i = 0; i < 2; i++)
        bvhd_blob_unref(blobs[i]); /* the program drops them */
    struct bvhd_error error;
    assert_int_equal(local_micromaps_give(micromaps, references, 4, 0, &error), BVHD_OK);
    assert_int_equal(references[0].blob.size, SIZE);
    assert_int_equal(references[0].blob.data[0], OTHER_MICROMAP);
    assert_null(references[1].blob.data);
    assert_null(references[2].blob.data);
    assert_int_equal(references[3].blob.data[0], MICROMAP);
    local_micromaps_destroy(micromaps);

    assert_true(local_micromaps_find(&input, &micromaps)); /* they are gone */
    assert_int_equal(local_micromaps_give(micromaps, references, 4, 0, &error), BVHD_OK);
    assert_null(references[0].blob.data);
    local_micromaps_destroy(micromaps);
}

static void other_structures_are_refused(void **state)
{
    (void)state;
    struct bvhd_blob *blob = make(TRIANGLES);
    struct reference references[] = {name(REFERENCE_BLAS, TRIANGLES), name(REFERENCE_MICROMAP, TRIANGLES)};
    const struct build_input input = {.reference_count = 2, .references = references};
    struct local_micromaps *micromaps;
    struct bvhd_error error;
    assert_true(local_micromaps_find(&input, &micromaps));
    assert_int_equal(local_micromaps_give(micromaps, references, 2, 3, &error), BVHD_INVALID);
    assert_string_equal(error.where, "infos[3].references[1]");
    local_micromaps_destroy(micromaps);
    bvhd_blob_unref(blob);
}

static void most_inputs_name_none(void **state)
{
    (void)state;
    struct reference references[] = {name(REFERENCE_BLAS, MICROMAP)};
    const struct build_input input = {.reference_count = 1, .references = references};
    struct local_micromaps *micromaps;
    struct bvhd_error error;
    assert_true(local_micromaps_find(&input, &micromaps));
    assert_null(micromaps);
    assert_int_equal(local_micromaps_give(NULL, references, 1, 0, &error), BVHD_OK);
    local_micromaps_destroy(NULL);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(micromaps_are_held),
        cmocka_unit_test(other_structures_are_refused),
        cmocka_unit_test(most_inputs_name_none),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
