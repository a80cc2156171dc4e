/* SPDX-License-Identifier: Apache-2.0 */
/* test_agreement.c - tests which wrong answers of a device count as mismatches, and which are explained. */
#include "tests/support/unit.h"

#include <float.h>
#include <math.h>

#include "client/bvhctl/picture/agreement.h"
#include "client/bvhctl/oracle/rays.h"
#include "tests/support/client/bvhctl/test_world.h"
#include "client/bvhctl/scene/target_reader.h"
#include "client/bvhctl/scene/unpack.h"

enum { RAYS = 4000, FEW_SAMPLES = 4 };

/* A world, rays through it, and the CPU's answers, which tests falsify. */
struct court {
    struct test_world world;
    struct surfaces surfaces;
    struct agreement agreement;
    struct ray rays[RAYS];
    struct tracer_hit hits[RAYS];
};

static struct court court;

static void trace_rays(void)
{
    for (int i = 0; i < RAYS; i++) {
        struct ray_hit hit;
        bool is_hit = structures_trace(&court.world.structures, &court.rays[i], &hit);
        court.hits[i] = is_hit ? tracer_hit_of(&hit) : tracer_miss;
    }
}

static void open_court_for(uint32_t threads, uint64_t samples, const struct bvhd_format *format)
{
    uint64_t state = 3;
    test_world_init_for(&court.world, threads, format);
    const struct local *local = &court.world.local;
    assert_int_equal(surfaces_init(&court.surfaces, &court.world.structures, &court.world.local.memory, NULL), BVHD_OK);
    agreement_init(&court.agreement, &court.surfaces, samples, local->parallel, &court.world.local.memory);
    for (int i = 0; i < RAYS; i++) {
        struct vector from =
            vector_make(20 * rays_uniform(&state) - 10, 8 * rays_uniform(&state) - 2, 20 * rays_uniform(&state) - 10);
        struct vector to =
            vector_make(6 * rays_uniform(&state) - 2, 2 * rays_uniform(&state), 4 * rays_uniform(&state) - 2);
        court.rays[i] = stage_ray(from, vector_unit(vector_sub(to, from)), 0);
    }
    trace_rays();
}

static void open_court(uint32_t threads, uint64_t samples)
{
    open_court_for(threads, samples, NULL);
}

static void close_court(void)
{
    agreement_finish(&court.agreement);
    agreement_finish(&court.agreement);
    surfaces_finish(&court.surfaces);
    test_world_finish(&court.world);
    assert_int_equal(court.world.local.memory.live, 0);
}

static void watch_and_judge(void)
{
    assert_int_equal(agreement_watch(&court.agreement, true, court.rays, court.hits, RAYS, NULL), BVHD_OK);
    assert_int_equal(agreement_judge(&court.agreement, INFINITY, NULL, NULL, NULL), BVHD_OK);
}

/* Changes some answers and has all judged. Returns how many were changed. */
static unsigned falsify(bool (*change)(int ray, struct tracer_hit *hit))
{
    unsigned changed = 0;
    for (int i = 0; i < RAYS; i++)
        changed += change(i, &court.hits[i]);
    watch_and_judge();
    assert_int_equal(court.agreement.checked, RAYS);
    return changed;
}

static void expect_liars_found(bool (*change)(int ray, struct tracer_hit *hit))
{
    open_court(2, FEW_SAMPLES);
    unsigned changed = falsify(change);
    assert_true(changed > 20);
    assert_int_equal(court.agreement.differing, changed);
    assert_int_equal(court.agreement.mismatches + court.agreement.uncertain, changed);
    assert_true(court.agreement.uncertain <= changed / 10);
    close_court();
}

static bool leave(int ray, struct tracer_hit *hit)
{
    (void)ray;
    (void)hit;
    return false;
}

static void test_honest(void **state)
{
    (void)state;
    open_court(2, FEW_SAMPLES);
    falsify(leave);
    assert_int_equal(court.agreement.differing, 0);
    assert_int_equal(court.agreement.mismatches + court.agreement.uncertain, 0);
    close_court();
}

