/* SPDX-License-Identifier: Apache-2.0 */
/*
 * bvhd_scene.hpp - the interface of bvhd_scene.h for C++17 and newer: containers, which hold all structures of a scene.
 *
 *     bvhd::Container container = bvhd::Container::open("city.bvhd").value();
 *     const bvhd_scene_structure &top = container[container.top(0)];
 *     for (std::uint32_t bottom : bvhd::Container::bottoms(top))
 *         upload(container[bottom].data, container[bottom].size);
 *
 * A container can be moved but not copied. What it gives lives as long as it does. Any number of threads may use one at
 * once. Errors are those of bvhd_values.hpp.
 */
#ifndef BVHD_BVHD_SCENE_HPP
#define BVHD_BVHD_SCENE_HPP

#include <bvhd/bvhd_scene.h>
#include <bvhd/bvhd_values.hpp>

#include <cstdint>
#include <memory>
#include <string_view>

namespace bvhd
{

/* An open container. */
class Container
{
  public:
    /* Maps a file. `flags` are BVHD_SCENE_ flags. */
    static Expected<Container> open(const char *path, std::uint32_t flags = 0)
    {
        bvhd_scene *scene = nullptr;
        Error error;
        if (bvhd_scene_open(path, flags, &scene, &error) != BVHD_OK)
            return error;
        return Container(scene);
    }
    /* Opens a container in memory, which must stay as it is and is aligned to 64 bytes. */
    static Expected<Container> open(Span<const unsigned char> bytes, std::uint32_t flags = 0)
    {
        bvhd_scene *scene = nullptr;
        Error error;
        if (bvhd_scene_open_bytes(bytes.data(), bytes.size(), flags, &scene, &error) != BVHD_OK)
            return error;
        return Container(scene);
    }
    /* The number of structures. */
    std::uint32_t size() const
    {
        return bvhd_scene_structure_count(scene_.get());
    }
    /* A structure, whose number is less than size(). */
    const bvhd_scene_structure &operator[](std::uint32_t index) const
    {
        return *bvhd_scene_get_structure(scene_.get(), index);
    }
    /* The number of top levels, and of the structure that is one of them; UINT32_MAX if there is none. */
    std::uint32_t top_count() const
    {
        return bvhd_scene_top_count(scene_.get());
    }
    std::uint32_t top(std::uint32_t index) const
    {
        return bvhd_scene_top(scene_.get(), index);
    }
    /* The numbers of the structures that a top level names, by rows. */
    static Span<const std::uint32_t> bottoms(const bvhd_scene_structure &top)
    {
        return {top.bottoms, top.bottom_count};
    }
    /* The number of the structure with this name as a file; UINT32_MAX if there is none. */
    std::uint32_t find(const char *file) const
    {
        return bvhd_scene_find(scene_.get(), file);
    }
    /* The manifest, which is JSON. */
    std::string_view manifest() const
    {
        std::uint64_t size = 0;
        const char *text = bvhd_scene_manifest(scene_.get(), &size);
        return {text, static_cast<std::size_t>(size)};
    }
    /* Compares the bytes of a structure with their checksum. */
    Expected<void> check(std::uint32_t index) const
    {
        Error error;
        if (bvhd_scene_check(scene_.get(), index, &error) != BVHD_OK)
            return error;
        return {};
    }
    bvhd_scene *get() const
    {
        return scene_.get();
    }

  private:
    struct Close {
        void operator()(bvhd_scene *scene) const
        {
            bvhd_scene_close(scene);
        }
    };
    explicit Container(bvhd_scene *scene) : scene_(scene)
    {
    }
    std::unique_ptr<bvhd_scene, Close> scene_;
};

} /* namespace bvhd */

#endif
