/* SPDX-License-Identifier: Apache-2.0 */
/* statistic.h - summarises repeated measurements. */
#ifndef BVHD_BENCH_STATISTIC_H
#define BVHD_BENCH_STATISTIC_H

enum { STATISTIC_MAX = 101 };

/* The values of one measurement. Values after the first STATISTIC_MAX are dropped. */
struct statistic {
    int count;
    double values[STATISTIC_MAX];
};

void statistic_add(struct statistic *statistic, double value);
/* Each of the following is 0 without a value. */
double statistic_median(const struct statistic *statistic);
double statistic_least(const struct statistic *statistic);
double statistic_most(const struct statistic *statistic);
/* The median absolute deviation from the median, without a scale factor to a standard deviation. */
double statistic_mad(const struct statistic *statistic);

#endif