static bool is_hit(const struct tracer_hit *hit)
{
    return !isinf(hit->t);
}

static bool miss_some(int ray, struct tracer_hit *hit)
{
    bool change = ray % 7 == 0 && is_hit(hit);
    *hit = change ? tracer_miss : *hit;
    return change;
}

static bool hit_nothing(int ray, struct tracer_hit *hit)
{
    bool change = ray % 3 == 0 && !is_hit(hit);
    *hit = change ? (struct tracer_hit){.t = 1, .instance = 1} : *hit;
    return change;
}

static bool take_neighbour(int ray, struct tracer_hit *hit)
{
    bool change = ray % 7 == 0 && is_hit(hit);
    hit->primitive += change ? 2 : 0;
    return change;
}

static bool take_other_instance(int ray, struct tracer_hit *hit)
{
    bool change = ray % 7 == 0 && is_hit(hit) && hit->instance == 1;
    hit->instance += change ? 2 : 0;
    return change;
}

static bool invent_instance(int ray, struct tracer_hit *hit)
{
    bool change = ray % 7 == 0 && is_hit(hit);
    hit->instance = change ? 1000000 : hit->instance;
    return change;
}

static bool go_farther(int ray, struct tracer_hit *hit)
{
    bool change = ray % 7 == 0 && is_hit(hit);
    hit->t *= change ? 1.001f : 1;
    return change;
}

static bool be_no_number(int ray, struct tracer_hit *hit)
{
    bool change = ray % 7 == 0;
    hit->t = change ? NAN : hit->t;
    return change;
}

static bool go_backwards(int ray, struct tracer_hit *hit)
{
    bool change = ray % 7 == 0 && is_hit(hit);
    hit->t = change ? -INFINITY : hit->t;
    return change;
}

static bool turn_around(int ray, struct tracer_hit *hit)
{
    bool change = ray % 7 == 0 && is_hit(hit);
    hit->flags ^= change ? TRACER_FRONT_FACE : 0;
    return change;
}

static bool change_custom_index(int ray, struct tracer_hit *hit)
{
    bool change = ray % 7 == 0 && is_hit(hit);
    hit->custom_index += change;
    return change;
}

static bool be_a_box(int ray, struct tracer_hit *hit)
{
    bool change = ray % 7 == 0 && is_hit(hit);
    hit->flags |= change ? TRACER_AABB : 0;
    return change;
}

static void test_liars(void **state)
{
    (void)state;
    expect_liars_found(miss_some);
    expect_liars_found(hit_nothing);
    expect_liars_found(take_neighbour);
    expect_liars_found(take_other_instance);
    expect_liars_found(invent_instance);
    expect_liars_found(go_farther);
    expect_liars_found(be_no_number);
    expect_liars_found(go_backwards);
    expect_liars_found(turn_around);
    expect_liars_found(change_custom_index);
    expect_liars_found(be_a_box);
}

static bool round_t(int ray, struct tracer_hit *hit)
{
    if (!is_hit(hit))
        return false;
    for (int i = 0; i < 4; i++)
        hit->t = nextafterf(hit->t, ray % 2 ? INFINITY : 0);
    return true;
}

/* Rounding is not a difference, and barycentrics are not compared. */
static void test_rounding(void **state)
{
    (void)state;
    open_court(1, FEW_SAMPLES);
    for (int i = 0; i < RAYS; i++)
        court.hits[i].u = -1;
    assert_true(falsify(round_t) > RAYS / 2);
    assert_int_equal(court.agreement.differing, 0);
    close_court();
}

/*
 * A ray that grazes a surface, here the cube's top, may report a distance with a large error; one that comes straight
 * down may not.
 */
static void test_grazing(void **state)
{
    (void)state;
    open_court(1, FEW_SAMPLES);
    court.rays[0] = stage_ray(vector_make(-5, 2.0001, 0), vector_unit(vector_make(5, -0.0001, 0)), 0);
    court.rays[1] = stage_ray(vector_make(0.2, 7, 0.1), vector_make(0, -1, 0), 0);
    trace_rays();
    assert_true(fabsf(court.hits[0].t - 5) < 0.1f && court.hits[0].instance == 1 && court.hits[1].t == 5);
    court.hits[0].t += 0.01f;
    court.hits[1].t += 0.01f;
    watch_and_judge();
    assert_int_equal(court.agreement.differing, 1);
    assert_int_equal(court.agreement.mismatches, 1);
    close_court();
}

