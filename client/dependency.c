/* SPDX-License-Identifier: Apache-2.0 */
#include "client/dependency.h"

#include <inttypes.h>

#include "client/reference.h"
#include "proto/base/place.h"

/* The state of dependency_make. */
struct finding {
    struct bvhd_batch *batch;
    const struct reference_table *table;
    struct dependencies *found;
    uint32_t *lookups; /* for each of build.references: the item of the lookup, from 1; 0: none yet */
    uint32_t lookup_count;
};

/* Calls `visit` for each reference that is not complete, with its number in the table. */
static void for_incomplete(struct finding *finding,
                           void (*visit)(struct finding *finding, uint32_t item, uint32_t slot, uint32_t number))
{
    const struct reference_table *table = finding->table;
    for (uint32_t i = 0; i < finding->batch->count; i++) {
        const struct build_input *input = &vulkan_input_entries(finding->batch->input)[i];
        for (uint32_t slot = 0; finding->batch->items[i].state != ITEM_DONE && slot < input->reference_count; slot++) {
            if (input->references[slot].kind != REFERENCE_BLAS)
                continue; /* its key says all */
            uint32_t number = reference_table_find(table, input->references[slot].handle);
            if (table->infos[number] != REFERENCE_GIVEN || reference_table_lacks_bounds(table, number))
                visit(finding, i, slot, number);
        }
    }
}

/* Counts a dependency, and numbers the lookups in the order of their first use. */
static void count(struct finding *finding, uint32_t item, uint32_t slot, uint32_t number)
{
    (void)item;
    (void)slot;
    finding->found->count++;
    if (finding->table->infos[number] == REFERENCE_GIVEN && finding->lookups[number] == 0)
        finding->lookups[number] = ++finding->lookup_count;
}

static void add(struct finding *finding, uint32_t item, uint32_t slot, uint32_t number)
{
    struct dependencies *found = finding->found;
    const struct reference_table *table = finding->table;
    uint32_t *list = NULL;
    if (table->infos[number] != REFERENCE_GIVEN) {
        list = &found->on_items[table->infos[number]];
    } else {
        uint32_t lookup = finding->lookups[number] - 1;
        list = &found->on_keys[lookup];
        found->numbers[lookup] = number;
        found->lookup->keys[lookup] = table->references[number].key;
    }
    found->all[found->count] = (struct dependency){item, slot, *list};
    *list = found->count++;
    finding->batch->items[item].blockers++;
}

static bool make_lists(struct finding *finding)
{
    struct dependencies *found = finding->found;
    uint32_t items = finding->batch->count, keys = finding->lookup_count;
    found->all = memory_array(&library_memory, (uint64_t)found->count + 1, sizeof *found->all);
    found->on_items = memory_array(&library_memory, (uint64_t)items + 1, sizeof *found->on_items);
    found->on_keys = memory_array(&library_memory, (uint64_t)keys + 1, sizeof *found->on_keys);
    found->numbers = memory_array(&library_memory, (uint64_t)keys + 1, sizeof *found->numbers);
    if (!found->all || !found->on_items || !found->on_keys || !found->numbers)
        return false;
    for (uint32_t i = 0; i < items; i++)
        found->on_items[i] = DEPENDENCY_NONE;
    for (uint32_t i = 0; i < keys; i++)
        found->on_keys[i] = DEPENDENCY_NONE;
    if (keys > 0)
        found->lookup = client_batch_create_keys(finding->batch->client, keys, finding->batch->priority);
    if (found->lookup)
        found->lookup->parent = finding->batch;
    return keys == 0 || found->lookup;
}

/*
 * The instances of a blocked item are copied, because it may be blocked for long: the caller's memory is free as early
 * as that of any other item.
 */
static bool block_items(struct bvhd_batch *batch)
{
    for (uint32_t i = 0; i < batch->count; i++) {
        struct client_item *item = &batch->items[i];
        if (item->blockers == 0)
            continue;
        if (!vulkan_input_own_records(batch->input, i))
            return false;
        item->state = ITEM_BLOCKED;
        item->is_private = true;
        batch->uncopied--;
    }
    return true;
}

