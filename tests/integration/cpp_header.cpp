/* SPDX-License-Identifier: Apache-2.0 */
/*
 * cpp_header.cpp - uses the C++ headers of the library with a daemon, and counts what holds. cpp_header.sh compiles it
 * with exceptions and without.
 */
#include <bvhd/bvhd.hpp>
#include <bvhd/bvhd_cpu.hpp>
#include <bvhd/bvhd_scene.hpp>
#include <bvhd/bvhd_structure.hpp>

#include <array>
#include <cstdio>
#include <cstring>
#include <vector>

#include <unistd.h>

namespace
{

int failures = 0;
int checks = 0;

void expect(const char *what, bool holds)
{
    checks++;
    if (!holds) {
        failures++;
        std::printf("does not hold: %s\n", what);
    }
}

/* A structure over one triangle, and the structs that describe it. */
struct Scene {
    std::array<float, 9> vertices = {0, 0, 0, 1, 0, 0, 0, 1, 0};
    VkAccelerationStructureGeometryKHR geometry = {};
    VkAccelerationStructureBuildGeometryInfoKHR info = {};
    VkAccelerationStructureBuildRangeInfoKHR range = {};
    const VkAccelerationStructureBuildRangeInfoKHR *ranges = &range;

    Scene()
    {
        auto &triangles = geometry.geometry.triangles;
        geometry.sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_KHR;
        geometry.geometryType = VK_GEOMETRY_TYPE_TRIANGLES_KHR;
        triangles.sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_TRIANGLES_DATA_KHR;
        triangles.vertexFormat = VK_FORMAT_R32G32B32_SFLOAT;
        triangles.vertexData.hostAddress = vertices.data();
        triangles.vertexStride = 12;
        triangles.maxVertex = 2;
        triangles.indexType = VK_INDEX_TYPE_NONE_KHR;
        info.sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_BUILD_GEOMETRY_INFO_KHR;
        info.type = VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR;
        info.flags = 0x800; /* ALLOW_DATA_ACCESS, which older headers lack */
        info.geometryCount = 1;
        info.pGeometries = &geometry;
        range.primitiveCount = 1;
    }
    Scene(const Scene &) = delete;
    Scene &operator=(const Scene &) = delete;
};

bvhd::Client make_client()
{
    auto options = bvhd::Client::default_options();
    options.connect_timeout_ms = 30000;
    return bvhd::Client::create(options).value();
}

bvhd::Expected<bvhd::Batch> submit(const bvhd::Client &client, const Scene &scene)
{
    return client.submit({&scene.info, 1}, {&scene.ranges, 1});
}

void test_build(const bvhd::Client &client, bvhd::Blob &ret_blob)
{
    Scene scene;
    auto batch = submit(client, scene);
    expect("a batch", batch.has_value() && batch->size() == 1);
    int called = 0;
    batch->on_done([&called] { called = called + 1; });
    batch->wait();
    expect("it is done", batch->is_done() && batch->is_copied());
    client.dispatch();
    expect("all of it", batch->progress(0) >= 1 && batch->progress(1) <= 0);
    expect("it says so once", called == 1);
    expect("it is in time", batch->wait_for(std::chrono::milliseconds(0)));
    auto result = batch->result(0);
    expect("a result", static_cast<bool>(result));
    expect("its size", result->size() == (*result)->size && result->blob().bytes().size() == result->size());
    expect("one triangle", (*result)->triangles == 1);
    expect("a reference", result->reference(7).value().handle == 7);
    expect("none with handle 0", result->reference(0).error().status == BVHD_INVALID);
    expect("no second item", batch->result(1).error().status == BVHD_NOT_FOUND);

    /* The bytes outlive everything. */
    const bvhd::Blob copy = result->blob();
    bvhd::Blob moved = std::move(*result).blob();
    expect("copies share the bytes", copy.data() == moved.data() && copy.size() > 0);
    ret_blob = moved;
    const bvhd::Key key = result->key();
    const auto again = bvhd::Key::from_text(key.text().c_str());
    expect("a key as text", again && *again == key && !(*again != key) && !(*again < key));
    expect("no key", !bvhd::Key::from_text("zz"));
    const std::vector<bvhd::Key> keys = {key, bvhd::Key()};
    auto fetched = client.fetch(keys).value();
    fetched.wait();
    expect("fetched by key", fetched.result(0).value().size() == copy.size());
    expect("another key is not found", fetched.result(1).error().status == BVHD_NOT_FOUND);
}

void test_errors(const bvhd::Client &client)
{
    Scene scene;
    scene.geometry.geometry.triangles.vertexStride = 5;
    auto batch = submit(client, scene).value();
    batch.wait();
    const auto result = batch.result(0);
    expect("it fails", !result && result.error().status == BVHD_INVALID);
    expect("with a rule", std::strncmp(result.error().vuid_string(), "VUID-", 5) == 0);
    const std::string message = result.error().message();
    expect("in one line", message.find("INVALID: infos[0]") == 0 && message.find("VUID-") != std::string::npos);
    expect("two infos, one range", client.submit({&scene.info, 2}, {&scene.ranges, 1}).error().status == BVHD_INVALID);
#if defined(__cpp_exceptions)
    try {
        (void)result.value();
        expect("it throws", false);
    } catch (const bvhd::Exception &exception) {
        expect("the exception has the message", message == exception.what());
        expect("and the error", exception.error().status == BVHD_INVALID);
    }
#endif
}

void test_service(const bvhd::Client &client)
{
    expect("it connects", client.connect().has_value());
    expect("it answers", client.ping(std::chrono::seconds(30)).value() > 0);
    auto counters = client.counters().value();
    expect("counters", counters.size() > 10 && counters.name(0) && !counters.name(counters.size()));
    expect("a version", counters.version()[0] != 0);
    auto connections = client.connections(BVHD_CONNECTIONS_ALL).value();
    expect("its own connection", connections.size() > 0 && connections.total() >= connections.size() &&
                                     connections.hidden() == 0 && connections[0].pid == getpid());
    auto cache = client.cache(BVHD_CACHE_CLEAR).value();
    expect("nothing on disk", !*cache->directory && cache->memory_budget > 0);
    expect("a descriptor", client.descriptor() >= 0);
    client.dispatch();
}

void test_cpu(const bvhd::Blob &blob)
{
    const bvhd_cpu_blob bytes = {blob.data(), blob.size()};
    auto scene = bvhd::CpuScene::create({&bytes, 1}).value();
    const std::array<bvhd_cpu_ray, 2> rays = {bvhd::make_ray({0.25f, 0.25f, 2}, {0, 0, -1}),
                                              bvhd::make_ray({0.75f, 0.75f, 2}, {0, 0, -1})};
    std::array<bvhd_cpu_hit, 2> hits = {};
    expect("rays", scene.trace(rays, hits).has_value());
    expect("a hit and a miss", bvhd::is_hit(hits[0]) && hits[0].t > 1.99f && !bvhd::is_hit(hits[1]));
    expect("any hit", scene.trace(rays, hits, BVHD_CPU_TRACE_ANY_HIT).has_value() && bvhd::is_hit(hits[0]));
    expect("one ray", scene.closest_hit(rays[0]).value().primitive == 0);
    int asked = 0;
    const auto ignore = [&asked](bvhd_cpu_candidate &candidate) {
        asked += candidate.ray_index == 0;
        return BVHD_CPU_IGNORE;
    };
    expect("candidates", scene.trace(rays, hits, ignore).has_value() && asked == 1 && !bvhd::is_hit(hits[0]));
    expect("fewer hits than rays", scene.trace(rays, {hits.data(), 1}).error().status == BVHD_INVALID);
    const bvhd_cpu_blob half = {blob.data(), blob.size() / 2};
    auto corners = scene.positions(0, 0, 0);
    expect("positions", corners.has_value() && (*corners)[1][0] > 0.99f && (*corners)[2][1] > 0.99f);
    expect("positions at a time", scene.positions_at(0, 0, 0, 0.5f).value() == *corners);
    expect("no second triangle", scene.positions(0, 0, 1).error().status == BVHD_INVALID);
    expect("half a structure", bvhd::CpuScene::create({&half, 1}).error().status == BVHD_CORRUPT);
}

/* An indirect build, and an object that holds its result. */
void test_structure(const bvhd::Client &client)
{
    Scene scene;
    const void *address = &scene.range;
    const std::uint32_t stride = 0, maximum = 1, *maxima = &maximum;
    bvhd_indirect indirect = {};
    indirect.info_count = 1;
    indirect.infos = &scene.info;
    indirect.addresses = &address;
    indirect.strides = &stride;
    indirect.max_primitive_counts = &maxima;
    auto ranges = bvhd::IndirectRanges::read(indirect).value();
    scene.range.primitiveCount = 2; /* it has been read */
    auto batch = client.submit({&scene.info, 1}, ranges.span()).value();
    batch.wait();
    const auto result = batch.result(0).value();
    VkAccelerationStructureCreateInfoKHR create = {};
    create.sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_CREATE_INFO_KHR;
    create.type = VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR;
    create.size = 1 << 16;
    auto structure = bvhd::Structure::create(create).value();
    expect("an empty object", structure.handle() != VK_NULL_HANDLE && !structure.state().is_built);
    expect("no positions yet", !structure.positions(0, 0));
    expect("it holds the result",
           structure.hold(scene.info, ranges.span()[0], *result.operator->()) && structure.state().is_built);
    expect("its positions", structure.positions(0, 0).value()[1][0] > 0.99f);
    expect("its positions at a time", structure.positions_at(0, 0, 1).value()[1][0] > 0.99f);
    expect("over the maximum", bvhd::IndirectRanges::read(indirect).error().status == BVHD_INVALID);
}

void test_container(const char *path)
{
    auto container = bvhd::Container::open(path).value();
    expect("structures", container.size() == 2 && container.top_count() == 1);
    const auto &top = container[container.top(0)];
    const auto bottoms = bvhd::Container::bottoms(top);
    expect("a bottom level", bottoms.size() == 1 && container[bottoms[0]].size > 0);
    expect("its name", container.find(top.file) == container.top(0));
    expect("a manifest", container.manifest().find("\"schema\"") != std::string_view::npos);
    expect("its checksum", container.check(0).has_value() && !container.check(2));
    expect("no file", bvhd::Container::open("/no/such/file").error().status == BVHD_NOT_FOUND);
}

void test_lifetimes()
{
    Scene scene;
    std::optional<bvhd::Client> client = make_client();
    auto batch = submit(*client, scene).value();
    bvhd::Client other = std::move(*client);
    client.reset();
    other = make_client(); /* the first client lives as long as its batch */
    batch.wait_copied();
    batch.wait();
    expect("a batch keeps its client", batch.result(0).has_value());
    auto second = submit(other, scene).value();
    second.cancel(0);
    second.cancel();
    expect("cancelled, or done", second.is_done());
    batch = std::move(second);
}

} // namespace

int main(int argc, char **argv)
{
    bvhd::Blob blob;
    expect("no bytes yet", !blob && blob.data() == nullptr && blob.size() == 0);
    {
        const bvhd::Client client = make_client();
        test_build(client, blob);
        test_errors(client);
        test_structure(client);
        test_service(client);
    }
    test_lifetimes();
    test_cpu(blob);
    if (argc > 1)
        test_container(argv[1]);
    expect("the bytes are there", std::memcmp(blob.data(), "bvhd", 4) == 0);
    if (failures == 0)
        std::printf("%d expectations hold\n", checks);
    return failures != 0;
}
