/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/support/builder/test_scene.h"

#include "tests/support/builder/builders.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

static void must(bool condition, const char *what, const struct bvhd_error *error)
{
    if (condition)
        return;
    fprintf(stderr, "test scene: %s: %s %s\n", what, error ? error->where : "", error ? error->text : "");
    abort();
}

void test_scene_init(struct test_scene *scene)
{
    memset(scene, 0, sizeof *scene);
    memory_init(&scene->memory, UINT64_MAX);
    scene->scene.bottoms = scene->bottoms;
    scene->native.bottoms = scene->native_bottoms;
}

void test_scene_init_native(struct test_scene *scene, enum lavapipe_variant variant)
{
    test_scene_init(scene);
    memcpy(scene->device.driver_uuid, "test driver 1.0a", sizeof scene->device.driver_uuid);
    memcpy(scene->device.compatibility_uuid, "test driver 1.0a", sizeof scene->device.compatibility_uuid);
    scene->device.variant = variant;
}

void test_scene_finish(struct test_scene *scene)
{
    batch_finish(scene->items, TEST_SCENE_BOTTOMS + 1, &scene->memory);
    batch_finish(scene->native_items, TEST_SCENE_BOTTOMS + 1, &scene->memory);
    must(scene->memory.live == 0, "memory is still held", NULL);
}

static struct bytes build_item(struct test_scene *scene, const struct build_input *input, struct batch_item *item)
{
    struct bvhd_error error = {0};
    struct limits limits = limits_default();
    struct build_context context = {.memory = &scene->memory, .parallel = &parallel_serial};
    must(batch_build(input, 1, &limits, &context, item, &error) == BVHD_OK, "batch", &error);
    must(item->status == BVHD_OK, "build", &item->error);
    return (struct bytes){item->blob, item->size};
}

/* Builds one row. `references` are those of the input, or NULL; for the native target they get other keys. */
static void build_row(struct test_scene *scene, struct build_input *input, struct reference *references, uint32_t row)
{
    struct bvhd_error error = {0};
    input->flags = scene->flags;
    input->options.target = TARGET_PORTABLE;
    input->options.quality = scene->quality;
    input->options.builder = builders_asked();
    struct bytes blob = build_item(scene, input, &scene->items[row]);
    must(portable_open(blob, &scene->memory, &scene->views[row], &error) == BVHD_OK, "open", &error);
    if (scene->device.variant == 0)
        return;
    for (uint32_t i = 0; i < input->reference_count; i++)
        references[i].key = scene->native_items[i].key;
    input->options.target = TARGET_LAVAPIPE;
    input->options.layout_flags = 0;
    input->options.device = scene->device;
    blob = build_item(scene, input, &scene->native_items[row]);
    must(lavapipe_open_any(blob, &scene->memory, &scene->native_views[row], &error) == BVHD_OK, "open native", &error);
}

uint32_t test_scene_add(struct test_scene *scene, const struct geometry *geometries, uint32_t count,
                        uint32_t layout_flags)
{
    uint32_t row = scene->scene.bottom_count++;
    struct build_input input = {
        .type = STRUCTURE_BOTTOM,
        .geometry_count = count,
        .geometries = geometries,
        .options.layout_flags = layout_flags,
        .references = scene->micromaps,
        .reference_count = scene->micromap_count,
    };
    must(row < TEST_SCENE_BOTTOMS, "too many bottom levels", NULL);
    build_row(scene, &input, NULL, row);
    scene->bottoms[row] = &scene->views[row];
    scene->native_bottoms[row] = &scene->native_views[row];
    scene->native.bottom_count++;
    return row;
}

static void write_record(const struct test_instance *instance, unsigned char record[64])
{
    memcpy(record, instance->transform, 48);
    bytes_put32(record + 48, instance->custom_index | instance->mask << 24);
    bytes_put32(record + 52, instance->sbt_offset | instance->flags << 24);
    bytes_put64(record + 56, instance->bottom == TEST_SCENE_INACTIVE ? 0 : UINT64_C(0x1000) + instance->bottom);
}

