/* SPDX-License-Identifier: Apache-2.0 */
/* statistic.h - what becomes of repeated measurements. */
#ifndef BVHD_BENCH_STATISTIC_H
#define BVHD_BENCH_STATISTIC_H

enum { STATISTIC_MAX = 101 };

/* Values of one thing. Later ones than STATISTIC_MAX are dropped. */
struct statistic {
    int count;
    double values[STATISTIC_MAX];
};

void statistic_add(struct statistic *statistic, double value);
/* 0 without a value. */
double statistic_median(const struct statistic *statistic);
/* 0 without a value. */
double statistic_least(const struct statistic *statistic);
double statistic_most(const struct statistic *statistic);
/* The median distance from the median, as large as it is: not scaled to a standard deviation. */
double statistic_mad(const struct statistic *statistic);

#endif
