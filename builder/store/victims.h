/* SPDX-License-Identifier: Apache-2.0 */
/*
 * victims.h - finds the files of a store that were not used for the longest time, in an amount of memory that does not
 * depend on how many files there are: the VICTIMS_MOST oldest ones that were offered, in 3 MB.
 */
#ifndef BVHD_VICTIMS_H
#define BVHD_VICTIMS_H

#include "builder/store/walk.h"

enum { VICTIMS_MOST = 16384 };

struct victim {
    int64_t used_ns;
    uint64_t bytes;
    enum walk_kind kind;
    char generation[STORE_GENERATION_SIZE], folder[STORE_FOLDER_SIZE], name[KEY_TEXT_SIZE];
};

/* While files are offered, `items` is a heap whose first one was used last. */
struct victims {
    struct victim *items;
    uint32_t count;
    struct memory *memory;
};

/* End with victims_finish. */
enum bvhd_status victims_init(struct victims *victims, struct memory *memory, struct bvhd_error *error);
void victims_finish(struct victims *victims);

/* Forgets all files. */
void victims_clear(struct victims *victims);

/* Keeps the file if it is among the oldest ones. */
void victims_offer(struct victims *victims, const struct walk_file *file);

/* Puts the oldest file first. No more files may be offered until victims_clear. */
void victims_sort(struct victims *victims);

#endif
