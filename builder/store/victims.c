/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/store/victims.h"

#include <stdio.h>
#include <stdlib.h>

enum bvhd_status victims_init(struct victims *victims, struct memory *memory, struct bvhd_error *error)
{
    *victims = (struct victims){.items = memory_array(memory, VICTIMS_MOST, sizeof(struct victim)), .memory = memory};
    return victims->items ? BVHD_OK : bvhd_error_no_memory(error, "cache", "no memory to trim the cache on disk");
}

void victims_finish(struct victims *victims)
{
    memory_free(victims->memory, victims->items);
    victims->items = NULL;
}

void victims_clear(struct victims *victims)
{
    victims->count = 0;
}

/* Files of equal times are ordered by their names, so that the choice does not depend on the order of the folders. */
static int compare(const void *left, const void *right)
{
    const struct victim *a = left, *b = right;
    if (a->used_ns != b->used_ns)
        return a->used_ns < b->used_ns ? -1 : 1;
    return strcmp(a->name, b->name);
}

static void swap(struct victim *a, struct victim *b)
{
    struct victim other = *a;
    *a = *b;
    *b = other;
}

static void sift_up(struct victim *items, uint32_t at)
{
    for (uint32_t parent; at > 0 && compare(&items[at], &items[parent = (at - 1) / 2]) > 0; at = parent)
        swap(&items[at], &items[parent]);
}

static void sift_down(struct victim *items, uint32_t count)
{
    for (uint32_t at = 0, child; (child = 2 * at + 1) < count; at = child) {
        if (child + 1 < count && compare(&items[child + 1], &items[child]) > 0)
            child++;
        if (compare(&items[at], &items[child]) >= 0)
            return;
        swap(&items[at], &items[child]);
    }
}

void victims_offer(struct victims *victims, const struct walk_file *file)
{
    struct victim victim = {.used_ns = file->used_ns, .bytes = file->bytes, .kind = file->kind};
    if (victims->count == VICTIMS_MOST && victim.used_ns > victims->items[0].used_ns)
        return;
    snprintf(victim.generation, sizeof victim.generation, "%s", file->generation);
    snprintf(victim.folder, sizeof victim.folder, "%s", file->folder);
    snprintf(victim.name, sizeof victim.name, "%s", file->name);
    if (victims->count < VICTIMS_MOST) {
        victims->items[victims->count] = victim;
        sift_up(victims->items, victims->count++);
    } else if (compare(&victim, &victims->items[0]) < 0) {
        victims->items[0] = victim;
        sift_down(victims->items, victims->count);
    }
}

void victims_sort(struct victims *victims)
{
    qsort(victims->items, victims->count, sizeof *victims->items, compare);
}
