/* SPDX-License-Identifier: Apache-2.0 */
/*
 * fault_bed.h - a daemon with a cache on disk whose system calls fail when a test says so, and meshes whose right
 * results are known, from a second daemon without any of that.
 *
 * For test programs only. Failed expectations are printed and counted, as by hostile.h; failures on this side end the
 * program. A test stands on the same random numbers whenever it has the same seed.
 */
#ifndef BVHD_FAULT_BED_H
#define BVHD_FAULT_BED_H

#include "tests/support/daemon/fault_plan.h"
#include "tests/support/daemon/hostile.h"
#include "tests/support/random.h"

/* The sizes of meshes: their results travel within a frame, in a memfd that was written, in one that was mapped. */
enum fault_size { FAULT_SMALL, FAULT_MIDDLE, FAULT_LARGE, FAULT_SIZE_COUNT };

/* The command line of all tests with faults: BVHD SHIM [--cycles N] [--seed N] [TEST...] */
struct fault_options {
    const char *program, *shim;
    uint32_t cycles;
    uint64_t seed;
    char **tests; /* terminated by NULL; empty: all */
};

struct fault_options fault_options_parse(int argc, char **argv, uint32_t cycles);

/* Returns whether a test was chosen. */
bool fault_options_have(const struct fault_options *options, const char *test);

enum { FAULT_WORDS = 24 };

struct fault_bed {
    struct hostile hostile;
    const char *shim;
    struct fault_plan *plan;
    char plan_path[96], cache[96], generation[160];
    char memory_bytes[24];
    const char *words[FAULT_WORDS]; /* the daemon's options */
    struct random random;
};

/* The most meshes of each size. */
enum { FAULT_MESHES = 64 };

/*
 * Makes the directory and the plan, but starts no daemon yet. The cache in memory has `memory_bytes`, and `more` are
 * further options, terminated by NULL.
 */
void fault_bed_init(struct fault_bed *bed, const struct fault_options *options, const char *memory_bytes,
                    const char *const *more);

/* Starts the daemon. _try returns false when it ends before it answers; hostile.service.status says how. */
void fault_bed_start(struct fault_bed *bed);
bool fault_bed_try_start(struct fault_bed *bed);

/* Expects that the daemon is alive, holds nothing and exits cleanly. Returns the number of failures so far. */
int fault_bed_end(struct fault_bed *bed);

/* Removes the directory. */
void fault_bed_remove(struct fault_bed *bed);

/* Lets `most` of these calls fail after `after` of them have succeeded; sets the plan's counts to 0. */
void fault_bed_arm(struct fault_bed *bed, uint64_t calls, int64_t after, int64_t most);
void fault_bed_disarm(struct fault_bed *bed);

/* How the daemon answered. */
enum fault_answer {
    FAULT_RIGHT, /* with the right bytes */
    FAULT_REFUSED, /* with an error */
    FAULT_NOT_WELCOME, /* it has refused the connection, or closed it before WELCOME */
    FAULT_CLOSED, /* it has closed the connection after WELCOME */
    FAULT_LOST, /* it has not answered for a long time */
    FAULT_WRONG, /* with other bytes */
};

struct fault_reply {
    enum fault_answer answer;
    struct bvhd_error error; /* of FAULT_REFUSED */
    struct key key; /* the next two of FAULT_RIGHT */
    uint32_t origin;
};

/*
 * Builds meshes of each size, with the seeds from 0 to their count - 1, on a daemon without faults, and remembers the
 * right bytes. Called once, before all that follows.
 */
void fault_learn(const struct fault_options *options, const uint32_t counts[FAULT_SIZE_COUNT]);

/* Requests a mesh on a new connection, and judges the answer. */
struct fault_reply fault_ask(struct fault_bed *bed, enum fault_size size, uint32_t seed);

/* Connects and says HELLO. Returns false when the daemon has closed the connection. */
bool fault_connect(struct fault_bed *bed, struct raw_client *client);
bool fault_say_hello(struct raw_client *client);

/* Sends BUILD of a mesh. Returns false when the daemon has closed the connection. */
bool fault_send(struct raw_client *client, enum fault_size size, uint32_t seed);

/* Receives and judges the next result, which is that of this mesh. */
struct fault_reply fault_receive(struct raw_client *client, enum fault_size size, uint32_t seed, int patience_ms);

/* Expects a right answer. Returns where the result came from. */
uint32_t fault_expect_right(struct fault_bed *bed, enum fault_size size, uint32_t seed, const char *when);

/* Waits until an entry of the cache is on disk. Returns false if it does not come within `patience_ms`. */
bool fault_is_kept(struct fault_bed *bed, const struct key *key, int patience_ms);

/* Calls `visit` for all entries of the cache on disk, and returns their number. `visit` may be NULL. */
uint32_t fault_each_entry(struct fault_bed *bed, void (*visit)(struct fault_bed *bed, const char *path));

/* Returns the folder of the shards; the first generation, if there are several. */
const char *fault_generation(struct fault_bed *bed);

/* Removes all that is in the cache on disk. */
void fault_clear_cache(struct fault_bed *bed);

void fault_pause(long ms);

#endif
