/* SPDX-License-Identifier: Apache-2.0 */
/* portable_instances.c - the records of instances. */
#include <assert.h>
#include <float.h>
#include <math.h>

#include "builder/format/portable_records.h"

static void write_instance(const struct canonical_geometry *geometry, uint32_t primitive, unsigned char *record)
{
    const unsigned char *source = geometry->instances + (uint64_t)64 * primitive;
    uint64_t reference = bytes_get64(source + 56);
    assert(reference != 0); /* no tree contains inactive instances */
    struct portable_instance instance = {
        .custom_and_mask = bytes_get32(source + 48),
        .sbt_and_flags = bytes_get32(source + 52),
        .instance = primitive,
        .handle = (uint32_t)(reference - 1),
    };
    memcpy(instance.object_to_world, source, sizeof instance.object_to_world);
    portable_invert(instance.object_to_world, instance.world_to_object);
    memcpy(record, &instance, sizeof instance);
}

static void write_instances(const struct portable_records *writer, const uint32_t *refs, uint32_t count,
                            unsigned char *record)
{
    /* a top level has one geometry */
    for (uint32_t i = 0; i < count; i++, record += sizeof(struct portable_instance))
        write_instance(writer->canonical->geometries, refs[i], record);
}

static bool is_sound(const struct portable_view *view, const struct portable_instance *instance)
{
    uint32_t reserved = instance->reserved[0] | instance->reserved[1] | instance->reserved[2] | instance->reserved[3];
    return instance->instance < view->header->primitive_count && instance->handle < view->handle_count && reserved == 0;
}

static uint32_t find_unsound(const struct portable_view *view)
{
    const struct portable_instance *instances = view->records;
    uint32_t i = 0;
    while (i < view->header->record_count && is_sound(view, &instances[i]))
        i++;
    return i;
}

const struct record_kind record_instances = {
    .version = 1,
    .type = GEOMETRY_INSTANCES,
    .is_top = true,
    .size = sizeof(struct portable_instance),
    .node_size = sizeof(struct portable_node),
    .first_leaf = 1,
    .cost = 1,
    .write = write_instances,
    .find_unsound = find_unsound,
};

static double minor(const float m[12], int row, int column)
{
    static const int others[3][2] = {{1, 2}, {2, 0}, {0, 1}};
    const int *r = others[row], *c = others[column];
    return (double)m[4 * r[0] + c[0]] * m[4 * r[1] + c[1]] - (double)m[4 * r[0] + c[1]] * m[4 * r[1] + c[0]];
}

void portable_invert(const float matrix[12], float ret_inverse[12])
{
    double cofactors[3][3];
    for (int row = 0; row < 3; row++)
        for (int column = 0; column < 3; column++)
            cofactors[row][column] = minor(matrix, row, column);
    double determinant = matrix[0] * cofactors[0][0] + matrix[1] * cofactors[0][1] + matrix[2] * cofactors[0][2];
    bool finite = determinant < 0 || determinant > 0;
    for (int row = 0; row < 3 && finite; row++) {
        double move = 0;
        for (int column = 0; column < 3; column++) {
            double entry = cofactors[column][row] / determinant;
            move -= entry * matrix[4 * column + 3];
            finite = finite && fabs(entry) <= FLT_MAX;
            ret_inverse[4 * row + column] = (float)entry;
        }
        finite = finite && fabs(move) <= FLT_MAX;
        ret_inverse[4 * row + 3] = (float)move;
    }
    if (!finite)
        memset(ret_inverse, 0, 12 * sizeof *ret_inverse);
}
