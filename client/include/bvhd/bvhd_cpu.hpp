/* SPDX-License-Identifier: Apache-2.0 */
/*
 * bvhd_cpu.hpp - the interface of bvhd_cpu.h for C++17 and newer: rays on the CPU, without a daemon and without
 * Vulkan's headers.
 *
 *     const bvhd_cpu_blob blobs[] = {{bottom.data(), bottom.size()}, {top.data(), top.size()}};
 *     bvhd::CpuScene scene = bvhd::CpuScene::create(blobs).value();
 *     scene.trace(rays, hits).value();
 *
 * The bytes of a scene are borrowed: whoever owns them, such as a Result, keeps them as long as the scene. Any number
 * of threads may trace through one scene at once. Errors are those of bvhd_values.hpp.
 */
#ifndef BVHD_BVHD_CPU_HPP
#define BVHD_BVHD_CPU_HPP

#include <bvhd/bvhd_cpu.h>
#include <bvhd/bvhd_values.hpp>

#include <array>
#include <cstdint>
#include <limits>
#include <memory>

namespace bvhd
{

/* A ray from `origin` along `direction`, which every instance may meet. */
inline bvhd_cpu_ray make_ray(const float (&origin)[3], const float (&direction)[3], float tmin = 0,
                             float tmax = std::numeric_limits<float>::infinity())
{
    bvhd_cpu_ray ray = {};
    for (int axis = 0; axis < 3; axis++) {
        ray.origin[axis] = origin[axis];
        ray.direction[axis] = direction[axis];
    }
    ray.tmin = tmin;
    ray.tmax = tmax;
    ray.mask = 0xff;
    return ray;
}

inline bool is_hit(const bvhd_cpu_hit &hit)
{
    return hit.t <= std::numeric_limits<float>::max();
}

/* One structure, or bottom levels and last the top level over them, ready to be traced. */
class CpuScene
{
  public:
    static Expected<CpuScene> create(Span<const bvhd_cpu_blob> blobs)
    {
        bvhd_cpu_scene_options options = {};
        options.struct_size = sizeof options;
        options.blobs = blobs.data();
        options.blob_count = static_cast<std::uint32_t>(blobs.size());
        return create(options);
    }
    static Expected<CpuScene> create(const bvhd_cpu_scene_options &options)
    {
        bvhd_cpu_scene *scene = nullptr;
        Error error;
        if (bvhd_cpu_scene_create(&options, &scene, &error) != BVHD_OK)
            return error;
        return CpuScene(scene);
    }
    /* Traces in this thread; hits[i] belongs to rays[i], and there are as many. `flags` are BVHD_CPU_TRACE_ flags. */
    Expected<void> trace(Span<const bvhd_cpu_ray> rays, Span<bvhd_cpu_hit> hits, std::uint32_t flags = 0) const
    {
        bvhd_cpu_trace trace = describe(rays, hits, flags);
        return run(trace, rays.size() == hits.size());
    }
    /*
     * Also asks `decide` about each candidate: it takes a bvhd_cpu_candidate & and returns bits of BVHD_CPU_CONFIRM and
     * BVHD_CPU_TERMINATE, or BVHD_CPU_IGNORE. It must not throw.
     */
    template <class Decide, class = std::enable_if_t<std::is_invocable_v<Decide &, bvhd_cpu_candidate &>>>
    Expected<void> trace(Span<const bvhd_cpu_ray> rays, Span<bvhd_cpu_hit> hits, Decide &&decide,
                         std::uint32_t flags = 0) const
    {
        bvhd_cpu_trace trace = describe(rays, hits, flags);
        trace.candidate = [](void *context, bvhd_cpu_candidate *candidate) noexcept {
            return static_cast<std::uint32_t>((*static_cast<std::remove_reference_t<Decide> *>(context))(*candidate));
        };
        trace.context = const_cast<void *>(static_cast<const void *>(std::addressof(decide)));
        return run(trace, rays.size() == hits.size());
    }
    /* Traces arrays of the program's own structs, as bvhd_cpu.h says. */
    Expected<void> trace(const bvhd_cpu_trace &trace) const
    {
        return run(trace, true);
    }
    Expected<bvhd_cpu_hit> closest_hit(const bvhd_cpu_ray &ray) const
    {
        bvhd_cpu_hit hit = {};
        const Expected<void> traced = trace({&ray, 1}, {&hit, 1});
        if (!traced)
            return traced.error();
        return hit;
    }
    /* Return the corners of a triangle, as bvhd_cpu_scene_positions and bvhd_cpu_scene_positions_at give them. */
    Expected<std::array<std::array<float, 3>, 3>> positions(std::uint32_t blob, std::uint32_t geometry,
                                                            std::uint32_t primitive) const
    {
        float numbers[3][3];
        Error error;
        if (bvhd_cpu_scene_positions(scene_.get(), blob, geometry, primitive, numbers, &error) != BVHD_OK)
            return error;
        return corners_of(numbers);
    }
    Expected<std::array<std::array<float, 3>, 3>> positions_at(std::uint32_t blob, std::uint32_t geometry,
                                                               std::uint32_t primitive, float time) const
    {
        float numbers[3][3];
        Error error;
        if (bvhd_cpu_scene_positions_at(scene_.get(), blob, geometry, primitive, time, numbers, &error) != BVHD_OK)
            return error;
        return corners_of(numbers);
    }
    bvhd_cpu_scene *get() const
    {
        return scene_.get();
    }

  private:
    static std::array<std::array<float, 3>, 3> corners_of(const float numbers[3][3])
    {
        std::array<std::array<float, 3>, 3> corners = {};
        for (std::size_t corner = 0; corner < 3; corner++)
            for (std::size_t axis = 0; axis < 3; axis++)
                corners[corner][axis] = numbers[corner][axis];
        return corners;
    }
    struct Destroy {
        void operator()(bvhd_cpu_scene *scene) const
        {
            bvhd_cpu_scene_destroy(scene);
        }
    };
    explicit CpuScene(bvhd_cpu_scene *scene) : scene_(scene)
    {
    }
    static bvhd_cpu_trace describe(Span<const bvhd_cpu_ray> rays, Span<bvhd_cpu_hit> hits, std::uint32_t flags)
    {
        bvhd_cpu_trace trace = {};
        trace.struct_size = sizeof trace;
        trace.rays = rays.data();
        trace.ray_size = sizeof(bvhd_cpu_ray);
        trace.hits = hits.data();
        trace.hit_size = sizeof(bvhd_cpu_hit);
        trace.ray_count = rays.size();
        trace.flags = flags;
        return trace;
    }
    Expected<void> run(const bvhd_cpu_trace &trace, bool are_as_many) const
    {
        Error error;
        if (!are_as_many) {
            error.status = BVHD_INVALID;
            std::snprintf(error.text, sizeof error.text, "there are not as many hits as rays");
            return error;
        }
        if (bvhd_cpu_scene_trace(scene_.get(), &trace, &error) != BVHD_OK)
            return error;
        return {};
    }
    std::unique_ptr<bvhd_cpu_scene, Destroy> scene_;
};

} /* namespace bvhd */

#endif
