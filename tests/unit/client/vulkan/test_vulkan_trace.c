/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_vulkan_trace.c - tests that every variant of the tracing kernels (bvhd_trace.h) finds on a Vulkan device what
 * the traversal finds on the CPU, also with undecided triangles by the dozen. Skipped without a device.
 */
#include "tests/support/unit.h"

#include <math.h>

#include "builder/traverse/traverse.h"
#include "client/bvhctl/gpu/gpu.h"
#include "client/bvhctl/trace/device_ray.h"
#include "client/vulkan/vulkan_tracer.h"
#include "tests/support/client/vulkan/trace_scene.h"

enum { SKIPPED = 77, FEW = 50, EDGES = 2, FINE_BYTES = 1 << 24, FINE_COPIES = 240 };

static struct gpu *gpu;
static float unit = 1; /* of t */

/* Whose barycentrics are all rounding. */
static bool is_sliver(const struct ray_hit *hit)
{
    return hit->geometry == 1 && hit->primitive >= TRIANGLES - FIRST_GEOMETRY - SLIVERS;
}

/*
 * t to some float ulps, and by whom: where triangles share an edge, or are the same, the CPU and the kernels choose
 * alike. Along an edge that no other triangle shares, a last bit decides.
 */
static unsigned count_differing(const struct scene *scene, const struct bvhd_hit *hits, unsigned *ret_hit)
{
    static const uint32_t kinds[PORTABLE_CONTENTS] = {
        [PORTABLE_SPHERES] = BVHD_HIT_SPHERE, [PORTABLE_SWEPT_SPHERES] = BVHD_HIT_SWEPT_SPHERE};
    unsigned differing = 0, met = 0;
    for (int i = 0; i < RAYS; i++) {
        struct ray_hit hit;
        bool is_hit = traverse(scene, &rays[i], NULL, &hit, NULL);
        met += is_hit;
        if (!isinf(hits[i].t))
            assert_int_equal(hits[i].flags & ~1u, kinds[scene->bottoms[0]->header->content]);
        if (!is_hit || isinf(hits[i].t))
            differing += is_hit != !isinf(hits[i].t);
        else
            differing += fabsf(hits[i].t - hit.t) > 2e-5f * hit.t + 1e-6f * unit || hits[i].geometry != hit.geometry ||
                         hits[i].primitive != hit.primitive || (hits[i].flags & 1) != hit.front_face ||
                         (!is_sliver(&hit) && (fabsf(hits[i].u - hit.u) > 1e-3f || fabsf(hits[i].v - hit.v) > 1e-3f));
    }
    *ret_hit = met;
    return differing;
}

/* Which kernel traces. */
enum way { BY_QUERY, COHERENT, INCOHERENT };

/* A tracer with buffers that the host sees. */
struct bed {
    struct bvhd_vulkan_scene *scene;
    struct bvhd_tracer *tracer;
    struct gpu_buffer rays, hits, scratch;
    struct bvhd_trace_binding *binding;
};

#define MUST(call)                                                                                                     \
    do {                                                                                                               \
        struct bvhd_error error_;                                                                                      \
        error_.where[0] = error_.text[0] = '\0';                                                                       \
        if (call)                                                                                                      \
            fail_msg("%s: %s", error_.where, error_.text);                                                             \
    } while (0)

/* The bed's own tracer, or another one over the same scene, with the bed's buffers. */
static void bind(struct bed *bed, const struct bvhd_tracer *tracer)
{
    const struct bvhd_trace_buffers buffers = {
        .struct_size = sizeof buffers,
        .rays = {bed->rays.buffer, 0, bed->rays.size},
        .hits = {bed->hits.buffer, 0, bed->hits.size},
        .scratch = {bed->scratch.buffer, 0, bed->scratch.size},
        .max_rays = RAYS,
    };
    bvhd_trace_binding_destroy(bed->binding);
    MUST(bvhd_tracer_bind(tracer, &buffers, &bed->binding, &error_) != BVHD_OK);
}

