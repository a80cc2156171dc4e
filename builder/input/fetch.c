/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/input/fetch_internal.h"

#include "builder/input/input_kind.h"
#include "builder/input/numbering.h"
#include "builder/input/triangle_micromap.h"
#include "proto/base/place.h"

/* Primitives or vertices that are one task for a thread. */
enum { CHUNK = 4096 };

/* Returns how many words of scratch memory the reading of a geometry needs. */
static uint64_t scratch_of(const struct geometry *geometry)
{
    const struct input_kind *kind = input_kind_of(geometry->type);
    return kind->scratch ? kind->scratch(geometry) : 0;
}

/*
 * Fills the sources and prefix sums. With millions of rows this takes a while, because the system clears their memory
 * on first use, so it checks the flag. Returns false when cancelled.
 */
static bool list_geometries(struct fetch *fetch, const atomic_bool *cancel)
{
    const struct geometry *geometries = fetch->input->geometries;
    uint32_t primitives = 0;
    for (uint32_t i = 0; i < fetch->view.geometry_count; i++) {
        if (parallel_cancelled_at(cancel, i))
            return false;
        atomic_init(&fetch->sources[i].lowest, UINT32_MAX);
        atomic_init(&fetch->sources[i].highest, 0);
        fetch->sources[i].scratch = NULL;
        atomic_init(&fetch->sources[i].gathers, false);
        atomic_init(&fetch->sources[i].index_sum, 0);
        fetch->sources[i].transformed = false;
        fetch->scratch_words += scratch_of(&geometries[i]);
        fetch->view.geometries[i] = (struct canonical_geometry){
            .primitive_count = geometries[i].range.primitive_count,
            .first_primitive = primitives,
        };
        primitives += geometries[i].range.primitive_count;
    }
    fetch->view.primitive_count = primitives;
    return true;
}

/* Allocates the scratch memory of all geometries, and divides it. The sum cannot overflow: a geometry has few words. */
static bool allocate_scratch(struct fetch *fetch, struct memory *memory)
{
    uint64_t at = 0;
    if (fetch->scratch_words == 0)
        return true;
    fetch->scratch = memory_array(memory, fetch->scratch_words, sizeof *fetch->scratch);
    for (uint32_t i = 0; fetch->scratch && i < fetch->view.geometry_count; i++) {
        fetch->sources[i].scratch = fetch->scratch + at;
        at += scratch_of(&fetch->input->geometries[i]);
    }
    return fetch->scratch != NULL;
}

enum bvhd_status fetch_init(struct fetch *fetch, const struct build_input *input, uint32_t index,
                            const struct build_context *context, struct bvhd_error *error)
{
    uint32_t count = input->geometry_count;
    struct memory *memory = context->memory;
    *fetch = (struct fetch){.input = input, .index = index, .view = {.geometry_count = count}};
    atomic_init(&fetch->first_unknown, UINT32_MAX);
    atomic_init(&fetch->suspect, false);
    if (input->type == STRUCTURE_TOP || triangle_micromap_names_any(input)) {
        enum bvhd_status status = reference_lookup_init(input, index, context, &fetch->lookup, error);
        if (status != BVHD_OK)
            return status;
    }
    fetch->sources = memory_array(memory, count, sizeof *fetch->sources);
    fetch->view.geometries = memory_array(memory, count, sizeof *fetch->view.geometries);
    bool allocated = count == 0 || (fetch->sources && fetch->view.geometries);
    bool listed = allocated && list_geometries(fetch, context->cancel);
    if (listed && allocate_scratch(fetch, memory))
        return BVHD_OK;
    memory_free(memory, fetch->view.geometries);
    fetch_finish(fetch, memory);
    if (allocated && !listed)
        return bvhd_error_set(error, BVHD_CANCELLED, place("infos[%u]", index).text, "cancelled");
    return bvhd_error_no_memory(error, place("infos[%u].pGeometries", index).text, "no memory for %u geometries",
                                count);
}