/* On the diagonal of the ground both of its triangles are right; at its rim, neither is surely hit. */
static void test_ties_and_doubt(void **state)
{
    (void)state;
    open_court(1, FEW_SAMPLES);
    court.rays[0] = stage_ray(vector_make(5, 4, 5), vector_make(0, -1, 0), 0);
    court.rays[1] = stage_ray(vector_make(8, 4, 5), vector_make(0, -1, 0), 0);
    trace_rays();
    assert_true(is_hit(&court.hits[0]) && court.hits[0].instance == 0);
    court.hits[0].primitive ^= 1;
    court.hits[1] = is_hit(&court.hits[1]) ? tracer_miss : (struct tracer_hit){.t = 4, .flags = TRACER_FRONT_FACE};
    watch_and_judge();
    assert_int_equal(court.agreement.differing, 2);
    assert_int_equal(court.agreement.uncertain, 1);
    assert_int_equal(court.agreement.mismatches, 0);
    close_court();
}

static bool find_another(int ray, struct tracer_hit *hit)
{
    (void)ray;
    if (is_hit(hit))
        *hit = (struct tracer_hit){.t = 0.5f, .instance = 1};
    return is_hit(hit);
}

/* For rays that end at any hit, only whether there is one is compared. */
static void test_any_hit(void **state)
{
    (void)state;
    for (int lies = 0; lies < 2; lies++) {
        open_court(2, FEW_SAMPLES);
        for (int i = 0; i < RAYS; i++)
            court.rays[i].flags = RAY_TERMINATE_ON_FIRST_HIT;
        trace_rays();
        unsigned changed = falsify(lies ? miss_some : find_another);
        assert_true(changed > 20);
        assert_int_equal(court.agreement.differing, lies ? changed : 0);
        assert_int_equal(court.agreement.mismatches + court.agreement.uncertain, lies ? changed : 0);
        assert_true(court.agreement.uncertain <= changed / 10);
        close_court();
    }
}

static void watch_misses(int rounds)
{
    for (int round = 0; round < rounds; round++) {
        for (int i = 0; i < RAYS; i++)
            court.hits[i] = tracer_miss;
        assert_int_equal(agreement_watch(&court.agreement, round % 2, court.rays, court.hits, RAYS, NULL), BVHD_OK);
    }
}

static uint64_t count_hits(void)
{
    uint64_t count = 0;
    for (int i = 0; i < RAYS; i++)
        count += is_hit(&court.hits[i]);
    return count;
}

/* All answers are wrong: they are more than the oracle judges. It judges a sample, and the others are no mismatches. */
static void test_many(void **state)
{
    (void)state;
    enum { ROUNDS = 120, SAMPLE = 1 << 16 };
    open_court(2, FEW_SAMPLES);
    uint64_t wrong = ROUNDS * count_hits();
    watch_misses(ROUNDS);
    assert_int_equal(agreement_judge(&court.agreement, INFINITY, NULL, NULL, NULL), BVHD_OK);
    assert_true(wrong > SAMPLE);
    assert_int_equal(court.agreement.checked, ROUNDS * RAYS);
    assert_int_equal(court.agreement.differing, wrong);
    assert_int_equal(court.agreement.judged, SAMPLE);
    assert_int_equal(court.agreement.mismatches + court.agreement.uncertain, SAMPLE);
    assert_true(court.agreement.uncertain < SAMPLE / 10);
    close_court();
}

/* Without time a few are judged. */
static void test_limits(void **state)
{
    (void)state;
    open_court(2, FEW_SAMPLES);
    uint64_t wrong = count_hits();
    watch_misses(1);
    assert_int_equal(agreement_judge(&court.agreement, 0, NULL, NULL, NULL), BVHD_OK);
    assert_in_range(court.agreement.judged, 1, wrong - 1);
    assert_int_equal(court.agreement.mismatches + court.agreement.uncertain, court.agreement.judged);
    close_court();
}

