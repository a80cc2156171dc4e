/* SPDX-License-Identifier: Apache-2.0 */
/* The generated scenes are what their names promise, and depend on their arguments alone. */
#include "tests/support/unit.h"

#include <float.h>
#include <math.h>
#include <unistd.h>

#include "tests/support/scene/adversarial.h"
#include "tests/support/scene/hair.h"
#include "tests/support/scene/park.h"

static struct mesh make(const char *name, uint32_t size, uint64_t seed)
{
    const struct adversarial *scene = adversarial_find(name);
    struct mesh mesh = {0};
    struct random random = {seed};
    assert_non_null(scene);
    scene->make(&mesh, size, &random);
    for (uint32_t i = 0; i < mesh.triangle_count; i++)
        for (int k = 0; k < 3; k++)
            assert_true(mesh.triangles[i][k] < mesh.vertex_count);
    return mesh;
}

static int equal(const struct mesh *a, const struct mesh *b)
{
    return a->vertex_count == b->vertex_count && a->triangle_count == b->triangle_count &&
           memcmp(a->vertices, b->vertices, a->vertex_count * sizeof *a->vertices) == 0 &&
           memcmp(a->triangles, b->triangles, a->triangle_count * sizeof *a->triangles) == 0;
}

static double double_area(const struct mesh *mesh, uint32_t triangle)
{
    double e[2][3];
    for (int k = 0; k < 2; k++)
        for (int axis = 0; axis < 3; axis++)
            e[k][axis] = (double)mesh->vertices[mesh->triangles[triangle][k + 1]][axis] -
                         mesh->vertices[mesh->triangles[triangle][0]][axis];
    double x = e[0][1] * e[1][2] - e[0][2] * e[1][1], y = e[0][2] * e[1][0] - e[0][0] * e[1][2],
           z = e[0][0] * e[1][1] - e[0][1] * e[1][0];
    return sqrt(x * x + y * y + z * z);
}

static void all_are_reproducible(void **state)
{
    uint32_t count;
    const struct adversarial *scenes = adversarial_scenes(&count);
    (void)state;
    for (uint32_t i = 0; i < count; i++) {
        assert_ptr_equal(adversarial_find(scenes[i].name), &scenes[i]);
        struct mesh a = make(scenes[i].name, 3000, 7), b = make(scenes[i].name, 3000, 7);
        assert_true(equal(&a, &b));
        mesh_finish(&a);
        mesh_finish(&b);
    }
    assert_null(adversarial_find("none such"));
}

static void seeds_differ(void **state)
{
    struct mesh a = make("slivers", 100, 1), b = make("slivers", 100, 2);
    (void)state;
    assert_false(equal(&a, &b));
    mesh_finish(&a);
    mesh_finish(&b);
}

static void sizes_are_about_right(void **state)
{
    uint32_t count;
    const struct adversarial *scenes = adversarial_scenes(&count);
    (void)state;
    for (uint32_t i = 0; i < count; i++) {
        for (uint32_t size = 1; size <= 10000; size *= 10) {
            struct mesh mesh = make(scenes[i].name, size, 1);
            assert_in_range(mesh.triangle_count, size, size * 5 + 200);
            mesh_finish(&mesh);
        }
    }
}

static void nan_is_in_x_alone(void **state)
{
    struct mesh mesh = make("nan", 5000, 1);
    uint32_t bad = 0;
    (void)state;
    for (uint32_t i = 0; i < mesh.vertex_count; i++) {
        bad += isnan(mesh.vertices[i][0]) != 0;
        assert_true(isfinite(mesh.vertices[i][1]) && isfinite(mesh.vertices[i][2]));
    }
    assert_in_range(bad, mesh.vertex_count / 200, mesh.vertex_count / 50);
    mesh_finish(&mesh);
}

static void infinities_are_there(void **state)
{
    struct mesh mesh = make("nan-inf", 5000, 1);
    uint32_t nan_y = 0, inf_z = 0, inf_x = 0;
    (void)state;
    for (uint32_t i = 0; i < mesh.vertex_count; i++) {
        inf_x += isinf(mesh.vertices[i][0]) != 0;
        nan_y += isnan(mesh.vertices[i][1]) != 0;
        inf_z += isinf(mesh.vertices[i][2]) != 0;
    }
    assert_true(inf_x && nan_y && inf_z);
    mesh_finish(&mesh);
}

/* The largest finite magnitude of a scene of that name lies in [low, high]. */
static void has_magnitude(const char *name, double low, double high)
{
    struct mesh mesh = make(name, 2000, 1);
    double most = 0;
    for (uint32_t i = 0; i < mesh.vertex_count; i++)
        for (int axis = 0; axis < 3; axis++)
            most = fmax(most, fabs((double)mesh.vertices[i][axis]));
    assert_true(most >= low && most <= high);
    mesh_finish(&mesh);
}

