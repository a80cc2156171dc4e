/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/support/driver/driver_world.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "tests/support/scene/adversarial.h"
#include "tests/support/driver/driver_scene.h"
#include "builder/input/prepare.h"

#define MUST(call) driver_scene_must((call), &error)

enum { SOUP = 600, SOUP_GEOMETRIES = 5, BOXES = 200, INSTANCES = 120, RECORD = 64 };

static const float identity[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};

static void *allocate(uint64_t count, uint64_t size)
{
    void *block = calloc(count + 1, size);
    if (!block) {
        fprintf(stderr, "driver_world: no memory\n");
        exit(1);
    }
    return block;
}

static void prepare_input(struct driver_world *world, const struct build_input *input, struct canonical *ret_canonical)
{
    struct bvhd_error error;
    struct limits limits = limits_default();
    struct build_context context = {.memory = &world->memory, .parallel = &parallel_serial};
    MUST(prepare(input, 0, &limits, &context, ret_canonical, &error));
}

/* ---- Bottom levels ---- */

static bool has_nan(const float *values, int count)
{
    bool has = false;
    for (int i = 0; i < count; i++)
        has = has || isnan(values[i]);
    return has;
}

static void grow(struct box *box, const float point[3])
{
    for (int axis = 0; axis < 3; axis++) {
        box->min[axis] = fminf(box->min[axis], point[axis]);
        box->max[axis] = fmaxf(box->max[axis], point[axis]);
    }
}

/* Returns the corners of a primitive, two for a box; false when it is inactive. */
static bool corners_of(const struct canonical_geometry *geometry, uint32_t primitive, float ret_corners[3][3],
                       int *ret_count)
{
    *ret_count = geometry->boxes ? 2 : 3;
    if (geometry->boxes)
        memcpy(ret_corners, geometry->boxes + 6 * (size_t)primitive, 6 * sizeof(float));
    else
        canonical_triangle(geometry, primitive, ret_corners);
    return !has_nan(ret_corners[0], 3 * *ret_count);
}

static struct box bounds_of(const struct canonical *canonical)
{
    struct box bounds = box_empty();
    float corners[3][3];
    int count;
    for (uint32_t g = 0; g < canonical->geometry_count; g++)
        for (uint32_t i = 0; i < canonical->geometries[g].primitive_count; i++)
            if (corners_of(&canonical->geometries[g], i, corners, &count))
                for (int k = 0; k < count; k++)
                    grow(&bounds, corners[k]);
    return bounds;
}

/*
 * Replaces inactive primitives by a point, which no ray hits, but only in geometries without indices, whose vertices
 * are not shared. The point is next to the other primitives, because the driver's own trees are slow when their boxes
 * reach far: tracing them took three times as long.
 */
static void neutralise(const struct canonical_geometry *geometry)
{
    static const float beside[3] = {2.25f, -2.5f, 2.125f};
    float corners[3][3];
    int count;
    for (uint32_t i = 0; i < geometry->primitive_count && !geometry->indices; i++)
        if (!corners_of(geometry, i, corners, &count)) {
            float *to = (float *)(uintptr_t)(geometry->boxes ? geometry->boxes + 6 * (size_t)i
                                                             : geometry->positions + 9 * (size_t)i);
            for (int k = 0; k < count; k++)
                memcpy(to + 3 * (ptrdiff_t)k, beside, sizeof beside);
        }
}

static void add_bottom(struct driver_world *world, const struct geometry *geometries, uint32_t count)
{
    struct bvhd_error error;
    uint32_t at = world->bottom_count++;
    struct canonical *given = &world->bottoms[at], *copy = &world->driver_bottoms[at];
    struct build_input input = {.type = STRUCTURE_BOTTOM,
                                .flags = BUILD_ALLOW_COMPACTION,
                                .geometry_count = count,
                                .geometries = geometries,
                                .options.target = TARGET_PORTABLE};
    prepare_input(world, &input, given);
    world->bounds[at] = bounds_of(given);
    world->blocks[at] = memory_array(&world->memory, given->size, 1);
    if (!world->blocks[at])
        exit(1);
    memcpy(world->blocks[at], given->bytes, given->size);
    MUST(prepare_open((struct bytes){world->blocks[at], given->size}, &world->memory, copy, &error));
    for (uint32_t g = 0; g < count; g++)
        neutralise(&copy->geometries[g]);
}