static bool lie_rarely(int ray, struct tracer_hit *hit)
{
    hit->t = ray == 7 ? NAN : INFINITY;
    return true;
}

/* An answer that nothing explains is judged however many others differ. */
static void test_disputed(void **state)
{
    (void)state;
    open_court(2, FEW_SAMPLES);
    for (int i = 0; i < RAYS; i++)
        lie_rarely(i, &court.hits[i]);
    assert_int_equal(agreement_watch(&court.agreement, true, court.rays, court.hits, RAYS, NULL), BVHD_OK);
    assert_int_equal(agreement_judge(&court.agreement, 0, NULL, NULL, NULL), BVHD_OK);
    assert_int_equal(court.agreement.disputes.count, 1);
    assert_true(court.agreement.mismatches >= 1 && court.agreement.judged < court.agreement.differing);
    close_court();
}

/* In large pictures every n-th ray is compared, over all waves, whatever their sizes. */
static void test_stride(void **state)
{
    (void)state;
    open_court(1, UINT64_C(16) << 20); /* 16 million camera rays, 80 million others */
    uint32_t first = 0;
    for (uint32_t count = 1; first < RAYS; first += count, count = count * 2 + 1) {
        count = RAYS - first < count ? RAYS - first : count;
        assert_int_equal(agreement_watch(&court.agreement, true, court.rays + first, court.hits + first, count, NULL),
                         BVHD_OK);
    }
    assert_int_equal(court.agreement.checked, RAYS / 4);
    for (int i = 0; i < RAYS; i++)
        court.hits[i] = i % 4 == 0 ? court.hits[i] : (struct tracer_hit){.t = NAN};
    watch_and_judge();
    assert_int_equal(court.agreement.checked, RAYS / 2);
    assert_int_equal(court.agreement.differing, 0);
    assert_int_equal(agreement_watch(&court.agreement, false, court.rays, court.hits, RAYS, NULL), BVHD_OK);
    assert_int_equal(court.agreement.checked, RAYS / 2 + RAYS / 80);
    close_court();
}

/* Hits of the CPU itself are judged by the oracle. */
static void test_doubt(void **state)
{
    (void)state;
    for (int lies = 0; lies < 2; lies++) {
        open_court(2, FEW_SAMPLES);
        uint64_t changed = 0;
        for (int i = 0; i < 1000 && lies; i++)
            changed += miss_some(i, &court.hits[i]);
        assert_int_equal(agreement_doubt(&court.agreement, court.rays, court.hits, 1000, NULL), BVHD_OK);
        assert_int_equal(agreement_judge(&court.agreement, INFINITY, NULL, NULL, NULL), BVHD_OK);
        assert_int_equal(court.agreement.checked, 1000);
        assert_in_range(court.agreement.mismatches, changed * 9 / 10, changed);
        close_court();
    }
}

static const struct bvhd_format lavapipe = {
    .struct_size = sizeof lavapipe, .target = BVHD_TARGET_LAVAPIPE, .variant = 1, .driver_uuid = "some driver"};

/* The matrix of a cube that is nearly flat, along (1, 1, 0) and (0, 0, 1): its inverse in float is inaccurate. */
static const float sheared[12] = {0.5f, 0.49987f, 0, 3.01f, 0.49987f, 0.5f, 0, 0.53f, 0, 0, 0.5f, 0.7f};

/* The matrix that the cube has otherwise. */
static const float upright[12] = {0.5f, 0, 0, 3, 0, 0.5f, 0, 0.5f, 0, 0, 0.5f, 0};

/* The matrix by which lavapipe sees that cube, because of its inverse in float; or one as far off on the other side. */
static void displace(bool is_other_side, float ret_matrix[12])
{
    struct structure_instance instance;
    struct unpacked unpacked = {.instances = &instance, .instance_count = 1};
    memcpy(instance.start, sheared, sizeof sheared);
    unpack_follow_inverses(&unpacked, target_reader_find(TARGET_LAVAPIPE));
    for (int i = 0; i < 12; i++)
        ret_matrix[i] = is_other_side ? 2 * sheared[i] - instance.start[i] : instance.start[i];
}

