/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/write_micromap.h"

enum bvhd_status write_micromap(const struct canonical *canonical, const struct layout *layout,
                                const struct build_context *context, unsigned char **ret_blob,
                                struct build_stats *stats, struct bvhd_error *error)
{
    const struct canonical_geometry *geometry = &canonical->geometries[0];
    const struct layout_micromap input = {.flags = canonical->flags,
                                          .triangles = geometry->micro_triangles,
                                          .triangle_count = geometry->primitive_count,
                                          .states = geometry->states,
                                          .states_size = geometry->vertex_count,
                                          .memory = context->memory,
                                          .output = context->output};
    if (!layout->write_micromap)
        return bvhd_error_set(error, BVHD_UNSUPPORTED, "options.target", "the %s layout has no opacity micromaps",
                              layout->name);
    stats->method = "none";
    stats->bounds = box_empty();
    stats->primitives = geometry->primitive_count;
    return layout->write_micromap(&input, ret_blob, &stats->sizes, error);
}
