/* SPDX-License-Identifier: Apache-2.0 */
/* test_gltf_shutter.c - tests the motion of random animated scenes over intervals against an independent evaluation. */
#include "tests/support/unit.h"

#include <math.h>
#include <unistd.h>

#include "client/bvhctl/scene/import.h"
#include "tests/support/scene/puppet.h"

enum { STEPS = 16, ROUNDS = 40, INTERVALS = 6 };

/* A file of a puppet, read over an interval. */
struct world {
    const struct puppet *puppet;
    const char *path;
    double start, end;
    struct memory memory;
    struct import import;
};

static void open_world(struct world *world, bool is_for_updates)
{
    struct bvhd_error error = {0};
    const struct import_moment interval = {
        .time = world->start, .is_shutter = true, .end = world->end, .is_for_updates = is_for_updates};
    const struct import_wish wish = {.moment = &interval};
    memory_init(&world->memory, UINT64_MAX);
    if (import_read_as(world->path, &wish, &world->memory, &world->import, &error) != BVHD_OK)
        fail_msg("%s: %s", error.where, error.text);
    assert_true(world->import.is_shutter && world->import.time == world->start && world->import.end_time == world->end);
    assert_true(world->import.instance_count == 1 && world->import.mesh_count == 1);
    assert_false(import_counts_any(&world->import.counts));
}

static void close_world(struct world *world)
{
    import_finish(&world->import);
    assert_int_equal(world->memory.live, 0);
}

static double step_time(const struct world *world, int step)
{
    return step == STEPS ? world->end : world->start + (world->end - world->start) * step / STEPS;
}

static double distance_of(const double a[3], const double b[3])
{
    return sqrt((a[0] - b[0]) * (a[0] - b[0]) + (a[1] - b[1]) * (a[1] - b[1]) + (a[2] - b[2]) * (a[2] - b[2]));
}

static void mix(const double a[3], const double b[3], double share, double ret[3])
{
    for (int k = 0; k < 3; k++)
        ret[k] = a[k] + share * (b[k] - a[k]);
}

static void expect_near(double found, double expected, double size)
{
    if (!(fabs(found - expected) <= 3e-6 * (1 + size)))
        fail_msg("%.9g instead of %.9g, of a size of %g", found, expected, size);
}

/* ---- vertices ---- */

/* Vertices are right at both ends, and their greatest distance from straight lines is what is said. */
static void check_skinned(struct world *world)
{
    double greatest = 0, size = 0;
    bool moves = false;
    open_world(world, false);
    const struct import_mesh *mesh = &world->import.meshes[0];
    for (int i = 0; i < PUPPET_VERTICES; i++) {
        double ends[2][3];
        for (int end = 0; end < 2; end++) {
            const float *positions = end && mesh->end_positions ? mesh->end_positions : mesh->positions;
            puppet_vertex(world->puppet, i, end ? world->end : world->start, ends[end]);
            for (int k = 0; k < 3; k++) {
                size = fmax(size, fabs(ends[end][k]));
                expect_near(positions[3 * i + k], ends[end][k], fabs(ends[end][k]));
            }
        }
        moves |= distance_of(ends[0], ends[1]) > 1e-5;
        for (int step = 1; step < STEPS; step++) {
            double there[3], line[3];
            puppet_vertex(world->puppet, i, step_time(world, step), there);
            mix(ends[0], ends[1], (double)step / STEPS, line);
            greatest = fmax(greatest, distance_of(there, line));
        }
    }
    assert_true(!moves || mesh->end_positions);
    assert_true(world->import.moving_meshes == (mesh->end_positions != NULL));
    assert_true(world->import.motion_count == 0 && world->import.instance_deviation.distance == 0);
    expect_near(world->import.vertex_deviation.distance, greatest, size);
    close_world(world);
}

/* ---- instances ---- */