static void open_scene(struct bed *bed, const struct bytes *blobs, uint32_t count, bool has_addresses)
{
    struct bvhd_vulkan_bytes *list = memory_array(&memory, count, sizeof *list);
    for (uint32_t i = 0; i < count; i++)
        list[i] = (struct bvhd_vulkan_bytes){blobs[i].data, blobs[i].size};
    const struct bvhd_vulkan_scene_options options = {.struct_size = sizeof options,
                                                      .blobs = list,
                                                      .blob_count = count,
                                                      .flags = has_addresses ? BVHD_VULKAN_SCENE_ADDRESSES : 0};
    MUST(bvhd_vulkan_scene_create(gpu->library, &gpu->queue, &options, &bed->scene, &error_) != BVHD_OK);
    memory_free(&memory, list);
}

static void open_buffers(struct bed *bed)
{
    const VkBufferUsageFlags usage = VK_BUFFER_USAGE_STORAGE_BUFFER_BIT | VK_BUFFER_USAGE_TRANSFER_DST_BIT;
    uint64_t scratch = bvhd_tracer_scratch_size(bed->tracer, RAYS);
    MUST(gpu_buffer_create(gpu, RAYS * sizeof(struct bvhd_ray), usage, GPU_UPLOAD, &bed->rays, &error_) != BVHD_OK);
    MUST(gpu_buffer_create(gpu, RAYS * sizeof(struct bvhd_hit), usage, GPU_READBACK, &bed->hits, &error_) != BVHD_OK);
    MUST(gpu_buffer_create(gpu, scratch ? scratch : VULKAN_TRACE_HEAD, usage, GPU_READBACK, &bed->scratch, &error_) !=
         BVHD_OK);
}

enum device_kind { WITH_DOUBLES, WITHOUT_DOUBLES, WITHOUT_ADDRESSES, WITH_SMALL_HALVES };

/* As on a device of that kind. The first blob is traced. */
static void open_bed(struct bed *bed, const struct bytes *blobs, uint32_t count, enum device_kind kind)
{
    struct bvhd_tracer *plain;
    *bed = (struct bed){.scene = NULL};
    open_scene(bed, blobs, count, gpu->properties.has_buffer_address && kind != WITHOUT_ADDRESSES);
    const struct bvhd_tracer_options options = {.struct_size = sizeof options,
                                                .scene = bed->scene,
                                                .has_shader_float64 =
                                                    gpu->properties.has_doubles && kind != WITHOUT_DOUBLES};
    MUST(bvhd_tracer_create(gpu->library, &gpu->queue, &options, &plain, &error_) != BVHD_OK);
    bed->tracer = plain;
    if (kind == WITH_SMALL_HALVES) {
        struct vulkan_trace_traits traits =
            vulkan_trace_traits_of(gpu->library, &gpu->queue, gpu->properties.has_doubles);
        traits.has_small_halves = vulkan_keeps_small_halves(gpu->library, &gpu->queue);
        MUST(vulkan_tracer_create(gpu->library, &plain->scene, &traits, VK_NULL_HANDLE, &bed->tracer, &error_) !=
             BVHD_OK);
        bvhd_tracer_destroy(plain);
    }
    open_buffers(bed);
    bind(bed, bed->tracer);
}

static void close_bed(struct bed *bed)
{
    bvhd_trace_binding_destroy(bed->binding);
    gpu_buffer_destroy(gpu, &bed->rays);
    gpu_buffer_destroy(gpu, &bed->hits);
    gpu_buffer_destroy(gpu, &bed->scratch);
    bvhd_tracer_destroy(bed->tracer);
    bvhd_vulkan_scene_destroy(bed->scene);
}

