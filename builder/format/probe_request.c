/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/format/probe.h"

/*
 * The values are chosen to reveal the layout: coordinates whose products and sums are exact in float, so that the order
 * of operations does not matter; negative zeros inside the bounds; counts, flags, masks and offsets that are all
 * different; a matrix that shears, mirrors and scales unevenly, and whose inverse is not exact.
 */
enum { TRIANGLES = 5, OPAQUE_TRIANGLES = 3, AABBS = 4, OPAQUE_AABBS = 1, INSTANCES = 2 };

static const float positions[3 * TRIANGLES][3] = {
    {-3, -1, 0.5f},      {-2, 1.5f, 0.25f}, {-1, -0.5f, 2},  {1, -0.0f, 1.25f}, {2, -0.25f, -1},
    {1.5f, 2.5f, -0.0f}, {4, 4, 4},         {5, 3.5f, 4.5f}, {4.5f, 5, 3},      {-0.0f, 6, -2},
    {0.75f, 7, -1.5f},   {-0.5f, 6.5f, 1},  {8, -4, 0.125f}, {7, -3, 0},        {7.5f, -3.5f, -4},
};
static const float boxes[AABBS][6] = {{-1, -2, -3, 0.5f, -0.0f, 1},
                                      {2, 2, -1, 3.5f, 2, 4},
                                      {-6, 0.25f, -0.0f, -5, 8, 0.75f},
                                      {10, -1.5f, 2, 10.25f, 1, 16}};

static const struct box bounds[] = {
    [PROBE_TRIANGLES] = {{-3, -4, -4}, {8, 7, 4.5f}},
    [PROBE_AABBS] = {{-6, -2, -3}, {10.25f, 8, 16}},
};

/* A Vulkan instance record: matrix, custom index and mask, offset and flags, reference. */
struct record {
    float matrix[12];
    uint32_t custom_and_mask, offset_and_flags;
    uint64_t reference;
};
_Static_assert(sizeof(struct record) == 64, "as Vulkan's");

static const struct record instances[INSTANCES] = {
    {{3, 0.5f, 0, 5, 0, -2, 1.25f, -7, 0.75f, 0, 1.5f, 0.25f},
     UINT32_C(0x5a123456),
     (uint32_t)(INSTANCE_FORCE_OPAQUE | INSTANCE_FLIP_FACING) << 24 | 0x00abcd,
     1 + PROBE_TRIANGLES},
    {{0, 0, -5, 1, 1, 0, 0, -0.0f, 0, 7, 0.5f, -2},
     UINT32_C(0x0100002b),
     (uint32_t)(INSTANCE_FORCE_NO_OPAQUE | INSTANCE_CULL_DISABLE) << 24 | 0x010203,
     1 + PROBE_AABBS},
};

static void add_geometry(struct probe_request *request, uint32_t type, uint32_t flags, uint32_t primitives)
{
    struct canonical *canonical = &request->canonical;
    struct canonical_geometry *geometry = &request->geometries[canonical->geometry_count++];
    uint32_t first = canonical->primitive_count, vertices = type == GEOMETRY_TRIANGLES ? 3 * primitives : 0;
    *geometry = (struct canonical_geometry){.type = type,
                                            .flags = flags,
                                            .primitive_count = primitives,
                                            .first_primitive = first,
                                            .vertex_count = vertices};
    if (type == GEOMETRY_TRIANGLES)
        geometry->positions = positions[3 * first];
    else if (type == GEOMETRY_AABBS)
        geometry->boxes = boxes[first];
    else
        geometry->instances = (const unsigned char *)instances;
    geometry->first_vertex = canonical->vertex_count;
    canonical->vertex_count += vertices;
    canonical->primitive_count += primitives;
}

void probe_request_init(struct probe_request *request, enum probe_structure which)
{
    struct canonical *canonical = &request->canonical;
    memset(request, 0, sizeof *request);
    canonical->type = which == PROBE_INSTANCES ? STRUCTURE_TOP : STRUCTURE_BOTTOM;
    canonical->geometries = request->geometries;
    if (which == PROBE_TRIANGLES) {
        add_geometry(request, GEOMETRY_TRIANGLES, GEOMETRY_OPAQUE, OPAQUE_TRIANGLES);
        add_geometry(request, GEOMETRY_TRIANGLES, GEOMETRY_NO_DUPLICATE_ANY_HIT, TRIANGLES - OPAQUE_TRIANGLES);
    } else if (which == PROBE_AABBS) {
        add_geometry(request, GEOMETRY_AABBS, GEOMETRY_OPAQUE, OPAQUE_AABBS);
        add_geometry(request, GEOMETRY_AABBS, 0, AABBS - OPAQUE_AABBS);
    } else {
        add_geometry(request, GEOMETRY_INSTANCES, 0, INSTANCES);
        canonical->references = request->references;
        canonical->reference_count = PROBE_INSTANCES;
        for (uint32_t i = 0; i < PROBE_INSTANCES; i++)
            request->references[i] = (struct canonical_reference){.kind = REFERENCE_BLAS, .bounds = bounds[i]};
    }
}