/* Moves a point by a motion at a time from 0 to 1: it is scaled, turned by two products of quaternions, and moved. */
static void move(const struct import *import, double share, const double at[3], double ret[3])
{
    const struct import_instance *instance = &import->instances[0];
    const struct import_motion *motion = instance->motion ? &import->motions[instance->motion - 1] : NULL;
    double n[16] = {0}, c[3], square = 0;
    for (int i = 0; i < 16; i++)
        n[i] = motion   ? motion->start[i] + share * ((double)motion->end[i] - motion->start[i])
               : i < 12 ? instance->transform[i]
                        : 0;
    for (int i = 0; i < 3; i++)
        ret[i] = n[4 * i] * at[0] + n[4 * i + 1] * at[1] + n[4 * i + 2] * at[2] + n[4 * i + 3];
    if (!motion || motion->kind == ORACLE_MATRIX)
        return;
    const double p[3] = {n[0] * at[0] + n[1] * at[1] + n[2] * at[2] + n[3], n[4] * at[1] + n[5] * at[2] + n[6],
                         n[7] * at[2] + n[8]};
    const double *q = n + 9;
    for (int i = 0; i < 4; i++)
        square += q[i] * q[i];
    for (int i = 0; i < 3; i++)
        c[i] = q[(i + 1) % 3] * p[(i + 2) % 3] - q[(i + 2) % 3] * p[(i + 1) % 3] + q[3] * p[i];
    for (int i = 0; i < 3; i++)
        ret[i] = p[i] + 2 * (q[(i + 1) % 3] * c[(i + 2) % 3] - q[(i + 2) % 3] * c[(i + 1) % 3]) / square + n[13 + i];
}

static void find_box(const struct puppet *puppet, double ret_box[2][3])
{
    for (int k = 0; k < 3; k++) {
        ret_box[0][k] = INFINITY, ret_box[1][k] = -INFINITY;
        for (int i = 0; i < PUPPET_VERTICES; i++) {
            ret_box[0][k] = fmin(ret_box[0][k], puppet->positions[i][k]);
            ret_box[1][k] = fmax(ret_box[1][k], puppet->positions[i][k]);
        }
    }
}

/*
 * A mesh below a chain of moving nodes is right at both ends, its greatest distance from the path is what is said, and
 * it is never farther than with matrices, which move each point in a straight line.
 */
static enum oracle_motion check_chained(struct world *world)
{
    double greatest = 0, straight = 0, size = 0, box[2][3];
    open_world(world, false);
    find_box(world->puppet, box);
    for (int corner = 0; corner < 8; corner++) {
        double ends[2][3];
        const double point[3] = {box[corner & 1][0], box[corner >> 1 & 1][1], box[corner >> 2][2]};
        for (int end = 0; end < 2; end++) {
            memcpy(ends[end], point, sizeof point);
            puppet_carry(world->puppet, PUPPET_JOINTS - 1, end ? world->end : world->start, ends[end]);
        }
        for (int step = 0; step <= STEPS; step++) {
            double there[3] = {point[0], point[1], point[2]}, line[3], found[3];
            puppet_carry(world->puppet, PUPPET_JOINTS - 1, step_time(world, step), there);
            mix(ends[0], ends[1], (double)step / STEPS, line);
            move(&world->import, (double)step / STEPS, point, found);
            size = fmax(size, fabs(there[0]) + fabs(there[1]) + fabs(there[2]));
            greatest = fmax(greatest, distance_of(there, found));
            straight = fmax(straight, distance_of(there, line));
            if (step % STEPS == 0) /* a pivot that is far away is rounded more coarsely */
                assert_true(distance_of(found, there) <= 1e-5 * (1 + size));
        }
    }
    expect_near(world->import.instance_deviation.distance, greatest, size);
    assert_true(greatest <= straight + 3e-6 * (1 + size));
    assert_true(world->import.moving_meshes == 0 && world->import.vertex_deviation.distance == 0);
    enum oracle_motion kind = world->import.motion_count ? world->import.motions[0].kind : ORACLE_STILL;
    assert_int_equal(world->import.motion_count, world->import.instances[0].motion);
    close_world(world);
    return kind;
}

/* ---- tests ---- */

