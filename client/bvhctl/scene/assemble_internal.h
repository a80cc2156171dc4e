/* SPDX-License-Identifier: Apache-2.0 */
/* assemble_internal.h - what the files of the module assemble share. */
#ifndef BVHCTL_ASSEMBLE_INTERNAL_H
#define BVHCTL_ASSEMBLE_INTERNAL_H

#include "bvhd/vulkan_nv.h"
#include "client/bvhctl/scene/assemble.h"

/* The arguments of assemble(), for its helpers. */
struct scene_build {
    const struct import *import;
    const struct options *options;
    const struct assembly_sources *sources; /* NULL: everything is built */
    struct backend *backend;
    struct bvhd_error *error;
};

/* Makes a handle, which only has to differ from the others of a call. */
VkAccelerationStructureKHR assemble_handle(uint64_t number);

/* What a geometry of points, lines or motion triangles has in a pNext chain. */
union assemble_chain {
    VkAccelerationStructureGeometrySpheresDataNV spheres;
    VkAccelerationStructureGeometryLinearSweptSpheresDataNV swept_spheres;
    VkAccelerationStructureGeometryMotionTrianglesDataNV motion;
};

/*
 * Describes a mesh, which has to outlive the result. *chain has to do so, too: all but triangles that stand still use
 * it.
 */
VkAccelerationStructureGeometryKHR assemble_describe_mesh(const struct import_mesh *mesh, uint32_t geometry_flags,
                                                          union assemble_chain *chain);

/* Describes an instance that names a handle, in the place of a record of a top level that stands still. */
VkAccelerationStructureInstanceKHR assemble_describe_instance(const struct import *import, uint32_t index,
                                                              uint64_t handle);

/* A motion instance, as an array of them has it. */
struct assemble_motion_record {
    VkAccelerationStructureMotionInstanceNV instance;
    uint64_t padding;
};

/* Does the same for a record of a top level in which something moves. */
struct assemble_motion_record assemble_describe_motion(const struct import *import, uint32_t index, uint64_t handle);

/* A request whose structures are updated if they have a source. */
struct assembly_request {
    struct bvhd_build *build;
    VkAccelerationStructureBuildGeometryInfoKHR *infos; /* those of `build` */
    const struct assembly_source *sources; /* one for each info */
    struct bvhd_result *items; /* one for each info, to be filled */
    struct assembly_outcome *outcomes; /* and one of these */
    void **holds; /* two: the owner of the results, and that of the results of what is built after all */
};

/*
 * Runs a request: updates what has a source, and then builds what was lost, what may not be updated because other
 * primitives are active, and what has decayed too much.
 */
enum bvhd_status assemble_run(const struct scene_build *job, const struct assembly_request *request);

#endif