static struct geometry loose_triangles(const float *corners, uint32_t count, uint32_t flags)
{
    return (struct geometry){.type = GEOMETRY_TRIANGLES,
                             .flags = flags,
                             .triangles = {.vertex_format = VK_FORMAT_R32G32B32_SFLOAT,
                                           .max_vertex = count ? 3 * count - 1 : 0,
                                           .vertex_stride = 12,
                                           .index_type = INDEX_NONE,
                                           .vertices = {(const unsigned char *)corners, 36 * (uint64_t)count + 12}},
                             .range.primitive_count = count};
}

/*
 * Adds triangles of very different sizes; every seventh repeats the one before it. With `nan`, one coordinate of every
 * fifth is NaN.
 */
static void add_soup(struct driver_world *world, struct random *random, uint32_t geometry_count, bool nan)
{
    static const uint32_t flags[SOUP_GEOMETRIES] = {GEOMETRY_OPAQUE, 0, GEOMETRY_OPAQUE | GEOMETRY_NO_DUPLICATE_ANY_HIT,
                                                    GEOMETRY_NO_DUPLICATE_ANY_HIT, 0};
    struct geometry geometries[SOUP_GEOMETRIES];
    float *corners = allocate(SOUP * geometry_count, 9 * sizeof *corners);
    for (uint32_t i = 0; i < SOUP * geometry_count; i++) {
        double centre[3], corner[3], size = pow(2, random_between(random, -6, 0));
        float *to = corners + 9 * (size_t)i;
        random_point(random, centre);
        for (int k = 0; k < 9; k++) {
            if (k % 3 == 0)
                random_point(random, corner);
            to[k] = (float)(centre[k % 3] + size * corner[k % 3]);
        }
        if (i % 7 == 6)
            memcpy(to, to - 9, 9 * sizeof *to);
        if (nan && i % 5 == 3)
            to[random_next(random) % 9] = NAN;
    }
    for (uint32_t g = 0; g < geometry_count; g++)
        geometries[g] = loose_triangles(corners + 9 * (size_t)SOUP * g, g == 4 ? 0 : SOUP, flags[g]);
    add_bottom(world, geometries, geometry_count);
    free(corners);
}

/*
 * Adds two geometries, one of them opaque, of boxes that overlap, flat ones, equal ones, and with `nan` inactive ones.
 */
static void add_boxes(struct driver_world *world, struct random *random, uint32_t count, bool nan)
{
    struct geometry geometries[2];
    float *boxes = allocate(2 * (uint64_t)count, 6 * sizeof *boxes);
    for (uint32_t i = 0; i < 2 * count; i++) {
        double centre[3], size[3];
        float *to = boxes + 6 * (size_t)i;
        random_point(random, centre);
        random_point(random, size);
        for (int axis = 0; axis < 3; axis++) {
            double half = i % 11 == 5 && axis == (int)(i % 3) ? 0 : 0.2 * fabs(size[axis]);
            to[axis] = (float)(centre[axis] - half);
            to[axis + 3] = (float)(centre[axis] + half);
        }
        if (i % 7 == 6)
            memcpy(to, to - 6, 6 * sizeof *to);
        if (nan && i % 5 == 3)
            to[0] = NAN;
    }
    for (uint32_t g = 0; g < 2; g++)
        geometries[g] = (struct geometry){
            .type = GEOMETRY_AABBS,
            .flags = g ? GEOMETRY_OPAQUE : 0,
            .aabbs = {24, {(const unsigned char *)(boxes + 6 * (size_t)g * count), 24 * (uint64_t)count}},
            .range.primitive_count = count};
    add_bottom(world, geometries, 2);
    free(boxes);
}

static void shuffle(struct mesh *mesh, struct random *random)
{
    for (uint32_t i = mesh->triangle_count; i > 1; i--) {
        uint32_t other = (uint32_t)(random_next(random) % i), kept[3];
        memcpy(kept, mesh->triangles[i - 1], sizeof kept);
        memcpy(mesh->triangles[i - 1], mesh->triangles[other], sizeof kept);
        memcpy(mesh->triangles[other], kept, sizeof kept);
    }
}