static void magnitudes_are_as_named(void **state)
{
    (void)state;
    has_magnitude("large", 1e18, 1e20);
    has_magnitude("huge", 1e36, FLT_MAX);
    has_magnitude("tiny", 1e-21, 1e-19);
    has_magnitude("denormal", DBL_MIN, (double)FLT_MIN * 0.99);
    has_magnitude("offset", 1e6, 1.1e6);
    has_magnitude("outlier", 1e7, 1.1e7);
    has_magnitude("stadium-like", 1e4, 1e4);
}

static void degenerates_have_no_area(void **state)
{
    struct mesh mesh = make("degenerate", 5000, 1);
    uint32_t with_area = 0;
    (void)state;
    for (uint32_t i = 0; i < mesh.triangle_count; i++)
        with_area += double_area(&mesh, i) > 0;
    assert_int_equal(with_area, 100);
    mesh_finish(&mesh);
}

static void duplicates_are_equal(void **state)
{
    struct mesh mesh = make("dup", 50, 1);
    (void)state;
    for (uint32_t i = 0; i < mesh.vertex_count; i++)
        assert_memory_equal(mesh.vertices[i], mesh.vertices[i % 3], sizeof mesh.vertices[i]);
    mesh_finish(&mesh);
}

static void colocated_share_a_centroid(void **state)
{
    struct mesh mesh = make("colocated", 500, 1);
    (void)state;
    for (uint32_t i = 0; i < mesh.vertex_count; i += 3)
        for (int axis = 0; axis < 3; axis++) {
            double sum = (double)mesh.vertices[i][axis] + mesh.vertices[i + 1][axis] + mesh.vertices[i + 2][axis];
            assert_true(fabs(sum) <= 1e-6 * (1e-30 + fabs((double)mesh.vertices[i][axis]) +
                                             fabs((double)mesh.vertices[i + 1][axis])));
        }
    mesh_finish(&mesh);
}

static void closed_surfaces_face_outward(void **state)
{
    struct mesh mesh = make("sphere", 5000, 1);
    static const double centre[3] = {0.5, -0.25, 3};
    double volume = 0;
    (void)state;
    for (uint32_t i = 0; i < mesh.triangle_count; i++) {
        double p[3][3];
        for (int k = 0; k < 3; k++)
            for (int axis = 0; axis < 3; axis++)
                p[k][axis] = mesh.vertices[mesh.triangles[i][k]][axis] - centre[axis];
        for (int axis = 0; axis < 3; axis++)
            volume += p[0][axis] *
                      (p[1][(axis + 1) % 3] * p[2][(axis + 2) % 3] - p[1][(axis + 2) % 3] * p[2][(axis + 1) % 3]) / 6;
    }
    assert_true(fabs(volume / (4.0 / 3 * M_PI * 8) - 1) < 0.01);
    mesh_finish(&mesh);
}

static double determinant(const double m[12])
{
    return m[0] * (m[5] * m[10] - m[6] * m[9]) - m[1] * (m[4] * m[10] - m[6] * m[8]) +
           m[2] * (m[4] * m[9] - m[5] * m[8]);
}

static void park_is_large_and_sound(void **state)
{
    static struct gltf park;
    struct random random = {1};
    int instances = 0;
    (void)state;
    park_make(&park, 90000, &random);
    assert_true(gltf_triangles(&park) >= 200000);
    for (int i = 0; i < park.node_count; i++) {
        assert_true(park.nodes[i].parent < i);
        assert_true(fabs(determinant(park.nodes[i].matrix)) > 1e-4);
        instances += park.nodes[i].mesh != GLTF_NONE;
    }
    assert_true(instances > 1000);
    for (int i = 0; i < park.mesh_count; i++)
        for (int part = 0; part < park.meshes[i].part_count; part++)
            for (uint32_t v = 0; v < park.meshes[i].parts[part].vertex_count; v++)
                for (int axis = 0; axis < 3; axis++)
                    assert_true(isfinite(park.meshes[i].parts[part].vertices[v][axis]));
    gltf_finish(&park);
}