/* Builds a top level of one geometry over all bottom levels. */
static void build_top(struct test_scene *scene, const struct geometry *geometry)
{
    struct reference references[TEST_SCENE_BOTTOMS] = {0};
    for (uint32_t i = 0; i < scene->scene.bottom_count; i++) {
        references[i] =
            (struct reference){.kind = REFERENCE_BLAS, .handle = UINT64_C(0x1000) + i, .bounds = box_empty()};
        references[i].has_key = true;
        references[i].key = scene->items[i].key;
        if (scene->views[i].header->node_count)
            memcpy(&references[i].bounds, scene->views[i].header->bounds, sizeof references[i].bounds);
    }
    struct build_input input = {
        .type = STRUCTURE_TOP,
        .geometry_count = 1,
        .geometries = geometry,
        .reference_count = scene->scene.bottom_count,
        .references = references,
    };
    build_row(scene, &input, references, TEST_SCENE_BOTTOMS);
    scene->scene.top = &scene->views[TEST_SCENE_BOTTOMS];
    scene->native.top = scene->device.variant ? &scene->native_views[TEST_SCENE_BOTTOMS] : NULL;
}

void test_scene_add_top(struct test_scene *scene, const struct test_instance *instances, uint32_t count)
{
    unsigned char *records = calloc(count + 1, 64);
    must(records, "no memory", NULL);
    for (uint32_t i = 0; i < count; i++)
        write_record(&instances[i], records + (size_t)64 * i);
    const struct geometry geometry = {.type = GEOMETRY_INSTANCES,
                                      .instances.records = {records, (uint64_t)64 * count},
                                      .range.primitive_count = count};
    build_top(scene, &geometry);
    free(records);
    scene->instances = instances;
    scene->instance_count = count;
}

void test_scene_add_motion_top(struct test_scene *scene, const unsigned char *records, uint32_t count)
{
    const struct geometry geometry = {.type = GEOMETRY_MOVING_INSTANCES,
                                      .instances.records = {records, (uint64_t)MOTION_RECORD_STRIDE * count},
                                      .range.primitive_count = count};
    build_top(scene, &geometry);
}

struct geometry test_scene_triangles(const float (*corners)[3][3], uint32_t count, uint32_t flags)
{
    return (struct geometry){
        .type = GEOMETRY_TRIANGLES,
        .flags = flags,
        .triangles = {.vertex_format = 106,
                      .max_vertex = count ? 3 * count - 1 : 0,
                      .vertex_stride = 12,
                      .index_type = INDEX_NONE,
                      .vertices = {(const unsigned char *)corners, (uint64_t)36 * count}},
        .range.primitive_count = count,
    };
}

struct geometry test_scene_aabbs(const float (*boxes)[6], uint32_t count, uint32_t flags)
{
    return (struct geometry){
        .type = GEOMETRY_AABBS,
        .flags = flags,
        .aabbs = {.stride = 24, .boxes = {(const unsigned char *)boxes, (uint64_t)24 * count}},
        .range.primitive_count = count,
    };
}

typedef long double real;

static real volume(const real a[3], const real b[3], const real c[3])
{
    return a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2]) + a[2] * (b[0] * c[1] - b[1] * c[0]);
}

/* Solves three unknowns by Cramer's rule. */
static void to_object(const float m[12], const real point[3], bool is_point, real ret_point[3])
{
    real columns[3][3], right[3];
    for (int i = 0; i < 3; i++) {
        for (int j = 0; j < 3; j++)
            columns[j][i] = m[4 * i + j];
        right[i] = point[i] - (is_point ? m[4 * i + 3] : 0);
    }
    real all = volume(columns[0], columns[1], columns[2]);
    ret_point[0] = volume(right, columns[1], columns[2]) / all;
    ret_point[1] = volume(columns[0], right, columns[2]) / all;
    ret_point[2] = volume(columns[0], columns[1], right) / all;
}

static const double doubtful = 1e-10;

