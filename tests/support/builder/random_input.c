/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/support/builder/random_input.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "tests/support/builder/random_kind.h"

uint32_t random_below(struct random *random, uint32_t count)
{
    return (uint32_t)(random_next(random) % count);
}

bool random_chance(struct random *random, double probability)
{
    return random_between(random, 0, 1) < probability;
}

void *random_input_zeroed(size_t count, size_t size)
{
    void *block = calloc(count ? count : 1, size);
    if (!block) {
        fprintf(stderr, "random_input: no memory\n");
        exit(1);
    }
    return block;
}

void *random_input_buffer(struct random_input *input, uint64_t size)
{
    void *buffer = malloc(size ? size : 1);
    if (!buffer || input->buffer_count == RANDOM_INPUT_BUFFERS) {
        fprintf(stderr, "random_input: no memory\n");
        exit(1);
    }
    input->sizes[input->buffer_count] = size;
    input->buffers[input->buffer_count++] = buffer;
    return buffer;
}

void random_input_move(void *request, struct random *random)
{
    struct random_input *input = request;
    for (uint32_t i = 0; i < input->input.geometry_count; i++)
        input->kind->move(input, i, random);
}

void random_input_options(struct build_input *input, struct random *random)
{
    static const uint32_t preferences[] = {0, BUILD_PREFER_FAST_TRACE, BUILD_PREFER_FAST_BUILD};
    static const uint32_t others[] = {BUILD_ALLOW_UPDATE, BUILD_ALLOW_COMPACTION, BUILD_LOW_MEMORY,
                                      BUILD_ALLOW_DATA_ACCESS};
    input->flags = preferences[random_below(random, 3)];
    for (int i = 0; i < 4; i++)
        input->flags |= random_chance(random, 0.25) ? others[i] : 0;
    input->options.quality = (enum build_quality)random_below(random, 5);
    input->options.target = TARGET_PORTABLE;
    input->options.layout_flags = random_below(random, 2);
}

static void start(struct random_input *ret_input, struct random *random, const struct random_kind *kind)
{
    memset(ret_input, 0, sizeof *ret_input);
    ret_input->kind = kind;
    ret_input->input.type = STRUCTURE_BOTTOM;
    ret_input->input.geometries = ret_input->geometries;
    ret_input->input.geometry_count = random_below(random, 20) ? 1 + random_below(random, RANDOM_INPUT_GEOMETRIES) : 0;
    random_input_options(&ret_input->input, random);
}

/* Small counts are as likely as large ones. */
static uint32_t random_count(struct random *random, uint32_t most)
{
    if (most == 0 || random_chance(random, 0.1))
        return 0;
    return (uint32_t)exp(random_between(random, 0, log(most + 1.0)));
}

static void fill(struct random_input *ret_input, struct random *random, uint32_t most, const struct random_kind *kind,
                 bool is_calm)
{
    start(ret_input, random, kind);
    ret_input->is_calm = is_calm;
    for (uint32_t i = 0; i < ret_input->input.geometry_count; i++)
        kind->make(ret_input, i, random_count(random, most / ret_input->input.geometry_count), random);
}

void random_input_triangles(struct random_input *ret_input, struct random *random, uint32_t most)
{
    fill(ret_input, random, most, &random_triangles, false);
}

void random_input_bottom(struct random_input *ret_input, struct random *random, uint32_t most)
{
    random_input_bottom_of(ret_input, random, most, RANDOM_FLAT);
}

void random_input_bottom_of(struct random_input *ret_input, struct random *random, uint32_t most,
                            enum random_choice choice)
{
    fill(ret_input, random, most, random_kind_any(choice, random), choice == RANDOM_ALL);
}

bool random_input_moves(const struct random_input *input)
{
    for (uint32_t i = 0; i < input->input.geometry_count; i++)
        if (input->geometries[i].type == GEOMETRY_MOVING_TRIANGLES)
            return true;
    return false;
}

struct oracle_mesh random_input_mesh(const struct random_input *input, uint32_t geometry)
{
    const struct random_meaning *meaning = &input->meanings[geometry];
    const float *positions =
        meaning->shape == ORACLE_TRIANGLES ? (const float *)meaning->corners : (const float *)meaning->centres;
    return (struct oracle_mesh){.shape = meaning->shape,
                                .positions = positions,
                                .end_positions = (const float *)meaning->end_corners,
                                .radii = meaning->radii,
                                .caps = meaning->caps,
                                .primitive_count = meaning->count,
                                .instance = RAY_NO_INSTANCE,
                                .geometry = geometry};
}

void random_input_finish(struct random_input *input)
{
    for (uint32_t i = 0; i < input->buffer_count; i++)
        free(input->buffers[i]);
    for (int i = 0; i < RANDOM_INPUT_GEOMETRIES; i++) {
        free(input->meanings[i].corners);
        free(input->meanings[i].end_corners);
        free(input->meanings[i].boxes);
        free(input->meanings[i].centres);
        free(input->meanings[i].radii);
        free(input->meanings[i].caps);
        free(input->plans[i]);
    }
    memset(input, 0, sizeof *input);
}
