/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/support/builder/broken_input.h"

#include <math.h>
#include <stdio.h>

#include "tests/support/builder/random_kind.h"
#include "tests/support/builder/random_motion.h"
#include "tests/support/builder/random_top.h"

/* Returns a number near which checks may fail: a small one, a power of two or a neighbour of one. */
static uint64_t random_number(struct random *random)
{
    if (random_chance(random, 0.4))
        return random_below(random, 70);
    uint64_t power = UINT64_C(1) << random_below(random, 64);
    return power + random_below(random, 3) - 1;
}

static struct geometry *any_geometry(struct broken_input *broken, struct random *random)
{
    return &broken->base
                .geometries[broken->input.geometry_count ? random_below(random, broken->input.geometry_count) : 0];
}

/* Returns the fields of a geometry. One of an unknown type is taken for triangles, but only its arrays are known. */
static struct random_fields fields_of(struct geometry *geometry)
{
    const struct random_kind *kind = random_kind_find(geometry->type);
    if (kind)
        return kind->fields(geometry);
    struct random_fields fields = random_triangles.fields(geometry);
    fields.index_type = fields.max_vertex = NULL;
    fields.format_count = fields.stride_count = 0;
    return fields;
}

/* Returns a number below `count`, without a random number where there is no choice. */
static uint32_t one_of(uint32_t count, struct random *random)
{
    return count > 1 ? random_below(random, count) : 0;
}

static struct bytes *any_bytes(struct geometry *geometry, struct random *random)
{
    struct random_fields fields = fields_of(geometry);
    return fields.arrays[one_of(fields.array_count, random)];
}

static void break_type(struct broken_input *broken, struct random *random)
{
    static const uint32_t types[] = {0, 1, 2, 3, 1000623000};
    broken->input.type = types[random_below(random, 5)];
}

static void break_flags(struct broken_input *broken, struct random *random)
{
    broken->input.flags = (uint32_t)random_number(random);
}

static void break_mode(struct broken_input *broken, struct random *random)
{
    broken->input.mode = random_below(random, 3);
    broken->input.source = random_below(random, 2);
}

static void break_geometry_count(struct broken_input *broken, struct random *random)
{
    if (random_chance(random, 0.3))
        broken->input.geometries = NULL;
    else if (broken->input.geometry_count)
        broken->input.geometry_count--;
}

/* Makes another kind of geometry over memory of any size at a valid address, or an unknown kind. */
static void break_geometry_type(struct broken_input *broken, struct random *random)
{
    struct geometry *geometry = any_geometry(broken, random);
    struct bytes bytes = {random_input_buffer(&broken->base, 96), 96};
    memset((void *)(uintptr_t)bytes.data, 0, 96);
    const uint32_t kinds = random_kind_count(broken->choice);
    uint32_t which = random_below(random, kinds + 1);
    if (which == kinds) {
        if (broken->choice != RANDOM_FLAT)
            random_triangles.blank(geometry, bytes); /* as fields_of() will take it */
        geometry->type = 3 + (uint32_t)random_number(random) % 1000000;
        return;
    }
    geometry->type = random_kinds[which]->type;
    random_kinds[which]->blank(geometry, bytes);
}

static void break_geometry_flags(struct broken_input *broken, struct random *random)
{
    any_geometry(broken, random)->flags = (uint32_t)random_number(random);
}

static void break_format(struct broken_input *broken, struct random *random)
{
    struct random_fields fields = fields_of(any_geometry(broken, random));
    if (fields.format_count)
        *fields.formats[one_of(fields.format_count, random)] = random_below(random, 130);
}

static void break_stride(struct broken_input *broken, struct random *random)
{
    struct random_fields fields = fields_of(any_geometry(broken, random));
    if (fields.stride_count)
        *fields.strides[one_of(fields.stride_count, random)] = random_number(random);
}

static void break_index_type(struct broken_input *broken, struct random *random)
{
    static const uint32_t types[] = {INDEX_NONE, INDEX_UINT16, INDEX_UINT32, 1000265000, 2, 99};
    struct random_fields fields = fields_of(any_geometry(broken, random));
    if (fields.index_type)
        *fields.index_type = types[random_below(random, 6)];
    if (fields.mode_count)
        *fields.modes[one_of(fields.mode_count, random)] = random_below(random, 3);
}

