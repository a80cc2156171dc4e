/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/support/builder/random_top.h"

#include <math.h>
#include <stdlib.h>

#include "tests/support/builder/random_kind.h"

/* Returns the distance of records. The last motion record ends before it. */
static uint32_t record_stride(const struct random_top *top)
{
    return top->moves ? MOTION_RECORD_STRIDE : 64;
}

static double determinant(const float m[12])
{
    return (double)m[0] * ((double)m[5] * m[10] - (double)m[6] * m[9]) -
           (double)m[1] * ((double)m[4] * m[10] - (double)m[6] * m[8]) +
           (double)m[2] * ((double)m[4] * m[9] - (double)m[5] * m[8]);
}

void random_top_transform(enum random_choice choice, struct random *random, float ret_matrix[12])
{
    static const float identity[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
    static const double flat_scales[] = {1, 1, 1, 0.01, 30}, other_scales[] = {1, 1, 1, 0.3, 3};
    memcpy(ret_matrix, identity, sizeof identity);
    if (random_chance(random, 0.1))
        return;
    double scale = (choice == RANDOM_FLAT ? flat_scales : other_scales)[random_below(random, 5)];
    do {
        for (int i = 0; i < 12; i++)
            ret_matrix[i] = (float)random_between(random, -1, 1);
    } while (fabs(determinant(ret_matrix)) < 0.05);
    for (int i = 0; i < 12; i++)
        ret_matrix[i] *= (float)(i % 4 == 3 ? 4 : scale);
}

static void pack(const struct random_instance *instance, uint32_t ret_words[2])
{
    ret_words[0] = instance->custom_index | instance->mask << 24;
    ret_words[1] = instance->sbt_offset | instance->flags << 24;
}

void random_top_record(const struct random_instance *instance, uint64_t handle, unsigned char *ret_record)
{
    uint32_t words[2];
    pack(instance, words);
    memcpy(ret_record, instance->transform, sizeof instance->transform);
    memcpy(ret_record + 48, words, sizeof words);
    memcpy(ret_record + 56, &handle, sizeof handle);
}

/* Writes the record of an instance that names `handle`. */
static void write_record(const struct random_top *top, uint32_t index, uint64_t handle)
{
    const struct random_instance *instance = &top->instances[index];
    unsigned char *record = top->records + top->geometry.range.primitive_offset + (size_t)record_stride(top) * index;
    uint32_t words[2];
    pack(instance, words);
    if (top->moves)
        random_motion_record(&instance->motion, words, handle, record);
    else
        random_top_record(instance, handle, record);
}

bool random_top_matrix(const struct random_top *top, uint32_t instance, float time, float ret_matrix[12])
{
    const struct random_instance *that = &top->instances[instance];
    if (top->moves)
        return random_motion_matrix(&that->motion, time, ret_matrix);
    memcpy(ret_matrix, that->transform, sizeof that->transform);
    return true;
}

static struct random_instance random_instance(const struct random_top *top, struct random *random)
{
    static const uint32_t masks[] = {0xff, 0xff, 0xff, 0x01, 0x80, 0};
    static const uint32_t flags[] = {
        0, 0, INSTANCE_FLIP_FACING, INSTANCE_FORCE_OPAQUE, INSTANCE_FORCE_NO_OPAQUE, INSTANCE_CULL_DISABLE};
    struct random_instance instance = {
        .custom_index = random_below(random, 1 << 24),
        .mask = masks[random_below(random, 6)],
        .sbt_offset = random_below(random, 1 << 24),
        .flags = flags[random_below(random, 6)] | (random_chance(random, 0.2) ? INSTANCE_FLIP_FACING : 0),
        .bottom = random_chance(random, 0.1) ? -1 : (int)random_below(random, top->bottom_count),
    };
    if (top->moves)
        random_motion_make(top->choice, random, &instance.motion);
    else
        random_top_transform(top->choice, random, instance.transform);
    return instance;
}

static void make_records(struct random_top *top, struct random *random)
{
    uint32_t offset = 16 * random_below(random, 3);
    uint64_t size = offset + (uint64_t)record_stride(top) * top->instance_count;
    if (top->moves && top->instance_count)
        size -= MOTION_RECORD_STRIDE - MOTION_RECORD_SIZE;
    top->records = random_input_zeroed(size, 1);
    top->geometry.range = (struct geometry_range){.primitive_count = top->instance_count, .primitive_offset = offset};
    for (uint32_t i = 0; i < top->instance_count; i++) {
        struct random_instance *instance = &top->instances[i];
        *instance = random_instance(top, random);
        top->culling_disabled |= (instance->flags & INSTANCE_CULL_DISABLE) != 0;
        write_record(top, i, instance->bottom < 0 ? 0 : top->references[instance->bottom].handle);
    }
    top->geometry.type = top->moves ? GEOMETRY_MOVING_INSTANCES : GEOMETRY_INSTANCES;
    top->geometry.flags = random_below(random, 4);
    top->geometry.instances.records = (struct bytes){top->records, size};
}

void random_top_move(void *request, struct random *random)
{
    struct random_top *top = request;
    top->culling_disabled = false;
    for (uint32_t i = 0; i < top->instance_count; i++) {
        struct random_instance *instance = &top->instances[i];
        if (instance->bottom >= 0) {
            *instance = random_instance(top, random);
            instance->bottom = (int)random_below(random, top->bottom_count);
            write_record(top, i, top->references[instance->bottom].handle);
        }
        top->culling_disabled |= (instance->flags & INSTANCE_CULL_DISABLE) != 0;
    }
    for (uint32_t i = 0; i < top->bottom_count; i++)
        for (int g = 0; g < RANDOM_INPUT_GEOMETRIES; g++) {
            free(top->flipped[i][g]);
            free(top->end_flipped[i][g]);
            top->flipped[i][g] = top->end_flipped[i][g] = NULL;
        }
}

void random_top_init(struct random_top *ret_top, struct random *random, uint32_t most)
{
    random_top_init_of(ret_top, random, most, RANDOM_FLAT);
}

void random_top_init_of(struct random_top *ret_top, struct random *random, uint32_t most, enum random_choice choice)
{
    memset(ret_top, 0, sizeof *ret_top);
    ret_top->choice = choice;
    ret_top->bottom_count = 1 + random_below(random, RANDOM_TOP_BOTTOMS);
    for (uint32_t i = 0; i < ret_top->bottom_count; i++) {
        random_input_bottom_of(&ret_top->bottoms[i], random, most, choice);
        ret_top->references[i] =
            (struct reference){.kind = REFERENCE_BLAS, .handle = 1000 - 7 * (uint64_t)i, .has_key = true};
    }
    for (uint32_t i = 0; i < ret_top->bottom_count; i++)
        ret_top->moves |= random_input_moves(&ret_top->bottoms[i]);
    ret_top->moves |= choice == RANDOM_MOTION || (choice == RANDOM_ALL && random_chance(random, 0.3));
    ret_top->instance_count = random_below(random, RANDOM_TOP_INSTANCES + 1);
    make_records(ret_top, random);
    random_input_options(&ret_top->input, random);
    ret_top->input.flags |= ret_top->moves ? BUILD_MOTION : 0;
    ret_top->input.type = STRUCTURE_TOP;
    ret_top->input.geometry_count = 1;
    ret_top->input.geometries = &ret_top->geometry;
    ret_top->input.references = ret_top->references;
    ret_top->input.reference_count = ret_top->bottom_count;
}

void random_top_finish(struct random_top *top)
{
    for (uint32_t i = 0; i < top->bottom_count; i++) {
        random_input_finish(&top->bottoms[i]);
        for (int g = 0; g < RANDOM_INPUT_GEOMETRIES; g++) {
            free(top->flipped[i][g]);
            free(top->end_flipped[i][g]);
        }
    }
    free(top->records);
    free(top->meshes);
}

/* Returns the corners with reversed winding; NULL: there are none. They are made once. */
static const float *flip(const struct random_meaning *meaning, float (*corners)[3][3], float **flipped)
{
    if (*flipped || !corners)
        return *flipped;
    *flipped = random_input_zeroed(meaning->count, 9 * sizeof **flipped);
    for (uint32_t i = 0; i < meaning->count; i++)
        for (uint32_t k = 0; k < 9; k++)
            (*flipped)[9 * (size_t)i + k] = corners[i][(3 - k / 3) % 3][k % 3];
    return *flipped;
}

void random_top_mean(struct random_top *top, uint32_t cull_mask)
{
    if (!top->meshes)
        top->meshes = random_input_zeroed((size_t)top->instance_count * RANDOM_INPUT_GEOMETRIES, sizeof *top->meshes);
    top->mesh_count = 0;
    for (uint32_t i = 0; i < top->instance_count; i++) {
        const struct random_instance *instance = &top->instances[i];
        if (instance->bottom < 0 || !(instance->mask & cull_mask) || !random_motion_is_active(&instance->motion))
            continue;
        uint32_t b = (uint32_t)instance->bottom;
        for (uint32_t g = 0; g < top->bottoms[b].input.geometry_count; g++) {
            const struct random_meaning *meaning = &top->bottoms[b].meanings[g];
            struct oracle_mesh mesh = random_input_mesh(&top->bottoms[b], g);
            if (meaning->boxes)
                continue;
            if (meaning->corners && instance->flags & INSTANCE_FLIP_FACING) {
                mesh.positions = flip(meaning, meaning->corners, &top->flipped[b][g]);
                mesh.end_positions = flip(meaning, meaning->end_corners, &top->end_flipped[b][g]);
            }
            mesh.transform = instance->transform;
            if (top->moves)
                random_motion_apply(&instance->motion, &mesh);
            mesh.instance = i;
            top->meshes[top->mesh_count++] = mesh;
        }
    }
}

uint32_t random_top_rows(const struct random_top *top, const struct portable_view *views,
                         const struct portable_view *ret_bottoms[RANDOM_TOP_BOTTOMS])
{
    int used[RANDOM_TOP_BOTTOMS];
    uint32_t count = 0;
    for (uint32_t i = 0; i < top->instance_count; i++) {
        int bottom = top->instances[i].bottom;
        bool known = bottom < 0;
        for (uint32_t k = 0; k < count && !known; k++)
            known = used[k] == bottom;
        if (known)
            continue;
        used[count] = bottom;
        ret_bottoms[count++] = &views[bottom];
    }
    return count;
}

static struct random_fields fields(struct geometry *geometry)
{
    return (struct random_fields){.array_count = 1, .arrays = {&geometry->instances.records}};
}

static void blank(struct geometry *geometry, struct bytes bytes)
{
    geometry->instances = (struct geometry_instances){bytes};
}

const struct random_kind random_instances = {.type = GEOMETRY_INSTANCES, .fields = fields, .blank = blank};

const struct random_kind random_moving_instances = {
    .type = GEOMETRY_MOVING_INSTANCES, .fields = fields, .blank = blank};
