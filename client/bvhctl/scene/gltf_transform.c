/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/scene/gltf_transform.h"

#include <math.h>
#include <string.h>

#include "builder/input/validate.h"

const struct gltf_matrix gltf_matrix_identity = {{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}};
const struct gltf_trs gltf_trs_identity = {{0, 0, 0}, {0, 0, 0, 1}, {1, 1, 1}};

struct gltf_matrix gltf_trs_matrix(const struct gltf_trs *trs)
{
    double x = trs->rotation[0], y = trs->rotation[1], z = trs->rotation[2], w = trs->rotation[3];
    const double rotation[3][3] = {{1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)},
                                   {2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)},
                                   {2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)}};
    struct gltf_matrix matrix;
    for (int row = 0; row < 3; row++) {
        for (int column = 0; column < 3; column++)
            matrix.at[4 * row + column] = rotation[row][column] * trs->scale[column];
        matrix.at[4 * row + 3] = trs->translation[row];
    }
    return matrix;
}

void gltf_trs_normalize(struct gltf_trs *trs)
{
    double *q = trs->rotation, length = sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
    for (int i = 0; i < 4 && length > 0; i++)
        q[i] /= length;
}

struct gltf_matrix gltf_matrix_product(const struct gltf_matrix *a, const struct gltf_matrix *b)
{
    struct gltf_matrix product;
    for (int row = 0; row < 3; row++)
        for (int column = 0; column < 4; column++) {
            double sum = 0;
            for (int k = 0; k < 3; k++)
                sum += a->at[4 * row + k] * b->at[4 * k + column];
            product.at[4 * row + column] = column == 3 ? sum + a->at[4 * row + 3] : sum;
        }
    return product;
}

bool gltf_matrix_round(const struct gltf_matrix *matrix, float ret_rounded[12])
{
    bool is_finite = true;
    for (int i = 0; i < 12; i++) {
        ret_rounded[i] = (float)matrix->at[i];
        is_finite &= isfinite(ret_rounded[i]) != 0;
    }
    return is_finite && validate_invertible(ret_rounded);
}

bool gltf_matrix_from_columns(const double columns[16], struct gltf_matrix *ret_matrix)
{
    static const double tolerance = 1e-5;
    bool is_affine = true;
    for (int column = 0; column < 4; column++) {
        for (int row = 0; row < 3; row++) {
            ret_matrix->at[4 * row + column] = columns[4 * column + row];
            is_affine &= isfinite(columns[4 * column + row]) != 0;
        }
        is_affine &= fabs(columns[4 * column + 3] - (column == 3)) <= tolerance;
    }
    return is_affine;
}

static void animate(const struct gltf_animated *animated, struct gltf_trs *trs)
{
    if (animated->has_translation)
        memcpy(trs->translation, animated->trs.translation, sizeof trs->translation);
    if (animated->has_rotation)
        memcpy(trs->rotation, animated->trs.rotation, sizeof trs->rotation);
    if (animated->has_scale)
        memcpy(trs->scale, animated->trs.scale, sizeof trs->scale);
}

enum bvhd_status gltf_transform_read(const struct gltf_file *file, const struct gltf_value *node,
                                     struct gltf_local *ret_local)
{
    double columns[16];
    struct gltf_local local = {.trs = gltf_trs_identity};
    struct gltf_value place = gltf_member(node, "matrix");
    enum bvhd_status status = gltf_numbers(file, node, "matrix", 16, columns, &local.is_matrix);
    if (!status && local.is_matrix && !gltf_matrix_from_columns(columns, &local.matrix))
        return gltf_refuse(file, BVHD_INVALID, &place, "not affine: its last row is not 0, 0, 0, 1");
    if (!status && !local.is_matrix)
        status = gltf_numbers(file, node, "translation", 3, local.trs.translation, NULL);
    if (!status && !local.is_matrix)
        status = gltf_numbers(file, node, "rotation", 4, local.trs.rotation, NULL);
    if (!status && !local.is_matrix)
        status = gltf_numbers(file, node, "scale", 3, local.trs.scale, NULL);
    *ret_local = local;
    return status;
}

struct gltf_matrix gltf_transform_matrix(const struct gltf_local *local, const struct gltf_animated *animated)
{
    struct gltf_trs trs = local->trs;
    if (local->is_matrix)
        return local->matrix;
    if (animated)
        animate(animated, &trs);
    return gltf_trs_matrix(&trs);
}
