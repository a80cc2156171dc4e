/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_placement.c - tests where payloads are placed: in the pool, or in their own memfds, sealed as the daemon
 * requires; and that memory is given back.
 */
#include "tests/support/unit.h"

#include <fcntl.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include "client/placement.h"
#include "proto/wire/rows.h"
#include "tests/support/open_descriptors.h"

enum { POOL_SEALS = F_SEAL_SHRINK | F_SEAL_GROW, OWN_SEALS = F_SEAL_SHRINK | F_SEAL_GROW | F_SEAL_WRITE | F_SEAL_SEAL };

static struct memory memory;

/* A mesh whose payload has a given size. */
struct mesh {
    struct build_input input;
    struct geometry geometry;
    unsigned char *vertices;
    uint64_t size;
    unsigned char *expected;
};

static void make_mesh(struct mesh *mesh, uint64_t size, unsigned char first)
{
    uint64_t bytes = size - ROWS_GEOMETRY_LEAST;
    *mesh = (struct mesh){.size = size, .vertices = malloc(bytes), .expected = malloc(size)};
    for (uint64_t i = 0; i < bytes; i++)
        mesh->vertices[i] = (unsigned char)(first + i % 253);
    mesh->geometry = (struct geometry){.type = GEOMETRY_TRIANGLES, .triangles = {.vertices = {mesh->vertices, bytes}}};
    mesh->input = (struct build_input){.geometry_count = 1, .geometries = &mesh->geometry};
    rows_write(&mesh->input, mesh->expected);
}

static void free_mesh(struct mesh *mesh)
{
    free(mesh->vertices);
    free(mesh->expected);
}

static enum bvhd_status take(struct placement *placement, const struct mesh *mesh, struct held *ret_held)
{
    struct bvhd_error error;
    return placement_take(placement, &mesh->input, mesh->size, ret_held, &error);
}

static void check_pooled(const struct placement *placement, const struct mesh *mesh, const struct held *held,
                         uint64_t offset)
{
    assert_int_equal(held->kind, HELD_POOL);
    assert_int_equal(held->offset, offset);
    assert_int_equal(held->size, mesh->size);
    assert_memory_equal(placement_bytes(placement, held), mesh->expected, mesh->size);
}

/* Checks a memfd as the daemon does: exact size, seals, no holes. */
static void check_own(const struct mesh *mesh, const struct held *held)
{
    struct stat file;
    unsigned char *bytes = malloc(mesh->size);
    assert_int_equal(held->kind, HELD_MEMFD);
    assert_int_equal(fcntl(held->descriptor, F_GET_SEALS) & OWN_SEALS, OWN_SEALS);
    assert_int_equal(fcntl(held->descriptor, F_GETFD), FD_CLOEXEC);
    assert_int_equal(fstat(held->descriptor, &file), 0);
    assert_int_equal(file.st_size, mesh->size);
    assert_int_equal(lseek(held->descriptor, 0, SEEK_HOLE), mesh->size);
    assert_int_equal(pread(held->descriptor, bytes, mesh->size, 0), mesh->size);
    assert_memory_equal(bytes, mesh->expected, mesh->size);
    free(bytes);
}

static void test_pool(void **state)
{
    (void)state;
    struct placement placement;
    struct mesh mesh;
    struct held held[3];
    make_mesh(&mesh, 20000, 1);
    placement_init(&placement, &memory, 65536);
    assert_int_equal(placement.descriptor, -1);
    for (int i = 0; i < 3; i++) {
        assert_int_equal(take(&placement, &mesh, &held[i]), BVHD_OK);
        check_pooled(&placement, &mesh, &held[i], (uint64_t)i * 20032);
    }
    assert_int_equal(fcntl(placement.descriptor, F_GET_SEALS) & OWN_SEALS, POOL_SEALS);
    struct held more;
    assert_int_equal(take(&placement, &mesh, &more), BVHD_BUSY);
    placement_release(&placement, &held[1]);
    placement_release(&placement, &held[1]);
    assert_int_equal(take(&placement, &mesh, &held[1]), BVHD_OK);
    assert_int_equal(held[1].offset, 20032);
    for (int i = 0; i < 3; i++)
        placement_release(&placement, &held[i]);
    placement_finish(&placement);
    placement_finish(&placement);
    free_mesh(&mesh);
}

