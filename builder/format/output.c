/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/format/output.h"

#include <inttypes.h>

unsigned char *output_allocate(struct build_output *output, struct memory *memory, uint64_t size,
                               struct bvhd_error *error)
{
    unsigned char *blob = output ? output->allocate(output, size) : memory_alloc(memory, size);
    if (!blob)
        bvhd_error_no_memory(error, "blob", "no memory for %" PRIu64 " bytes", size);
    return blob;
}

void output_discard(struct build_output *output, struct memory *memory, unsigned char *blob)
{
    if (!blob)
        return;
    if (output)
        output->discard(output, blob);
    else
        memory_free(memory, blob);
}
