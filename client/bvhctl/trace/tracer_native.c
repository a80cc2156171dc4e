/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/scene/target_reader.h"
#include "client/bvhctl/trace/tracer_query.h"
#include "client/bvhctl/trace/tracer_scene.h"
#include "client/bvhctl/trace/tracer_top.h"

struct tracer_native {
    struct tracer tracer; /* its first member */
    struct gpu *gpu;
    struct memory *memory;
    struct bvhd_vulkan_scene *scene;
    struct tracer_top top; /* of a scene without one */
    struct tracer *query;
};

static enum bvhd_status trace(struct tracer *tracer, const struct ray *rays, uint64_t count,
                              struct tracer_hit *ret_hits, double *ret_seconds, struct bvhd_error *error)
{
    struct tracer *query = ((struct tracer_native *)tracer)->query;
    return query->trace(query, rays, count, ret_hits, ret_seconds, error);
}

static void destroy(struct tracer *tracer)
{
    struct tracer_native *self = (struct tracer_native *)tracer;
    tracer_destroy(self->query);
    tracer_top_finish(self->gpu, &self->top);
    bvhd_vulkan_scene_destroy(self->scene);
    memory_free(self->memory, self);
}

/* Ray queries start at a top level. */
static enum bvhd_status find_top(struct tracer_native *self, const struct structures *structures,
                                 VkAccelerationStructureKHR *ret_top, struct bvhd_error *error)
{
    if (structures->has_top) {
        *ret_top = bvhd_vulkan_scene_structure(self->scene, structures->file_count - 1);
        return BVHD_OK;
    }
    enum bvhd_status status =
        tracer_top_build(self->gpu, bvhd_vulkan_scene_location(self->scene, 0), &self->top, error);
    if (status == BVHD_OK)
        *ret_top = self->top.handle;
    return status;
}

static enum bvhd_status open(struct tracer_native *self, const struct structures *structures, struct bvhd_error *error)
{
    VkAccelerationStructureKHR top;
    enum bvhd_status status = tracer_scene_create(self->gpu, structures, 0, self->memory, &self->scene, error);
    if (status == BVHD_OK)
        status = find_top(self, structures, &top, error);
    if (status == BVHD_OK)
        status = tracer_query_create(self->gpu, top, self->memory, &self->query, error);
    if (status == BVHD_OK)
        tracer_query_set_top(self->query, structures->has_top);
    return status;
}

enum bvhd_status tracer_native_create(struct gpu *gpu, const struct structures *structures, struct memory *memory,
                                      struct tracer **ret_tracer, struct bvhd_error *error)
{
    if (!target_reader_find(structures->target)->is_native)
        return bvhd_error_set(error, BVHD_INCOMPATIBLE, structures->name,
                              "portable structures are traced by compute shaders, not natively");
    if (!gpu->properties.has_ray_query)
        return bvhd_error_set(error, BVHD_UNSUPPORTED, gpu->properties.name,
                              "has no ray queries: it takes the portable target");
    struct tracer_native *self = memory_alloc(memory, sizeof *self);
    if (!self)
        return bvhd_error_no_memory(error, structures->name, "no memory for the tracer");
    *self = (struct tracer_native){
        .tracer = {.device = gpu->properties.name, .target = structures->target, .trace = trace, .destroy = destroy},
        .gpu = gpu,
        .memory = memory};
    enum bvhd_status status = open(self, structures, error);
    if (status != BVHD_OK)
        destroy(&self->tracer);
    else
        *ret_tracer = &self->tracer;
    return status;
}