/*
 * Large payloads are written into pages that do not exist yet, and copied into those that do: the bytes are the same,
 * and their neighbours do not change.
 */
static void test_large_in_pool(void **state)
{
    (void)state;
    struct placement placement;
    struct mesh small, large;
    struct held held[3];
    make_mesh(&small, 10000, 1);
    make_mesh(&large, 300000, 5);
    placement_init(&placement, &memory, 1 << 20);
    for (int round = 0; round < 2; round++) {
        assert_int_equal(take(&placement, &small, &held[0]), BVHD_OK);
        assert_int_equal(take(&placement, &large, &held[1]), BVHD_OK);
        assert_int_equal(take(&placement, &small, &held[2]), BVHD_OK);
        check_pooled(&placement, &small, &held[0], 0);
        check_pooled(&placement, &large, &held[1], 10048);
        check_pooled(&placement, &small, &held[2], 310080);
        for (int i = 0; i < 3; i++)
            placement_release(&placement, &held[i]);
    }
    placement_finish(&placement);
    free_mesh(&small);
    free_mesh(&large);
}

/*
 * A payload that the pool cannot hold, or that would have to wait for half of it, gets its own memfd; the number of
 * memfds is limited.
 */
static void test_own(void **state)
{
    (void)state;
    struct placement placement;
    struct mesh large, half;
    struct held held[PLACEMENT_MAX_MEMFDS], more, pooled;
    make_mesh(&large, 70000, 2);
    make_mesh(&half, 40000, 3);
    placement_init(&placement, &memory, 65536);
    assert_int_equal(take(&placement, &half, &pooled), BVHD_OK);
    check_pooled(&placement, &half, &pooled, 0);
    for (int i = 0; i < PLACEMENT_MAX_MEMFDS; i++) {
        const struct mesh *mesh = i % 2 ? &half : &large;
        assert_int_equal(take(&placement, mesh, &held[i]), BVHD_OK);
        check_own(mesh, &held[i]);
    }
    assert_int_equal(take(&placement, &large, &more), BVHD_BUSY);
    assert_int_equal(placement_move_out(&placement, &pooled, NULL), BVHD_BUSY);
    check_pooled(&placement, &half, &pooled, 0);
    placement_release(&placement, &held[3]);
    assert_int_equal(placement_move_out(&placement, &pooled, NULL), BVHD_OK);
    check_own(&half, &pooled);
    assert_int_equal(placement.arena.taken, 0);
    placement_release(&placement, &pooled);
    assert_int_equal(take(&placement, &large, &held[3]), BVHD_OK);
    for (int i = 0; i < PLACEMENT_MAX_MEMFDS; i++)
        placement_release(&placement, &held[i]);
    placement_finish(&placement);
    free_mesh(&large);
    free_mesh(&half);
}

/* A pool is made smaller for the daemon's limit: it is made again when it is empty, not while payloads are in it. */
static void test_limit(void **state)
{
    (void)state;
    struct placement placement;
    struct mesh mesh;
    struct held held;
    make_mesh(&mesh, 20000, 1);
    placement_init(&placement, &memory, 1 << 20);
    assert_true(placement_limit(&placement, UINT64_MAX));
    assert_int_equal(placement.pool_size, 1 << 20);
    assert_int_equal(take(&placement, &mesh, &held), BVHD_OK);
    assert_false(placement_limit(&placement, 65536));
    assert_true(placement_limit(&placement, 1 << 20));
    placement_release(&placement, &held);
    assert_true(placement_limit(&placement, 65536));
    assert_int_equal(take(&placement, &mesh, &held), BVHD_OK);
    assert_int_equal(placement.pool_size, 65536);
    placement_release(&placement, &held);
    assert_true(placement_limit(&placement, 0));
    assert_int_equal(take(&placement, &mesh, &held), BVHD_OK);
    check_own(&mesh, &held);
    placement_release(&placement, &held);
    assert_true(placement_limit(&placement, UINT64_MAX));
    assert_int_equal(placement.pool_size, 1 << 20);
    placement_finish(&placement);
    free_mesh(&mesh);
}

