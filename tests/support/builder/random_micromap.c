/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/support/builder/random_micromap.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "builder/update/batch.h"
#include "proto/base/validate_shape.h"

enum { SPECIAL = 4, INDEX_TYPES = 4 };

static void must(bool condition, const char *what, const struct bvhd_error *error)
{
    if (condition)
        return;
    fprintf(stderr, "random micromap: %s: %s %s\n", what, error ? error->where : "", error ? error->text : "");
    abort();
}

static void *allocate(uint64_t size)
{
    void *block = calloc(size + 1, 1);
    must(block, "no memory", NULL);
    return block;
}

static uint32_t below(struct random *random, uint64_t count)
{
    return (uint32_t)(random_next(random) % count);
}

struct micromap_triangle random_micromap_triangle(const struct random_micromap *micromap, uint32_t index)
{
    struct micromap_triangle triangle;
    memcpy(&triangle, (const unsigned char *)micromap->triangles + micromap->stride * index, sizeof triangle);
    return triangle;
}

/* Fills the states of a triangle: one state in a third of all, else any, or long runs of the same ones. */
static void fill_states(struct random *random, const struct micromap_triangle *triangle, unsigned char *states)
{
    const uint32_t bytes = micro_triangle_bytes((enum micro_format)triangle->format, triangle->level);
    const unsigned whole = below(random, 4), manner = below(random, 3);
    const unsigned char byte = (unsigned char)(triangle->format == MICRO_2_STATE ? (whole & 1) * 0xff : whole * 0x55);
    for (uint32_t i = 0; i < bytes; i++)
        states[i] = manner == 0 || (manner == 1 && below(random, 8)) ? byte : (unsigned char)random_next(random);
}

/* Places the states behind those of the others, or, of one triangle in four, anywhere among them. */
static void make_triangles(struct random *random, unsigned max_level, struct random_micromap *micromap)
{
    unsigned char *at = (unsigned char *)micromap->triangles;
    uint64_t room = 0;
    for (uint32_t i = 0; i < micromap->count; i++, at += micromap->stride) {
        struct micromap_triangle triangle = {.level = (uint16_t)below(random, max_level + 1),
                                             .format = (uint16_t)(1 + below(random, 2))};
        const uint32_t bytes = micro_triangle_bytes((enum micro_format)triangle.format, triangle.level);
        const bool is_shared = micromap->states_size >= bytes && below(random, 4) == 0;
        triangle.offset =
            (uint32_t)(is_shared ? below(random, micromap->states_size - bytes + 1) : micromap->states_size);
        if (!is_shared && micromap->states_size + bytes > room) {
            room = 2 * (micromap->states_size + bytes);
            micromap->states = realloc(micromap->states, room);
            must(micromap->states, "no memory", NULL);
        }
        if (!is_shared) {
            fill_states(random, &triangle, micromap->states + micromap->states_size);
            micromap->states_size += bytes;
        }
        memcpy(at, &triangle, sizeof triangle);
    }
}

/* Counts the triangles; the first two usages take some of what the others say away from them. */
static void make_usages(struct random *random, struct random_micromap *micromap)
{
    struct micromap_usage *usages = micromap->usages;
    micromap->usage_count = 2 * (MICRO_LEVEL_MAX + 1) + 2;
    for (uint32_t i = 0; i < micromap->usage_count; i++) {
        const uint32_t kind = i < 2 ? below(random, 2 * (MICRO_LEVEL_MAX + 1)) : i - 2;
        usages[i] = (struct micromap_usage){0, kind / 2, 1 + kind % 2};
    }
    for (uint32_t i = 0; i < micromap->count; i++) {
        const struct micromap_triangle triangle = random_micromap_triangle(micromap, i);
        uint32_t k = below(random, 3);
        while (usages[k].level != triangle.level || usages[k].format != triangle.format)
            k++;
        usages[k].count++;
    }
}

static void build_micromap(uint32_t flags, struct random_micromap *micromap)
{
    struct memory memory;
    struct batch_item item;
    struct bvhd_error error = {0};
    const struct limits limits = limits_default();
    const struct build_context context = {.memory = &memory, .parallel = &parallel_serial};
    const struct build_input input = {.type = STRUCTURE_MICROMAP,
                                      .flags = flags,
                                      .geometry_count = 1,
                                      .geometries = &micromap->geometry,
                                      .options.target = TARGET_PORTABLE};
    void *copy = NULL;
    memory_init(&memory, UINT64_MAX);
    must(batch_build(&input, 1, &limits, &context, &item, &error) == BVHD_OK, "batch", &error);
    must(item.status == BVHD_OK, "build", &item.error);
    must(posix_memalign(&copy, 64, item.size) == 0, "no memory", NULL);
    memcpy(copy, item.blob, item.size);
    micromap->blob = (struct bytes){copy, item.size};
    micromap->key = item.key;
    batch_finish(&item, 1, &memory);
}