static void trace(struct bed *bed, const struct ray *some, uint32_t count, const struct bvhd_trace *trace,
                  struct bvhd_hit *ret_hits, struct vulkan_trace_counters *ret_counters)
{
    const VkMemoryBarrier traced = {.sType = VK_STRUCTURE_TYPE_MEMORY_BARRIER,
                                    .srcAccessMask = VK_ACCESS_SHADER_WRITE_BIT | VK_ACCESS_TRANSFER_WRITE_BIT,
                                    .dstAccessMask = VK_ACCESS_HOST_READ_BIT};
    VkCommandBuffer commands;
    device_rays_put(some, count, bed->rays.mapped);
    memset(bed->scratch.mapped, 0, sizeof *ret_counters);
    MUST(gpu_begin(gpu, &commands, &error_) != BVHD_OK);
    MUST(bvhd_tracer_record(bed->binding, commands, trace, &error_) != BVHD_OK);
    gpu->vk.CmdPipelineBarrier(commands, VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT | VK_PIPELINE_STAGE_TRANSFER_BIT,
                               VK_PIPELINE_STAGE_HOST_BIT, 0, 1, &traced, 0, NULL, 0, NULL);
    MUST(gpu_submit(gpu, commands, &error_) != BVHD_OK);
    memcpy(ret_hits, bed->hits.mapped, count * sizeof *ret_hits);
    memcpy(ret_counters, bed->scratch.mapped, sizeof *ret_counters);
}

static struct bvhd_trace trace_of(enum way way, uint32_t count)
{
    return (struct bvhd_trace){.struct_size = sizeof(struct bvhd_trace),
                               .ray_count = count,
                               .flags = way == BY_QUERY ? BVHD_TRACE_RAY_FLAGS : 0,
                               .order = way == COHERENT ? BVHD_RAYS_COHERENT : BVHD_RAYS_INCOHERENT};
}

/* Traces all rays, `batch` at a time. `ret_sum`: the sums of all counters. */
static void trace_in_batches(struct bed *bed, enum way way, const struct scene *scene, uint32_t batch,
                             struct vulkan_trace_counters *ret_sum)
{
    static struct bvhd_hit hits[RAYS];
    struct vulkan_trace_counters sum = {0};
    unsigned hit;
    memset(hits, 0x55, sizeof hits);
    for (uint32_t at = 0; at < RAYS; at += batch) {
        struct vulkan_trace_counters counters;
        const struct bvhd_trace options = trace_of(way, batch);
        trace(bed, rays + at, batch, &options, hits + at, &counters);
        sum.fallback += counters.fallback;
        sum.unresolved += counters.unresolved;
        sum.undecided += counters.undecided;
    }
    unsigned differing = count_differing(scene, hits, &hit);
    if (differing > EDGES || hit < RAYS / 4)
        fail_msg("way %d, %u at a time: %u of %d rays differ, %u hit", way, batch, differing, RAYS, hit);
    *ret_sum = sum;
}

/*
 * Directions so short that steps of boxes would leave floats along axes that a ray hardly moves on: such rays are left
 * to the query.
 */
static void trace_from_afar(struct bed *bed, enum way way, const struct scene *scene)
{
    static struct ray near_rays[RAYS];
    struct vulkan_trace_counters counters;
    memcpy(near_rays, rays, sizeof rays);
    for (int i = 0; i < RAYS; i++)
        for (int axis = 0; axis < 3; axis++)
            rays[i].direction[axis] *= 0x1p-84f;
    unit = 0x1p84f;
    trace_in_batches(bed, way, scene, FEW, &counters);
    memcpy(rays, near_rays, sizeof rays);
    unit = 1;
    assert_in_range(counters.fallback, RAYS / 2, RAYS - 1);
}

/* Of few rays all undecided triangles find room and are resolved; of all rays together some are left to the query. */
static void trace_undecided(struct bed *bed, enum way way, const struct scene *scene, bool has_resolve)
{
    struct vulkan_trace_counters counters;
    trace_in_batches(bed, way, scene, FEW, &counters);
    assert_true(counters.undecided > RAYS && !counters.fallback);
    assert_int_equal(counters.unresolved != 0, has_resolve);
    trace_in_batches(bed, way, scene, RAYS, &counters);
    assert_in_range(counters.fallback, 1, RAYS - 1);
}

