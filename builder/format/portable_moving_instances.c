/* SPDX-License-Identifier: Apache-2.0 */
/* portable_moving_instances.c - the records of motion instances. */
#include <assert.h>
#include <stddef.h>

#include "builder/format/portable_records.h"

enum { WORD = sizeof(uint32_t), NUMBERS = sizeof(((struct portable_moving_instance *)0)->start) / sizeof(float) };

/* The size of an instance by its MOTION_ type: how many numbers it has for one key, and how many keys. */
static const struct {
    uint32_t numbers, keys;
} motions[MOTION_TYPES] = {
    [MOTION_STATIC] = {PORTABLE_MATRIX, 1},
    [MOTION_MATRIX] = {PORTABLE_MATRIX, 2},
    [MOTION_SRT] = {PORTABLE_SRT, 2},
};

static void write_one(const struct canonical_geometry *geometry, uint32_t primitive, unsigned char *record)
{
    const unsigned char *source = geometry->instances + (uint64_t)MOTION_RECORD_STRIDE * primitive;
    const uint32_t motion = bytes_get32(source), size = motions[motion].numbers * WORD, keys = motions[motion].keys;
    const unsigned char *start = source + MOTION_RECORD_DATA, *end = start + (keys - 1) * size, *rest = end + size;
    const uint64_t reference = bytes_get64(rest + 8);
    assert(reference != 0); /* no tree contains inactive instances */
    struct portable_moving_instance instance = {
        .motion = motion,
        .custom_and_mask = bytes_get32(rest),
        .sbt_and_flags = bytes_get32(rest + 4),
        .instance = primitive,
        .handle = (uint32_t)(reference - 1),
    };
    memcpy(instance.start, start, size);
    memcpy(instance.end, end, size);
    memcpy(record, &instance, sizeof instance);
}

static void write(const struct portable_records *writer, const uint32_t *refs, uint32_t count, unsigned char *record)
{
    /* a top level has one geometry */
    for (uint32_t i = 0; i < count; i++, record += sizeof(struct portable_moving_instance))
        write_one(writer->canonical->geometries, refs[i], record);
}

/* Returns whether the numbers from `first` on are 0, and not -0. */
static bool are_zero(const float numbers[NUMBERS], uint32_t first)
{
    static const float zeros[NUMBERS];
    return memcmp(numbers + first, zeros, (NUMBERS - first) * sizeof *numbers) == 0;
}

static bool is_sound(const struct portable_view *view, const struct portable_moving_instance *instance)
{
    const uint32_t reserved = instance->reserved[0] | instance->reserved[1] | instance->reserved[2];
    if (instance->motion >= MOTION_TYPES || instance->instance >= view->header->primitive_count ||
        instance->handle >= view->handle_count || reserved != 0)
        return false;
    const uint32_t numbers = motions[instance->motion].numbers;
    if (!are_zero(instance->start, numbers) || !are_zero(instance->end, numbers))
        return false;
    return motions[instance->motion].keys > 1 || memcmp(instance->start, instance->end, sizeof instance->start) == 0;
}

static uint32_t find_unsound(const struct portable_view *view)
{
    const struct portable_moving_instance *instances = view->records;
    uint32_t i = 0;
    while (i < view->header->record_count && is_sound(view, &instances[i]))
        i++;
    return i;
}

const struct record_kind record_moving_instances = {
    .version = 2,
    .type = GEOMETRY_MOVING_INSTANCES,
    .is_top = true,
    .size = sizeof(struct portable_moving_instance),
    .node_size = sizeof(struct portable_moving_node),
    .first_leaf = 1,
    .cost = 1,
    .write = write,
    .find_unsound = find_unsound,
};