/* Makes a court with that cube, and rays that pass its upper rim closely. */
static void open_court_at_rim(const struct bvhd_format *format, const float matrix[12], uint32_t flags)
{
    uint64_t state = 5;
    test_world_place(3, matrix);
    open_court_for(2, FEW_SAMPLES, format);
    for (int i = 0; i < RAYS; i++) {
        double beside = 2e-3 * rays_uniform(&state) - 1e-3;
        struct vector from = vector_make(4.0099 + beside + 1, 1.5299 + beside - 1, 0.4 + 0.6 * rays_uniform(&state));
        court.rays[i] = stage_ray(from, vector_unit(vector_make(-1, 1, 0)), 0);
        court.rays[i].flags |= flags;
    }
    trace_rays();
}

/* Judges the answers of a device for which the cube is slightly displaced. */
static void judge_displaced(const struct bvhd_format *format, bool is_other_side, uint32_t flags)
{
    static struct tracer_hit hits[RAYS];
    float displaced[12];
    displace(is_other_side, displaced);
    open_court_at_rim(format, displaced, flags);
    memcpy(hits, court.hits, sizeof hits);
    close_court();
    open_court_at_rim(format, sheared, flags);
    memcpy(court.hits, hits, sizeof hits);
    watch_and_judge();
    assert_true(court.agreement.differing > RAYS / 10);
}

/* Answers that are displaced by the driver's inverse of a matrix are uncertain, and not mismatches. */
static void test_drivers_inverse(void **state)
{
    (void)state;
    for (int any_hit = 0; any_hit < 2; any_hit++) {
        uint32_t flags = any_hit ? RAY_TERMINATE_ON_FIRST_HIT : 0;
        judge_displaced(&lavapipe, false, flags);
        assert_true(court.agreement.uncertain > court.agreement.differing * 9 / 10);
        assert_int_equal(court.agreement.mismatches, 0);
        close_court();
        judge_displaced(&lavapipe, true, flags);
        assert_true(court.agreement.mismatches > court.agreement.differing / 2);
        close_court();
        judge_displaced(NULL, false, flags);
        assert_true(court.agreement.mismatches > court.agreement.differing / 2);
        close_court();
    }
    test_world_place(3, upright);
}

static void test_no_memory(void **state)
{
    (void)state;
    open_court(1, FEW_SAMPLES);
    struct memory *memory = &court.world.local.memory;
    enum bvhd_status status = BVHD_NO_MEMORY;
    uint64_t live = memory->live;
    int64_t after = 0;
    for (int i = 0; i < 50; i++)
        miss_some(0, &court.hits[i]);
    for (; status != BVHD_OK; after++) {
        agreement_finish(&court.agreement);
        assert_int_equal(memory->live, live);
        agreement_init(&court.agreement, &court.surfaces, FEW_SAMPLES, court.world.local.parallel, memory);
        atomic_store(&memory->fail_after, after);
        status = agreement_watch(&court.agreement, true, court.rays, court.hits, 50, NULL);
        if (status == BVHD_OK)
            status = agreement_judge(&court.agreement, INFINITY, NULL, NULL, NULL);
        assert_true(status == BVHD_OK || status == BVHD_NO_MEMORY);
    }
    atomic_store(&memory->fail_after, -1);
    assert_true(after > 6 && court.agreement.mismatches > 20);
    close_court();
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_honest),          cmocka_unit_test(test_liars),    cmocka_unit_test(test_rounding),
        cmocka_unit_test(test_grazing),         cmocka_unit_test(test_any_hit),  cmocka_unit_test(test_many),
        cmocka_unit_test(test_limits),          cmocka_unit_test(test_disputed), cmocka_unit_test(test_ties_and_doubt),
        cmocka_unit_test(test_stride),          cmocka_unit_test(test_doubt),    cmocka_unit_test(test_no_memory),
        cmocka_unit_test(test_drivers_inverse),
    };
    return cmocka_run_group_tests_name("agreement", tests, NULL, NULL);
}