/* Any hit: there is one where the CPU finds one, between tmin and tmax. */
static void trace_any_hit(struct bed *bed, enum way way, const struct scene *scene)
{
    static struct bvhd_hit hits[RAYS];
    struct vulkan_trace_counters counters;
    struct bvhd_trace options = trace_of(way, RAYS);
    unsigned differing = 0, met = 0;
    options.flags |= BVHD_TRACE_ANY_HIT;
    trace(bed, rays, RAYS, &options, hits, &counters);
    for (int i = 0; i < RAYS; i++) {
        struct ray_hit hit;
        bool is_hit = traverse(scene, &rays[i], NULL, &hit, NULL);
        met += is_hit;
        differing += is_hit != !isinf(hits[i].t);
        assert_true(isinf(hits[i].t) || (hits[i].t > rays[i].tmin && hits[i].t < rays[i].tmax));
    }
    assert_true(met > RAYS / 4 && differing <= EDGES);
}

static void try_bed(struct bed *bed, const struct scene *scene, bool has_whole)
{
    struct vulkan_trace_counters counters;
    assert_true(bed->tracer->has_closest);
    assert_int_equal(bed->tracer->coherent.resolves, has_whole);
    trace_in_batches(bed, BY_QUERY, scene, RAYS, &counters);
    assert_int_equal(counters.undecided, 0);
    for (int way = COHERENT; way <= INCOHERENT; way++) {
        trace_in_batches(bed, (enum way)way, scene, RAYS, &counters);
        trace_undecided(bed, (enum way)way, scene, !has_whole);
        trace_from_afar(bed, (enum way)way, scene);
        trace_any_hit(bed, (enum way)way, scene);
    }
    trace_any_hit(bed, BY_QUERY, scene);
}

static void try_blobs(const struct bytes *blobs, uint32_t count, enum device_kind kind)
{
    struct bed bed;
    struct portable_view view;
    const struct gpu_properties *properties = &gpu->properties;
    assert_int_equal(portable_open(blobs[0], &memory, &view, NULL), BVHD_OK);
    const struct portable_view *const bottoms[] = {&view};
    const struct scene scene = {.bottoms = bottoms, .bottom_count = 1};
    open_bed(&bed, blobs, count, kind);
    try_bed(&bed, &scene,
            properties->has_doubles && properties->has_buffer_address && kind != WITHOUT_DOUBLES &&
                kind != WITHOUT_ADDRESSES);
    close_bed(&bed);
}

static void try_layout(uint32_t layout_flags, enum device_kind kind)
{
    struct bytes blob;
    build_blob(layout_flags, &blob);
    try_blobs(&blob, 1, kind);
    memory_free(&memory, (void *)(uintptr_t)blob.data);
}

/* Kernels that know the layout of all bottom levels leave out the others. Here there are two. */
static void test_both(void **state)
{
    struct bytes blobs[2];
    (void)state;
    build_blob(0, &blobs[0]);
    build_blob(PORTABLE_FAST_TRIANGLES, &blobs[1]);
    try_blobs(blobs, 2, WITH_DOUBLES);
    for (int i = 0; i < 2; i++)
        memory_free(&memory, (void *)(uintptr_t)blobs[i].data);
}

/* As many structures as make one that is traced like many small triangles. */
static void test_fine(void **state)
{
    (void)state;
    struct bytes blobs[FINE_COPIES];
    build_blob(PORTABLE_FAST_TRIANGLES, &blobs[0]);
    assert_true(blobs[0].size * FINE_COPIES > FINE_BYTES);
    for (int i = 1; i < FINE_COPIES; i++)
        blobs[i] = blobs[0];
    try_blobs(blobs, FINE_COPIES, WITH_DOUBLES);
    try_blobs(blobs, FINE_COPIES, WITHOUT_DOUBLES);
    memory_free(&memory, (void *)(uintptr_t)blobs[0].data);
}

static void test_indexed(void **state)
{
    (void)state;
    for (int kind = WITH_DOUBLES; kind <= WITH_SMALL_HALVES; kind++)
        try_layout(0, (enum device_kind)kind);
}

