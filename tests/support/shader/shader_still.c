/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/support/shader/shader_still.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "builder/traverse/motion.h"
#include "tests/support/builder/candidates.h"

static void *allocate(uint64_t count, size_t size)
{
    void *block = calloc((size_t)count + 1, size);
    if (!block) {
        fprintf(stderr, "shader still: no memory\n");
        exit(1);
    }
    return block;
}

static void stop_vertices(const struct portable_view *moving, float time, float *vertices)
{
    const struct motion_weights at = motion_weights_at(time);
    for (uint64_t i = 0; i < moving->header->vertex_count; i++)
        for (uint64_t axis = 0; axis < 3; axis++)
            vertices[3 * i + axis] =
                motion_number(moving->vertices[6 * i + axis], moving->vertices[6 * i + 3 + axis], at);
}

static void invert(const float m[12], float ret_inverse[12])
{
    long double inverse[3][3];
    candidates_invert(m, inverse);
    for (int row = 0; row < 3; row++) {
        long double moved = 0;
        for (int column = 0; column < 3; column++) {
            ret_inverse[4 * row + column] = (float)inverse[row][column];
            moved -= inverse[row][column] * m[4 * column + 3];
        }
        ret_inverse[4 * row + 3] = (float)moved;
    }
}

static void stop_instances(const struct portable_view *moving, float time, struct portable_instance *instances)
{
    const struct portable_moving_instance *records = moving->records;
    for (uint32_t i = 0; i < moving->header->record_count; i++) {
        instances[i] = (struct portable_instance){.custom_and_mask = records[i].custom_and_mask,
                                                  .sbt_and_flags = records[i].sbt_and_flags,
                                                  .instance = records[i].instance,
                                                  .handle = records[i].handle};
        float *matrix = instances[i].object_to_world;
        bool is_there = motion_matrix(&records[i], time, matrix);
        if (is_there)
            invert(matrix, instances[i].world_to_object);
        for (int k = 0; k < 12; k++)
            is_there = is_there && isfinite(instances[i].world_to_object[k]);
        instances[i].custom_and_mask &= is_there ? 0xffffffff : 0xffffff;
    }
}

/* Makes views[index] of a structure: the same, if it does not move. */
static void stop(struct shader_still *still, uint32_t index, const struct portable_view *view, float time)
{
    struct portable_view *copy = &still->views[index];
    struct portable_header *header = &still->headers[index];
    *copy = *view;
    *header = *view->header;
    copy->header = header;
    if (header->content == PORTABLE_MOVING_TRIANGLES) {
        float *vertices = allocate(UINT64_C(3) * header->vertex_count, sizeof *vertices);
        stop_vertices(view, time, vertices);
        copy->vertices = still->blocks[index] = vertices;
        header->content = PORTABLE_INDEXED_TRIANGLES;
    } else if (header->content == PORTABLE_MOVING_INSTANCES) {
        struct portable_instance *instances = allocate(header->record_count, sizeof *instances);
        stop_instances(view, time, instances);
        copy->records = still->blocks[index] = instances;
        header->content = PORTABLE_INSTANCES;
    }
}

void shader_still_make(const struct scene *scene, float time, struct shader_still *ret_still)
{
    const uint32_t count = scene->bottom_count;
    struct shader_still still = {
        .scene = *scene,
        .has_moving_top = scene->top && scene->top->header->content == PORTABLE_MOVING_INSTANCES,
        .views = allocate(count, sizeof *still.views),
        .headers = allocate(count, sizeof *still.headers),
        .bottoms = allocate(count, sizeof *still.bottoms),
        .blocks = allocate(count, sizeof *still.blocks),
    };
    for (uint32_t i = 0; i < count; i++)
        if (scene->bottoms[i]) {
            stop(&still, i, scene->bottoms[i], time);
            still.bottoms[i] = &still.views[i];
        }
    still.scene.bottoms = still.bottoms;
    still.scene.unpacked = NULL;
    still.scene.unpacked_top = NULL;
    if (scene->top) {
        stop(&still, count, scene->top, time);
        still.scene.top = &still.views[count];
    }
    *ret_still = still;
}

void shader_still_finish(struct shader_still *still)
{
    for (uint32_t i = 0; i <= still->scene.bottom_count; i++)
        free(still->blocks[i]);
    free(still->blocks);
    free(still->bottoms);
    free(still->headers);
    free(still->views);
}

static bool is_nearly_singular(const float m[12])
{
    double determinant = 0, permanent = 0;
    for (int i = 0; i < 3; i++) {
        const int j = (i + 1) % 3, k = (i + 2) % 3;
        const double left = (double)m[4 + j] * m[8 + k], right = (double)m[4 + k] * m[8 + j];
        determinant += m[i] * (left - right);
        permanent += fabs((double)m[i]) * (fabs(left) + fabs(right));
    }
    return !(fabs(determinant) > 1e-3 * permanent);
}

bool shader_still_is_flat(const struct shader_still *still, uint32_t instance)
{
    const struct portable_instance *records = still->has_moving_top ? still->scene.top->records : NULL;
    for (uint32_t i = 0; records && i < still->scene.top->header->record_count; i++)
        if (records[i].instance == instance)
            return is_nearly_singular(records[i].object_to_world);
    return false;
}

static bool moves(const struct portable_view *view)
{
    return view && view->node_size == sizeof(struct portable_moving_node);
}

bool shader_still_moves(const struct scene *scene)
{
    bool any = moves(scene->top);
    for (uint32_t i = 0; i < scene->bottom_count; i++)
        any = any || moves(scene->bottoms[i]);
    return any;
}
