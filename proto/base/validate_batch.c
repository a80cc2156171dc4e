/* SPDX-License-Identifier: Apache-2.0 */
#include "proto/base/validate_batch.h"

#include "proto/base/handle_table.h"
#include "proto/base/place.h"

/* The destinations of a call, sorted; each entry's number is its index in the call. */
struct destinations {
    struct handle_entry *entries;
    uint32_t count;
};

/*
 * Returns an entry other than `index` that builds into `handle`, or HANDLE_NONE. Equal handles are adjacent, so
 * checking two entries is enough.
 */
static uint32_t other_destination(const struct destinations *destinations, uint64_t handle, uint32_t index)
{
    uint32_t at = handle ? handle_find(destinations->entries, destinations->count, handle) : HANDLE_NONE;
    if (at == HANDLE_NONE)
        return HANDLE_NONE;
    if (destinations->entries[at].number == index)
        at++;
    bool other = at < destinations->count && destinations->entries[at].handle == handle;
    return other ? destinations->entries[at].number : HANDLE_NONE;
}

static enum bvhd_status check_entry(const struct build_input *input, uint32_t index,
                                    const struct destinations *destinations, bool with_references,
                                    struct bvhd_error *error)
{
    uint32_t other = other_destination(destinations, input->destination, index);
    if (other != HANDLE_NONE)
        return bvhd_error_rule(error, BVHD_VUID_03698, place("infos[%u].dstAccelerationStructure", index).text,
                               "infos[%u] builds into the same structure", other);
    other = input->mode == MODE_UPDATE ? other_destination(destinations, input->source, index) : HANDLE_NONE;
    if (other != HANDLE_NONE)
        return bvhd_error_rule(error, BVHD_VUID_03403, place("infos[%u].srcAccelerationStructure", index).text,
                               "infos[%u] builds into this source", other);
    for (uint32_t i = 0; with_references && input->references && i < input->reference_count; i++) {
        other = other_destination(destinations, input->references[i].handle, index);
        if (other != HANDLE_NONE)
            return bvhd_error_rule(error, BVHD_VUID_03407, place("infos[%u].references[%u]", index, i).text,
                                   "infos[%u] builds into this structure", other);
    }
    return BVHD_OK;
}

static enum bvhd_status validate(const struct build_input *inputs, uint32_t count, bool with_references,
                                 struct memory *memory, struct bvhd_error *ret_errors)
{
    if (count == 0)
        return BVHD_OK;
    struct handle_entry *entries = memory_array(memory, (uint64_t)2 * count, sizeof *entries);
    if (!entries)
        return BVHD_NO_MEMORY;
    struct destinations destinations = {entries, count};
    for (uint32_t i = 0; i < count; i++)
        entries[i] = (struct handle_entry){inputs[i].destination, i};
    handle_sort(entries, entries + count, count);
    for (uint32_t i = 0; i < count; i++) {
        ret_errors[i] = (struct bvhd_error){.status = BVHD_OK};
        check_entry(&inputs[i], i, &destinations, with_references, &ret_errors[i]);
    }
    memory_free(memory, entries);
    return BVHD_OK;
}

enum bvhd_status validate_batch(const struct build_input *inputs, uint32_t count, struct memory *memory,
                                struct bvhd_error *ret_errors)
{
    return validate(inputs, count, true, memory, ret_errors);
}

enum bvhd_status validate_batch_destinations(const struct build_input *inputs, uint32_t count, struct memory *memory,
                                             struct bvhd_error *ret_errors)
{
    return validate(inputs, count, false, memory, ret_errors);
}