/* A root whose boxes are sound, but far larger than what they hold: steps that do not fit are not taken 2^24 times. */
static void test_large_steps(void **state)
{
    (void)state;
    struct bytes blob;
    struct portable_view view;
    struct bed bed;
    static struct bvhd_hit hits[RAYS];
    build_blob(0, &blob);
    assert_int_equal(portable_open(blob, &memory, &view, NULL), BVHD_OK);
    struct portable_node *root = (struct portable_node *)(uintptr_t)view.nodes;
    for (int axis = 0; axis < 3; axis++) {
        root->origin[axis] = -0x1p106f;
        root->exponent[axis] = 127 + 108;
        for (int slot = 0; slot < 8; slot++)
            if (root->meta[slot]) {
                root->lo[axis][slot] = 0;
                root->hi[axis][slot] = 255;
            }
    }
    open_bed(&bed, &blob, 1, WITH_SMALL_HALVES);
    const struct portable_view *const bottoms[] = {&view};
    const struct scene scene = {.bottoms = bottoms, .bottom_count = 1};
    for (int way = COHERENT; way <= INCOHERENT; way++) {
        unsigned hit = 0, differing = 0;
        struct vulkan_trace_counters counters;
        const struct bvhd_trace options = trace_of((enum way)way, RAYS / 2);
        trace(&bed, rays + RAYS / 2, RAYS / 2, &options, hits, &counters);
        for (int i = 0; i < RAYS / 2; i++) {
            struct ray_hit one;
            bool is_hit = traverse(&scene, &rays[RAYS / 2 + i], NULL, &one, NULL);
            hit += is_hit;
            differing += is_hit != !isinf(hits[i].t);
        }
        assert_true(hit > RAYS / 16 && differing <= EDGES);
    }
    close_bed(&bed);
    memory_free(&memory, (void *)(uintptr_t)blob.data);
}

static void test_fast_triangles(void **state)
{
    (void)state;
    try_layout(PORTABLE_FAST_TRIANGLES, WITHOUT_DOUBLES);
}

/* Spheres and linear swept spheres are traced by the query, in whatever order rays are. */
static void test_round(void **state)
{
    (void)state;
    for (int kind = WITHOUT_DOUBLES; kind <= WITHOUT_ADDRESSES; kind++)
        for (uint32_t type = GEOMETRY_SPHERES; type <= GEOMETRY_SWEPT_SPHERES; type++) {
            struct bytes blob;
            struct bed bed;
            struct portable_view view;
            struct vulkan_trace_counters counters;
            build_round(type, &blob);
            assert_int_equal(portable_open(blob, &memory, &view, NULL), BVHD_OK);
            const struct portable_view *const bottoms[] = {&view};
            const struct scene scene = {.bottoms = bottoms, .bottom_count = 1};
            open_bed(&bed, &blob, 1, (enum device_kind)kind);
            assert_false(bed.tracer->has_closest);
            for (int way = BY_QUERY; way <= INCOHERENT; way++) {
                trace_in_batches(&bed, (enum way)way, &scene, RAYS, &counters);
                trace_any_hit(&bed, (enum way)way, &scene);
            }
            close_bed(&bed);
            memory_free(&memory, (void *)(uintptr_t)blob.data);
        }
}

/* What moves is traced by the query, too, and each ray meets it at a time of its own. */
static void test_motion(void **state)
{
    (void)state;
    struct bytes blob;
    build_moving(&blob);
    for (int i = 0; i < RAYS; i++)
        rays[i].time = (float)(i % 9) / 8;
    for (int kind = WITHOUT_DOUBLES; kind <= WITHOUT_ADDRESSES; kind++) {
        struct bed bed;
        struct portable_view view;
        struct vulkan_trace_counters counters;
        assert_int_equal(portable_open(blob, &memory, &view, NULL), BVHD_OK);
        assert_int_equal(view.header->content, PORTABLE_MOVING_TRIANGLES);
        const struct portable_view *const bottoms[] = {&view};
        const struct scene scene = {.bottoms = bottoms, .bottom_count = 1};
        open_bed(&bed, &blob, 1, (enum device_kind)kind);
        assert_false(bed.tracer->has_closest);
        for (int way = BY_QUERY; way <= INCOHERENT; way++) {
            trace_in_batches(&bed, (enum way)way, &scene, RAYS, &counters);
            trace_any_hit(&bed, (enum way)way, &scene);
        }
        close_bed(&bed);
    }
    memory_free(&memory, (void *)(uintptr_t)blob.data);
}