enum bvhd_status dependency_make(struct bvhd_batch *batch, const struct reference_table *table)
{
    struct finding finding = {.batch = batch, .table = table};
    finding.found = memory_alloc(&library_memory, sizeof *finding.found);
    finding.lookups = memory_array(&library_memory, (uint64_t)table->given + 1, sizeof *finding.lookups);
    bool good = finding.found && finding.lookups;
    if (good) {
        *finding.found = (struct dependencies){.count = 0};
        memset(finding.lookups, 0, ((size_t)table->given + 1) * sizeof *finding.lookups);
        for_incomplete(&finding, count);
    }
    if (good && finding.found->count > 0) {
        batch->dependencies = finding.found;
        good = make_lists(&finding);
        finding.found->count = 0;
        if (good)
            for_incomplete(&finding, add);
        good = good && block_items(batch);
    } else {
        memory_free(&library_memory, finding.found);
    }
    memory_free(&library_memory, finding.lookups);
    return good ? BVHD_OK : BVHD_NO_MEMORY;
}

/* Returns the error of a top level whose bottom level, another item of the batch, has failed. */
static struct bvhd_error bottom_failed(const struct dependency *dependency, uint32_t bottom,
                                       const struct bvhd_error *reason)
{
    struct bvhd_error error;
    bvhd_error_set(&error, reason->status, place("infos[%u].geometries[0].instances", dependency->item).text,
                   "infos[%u] builds a structure that instances name, and failed: %s%s%s", bottom, reason->where,
                   reason->where[0] ? ": " : "", reason->text);
    return error;
}

/* Returns the error of a top level for which the bounds of a structure could not be found. */
static struct bvhd_error lookup_failed(const struct dependency *dependency, uint32_t number,
                                       const struct bvhd_error *reason)
{
    struct bvhd_error error;
    const char *text = reason->status == BVHD_NOT_FOUND ? "the service has no structure with this key" : reason->text;
    bvhd_error_set(&error, reason->status, place("build.references[%u].key", number).text,
                   "infos[%u] names this reference, whose bounds are not given: %s", dependency->item, text);
    return error;
}

/* Completes the reference; the item is an ordinary one when this was the last. */
static void fulfil(struct bvhd_batch *batch, const struct dependency *dependency, const struct bvhd_result *result)
{
    struct client_item *item = &batch->items[dependency->item];
    uint64_t handle = vulkan_input_entries(batch->input)[dependency->item].references[dependency->slot].handle;
    struct reference reference = reference_take(result, handle);
    vulkan_input_complete_reference(batch->input, dependency->item, dependency->slot, &reference);
    if (--item->blockers > 0)
        return;
    item->state = ITEM_WAITING;
    if (batch->first_uncopied > dependency->item)
        batch->first_uncopied = dependency->item;
}

/* Bytes that were only fetched for their bounds are not kept. */
static void drop_bytes(struct client_item *item)
{
    bvhd_blob_unref(item->result.blob);
    item->result.blob = NULL;
    item->result.data = NULL;
    item->result.size = 0;
}

void dependency_settle(struct bvhd_batch *batch, uint32_t index)
{
    struct bvhd_batch *dependent = batch->parent ? batch->parent : batch;
    const struct dependencies *known = dependent->dependencies;
    const struct bvhd_result *result = &batch->items[index].result;
    if (!known)
        return;
    struct bvhd_error reason = result->error;
    enum bvhd_status status = reason.status;
    if (status == BVHD_OK && batch->parent)
        status = reference_check_bottom(result, &reason);
    const uint32_t *lists = batch->parent ? known->on_keys : known->on_items;
    for (uint32_t at = lists[index]; at != DEPENDENCY_NONE; at = known->all[at].next) {
        const struct dependency *dependency = &known->all[at];
        if (dependent->items[dependency->item].state != ITEM_BLOCKED)
            continue;
        if (status == BVHD_OK) {
            fulfil(dependent, dependency, result);
            continue;
        }
        struct bvhd_error error = batch->parent ? lookup_failed(dependency, known->numbers[index], &reason)
                                                : bottom_failed(dependency, index, &reason);
        client_batch_fail_item(dependent, dependency->item, &error);
    }
    if (batch->parent)
        drop_bytes(&batch->items[index]);
}

void dependency_destroy(struct dependencies *dependencies)
{
    if (!dependencies)
        return;
    memory_free(&library_memory, dependencies->all);
    memory_free(&library_memory, dependencies->on_items);
    memory_free(&library_memory, dependencies->on_keys);
    memory_free(&library_memory, dependencies->numbers);
    memory_free(&library_memory, dependencies);
}