/* Runs `check` for intervals of some lengths in random puppets. */
static void for_puppets(bool is_skinned, void (*check)(struct world *world))
{
    static uint8_t bytes[GLTF_CASE_ROOM];
    char path[] = "/tmp/bvhd-test-shutter-XXXXXX";
    int descriptor = mkstemp(path);
    struct random random = {77};
    assert_true(descriptor >= 0);
    for (int round = 0; round < ROUNDS; round++) {
        struct puppet puppet;
        puppet_make(&random, &puppet);
        size_t size = puppet_write(&puppet, is_skinned, bytes);
        assert_true(ftruncate(descriptor, 0) == 0 && pwrite(descriptor, bytes, size, 0) == (ssize_t)size);
        for (int i = 0; i < INTERVALS; i++) {
            struct world world = {.puppet = &puppet, .path = path, .start = random_between(&random, -0.5, 4)};
            world.end = world.start + random_between(&random, 0.01, i % 2 ? 0.1 : 1.5);
            check(&world);
        }
    }
    close(descriptor);
    unlink(path);
}

static void test_skinned(void **state)
{
    (void)state;
    for_puppets(true, check_skinned);
}

static int kinds[3];

static void count_chained(struct world *world)
{
    kinds[check_chained(world)]++;
}

static void test_chained(void **state)
{
    (void)state;
    for_puppets(false, count_chained);
    print_message("%d still, %d by matrices, %d by SRT\n", kinds[ORACLE_STILL], kinds[ORACLE_MATRIX],
                  kinds[ORACLE_SRT]);
    assert_true(kinds[ORACLE_STILL] && kinds[ORACLE_MATRIX] && kinds[ORACLE_SRT]);
}

static const struct gltf_case *find_case(const char *name)
{
    uint32_t i = 0;
    while (i < gltf_case_count && strcmp(gltf_cases[i].name, name) != 0)
        i++;
    assert_true(i < gltf_case_count);
    return &gltf_cases[i];
}

/* Points whose vertices move stay, and are counted; how far they are from where they should be is said. */
static void test_points(void **state)
{
    (void)state;
    static uint8_t bytes[GLTF_CASE_ROOM];
    char path[] = "/tmp/bvhd-test-shutter-XXXXXX";
    int descriptor = mkstemp(path);
    size_t size = gltf_case_make(find_case("shutter, weights of points"), bytes);
    assert_true(descriptor >= 0 && pwrite(descriptor, bytes, size, 0) == (ssize_t)size);
    for (int round = 0; round < 4; round++) {
        struct memory memory;
        struct import import;
        const struct import_moment interval = {.is_shutter = true, .end = 1, .is_for_updates = round & 2};
        const struct import_wish wish = {.moment = &interval, .point_radius = round & 1 ? 0.1f : 0};
        memory_init(&memory, UINT64_MAX);
        assert_int_equal(import_read_as(path, &wish, &memory, &import, NULL), BVHD_OK);
        assert_int_equal(import.counts.unmoved, round & 1);
        assert_int_equal(import.meshes[0].counts.unmoved, round & 1);
        assert_true(!import.meshes[0].end_positions && import.meshes[1].end_positions);
        assert_float_equal(import.vertex_deviation.distance, (float)(round & 1), 1e-6);
        assert_int_equal(import.moving_meshes, 1);
        import_finish(&import);
        assert_int_equal(memory.live, 0);
    }
    close(descriptor);
    unlink(path);
}

/* After the last key nothing moves, but for updates it is built as what does. */
static void check_updatable(struct world *world)
{
    for (int is_for_updates = 0; is_for_updates < 2; is_for_updates++) {
        world->start = 100, world->end = 101;
        open_world(world, is_for_updates != 0);
        assert_int_equal(world->import.moving_meshes + world->import.motion_count, is_for_updates);
        assert_true(world->import.vertex_deviation.distance == 0 && world->import.instance_deviation.distance < 1e-4);
        close_world(world);
    }
}

static void test_updatable(void **state)
{
    (void)state;
    for_puppets(false, check_updatable);
    for_puppets(true, check_updatable);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_skinned),
        cmocka_unit_test(test_chained),
        cmocka_unit_test(test_updatable),
        cmocka_unit_test(test_points),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