/* Adds three geometries over the same vertices. */
static void add_mesh(struct driver_world *world, const char *name, uint32_t size, struct random *random)
{
    static const uint32_t flags[3] = {GEOMETRY_OPAQUE, 0, GEOMETRY_NO_DUPLICATE_ANY_HIT};
    const struct adversarial *adversarial = adversarial_find(name);
    struct mesh mesh = {0};
    struct geometry geometries[3];
    adversarial->make(&mesh, size, random);
    shuffle(&mesh, random);
    for (uint32_t g = 0; g < 3; g++) {
        uint32_t begin = mesh.triangle_count * g / 3, end = mesh.triangle_count * (g + 1) / 3;
        geometries[g] = (struct geometry){
            .type = GEOMETRY_TRIANGLES,
            .flags = flags[g],
            .triangles = {.vertex_format = VK_FORMAT_R32G32B32_SFLOAT,
                          .max_vertex = mesh.vertex_count - 1,
                          .vertex_stride = 12,
                          .index_type = INDEX_UINT32,
                          .vertices = {(const unsigned char *)mesh.vertices, 12 * (uint64_t)mesh.vertex_count},
                          .indices = {(const unsigned char *)(mesh.triangles + begin), 12 * (uint64_t)(end - begin)}},
            .range.primitive_count = end - begin};
    }
    add_bottom(world, geometries, 3);
    mesh_finish(&mesh);
}

/* ---- Top level ---- */

static void move(const float matrix[12], const float point[3], float ret_point[3])
{
    for (int row = 0; row < 3; row++) {
        const float *m = matrix + 4 * (ptrdiff_t)row;
        ret_point[row] = m[0] * point[0] + m[1] * point[1] + m[2] * point[2] + m[3];
    }
}

static double determinant(const float m[12])
{
    return (double)m[0] * ((double)m[5] * m[10] - (double)m[6] * m[9]) -
           (double)m[1] * ((double)m[4] * m[10] - (double)m[6] * m[8]) +
           (double)m[2] * ((double)m[4] * m[9] - (double)m[5] * m[8]);
}

/* A matrix that is sheared and scaled, half of the time mirrored, and sometimes only a translation. */
static void random_matrix(struct random *random, float ret_matrix[12])
{
    double place[3], scale = pow(2, random_between(random, -3, 1.5));
    random_point(random, place);
    do {
        for (int k = 0; k < 12; k++)
            ret_matrix[k] = (float)(scale * random_between(random, -1, 1));
    } while (fabs(determinant(ret_matrix)) < 0.05 * scale * scale * scale);
    if (random_next(random) % 8 == 0)
        memcpy(ret_matrix, identity, sizeof identity);
    for (int axis = 0; axis < 3; axis++)
        ret_matrix[4 * axis + 3] = (float)(8 * place[axis]);
}

static VkAccelerationStructureInstanceKHR random_instance(struct random *random, uint32_t bottom_count)
{
    static const uint8_t masks[] = {0xff, 0xff, 0xff, 0x01, 0x80, 0x7e, 0};
    static const uint32_t flags[] = {0, 0, 0, INSTANCE_FORCE_OPAQUE, INSTANCE_FORCE_NO_OPAQUE};
    VkAccelerationStructureInstanceKHR instance = {0};
    float matrix[12];
    random_matrix(random, matrix);
    memcpy(&instance.transform, matrix, sizeof matrix);
    instance.instanceCustomIndex = (uint32_t)random_next(random) & 0xffffff;
    instance.mask = masks[random_next(random) % sizeof masks];
    instance.instanceShaderBindingTableRecordOffset = (uint32_t)random_next(random) & 0xffffff;
    instance.flags = (flags[random_next(random) % 5] |
                      (uint32_t)(random_next(random) & (INSTANCE_CULL_DISABLE | INSTANCE_FLIP_FACING))) &
                     0xff;
    instance.accelerationStructureReference = random_next(random) % 16 ? 1 + random_next(random) % bottom_count : 0;
    return instance;
}

static void grow_by_instance(struct driver_world *world, const VkAccelerationStructureInstanceKHR *instance)
{
    if (!instance->accelerationStructureReference)
        return;
    float matrix[12];
    memcpy(matrix, &instance->transform, sizeof matrix);
    const struct box *box = &world->bounds[instance->accelerationStructureReference - 1];
    for (int k = 0; k < 8; k++) {
        const float corner[3] = {k & 1 ? box->max[0] : box->min[0], k & 2 ? box->max[1] : box->min[1],
                                 k & 4 ? box->max[2] : box->min[2]};
        float moved[3];
        move(matrix, corner, moved);
        grow(&world->all, moved);
    }
}

