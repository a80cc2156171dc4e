/* SPDX-License-Identifier: Apache-2.0 */
/* test_gltf_pose.c - tests skins, morph targets and animations of random scenes against an independent evaluation. */
#include "tests/support/unit.h"

#include <math.h>
#include <unistd.h>

#include "client/bvhctl/scene/gltf_sampler.h"
#include "client/bvhctl/scene/import.h"
#include "tests/support/scene/puppet.h"

/* ---- tests ---- */

static void check_moment(const struct puppet *puppet, double time, const char *path)
{
    struct memory memory;
    struct import import;
    struct bvhd_error error = {0};
    const struct import_moment moment = {.time = time};
    const struct import_wish wish = {.moment = &moment};
    memory_init(&memory, UINT64_MAX);
    if (import_read_as(path, &wish, &memory, &import, &error) != BVHD_OK)
        fail_msg("%s: %s", error.where, error.text);
    assert_true(import.has_moment && import.time == time && import.has_animation && import.animation == 0);
    assert_true(import.bottom_count == 1 && import.instance_count == 1 && import.mesh_count == 1);
    assert_false(import_counts_any(&import.counts));
    for (int k = 0; k < 12; k++) /* joints have placed it in the world */
        assert_true(import.instances[0].transform[k] == (k % 5 == 0 ? 1.0f : 0.0f));
    assert_int_equal(import.meshes[0].vertex_count, PUPPET_VERTICES);
    for (int i = 0; i < PUPPET_VERTICES; i++) {
        double expected[3];
        puppet_vertex(puppet, i, time, expected);
        for (int k = 0; k < 3; k++)
            assert_true(fabs(import.meshes[0].positions[3 * i + k] - expected[k]) <= 1e-6 * (1 + fabs(expected[k])));
    }
    import_finish(&import);
    assert_int_equal(memory.live, 0);
}

static void test_puppets(void **state)
{
    (void)state;
    static uint8_t bytes[GLTF_CASE_ROOM];
    char path[] = "/tmp/bvhd-test-pose-XXXXXX";
    int descriptor = mkstemp(path);
    struct random random = {2026};
    assert_true(descriptor >= 0);
    for (int round = 0; round < 60; round++) {
        struct puppet puppet;
        puppet_make(&random, &puppet);
        size_t size = puppet_write(&puppet, true, bytes);
        assert_true(ftruncate(descriptor, 0) == 0 && pwrite(descriptor, bytes, size, 0) == (ssize_t)size);
        for (int i = 0; i < 8; i++)
            check_moment(&puppet, i == 0 ? puppet.moves[0].times[1] : 2.5 + random_between(&random, -3, 3), path);
    }
    close(descriptor);
    unlink(path);
}

/* Rotations go the shorter way round, also between quaternions of opposite signs, and nearly equal ones stay finite. */
static void test_shorter_way(void **state)
{
    (void)state;
    static const float times[2] = {0, 1};
    const float sine = (float)sin(0.2), cosine = (float)cos(0.2);
    float values[2][4] = {{0, 0, 0, 1}, {0, 0, -sine, -cosine}};
    struct gltf_sampler sampler = {GLTF_LINEAR, true, 2, 4, times, values[0]};
    double rotation[4];
    gltf_sampler_at(&sampler, 0.5, rotation);
    assert_float_equal(rotation[2], sin(0.1), 1e-6);
    assert_float_equal(rotation[3], cos(0.1), 1e-6);
    values[1][2] = 1e-9f, values[1][3] = 1;
    gltf_sampler_at(&sampler, 0.5, rotation);
    assert_float_equal(rotation[2], 5e-10, 1e-15);
    assert_float_equal(rotation[3], 1, 1e-12);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_puppets), cmocka_unit_test(test_shorter_way)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
