/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/format/lavapipe.h"

#include <math.h>
#include <stdbool.h>

/*
 * The driver inverts a general 4x4 matrix by elimination with one pivot per column, and passes the rows of the
 * instance's matrix as columns. Therefore this code eliminates the transpose of the 4x4 matrix whose last row is 0 0 0
 * 1, beside a unit matrix. It skips the same products as the driver, because a product of zero and infinity is not
 * zero.
 */
struct matrix_row {
    float left[4], right[4];
};

static void load(const float matrix[12], struct matrix_row rows[4])
{
    for (int i = 0; i < 4; i++)
        for (int k = 0; k < 4; k++) {
            rows[i].left[k] = k < 3 ? matrix[4 * k + i] : i == 3 ? 1.0f : 0.0f;
            rows[i].right[k] = i == k ? 1.0f : 0.0f;
        }
}

/* Moves the row with the largest entry of that column up, by swapping neighbours from the bottom. */
static void choose_pivot(struct matrix_row *rows[4], int column)
{
    for (int i = 3; i > column; i--)
        if (fabsf(rows[i]->left[column]) > fabsf(rows[i - 1]->left[column])) {
            struct matrix_row *swap = rows[i];
            rows[i] = rows[i - 1];
            rows[i - 1] = swap;
        }
}

/* As in the driver, the elimination of the last column computes every product. */
static void eliminate(struct matrix_row *rows[4], int column)
{
    const struct matrix_row *pivot = rows[column];
    float factors[4];
    for (int i = column + 1; i < 4; i++)
        factors[i] = rows[i]->left[column] / pivot->left[column];
    for (int i = column + 1; i < 4; i++) {
        for (int k = column + 1; k < 4; k++)
            rows[i]->left[k] -= factors[i] * pivot->left[k];
        for (int k = 0; k < 4; k++)
            if (column == 2 || pivot->right[k] != 0.0f)
                rows[i]->right[k] -= factors[i] * pivot->right[k];
    }
}

static void substitute_back(struct matrix_row *rows[4])
{
    float scale = 1.0f / rows[3]->left[3];
    for (int k = 0; k < 4; k++)
        rows[3]->right[k] *= scale;
    for (int column = 3; column > 0; column--) {
        struct matrix_row *next = rows[column - 1];
        scale = 1.0f / next->left[column - 1];
        for (int k = 0; k < 4; k++)
            next->right[k] = scale * (next->right[k] - rows[column]->right[k] * next->left[column]);
        for (int i = column - 2; i >= 0; i--)
            for (int k = 0; k < 4; k++)
                rows[i]->right[k] -= rows[column]->right[k] * rows[i]->left[column];
    }
}

void lavapipe_invert(const float object_to_world[12], float ret_world_to_object[12])
{
    struct matrix_row storage[4], *rows[4] = {&storage[0], &storage[1], &storage[2], &storage[3]};
    bool regular = true;
    load(object_to_world, storage);
    for (int column = 0; column < 3 && regular; column++) {
        choose_pivot(rows, column);
        regular = rows[column]->left[column] != 0.0f;
        if (regular)
            eliminate(rows, column);
    }
    regular = regular && rows[3]->left[3] != 0.0f;
    if (regular)
        substitute_back(rows);
    for (int i = 0; i < 4; i++)
        for (int k = 0; k < 3; k++)
            ret_world_to_object[4 * k + i] = regular ? rows[i]->right[k] : 0.0f;
}