/* Tests one triangle against a ray in its space. */
static void try_triangle(const real origin[3], const real direction[3], const struct ray *ray, bool cull_front,
                         bool cull_back, const float *const corners[3], struct test_answer candidate,
                         struct test_answer *answer)
{
    real from[3][3], sides[3], sum = 0, magnitude = 0;
    for (int k = 0; k < 3; k++)
        for (int axis = 0; axis < 3; axis++)
            from[k][axis] = corners[k][axis] - origin[axis];
    for (int k = 0; k < 3; k++) {
        sides[k] = volume(direction, from[(k + 1) % 3], from[(k + 2) % 3]);
        sum += sides[k];
        magnitude += fabsl(sides[k]);
    }
    real low = fminl(sides[0], fminl(sides[1], sides[2])), high = fmaxl(sides[0], fmaxl(sides[1], sides[2]));
    real margin = doubtful * magnitude;
    if (low < -margin && high > margin)
        return;
    real t = volume(from[0], from[1], from[2]) / sum;
    if (!isfinite(t) || t < ray->tmin * (1 - doubtful) || t > ray->tmax * (1 + doubtful))
        return;
    if (sum > 0 ? cull_back : cull_front)
        return;
    bool sure = (low > margin || high < -margin) && t > ray->tmin * (1 + doubtful) && t < ray->tmax * (1 - doubtful);
    candidate.t = (double)t;
    if (answer->is_hit && fabsl(t - answer->t) <= doubtful * fabsl(t)) {
        answer->is_doubtful = true;
    } else if (!answer->is_hit || t < answer->t) {
        *answer = candidate;
        answer->is_hit = true;
        answer->is_doubtful = !sure;
    }
}

static void try_bottom(const struct portable_view *view, const struct test_instance *instance, uint32_t row,
                       const struct ray *ray, struct test_answer *answer)
{
    real origin[3], direction[3], o[3], d[3];
    uint32_t flags = instance ? instance->flags : 0, front = RAY_CULL_FRONT_FACING, back = RAY_CULL_BACK_FACING;
    bool culls = !(flags & INSTANCE_CULL_DISABLE), flips = flags & INSTANCE_FLIP_FACING;
    for (int axis = 0; axis < 3; axis++) {
        o[axis] = origin[axis] = ray->origin[axis];
        d[axis] = direction[axis] = ray->direction[axis];
    }
    if (instance) {
        to_object(instance->transform, origin, true, o);
        to_object(instance->transform, direction, false, d);
    }
    if (view->header->content > PORTABLE_TRIANGLES)
        return;
    for (uint32_t record = 0; record < view->header->record_count; record++) {
        struct scene alone = {.bottoms = &view, .bottom_count = 1};
        struct ray_hit hit = {.record = record};
        float corners[3][3];
        traverse_positions(&alone, &hit, corners);
        const float *const pointers[3] = {corners[0], corners[1], corners[2]};
        uint32_t id = view->header->content == PORTABLE_TRIANGLES
                          ? ((const struct portable_triangle *)view->records)[record].id
                          : ((const struct portable_indexed_triangle *)view->records)[record].id;
        uint32_t geometry = portable_geometry_of(view, id & PORTABLE_ID_MASK);
        struct test_answer candidate = {.instance = row, .geometry = geometry};
        candidate.primitive = (id & PORTABLE_ID_MASK) - view->geometries[geometry].first_primitive;
        try_triangle(o, d, ray, culls && (ray->flags & (flips ? back : front)),
                     culls && (ray->flags & (flips ? front : back)), pointers, candidate, answer);
    }
}

struct test_answer test_scene_brute_force(const struct test_scene *scene, const struct ray *ray)
{
    struct test_answer answer = {0};
    if (!scene->instances)
        try_bottom(scene->bottoms[0], NULL, RAY_NO_INSTANCE, ray, &answer);
    for (uint32_t i = 0; i < scene->instance_count; i++)
        if (scene->instances[i].bottom != TEST_SCENE_INACTIVE && scene->instances[i].mask & ray->cull_mask)
            try_bottom(scene->bottoms[scene->instances[i].bottom], &scene->instances[i], i, ray, &answer);
    return answer;
}

bool test_scene_same_hit(const struct ray_hit *a, const struct ray_hit *b)
{
    return a->t == b->t && a->u == b->u && a->v == b->v && a->instance == b->instance && a->geometry == b->geometry &&
           a->primitive == b->primitive && a->handle == b->handle && a->front_face == b->front_face &&
           a->is_aabb == b->is_aabb && a->custom_index == b->custom_index && a->sbt_offset == b->sbt_offset;
}

void test_scene_transform(struct random *random, double scale, double place, float ret_transform[12])
{
    double axes[3][3];
    for (int i = 0; i < 3; i++)
        random_point(random, axes[i]);
    for (int i = 0; i < 3; i++) {
        for (int j = 0; j < 3; j++)
            ret_transform[4 * i + j] = (float)((axes[i][j] + (i == j ? 0.5 : 0)) * pow(10, (j - 1) * 0.5) * scale);
        ret_transform[4 * i + 3] = (float)random_between(random, -place, place);
    }
}