/* A pool that the daemon refuses still holds payloads that fit into a frame. */
static void test_refused(void **state)
{
    (void)state;
    struct placement placement;
    struct mesh small, large;
    struct held held[2];
    make_mesh(&small, 65536, 1);
    make_mesh(&large, 65552, 1);
    placement_init(&placement, &memory, 1 << 20);
    placement_refuse(&placement, true);
    assert_int_equal(take(&placement, &small, &held[0]), BVHD_OK);
    assert_int_equal(take(&placement, &large, &held[1]), BVHD_OK);
    check_pooled(&placement, &small, &held[0], 0);
    check_own(&large, &held[1]);
    placement_release(&placement, &held[0]);
    placement_release(&placement, &held[1]);
    placement_refuse(&placement, false);
    assert_int_equal(take(&placement, &large, &held[1]), BVHD_OK);
    check_pooled(&placement, &large, &held[1], 0);
    placement_release(&placement, &held[1]);
    placement_finish(&placement);
    free_mesh(&small);
    free_mesh(&large);
}

/*
 * Without free descriptors, the call reports BVHD_BUSY while payloads are placed, because they will be released, and
 * otherwise an error.
 */
static void test_no_descriptors(void **state)
{
    (void)state;
    struct placement placement;
    struct mesh mesh;
    struct held held, more;
    int taken[64], count = 0;
    struct rlimit before, few = {64, 0};
    make_mesh(&mesh, 100000, 1);
    placement_init(&placement, &memory, 0);
    assert_int_equal(getrlimit(RLIMIT_NOFILE, &before), 0);
    few.rlim_max = before.rlim_max;
    assert_int_equal(setrlimit(RLIMIT_NOFILE, &few), 0);
    int spare = dup(0);
    while ((taken[count] = dup(0)) >= 0)
        count++;
    close(spare);
    assert_int_equal(take(&placement, &mesh, &held), BVHD_OK);
    assert_int_equal(take(&placement, &mesh, &more), BVHD_BUSY);
    placement_release(&placement, &held);
    spare = dup(0);
    assert_int_equal(take(&placement, &mesh, &more), BVHD_IO);
    assert_int_equal(setrlimit(RLIMIT_NOFILE, &before), 0);
    close(spare);
    while (count > 0)
        close(taken[--count]);
    placement_finish(&placement);
    free_mesh(&mesh);
}

static void test_failing_allocations(void **state)
{
    (void)state;
    static const uint64_t pools[2] = {1 << 20, 0};
    struct mesh mesh;
    make_mesh(&mesh, 200000, 1);
    for (int i = 0; i < 2; i++) {
        enum bvhd_status status = BVHD_NO_MEMORY;
        int fails = 0;
        for (; status != BVHD_OK || memory.fail_after < 0; fails++) {
            struct placement placement;
            struct held held;
            placement_init(&placement, &memory, pools[i]);
            memory.fail_after = fails;
            status = take(&placement, &mesh, &held);
            assert_true(status == BVHD_OK || status == BVHD_NO_MEMORY);
            if (status == BVHD_OK)
                placement_release(&placement, &held);
            placement_finish(&placement);
            assert_int_equal(memory.live, 0);
        }
        memory.fail_after = -1;
        assert_in_range(fails, 2, 10);
    }
    free_mesh(&mesh);
}

static int descriptors_before;

static int begin(void **state)
{
    (void)state;
    descriptors_before = open_descriptors();
    return 0;
}

static int end(void **state)
{
    (void)state;
    return memory.live != 0 || open_descriptors() != descriptors_before;
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(test_pool, begin, end),
        cmocka_unit_test_setup_teardown(test_large_in_pool, begin, end),
        cmocka_unit_test_setup_teardown(test_own, begin, end),
        cmocka_unit_test_setup_teardown(test_limit, begin, end),
        cmocka_unit_test_setup_teardown(test_refused, begin, end),
        cmocka_unit_test_setup_teardown(test_no_descriptors, begin, end),
        cmocka_unit_test_setup_teardown(test_failing_allocations, begin, end),
    };
    memory_init(&memory, UINT64_MAX);
    return cmocka_run_group_tests(tests, NULL, NULL);
}