static void break_max_vertex(struct broken_input *broken, struct random *random)
{
    struct random_fields fields = fields_of(any_geometry(broken, random));
    if (fields.max_vertex)
        *fields.max_vertex = (uint32_t)random_number(random);
}

static void break_size(struct broken_input *broken, struct random *random)
{
    struct bytes *bytes = any_bytes(any_geometry(broken, random), random);
    if (!bytes->data || !bytes->size || random_chance(random, 0.2)) {
        *bytes = (struct bytes){NULL, 0};
        return;
    }
    uint64_t less = bytes->size - 1 - random_below(random, (uint32_t)(bytes->size < 100 ? bytes->size : 100));
    unsigned char *copy = random_input_buffer(&broken->base, less);
    memcpy(copy, bytes->data, less);
    *bytes = (struct bytes){copy, less};
}

static void break_range(struct broken_input *broken, struct random *random)
{
    struct geometry_range *range = &any_geometry(broken, random)->range;
    uint32_t *fields[] = {&range->primitive_count, &range->primitive_offset, &range->first_vertex,
                          &range->transform_offset};
    *fields[random_below(random, 4)] = (uint32_t)random_number(random);
}

static void break_contents(struct broken_input *broken, struct random *random)
{
    static const uint32_t words[] = {0,          1,          7,          0xffff,     0xffffffff,
                                     0x7fc00000, 0x7f800000, 0xff800000, 0x3f800000, 0x80000000};
    struct bytes *bytes = any_bytes(any_geometry(broken, random), random);
    for (uint32_t i = 0; i < 3 && bytes->size >= 4; i++) {
        uint32_t word = words[random_below(random, 10)];
        uint64_t at = random_next(random) % (bytes->size / 4) * 4;
        memcpy((void *)(uintptr_t)(bytes->data + at), &word, 4);
    }
}

static void break_options(struct broken_input *broken, struct random *random)
{
    struct build_options *options = &broken->input.options;
    switch (random_below(random, 3)) {
    case 0:
        options->quality = (enum build_quality)random_below(random, 9);
        break;
    case 1:
        options->target = (enum target)random_below(random, 4);
        break;
    default:
        options->layout_flags = (uint32_t)random_number(random);
    }
}

static void break_references(struct broken_input *broken, struct random *random)
{
    struct reference *reference = &broken->references[random_below(random, BROKEN_REFERENCES)];
    switch (random_below(random, 6)) {
    case 0:
        reference->handle = random_below(random, 3);
        break;
    case 1:
        reference->handle = broken->references[0].handle;
        break;
    case 2:
        reference->kind = (enum reference_kind)random_below(random, 4);
        break;
    case 3:
        reference->bounds.min[random_below(random, 3)] = random_chance(random, 0.5) ? NAN : INFINITY;
        break;
    case 4:
        broken->input.references = NULL;
        break;
    default:
        broken->input.reference_count = random_below(random, BROKEN_REFERENCES);
    }
}

static void break_handles(struct broken_input *broken, struct random *random)
{
    broken->input.destination = 3 + random_below(random, 2);
    broken->input.source = random_below(random, 5);
}

/* The array of motion instances: its last record ends before its stride does. */
enum { MOTION_BYTES = MOTION_RECORD_STRIDE * (BROKEN_RECORDS - 1) + MOTION_RECORD_SIZE };

/* Breaks what the flag MOTION has to do with: the flag itself, or the type and the flags of a motion instance. */
static void break_motion(struct broken_input *broken, struct random *random)
{
    const struct geometry *geometry = any_geometry(broken, random);
    if (geometry->type != GEOMETRY_MOVING_INSTANCES || random_chance(random, 0.3)) {
        broken->input.flags ^= BUILD_MOTION;
        return;
    }
    const uint32_t number = random_below(random, 5);
    const size_t at = (size_t)MOTION_RECORD_STRIDE * random_below(random, BROKEN_RECORDS) + 4 * random_below(random, 2);
    if (geometry->instances.records.size == MOTION_BYTES)
        memcpy((void *)(uintptr_t)(geometry->instances.records.data + at), &number, sizeof number);
}