void fetch_finish(struct fetch *fetch, struct memory *memory)
{
    memory_free(memory, fetch->sources);
    memory_free(memory, fetch->scratch);
    reference_lookup_finish(&fetch->lookup, memory);
    fetch->sources = NULL;
    fetch->scratch = NULL;
}

static const struct input_kind *kind_of(const struct fetch *fetch, uint32_t geometry)
{
    return input_kind_of(fetch->input->geometries[geometry].type);
}

static void take_primitives(void *context, uint32_t geometry, uint32_t first, uint32_t count)
{
    struct fetch *fetch = context;
    kind_of(fetch, geometry)->fetch_primitives(fetch, geometry, first, count);
}

static void take_indices(void *context, uint32_t geometry, uint32_t first, uint32_t count)
{
    struct fetch *fetch = context;
    kind_of(fetch, geometry)->rebase(fetch, geometry, first, count);
}

static void take_vertices(void *context, uint32_t geometry, uint32_t first, uint32_t count)
{
    struct fetch *fetch = context;
    kind_of(fetch, geometry)->fetch_vertices(fetch, geometry, first, count);
}

/* One pass over all primitives or all vertices. */
struct pass {
    struct fetch *fetch;
    enum form_section section;
    numbering_function take;
    size_t count;
};

static void pass_task(void *context, size_t chunk)
{
    const struct pass *pass = context;
    size_t begin, end;
    parallel_chunk(chunk, CHUNK, pass->count, &begin, &end);
    numbering_for_each(&pass->fetch->view, pass->section, begin, end, pass->take, pass->fetch);
}

static enum bvhd_status make_pass(struct fetch *fetch, enum form_section section, numbering_function take,
                                  const struct build_context *context, struct bvhd_error *error)
{
    const struct canonical *view = &fetch->view;
    struct pass pass = {fetch, section, take, section == FORM_PRIMITIVES ? view->primitive_count : view->vertex_count};
    size_t chunks = parallel_chunks(CHUNK, pass.count);
    if (parallel_for_until(context->parallel, context->cancel, chunks, pass_task, &pass))
        return BVHD_OK;
    return bvhd_error_set(error, BVHD_CANCELLED, place("infos[%u]", fetch->index).text, "cancelled");
}

static enum bvhd_status finish_primitives(struct fetch *fetch, struct bvhd_error *error)
{
    enum bvhd_status status = BVHD_OK;
    uint64_t vertices = 0;
    for (uint32_t i = 0; status == BVHD_OK && i < fetch->view.geometry_count; i++) {
        const struct input_kind *kind = kind_of(fetch, i);
        fetch->view.geometries[i].first_vertex = (uint32_t)vertices;
        if (kind->finish)
            status = kind->finish(fetch, i, error);
        vertices += fetch->view.geometries[i].vertex_count;
    }
    if (status == BVHD_OK && vertices > UINT32_MAX)
        return bvhd_error_set(error, BVHD_TOO_LARGE, place("infos[%u]", fetch->index).text, "over 2^32 - 1 vertices");
    fetch->view.vertex_count = (uint32_t)vertices;
    return status;
}

enum bvhd_status fetch_primitives(struct fetch *fetch, unsigned char *block, const struct build_context *context,
                                  struct bvhd_error *error)
{
    fetch->block = block;
    enum bvhd_status status = make_pass(fetch, FORM_PRIMITIVES, take_primitives, context, error);
    if (status == BVHD_OK)
        status = finish_primitives(fetch, error);
    if (status == BVHD_OK && fetch->must_rebase)
        status = make_pass(fetch, FORM_PRIMITIVES, take_indices, context, error);
    return status;
}

enum bvhd_status fetch_positions(struct fetch *fetch, unsigned char *block, const struct build_context *context,
                                 struct bvhd_error *error)
{
    fetch->block = block;
    enum bvhd_status status = make_pass(fetch, FORM_POSITIONS, take_vertices, context, error);
    for (uint32_t i = 0; status == BVHD_OK && i < fetch->view.geometry_count; i++)
        if (kind_of(fetch, i)->gather)
            status = kind_of(fetch, i)->gather(fetch, i, context, error);
    return status;
}