/* Enlarges the box, so that also flat scenes are seen from outside. */
static void thicken(struct box *box)
{
    float largest = 0;
    for (int axis = 0; axis < 3; axis++)
        largest = fmaxf(largest, box->max[axis] - box->min[axis]);
    for (int axis = 0; axis < 3; axis++) {
        box->min[axis] -= 0.05f * largest;
        box->max[axis] += 0.05f * largest;
    }
}

static void add_top(struct driver_world *world, const VkAccelerationStructureInstanceKHR *instances, uint32_t count)
{
    struct reference references[DRIVER_WORLD_BOTTOMS];
    for (uint32_t i = 0; i < world->bottom_count; i++) {
        uint64_t number = (uint64_t)i + 1;
        references[i] =
            (struct reference){.kind = REFERENCE_BLAS, .handle = number, .has_key = true, .bounds = world->bounds[i]};
        memcpy(&references[i].key, &number, sizeof number);
    }
    const struct geometry geometry = {.type = GEOMETRY_INSTANCES,
                                      .instances = {{(const unsigned char *)instances, (uint64_t)RECORD * count}},
                                      .range.primitive_count = count};
    const struct build_input input = {.type = STRUCTURE_TOP,
                                      .flags = BUILD_ALLOW_COMPACTION,
                                      .geometry_count = 1,
                                      .geometries = &geometry,
                                      .reference_count = world->bottom_count,
                                      .references = references,
                                      .options.target = TARGET_PORTABLE};
    prepare_input(world, &input, &world->top);
    world->all = box_empty();
    for (uint32_t i = 0; i < count; i++)
        grow_by_instance(world, &instances[i]);
    thicken(&world->all);
}

void driver_world_init(struct driver_world *ret_world, uint64_t seed)
{
    struct random random = {seed};
    VkAccelerationStructureInstanceKHR instances[INSTANCES];
    *ret_world = (struct driver_world){.name = "mixed"};
    memory_init(&ret_world->memory, UINT64_MAX);
    add_mesh(ret_world, "sphere", 3000, &random);
    add_soup(ret_world, &random, SOUP_GEOMETRIES, false);
    add_boxes(ret_world, &random, BOXES, false);
    add_soup(ret_world, &random, 2, true);
    add_boxes(ret_world, &random, BOXES, true);
    add_boxes(ret_world, &random, 1, false);
    add_soup(ret_world, &random, 1, false);
    for (uint32_t i = 0; i < INSTANCES; i++)
        instances[i] = random_instance(&random, ret_world->bottom_count);
    /* Some instances are in the same place as another one. */
    for (uint32_t i = 10; i < INSTANCES; i += 20)
        instances[i].transform = instances[i - 1].transform;
    add_top(ret_world, instances, INSTANCES);
}

void driver_world_init_mesh(struct driver_world *ret_world, const char *name, uint32_t size, uint64_t seed)
{
    struct random random = {seed};
    VkAccelerationStructureInstanceKHR instances[2] = {0};
    *ret_world = (struct driver_world){.name = name};
    memory_init(&ret_world->memory, UINT64_MAX);
    add_mesh(ret_world, name, size, &random);
    for (uint32_t i = 0; i < 2; i++) {
        memcpy(&instances[i].transform, identity, sizeof identity);
        instances[i].mask = 0xff;
        instances[i].instanceCustomIndex = 7 + i;
        instances[i].accelerationStructureReference = 1;
    }
    instances[1].transform.matrix[0][0] = -1;
    add_top(ret_world, instances, 2);
}

void driver_world_finish(struct driver_world *world)
{
    for (uint32_t i = 0; i < world->bottom_count; i++) {
        prepare_finish(&world->bottoms[i], &world->memory);
        prepare_finish(&world->driver_bottoms[i], &world->memory);
        memory_free(&world->memory, world->blocks[i]);
    }
    prepare_finish(&world->top, &world->memory);
}

/* ---- Rays ---- */

const char *const driver_rays_names[DRIVER_RAYS] = {"outside", "within", "corners"};

static void random_place(const struct driver_world *world, struct random *random, double ret_point[3])
{
    for (int axis = 0; axis < 3; axis++)
        ret_point[axis] = random_between(random, world->all.min[axis], world->all.max[axis]);
}