static const struct {
    const char *name;
    void (*apply)(struct broken_input *broken, struct random *random);
} breaks[] = {
    {"type", break_type},
    {"flags", break_flags},
    {"mode", break_mode},
    {"geometryCount", break_geometry_count},
    {"geometryType", break_geometry_type},
    {"geometry flags", break_geometry_flags},
    {"vertexFormat", break_format},
    {"stride", break_stride},
    {"indexType", break_index_type},
    {"maxVertex", break_max_vertex},
    {"size", break_size},
    {"range", break_range},
    {"contents", break_contents},
    {"options", break_options},
    {"references", break_references},
    {"handles", break_handles},
    {"motion", break_motion}, /* where there is motion */
};

enum { BREAKS = sizeof breaks / sizeof breaks[0] };

static void make_top(struct broken_input *broken, struct random *random)
{
    unsigned char *records = random_input_buffer(&broken->base, 64 * BROKEN_RECORDS);
    for (uint32_t i = 0; i < BROKEN_RECORDS; i++) {
        struct random_instance instance = {.mask = 0xff, .custom_index = i};
        random_top_transform(broken->choice, random, instance.transform);
        random_top_record(&instance, i ? broken->references[i % BROKEN_REFERENCES].handle : 0,
                          records + (size_t)64 * i);
    }
    broken->input.type = STRUCTURE_TOP;
    broken->input.geometry_count = 1;
    broken->base.geometries[0] = (struct geometry){
        .type = GEOMETRY_INSTANCES,
        .instances = {{records, 64 * BROKEN_RECORDS}},
        .range = {.primitive_count = BROKEN_RECORDS},
    };
}

static void make_moving_top(struct broken_input *broken, struct random *random)
{
    unsigned char *records = random_input_buffer(&broken->base, MOTION_BYTES);
    memset(records, 0xdd, MOTION_BYTES);
    for (uint32_t i = 0; i < BROKEN_RECORDS; i++) {
        struct random_motion motion;
        const uint32_t words[2] = {i | UINT32_C(0xff000000), 0};
        random_motion_make(broken->choice, random, &motion);
        random_motion_record(&motion, words, i ? broken->references[i % BROKEN_REFERENCES].handle : 0,
                             records + (size_t)MOTION_RECORD_STRIDE * i);
    }
    broken->input.type = STRUCTURE_TOP;
    broken->input.flags |= BUILD_MOTION;
    broken->input.geometry_count = 1;
    broken->base.geometries[0] = (struct geometry){
        .type = GEOMETRY_MOVING_INSTANCES,
        .instances = {{records, MOTION_BYTES}},
        .range = {.primitive_count = BROKEN_RECORDS},
    };
}

void broken_input_init(struct broken_input *ret_broken, struct random *random, enum random_choice choice)
{
    memset(ret_broken, 0, sizeof *ret_broken);
    ret_broken->choice = choice;
    random_input_bottom_of(&ret_broken->base, random, 30, choice);
    ret_broken->base.input.destination = 3;
    ret_broken->input = ret_broken->base.input;
    for (uint32_t i = 0; i < BROKEN_REFERENCES; i++)
        ret_broken->references[i] = (struct reference){
            .kind = REFERENCE_BLAS, .handle = 50 + i, .bounds = {{-1, -1, -1}, {1, 1, (float)(i + 1)}}};
    ret_broken->input.references = ret_broken->references;
    ret_broken->input.reference_count = BROKEN_REFERENCES;
    const bool may_move = random_kind_count(choice) == RANDOM_KINDS;
    if (random_chance(random, 0.3))
        (may_move && random_chance(random, 0.7) ? make_moving_top : make_top)(ret_broken, random);
    for (uint32_t i = 1 + random_below(random, 3); i > 0; i--) {
        uint32_t which = random_below(random, may_move ? BREAKS : BREAKS - 1);
        size_t length = strlen(ret_broken->what);
        breaks[which].apply(ret_broken, random);
        snprintf(ret_broken->what + length, sizeof ret_broken->what - length, "%s%s", length ? ", " : "",
                 breaks[which].name);
    }
}

void broken_input_finish(struct broken_input *broken)
{
    random_input_finish(&broken->base);
}
