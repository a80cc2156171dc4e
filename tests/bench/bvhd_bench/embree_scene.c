/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/bench/bvhd_bench/embree_scene.h"

#include <stdlib.h>
#include <string.h>

#include "tests/bench/bvhd_bench/embree_api.h"
#include "tests/bench/embree_ray.h"
#include "tests/bench/bvhd_bench/stopwatch.h"
#include "tests/bench/bvhd_bench/tree.h"

enum { WARM_UP = 20000 };

struct embree_scene {
    atomic_llong live;
    RTCDevice device;
    RTCScene scene;
    double ms;
    uint64_t bytes;
};

/* Describes a scene of the first `triangles` triangles of the mesh. */
static RTCScene describe(const struct embree_scene *self, const struct method *method, const struct ply *mesh,
                         uint32_t triangles)
{
    RTCScene scene = rtcNewScene(self->device);
    RTCGeometry geometry = rtcNewGeometry(self->device, RTC_GEOMETRY_TYPE_TRIANGLE);
    void *vertices =
        rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, 12, mesh->vertex_count);
    void *indices = rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, 12, triangles);
    if (vertices && indices) {
        memcpy(vertices, mesh->positions, (size_t)12 * mesh->vertex_count);
        memcpy(indices, mesh->indices, (size_t)12 * triangles);
        /* In a scene of low quality each geometry has its own quality. */
        if (method->effort == EFFORT_LOW)
            rtcSetGeometryBuildQuality(geometry, RTC_BUILD_QUALITY_LOW);
        rtcCommitGeometry(geometry);
        rtcAttachGeometry(scene, geometry);
    }
    rtcReleaseGeometry(geometry);
    int flags = (method->robust ? RTC_SCENE_FLAG_ROBUST : 0) | (method->compact ? RTC_SCENE_FLAG_COMPACT : 0);
    rtcSetSceneFlags(scene, (enum RTCSceneFlags)flags);
    rtcSetSceneBuildQuality(scene, embree_api_quality(method->effort));
    return scene;
}

/* Starts Embree's threads, which a program that builds often does only once. */
static void warm_up(const struct embree_scene *self, const struct method *method, const struct ply *mesh)
{
    RTCScene scene = describe(self, method, mesh, mesh->triangle_count < WARM_UP ? mesh->triangle_count : WARM_UP);
    rtcCommitScene(scene);
    rtcReleaseScene(scene);
}

struct embree_scene *embree_scene_build(const struct method *method, const struct ply *mesh, unsigned threads)
{
    struct embree_scene *self = tree_need(1, sizeof *self);
    self->device = embree_api_device(threads, embree_api_count, &self->live);
    if (!self->device) {
        free(self);
        return NULL;
    }
    warm_up(self, method, mesh);
    self->scene = describe(self, method, mesh, mesh->triangle_count);
    long long before = self->live;
    double begin = stopwatch_ms(threads);
    rtcCommitScene(self->scene);
    self->ms = stopwatch_ms(threads) - begin;
    self->bytes = (uint64_t)(self->live - before);
    if (rtcGetDeviceError(self->device) != RTC_ERROR_NONE) {
        embree_scene_destroy(self);
        return NULL;
    }
    return self;
}

void embree_scene_destroy(struct embree_scene *scene)
{
    if (!scene)
        return;
    rtcReleaseScene(scene->scene);
    rtcReleaseDevice(scene->device);
    free(scene);
}

double embree_scene_ms(const struct embree_scene *scene)
{
    return scene->ms;
}

uint64_t embree_scene_bytes(const struct embree_scene *scene)
{
    return scene->bytes;
}

static bool occluded(RTCScene scene, const struct ray *ray)
{
    struct RTCRay own = embree_ray(ray);
#if RTC_VERSION_MAJOR >= 4
    struct RTCOccludedArguments arguments;
    rtcInitOccludedArguments(&arguments);
    rtcOccluded1(scene, &own, &arguments);
#else
    struct RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    rtcOccluded1(scene, &context, &own);
#endif
    return own.tfar < 0;
}

bool embree_scene_trace(const struct embree_scene *scene, const struct ray *ray, struct ray_hit *ret_hit)
{
    if (ray->flags & RAY_TERMINATE_ON_FIRST_HIT)
        return occluded(scene->scene, ray);
    struct RTCRayHit own = {.ray = embree_ray(ray),
                            .hit = {.geomID = RTC_INVALID_GEOMETRY_ID, .instID = {RTC_INVALID_GEOMETRY_ID}}};
#if RTC_VERSION_MAJOR >= 4
    struct RTCIntersectArguments arguments;
    rtcInitIntersectArguments(&arguments);
    rtcIntersect1(scene->scene, &own, &arguments);
#else
    struct RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    rtcIntersect1(scene->scene, &context, &own);
#endif
    if (own.hit.geomID == RTC_INVALID_GEOMETRY_ID)
        return false;
    *ret_hit = (struct ray_hit){.t = own.ray.tfar,
                                .u = own.hit.u,
                                .v = own.hit.v,
                                .instance = RAY_NO_INSTANCE,
                                .geometry = own.hit.geomID,
                                .primitive = own.hit.primID};
    return true;
}