/* Picks a vertex of an active triangle, or the middle of an edge, or a corner of a box. */
static void random_corner(const struct driver_world *world, struct random *random, float ret_point[3])
{
    float corners[3][3], point[3];
    int count = 0;
    for (int tries = 0; tries < 100; tries++) {
        struct canonical_instance instance =
            canonical_instance(&world->top.geometries[0], (uint32_t)(random_next(random) % world->top.primitive_count));
        uint64_t number;
        if (!instance.reference)
            continue;
        memcpy(&number, &world->top.references[instance.reference - 1].key, sizeof number);
        const struct canonical *bottom = &world->bottoms[number - 1];
        const struct canonical_geometry *geometry = &bottom->geometries[random_next(random) % bottom->geometry_count];
        if (!geometry->primitive_count ||
            !corners_of(geometry, (uint32_t)(random_next(random) % geometry->primitive_count), corners, &count))
            continue;
        const float *a = corners[random_next(random) % (unsigned)count],
                    *b = corners[random_next(random) % (unsigned)count];
        for (int axis = 0; axis < 3; axis++)
            point[axis] =
                geometry->boxes ? (random_next(random) % 2 ? a[axis] : b[axis]) : 0.5f * a[axis] + 0.5f * b[axis];
        move(instance.transform, point, ret_point);
        return;
    }
    memcpy(ret_point, world->all.min, 3 * sizeof *ret_point);
}

static struct ray ray_to(const double from[3], const double to[3])
{
    struct ray ray = {.tmax = 1e30f, .cull_mask = 0xff};
    for (int axis = 0; axis < 3; axis++) {
        ray.origin[axis] = (float)from[axis];
        ray.direction[axis] = (float)(to[axis] - from[axis]);
    }
    if (ray.direction[0] == 0 && ray.direction[1] == 0 && ray.direction[2] == 0)
        ray.direction[2] = 1;
    return ray;
}

static struct ray ray_of_picture(const struct driver_world *world, uint32_t number, uint32_t side)
{
    double eye[3], at[3];
    const double across[2] = {(number % side + 0.5) / side, (number / side + 0.5) / side};
    for (int axis = 0; axis < 3; axis++) {
        double low = world->all.min[axis], high = world->all.max[axis];
        eye[axis] = axis == 2 ? low - 1.1 * (high - low) - 0.01 : low + 0.6 * (high - low);
        at[axis] = axis == 2 ? 0.5 * low + 0.5 * high : low + across[axis] * (high - low);
    }
    return ray_to(eye, at);
}

static struct ray ray_within(const struct driver_world *world, struct random *random)
{
    double from[3], to[3];
    random_place(world, random, from);
    random_place(world, random, to);
    uint64_t choice = random_next(random) % 32;
    for (int axis = 0; axis < 3 && choice < 6; axis++)
        if (choice < 3 ? axis != (int)choice : axis == (int)choice - 3)
            to[axis] = from[axis];
    struct ray ray = ray_to(from, to);
    if (choice == 6)
        ray.tmin = 0.25f;
    if (choice == 7)
        ray.tmax = 1;
    return ray;
}

static struct ray ray_at_corner(const struct driver_world *world, struct random *random)
{
    float corner[3];
    double from[3], to[3];
    random_corner(world, random, corner);
    random_place(world, random, from);
    for (int axis = 0; axis < 3; axis++)
        to[axis] = corner[axis];
    /* Some rays are parallel to an axis, where no rounding of the direction moves them off the corner. */
    uint64_t along = random_next(random) % 6;
    for (uint64_t axis = 0; axis < 3 && along < 3; axis++)
        if (axis != along)
            from[axis] = to[axis];
    return ray_to(from, to);
}

void driver_world_rays(const struct driver_world *world, enum driver_rays kind, uint64_t seed, uint32_t count,
                       struct ray *ret_rays)
{
    struct random random = {seed};
    uint32_t side = (uint32_t)ceil(sqrt(count));
    for (uint32_t i = 0; i < count; i++)
        ret_rays[i] = kind == RAYS_FROM_OUTSIDE ? ray_of_picture(world, i, side)
                      : kind == RAYS_WITHIN     ? ray_within(world, &random)
                                                : ray_at_corner(world, &random);
}