/* A scene in the program's own buffer, described by its bytes, is traced as the library's scene is. */
static void test_own_buffer(void **state)
{
    (void)state;
    struct bytes blob;
    struct bed bed;
    struct portable_view view;
    struct bvhd_vulkan_span span;
    struct bvhd_tracer *tracer;
    struct vulkan_trace_counters counters;
    VkDeviceSize size;
    build_blob(0, &blob);
    assert_int_equal(portable_open(blob, &memory, &view, NULL), BVHD_OK);
    const struct portable_view *const bottoms[] = {&view};
    const struct scene scene = {.bottoms = bottoms, .bottom_count = 1};
    for (int kind = WITHOUT_DOUBLES; kind <= WITHOUT_ADDRESSES; kind++) {
        open_bed(&bed, &blob, 1, (enum device_kind)kind);
        assert_int_equal(bvhd_vulkan_scene_storage(bed.scene, 0, &span, &size), BVHD_OK);
        const struct bvhd_vulkan_bytes blobs[] = {{NULL, 0}, {blob.data, blob.size}};
        const struct bvhd_tracer_options options = {
            .struct_size = sizeof options,
            .root = 1,
            .buffer = span.buffer,
            .buffer_size = size,
            .buffer_address = bed.tracer->scene.base,
            .root_location = bvhd_vulkan_scene_location(bed.scene, 0),
            .blobs = blobs,
            .blob_count = 2,
        };
        MUST(bvhd_tracer_create(gpu->library, NULL, &options, &tracer, &error_) != BVHD_OK);
        assert_memory_equal(&tracer->scene.contents, &bed.tracer->scene.contents, sizeof tracer->scene.contents);
        assert_true(tracer->has_closest && !tracer->scene.has_top);
        bind(&bed, tracer);
        for (int way = BY_QUERY; way <= INCOHERENT; way++)
            trace_in_batches(&bed, (enum way)way, &scene, RAYS, &counters);
        bvhd_trace_binding_destroy(bed.binding);
        bed.binding = NULL;
        bvhd_tracer_destroy(tracer);
        close_bed(&bed);
    }
    memory_free(&memory, (void *)(uintptr_t)blob.data);
}

/* A device gives the same answer about denormal halves each time; a CPU is faster without them. */
static void test_small_halves(void **state)
{
    (void)state;
    bool keeps = vulkan_keeps_small_halves(gpu->library, &gpu->queue);
    assert_int_equal(vulkan_keeps_small_halves(gpu->library, &gpu->queue), keeps);
    const struct vulkan_trace_traits traits = vulkan_trace_traits_of(gpu->library, &gpu->queue, false);
    assert_int_equal(traits.has_small_halves, keeps && !traits.is_cpu);
    assert_false(vulkan_trace_traits_of(gpu->library, NULL, false).has_small_halves);
}

static void test_order(void **state)
{
    (void)state;
    assert_int_equal(bvhd_rays_order(rays, 64, sizeof *rays), BVHD_RAYS_COHERENT);
    assert_int_equal(bvhd_rays_order(rays + RAYS / 2, 1024, sizeof *rays), BVHD_RAYS_INCOHERENT);
    assert_int_equal(bvhd_rays_order(rays, 0, sizeof *rays), BVHD_RAYS_COHERENT);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_order),          cmocka_unit_test(test_small_halves), cmocka_unit_test(test_indexed),
        cmocka_unit_test(test_large_steps),    cmocka_unit_test(test_fine),         cmocka_unit_test(test_own_buffer),
        cmocka_unit_test(test_fast_triangles), cmocka_unit_test(test_both),         cmocka_unit_test(test_round),
        cmocka_unit_test(test_motion),
    };
    struct bvhd_error error;
    memory_init(&memory, UINT64_MAX);
    if (gpu_open("auto", &memory, &gpu, &error) != BVHD_OK) {
        printf("skipped: %s: %s\n", error.where, error.text);
        return SKIPPED;
    }
    make_triangles();
    make_rays();
    int failed = cmocka_run_group_tests(tests, NULL, NULL) + (int)gpu_messages();
    gpu_close(gpu);
    return failed || atomic_load(&memory.live) != 0;
}