void random_micromap_make(struct random *random, uint32_t count, unsigned max_level, uint32_t flags,
                          struct random_micromap *ret_micromap)
{
    struct random_micromap *micromap = ret_micromap;
    *micromap = (struct random_micromap){.count = count, .stride = 8 + 4 * (uint64_t)below(random, 3)};
    micromap->triangles = allocate(micromap->stride * count);
    micromap->states = allocate(0);
    make_triangles(random, max_level, micromap);
    make_usages(random, micromap);
    micromap->geometry = (struct geometry){
        .type = GEOMETRY_MICROMAP,
        .micromap = {.usages = {(const unsigned char *)micromap->usages,
                                micromap->usage_count * sizeof *micromap->usages},
                     .states = {micromap->states, micromap->states_size},
                     .triangles = {(const unsigned char *)micromap->triangles, micromap->stride * count},
                     .stride = micromap->stride},
        .range.primitive_count = count,
    };
    validate_micromaps = true;
    build_micromap(flags, micromap);
}

void random_micromap_finish(struct random_micromap *micromap)
{
    free(micromap->triangles);
    free(micromap->states);
    free((void *)(uintptr_t)micromap->blob.data);
}

struct reference random_micromap_reference(const struct random_micromap *micromap, uint64_t handle)
{
    return (struct reference){
        .kind = REFERENCE_MICROMAP, .handle = handle, .has_key = true, .key = micromap->key, .blob = micromap->blob};
}

/* Writes an index of `size` bytes, less the base if it is none of the special ones. */
static void write_index(uint32_t name, uint32_t base, uint32_t size, unsigned char *to)
{
    const uint32_t index = name >= MICROMAP_FULLY_UNKNOWN_OPAQUE ? name : name - base;
    if (size == 1)
        *to = (unsigned char)index;
    else if (size == 2)
        memcpy(to, &(uint16_t){(uint16_t)index}, size);
    else
        bytes_put32(to, index);
}

static void count_name(struct random_attachment *attachment, uint32_t name)
{
    if (name >= MICROMAP_FULLY_UNKNOWN_OPAQUE)
        return;
    const struct micromap_triangle triangle = random_micromap_triangle(attachment->micromap, name);
    attachment->usages[2 * triangle.level + triangle.format - 1].count++;
}

void random_micromap_attach(struct random *random, const struct random_micromap *micromap, uint64_t handle,
                            struct geometry *geometry, struct random_attachment *ret_attachment)
{
    static const uint32_t types[INDEX_TYPES] = {INDEX_UINT8, INDEX_UINT16, INDEX_UINT32, INDEX_NONE},
                          sizes[INDEX_TYPES] = {1, 2, 4, 0};
    struct random_attachment *attachment = ret_attachment;
    const uint32_t count = geometry->range.primitive_count, all = micromap ? micromap->count : 0;
    uint32_t type = below(random, INDEX_TYPES);
    if (types[type] == INDEX_NONE && (!micromap || all < count))
        type = 2;
    const bool is_ext = types[type] != INDEX_UINT8 && below(random, 2);
    const uint32_t size = sizes[type], gap = below(random, 3) * size;
    /* Only indices that the type has are used, counted from the base, which may wrap. */
    const uint32_t most = size == 1 ? 0xfb : size == 2 ? 0xfffb : UINT32_MAX;
    const uint32_t base = size == 0                       ? below(random, (uint64_t)all - count + 1)
                          : size == 4 && below(random, 2) ? (uint32_t)random_next(random) & 0x0fffffff
                                                          : below(random, (uint64_t)all / 2 + 1);
    *attachment = (struct random_attachment){.micromap = micromap, .count = count};
    attachment->names = allocate((uint64_t)count * sizeof *attachment->names);
    attachment->indices = allocate((uint64_t)count * (size + gap));
    for (uint32_t i = 0; i < 2 * (MICRO_LEVEL_MAX + 1); i++)
        attachment->usages[i] = (struct micromap_usage){0, i / 2, 1 + i % 2};
    for (uint32_t i = 0; i < count; i++) {
        uint32_t name = ~below(random, SPECIAL);
        if (size == 0)
            name = base + i;
        else if (all > 0 && below(random, 4))
            name = size == 4 ? below(random, all) : base + below(random, all - base < most ? all - base : most);
        if (size == 4 && name < MICROMAP_FULLY_UNKNOWN_OPAQUE && name - base >= MICROMAP_FULLY_UNKNOWN_OPAQUE)
            name = ~below(random, SPECIAL); /* its index would be a special one */
        attachment->names[i] = name;
        count_name(attachment, name);
        if (size > 0)
            write_index(name, base, size, attachment->indices + (uint64_t)i * (size + gap));
    }
    geometry->triangles.micromap = (struct triangle_micromap){
        .is_given = 1,
        .index_type = types[type],
        .indices = {size ? attachment->indices : NULL, (uint64_t)count * (size + gap)},
        .stride = size + gap,
        .base_triangle = base,
        .has_usages = is_ext,
        .usages = {(const unsigned char *)attachment->usages, is_ext ? sizeof attachment->usages : 0},
        .micromap = micromap ? handle : 0,
    };
}

void random_attachment_finish(struct random_attachment *attachment)
{
    free(attachment->indices);
    free(attachment->names);
}

enum micro_state random_attachment_state(const struct random_attachment *attachment, uint32_t triangle, float u,
                                         float v)
{
    const uint32_t name = attachment->names[triangle];
    if (name >= MICROMAP_FULLY_UNKNOWN_OPAQUE)
        return (enum micro_state) ~name;
    const struct micromap_triangle found = random_micromap_triangle(attachment->micromap, name);
    return micro_triangle_state(attachment->micromap->states + found.offset, (enum micro_format)found.format,
                                micro_triangle_index(u, v, found.level));
}
