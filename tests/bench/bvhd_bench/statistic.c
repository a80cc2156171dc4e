/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/bench/bvhd_bench/statistic.h"

#include <math.h>
#include <stdlib.h>

void statistic_add(struct statistic *statistic, double value)
{
    if (statistic->count < STATISTIC_MAX)
        statistic->values[statistic->count++] = value;
}

static int by_value(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

double statistic_median(const struct statistic *statistic)
{
    struct statistic sorted = *statistic;
    int middle = sorted.count / 2;
    if (sorted.count == 0)
        return 0;
    qsort(sorted.values, (size_t)sorted.count, sizeof sorted.values[0], by_value);
    return sorted.count % 2 ? sorted.values[middle] : (sorted.values[middle - 1] + sorted.values[middle]) / 2;
}

double statistic_mad(const struct statistic *statistic)
{
    struct statistic distances = *statistic;
    double median = statistic_median(statistic);
    for (int i = 0; i < distances.count; i++)
        distances.values[i] = fabs(distances.values[i] - median);
    return statistic_median(&distances);
}

static double extreme_of(const struct statistic *statistic, double sign)
{
    double extreme = statistic->count > 0 ? statistic->values[0] : 0;
    for (int i = 1; i < statistic->count; i++)
        if (sign * statistic->values[i] > sign * extreme)
            extreme = statistic->values[i];
    return extreme;
}

double statistic_least(const struct statistic *statistic)
{
    return extreme_of(statistic, -1);
}

double statistic_most(const struct statistic *statistic)
{
    return extreme_of(statistic, 1);
}