static void ply_has_every_byte(void **state)
{
    struct mesh mesh = make("grid", 200, 1);
    char path[] = "/tmp/test_scenes.XXXXXX", head[400];
    int descriptor = mkstemp(path);
    (void)state;
    assert_true(descriptor >= 0);
    close(descriptor);
    assert_int_equal(mesh_write_ply(&mesh, "a grid", path), 0);
    FILE *file = fopen(path, "rb");
    assert_non_null(file);
    size_t got = fread(head, 1, sizeof head - 1, file);
    head[got] = 0;
    char *body = strstr(head, "end_header\n");
    assert_non_null(body);
    assert_int_equal(fseek(file, 0, SEEK_END), 0);
    assert_int_equal(ftell(file), (body - head) + 11 + mesh.vertex_count * 12 + mesh.triangle_count * 13);
    assert_int_equal(fclose(file), 0);
    assert_int_equal(unlink(path), 0);
    mesh_finish(&mesh);
}

static struct mesh make_strands(uint32_t strands, uint64_t seed)
{
    struct mesh mesh = {0};
    struct random random = {seed};
    hair_make(&mesh, strands, &random);
    return mesh;
}

static void strands_are_chains_that_become_thinner(void **state)
{
    struct mesh hair = make_strands(50, 1), same = make_strands(50, 1), other = make_strands(50, 2);
    (void)state;
    assert_int_equal(hair.vertex_count, 50 * HAIR_POINTS);
    assert_int_equal(hair.line_count, 50 * (HAIR_POINTS - 1));
    assert_memory_equal(hair.vertices, same.vertices, hair.vertex_count * sizeof *hair.vertices);
    assert_memory_equal(hair.radii, same.radii, hair.vertex_count * sizeof *hair.radii);
    assert_memory_not_equal(hair.vertices, other.vertices, hair.vertex_count * sizeof *hair.vertices);
    for (uint32_t i = 0; i < hair.line_count; i++) {
        uint32_t first = i / (HAIR_POINTS - 1) * HAIR_POINTS + i % (HAIR_POINTS - 1);
        assert_int_equal(hair.lines[i][0], first);
        assert_int_equal(hair.lines[i][1], first + 1);
        assert_true(hair.radii[first] > hair.radii[first + 1] && hair.radii[first + 1] > 0);
    }
    mesh_finish(&hair);
    mesh_finish(&same);
    mesh_finish(&other);
}

/* The corners of the tubes are as far from the strands' points as the radii say. */
static void tubes_follow_the_strands(void **state)
{
    struct mesh hair = make_strands(20, 3), tubes = {0};
    (void)state;
    hair_make_tubes(&hair, HAIR_SIDES, &tubes);
    assert_int_equal(tubes.vertex_count, hair.vertex_count * HAIR_SIDES);
    assert_int_equal(tubes.triangle_count, 20 * (2 * HAIR_SIDES * (HAIR_POINTS - 1) + 2 * (HAIR_SIDES - 2)));
    for (uint32_t i = 0; i < tubes.vertex_count; i++) {
        double square = 0;
        for (int axis = 0; axis < 3; axis++)
            square += pow((double)tubes.vertices[i][axis] - hair.vertices[i / HAIR_SIDES][axis], 2);
        assert_float_equal(sqrt(square), hair.radii[i / HAIR_SIDES], 1e-6);
    }
    mesh_finish(&hair);
    mesh_finish(&tubes);
}

static void clouds_have_radii(void **state)
{
    struct mesh plain = {0}, stripes = {0}, all = {0};
    struct random random = {1}, again = {1};
    (void)state;
    cloud_make(&plain, &stripes, 1000, &random);
    cloud_make(&all, &all, 1000, &again);
    assert_int_equal(plain.vertex_count + stripes.vertex_count, 1000);
    assert_int_equal(all.vertex_count, 1000);
    assert_true(plain.vertex_count && stripes.vertex_count);
    for (uint32_t i = 0; i < all.vertex_count; i++)
        assert_true(all.radii[i] > 0 && all.radii[i] < 0.1f);
    mesh_finish(&plain);
    mesh_finish(&stripes);
    mesh_finish(&all);
}

int main(void)
{
    static const struct CMUnitTest tests[] = {
        cmocka_unit_test(all_are_reproducible),
        cmocka_unit_test(seeds_differ),
        cmocka_unit_test(sizes_are_about_right),
        cmocka_unit_test(nan_is_in_x_alone),
        cmocka_unit_test(infinities_are_there),
        cmocka_unit_test(magnitudes_are_as_named),
        cmocka_unit_test(degenerates_have_no_area),
        cmocka_unit_test(duplicates_are_equal),
        cmocka_unit_test(colocated_share_a_centroid),
        cmocka_unit_test(closed_surfaces_face_outward),
        cmocka_unit_test(park_is_large_and_sound),
        cmocka_unit_test(ply_has_every_byte),
        cmocka_unit_test(strands_are_chains_that_become_thinner),
        cmocka_unit_test(tubes_follow_the_strands),
        cmocka_unit_test(clouds_have_radii),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
